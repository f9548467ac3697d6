//! The figures of a run as a few lines of text.

use core::fmt::Write;

use vt_io::summary::{Statistics, TargetSummary};

use crate::protocol::Score;
use crate::run::Outcome;

/// Lines for people: frames, speed, conditions and errors against truth.
pub fn describe(outcome: &Outcome) -> String {
    let summary = &outcome.summary;
    let mut out = String::new();
    let (steps, seconds) = (summary.steps, summary.wall.as_secs_f64());
    let _ = writeln!(out, "{steps} frames in {seconds:.2} s, {:.1} frames/s", summary.frames_per_second());
    summary.targets.iter().for_each(|t| target(&mut out, t));
    let cpu: Vec<f64> = outcome.times.iter().map(|t| 1e3 * t.cpu).collect();
    if let Some(s) = Statistics::of(&cpu) {
        let _ =
            writeln!(out, "CPU without reading pictures and outputs: {:.2} ms a frame (median)", s.median);
    }
    outcome.scores.iter().for_each(|s| score(&mut out, s));
    out
}

fn score(out: &mut String, s: &Score) {
    let Some(percent) = s.success_percent() else { return };
    let (name, good, frames) = (&s.target, s.succeeded.len(), s.frames);
    let _ = write!(out, "target `{name}`: success {percent:.1} % ({good} of {frames} frames");
    let _ = write!(out, ", put to the truth {} times)", s.resets);
    if let Some((mm, deg)) = s.medians() {
        let _ = write!(out, ", median error of these {mm:.2} mm, {deg:.3} deg");
    }
    out.push('\n');
}

fn target(out: &mut String, t: &TargetSummary) {
    let [tracking, doubtful, lost] = t.states;
    let _ = writeln!(out, "target `{}`: tracking {tracking}, doubtful {doubtful}, lost {lost}", t.name);
    if t.reinitialized > 0 || t.failures > 0 {
        let _ = writeln!(out, "  re-initialised {}, failures {}", t.reinitialized, t.failures);
    }
    if let Some(s) = Statistics::of(&t.seconds) {
        let _ = writeln!(out, "  tracking alone: {:.2} ms a frame (median)", 1e3 * s.median);
    }
    let degrees = 180.0 / core::f64::consts::PI;
    let rows = [
        ("translation", "mm", 1e3, &t.translation_errors),
        ("rotation", "deg", degrees, &t.rotation_errors),
        ("centre", "px", 1.0, &t.centre_errors),
    ];
    for (name, unit, factor, values) in rows {
        if let Some(s) = Statistics::of(values) {
            let (mean, max) = (factor * s.mean, factor * s.max);
            let _ = writeln!(out, "  {name} error: mean {mean:.3} {unit}, max {max:.3} {unit}");
        }
    }
    if let Some(s) = Statistics::of(&t.overlaps) {
        let _ = writeln!(out, "  overlap with the true box: mean {:.3}, median {:.3}", s.mean, s.median);
    }
}
