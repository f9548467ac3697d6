//! Loss detection of the edge tracker on random scenes: fits the weights on some bodies and judges them on others.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::Parser;
use nalgebra::SVector;
use vt_core::agent::LossDetector;
use vt_core::report::Status;
use vt_fusion::loss::{FusedLoss, Hysteresis, LossSigns, LossWeights};
use vt_io::plot::{CURVES, Curve, Figure, Panel};
use vt_sim::scenario::Disturbance;
use vt_tests::logistic::{area, fit, roc};
use vt_tests::monte_carlo::{FITTED, JUDGED, Record, picture, track};
use vt_tests::replay::median;
use vt_vision::edge::EdgeParams;

/// Receiver operating characteristic, delay and false alarms of the loss detector, per disturbance. A frame counts as
/// lost when its error is above 10 % of the diameter or 10 degrees; those from 5 to 10 % are left out.
#[derive(Parser)]
struct Arguments {
    /// Scenes of each body and disturbance.
    #[arg(long, default_value_t = 30)]
    scenes: u64,
    /// First scene of the fit.
    #[arg(long, default_value_t = 0)]
    fit_from: u64,
    /// First scene of the judgement.
    #[arg(long, default_value_t = 300)]
    judge_from: u64,
    /// Frames a scene.
    #[arg(long, default_value_t = 60)]
    frames: u64,
    /// Judges the weights in use and fits none.
    #[arg(long)]
    judge_only: bool,
    /// Only this disturbance.
    #[arg(long)]
    only: Option<String>,
    /// Folder for pictures of lost frames that were not told, one a scene.
    #[arg(long)]
    pictures: Option<PathBuf>,
    /// Plot of the curves, PNG or SVG.
    #[arg(long)]
    plot: Option<PathBuf>,
    /// File for errors and signs of every frame, of all bodies.
    #[arg(long)]
    csv: Option<PathBuf>,
}

const DISTURBANCES: [(Disturbance, &str); 6] = [
    (Disturbance::None, "none"),
    (Disturbance::Occlusion, "occlusion"),
    (Disturbance::Blur, "blur"),
    (Disturbance::Clutter, "clutter"),
    (Disturbance::Teleport, "teleport"),
    (Disturbance::Light, "light"),
];

type Runs = Vec<(&'static str, Vec<Vec<Record>>)>;

fn runs(bodies: [&str; 2], first: u64, a: &Arguments) -> Result<Runs> {
    DISTURBANCES
        .into_iter()
        .filter(|(_, name)| a.only.as_ref().is_none_or(|only| only == name))
        .map(|(disturbance, name)| {
            let mut all = vec![];
            for body in bodies {
                let seeds = first..first + a.scenes;
                let records = track(body, seeds, disturbance, a.frames, EdgeParams::default())?;
                if let Some(folder) = &a.pictures {
                    draw_missed(folder, name, body, disturbance, &records)?;
                }
                all.extend(records.chunk_by(|r, s| r.seed == s.seed).map(<[Record]>::to_vec));
            }
            Ok((name, all))
        })
        .collect()
}

/// Is the frame a loss? `None` for those in between and the first, which has the prior alone.
fn lost(r: &Record) -> Option<bool> {
    let turned = r.error.rotation > 10f64.to_radians();
    match () {
        () if r.frame == 0 => None,
        () if r.relative > 0.1 || turned => Some(true),
        () => (r.relative < 0.05).then_some(false),
    }
}

/// A line for every frame that has signs: errors as a share of the diameter and in degrees, then the signs.
fn write_signs(out: &mut impl Write, part: &str, runs: &Runs) -> Result<()> {
    for (disturbance, runs) in runs {
        for (run, r) in runs.iter().enumerate().flat_map(|(k, run)| run.iter().map(move |r| (k, r))) {
            let Some(s) = LossSigns::new(&r.assessment) else { continue };
            let degrees = r.error.rotation.to_degrees();
            write!(out, "{part},{disturbance},{run},{},{:.5},{degrees:.4},", r.frame, r.relative)?;
            writeln!(out, "{},{},{},{},{}", s.unsupported, s.log_ratio, s.misfit, s.surprise, s.spread)?;
        }
    }
    Ok(())
}

/// Draws of every scene the lost frame that looks least like a loss.
fn draw_missed(
    folder: &Path,
    name: &str,
    body: &str,
    disturbance: Disturbance,
    records: &[Record],
) -> Result<()> {
    for run in records.chunk_by(|r, s| r.seed == s.seed) {
        let missed = run.iter().filter(|r| lost(r) == Some(true) && r.verdict.loss_probability < 0.5);
        let frames = missed.clone().count();
        let least = missed.min_by(|r, s| r.verdict.loss_probability.total_cmp(&s.verdict.loss_probability));
        if let Some(r) = least {
            println!(
                "{name} {body} seed {} frame {} ({frames} such): {:.1} % of the diameter, {:.1} deg, p = {:.3}, {:?}",
                r.seed,
                r.frame,
                100.0 * r.relative,
                r.error.rotation.to_degrees(),
                r.verdict.loss_probability,
                LossSigns::new(&r.assessment)
            );
            picture(body, disturbance, r)?
                .save(folder.join(format!("{name}_{body}_{}_{}.png", r.seed, r.frame)))?;
        }
    }
    Ok(())
}

/// What is weighed; the share of unsupported contour is not, since the likelihood ratio counts it.
fn signs(r: &Record) -> Option<SVector<f64, 5>> {
    let s = LossSigns::new(&r.assessment)?;
    Some([1.0, s.log_ratio, s.misfit, s.surprise, s.spread].into())
}

fn fitted(runs: &Runs) -> Result<LossWeights> {
    let records = runs.iter().flat_map(|(_, runs)| runs.iter().flatten());
    let examples: Vec<_> = records.filter_map(|r| Some((signs(r)?, lost(r)?))).collect();
    let w = fit(&examples, 1.0).context("the examples determine no weights")?;
    let [bias, log_ratio, misfit, surprise, spread] = w.into();
    let least = LossWeights::default().least;
    Ok(LossWeights { bias, unsupported: 0.0, log_ratio, misfit, surprise, spread, least })
}

/// Figures of one disturbance under a loss detector.
struct Judged {
    roc: Vec<[f64; 2]>,
    /// Frames from the first lost one to the verdict "lost", of losses that last as long as the verdict takes.
    delays: Vec<f64>,
    /// Losses without a verdict until they end.
    missed: usize,
    /// Verdicts "lost" that begin in a good frame.
    false_alarms: usize,
    good: usize,
}

fn judge(weights: LossWeights, runs: &[Vec<Record>]) -> Judged {
    let mut judged = Judged { roc: vec![], delays: vec![], missed: 0, false_alarms: 0, good: 0 };
    let mut scores = vec![];
    for run in runs {
        let mut detector = FusedLoss::new(weights, FusedLoss::MEMORY, Hysteresis::default());
        let (mut since, mut alarmed) = (None, false);
        for r in run {
            let verdict = detector.assess(&r.assessment);
            let alarm = verdict.status == Status::Lost;
            let Some(lost) = lost(r) else { continue };
            scores.push((verdict.loss_probability, lost));
            if lost {
                let begin = *since.get_or_insert(r.frame);
                if alarm && begin != u64::MAX {
                    judged.delays.push((r.frame - begin) as f64);
                    since = Some(u64::MAX);
                }
            } else {
                judged.missed += usize::from(since.take().is_some_and(|s| s != u64::MAX && r.frame - s >= 3));
                judged.good += 1;
                judged.false_alarms += usize::from(alarm && !alarmed);
            }
            alarmed = alarm;
        }
        judged.missed += usize::from(since.is_some_and(|s| s != u64::MAX && run.len() as u64 - s >= 3));
    }
    judged.roc = roc(&scores);
    judged
}

fn table(title: &str, weights: LossWeights, runs: &Runs) -> Vec<Curve> {
    println!("{title}");
    println!("disturbance  area   lost frames  delay median/90 %  missed  false alarms per 1000");
    let curve = |(k, (name, runs)): (usize, &(&str, Vec<Vec<Record>>))| {
        let mut j = judge(weights, runs);
        let bad = runs.iter().flatten().filter(|r| lost(r) == Some(true)).count();
        j.delays.sort_unstable_by(f64::total_cmp);
        let slow = j.delays.get(j.delays.len() * 9 / 10).copied().unwrap_or(f64::NAN);
        println!(
            "{name:<11} {:.4} {bad:>8} of {:<6} {:>4.0} / {slow:<6.0} {:>9} of {:<4} {:>8.2}",
            area(&j.roc),
            j.good + bad,
            median(&j.delays),
            j.missed,
            j.missed + j.delays.len(),
            1e3 * j.false_alarms as f64 / j.good as f64,
        );
        Curve { name: format!("{name} {:.3}", area(&j.roc)), colour: CURVES[k % CURVES.len()], points: j.roc }
    };
    runs.iter().enumerate().map(curve).collect()
}

fn main() -> Result<()> {
    let a = Arguments::parse();
    let mut weights = LossWeights::default();
    let mut csv = a.csv.as_ref().map(File::create).transpose()?.map(BufWriter::new);
    if let Some(out) = &mut csv {
        writeln!(
            out,
            "part,disturbance,run,frame,relative,degrees,unsupported,log_ratio,misfit,surprise,spread"
        )?;
    }
    if !a.judge_only {
        let examples = runs(FITTED, a.fit_from, &a)?;
        csv.iter_mut().try_for_each(|out| write_signs(out, "fit", &examples))?;
        table("in use, on the bodies of the fit", weights, &examples);
        weights = fitted(&examples)?;
        println!("{weights:#?}");
        table("fitted, on the bodies of the fit", weights, &examples);
    }
    let judged = runs(JUDGED, a.judge_from, &a)?;
    csv.iter_mut().try_for_each(|out| write_signs(out, "judged", &judged))?;
    let mut curves = table("in use, on other bodies and scenes", LossWeights::default(), &judged);
    if weights != LossWeights::default() {
        curves = table("fitted, on other bodies and scenes", weights, &judged);
    }
    if let Some(plot) = a.plot {
        let (first, second) = curves.split_at(3);
        let panel = |curves: &[Curve]| Panel {
            title: "share of lost frames told, over false alarms".into(),
            curves: curves.to_vec(),
            ..Panel::default()
        };
        let panels = vec![panel(first), panel(second)];
        Figure { title: "Loss detection".into(), panels }.save(&plot)?;
    }
    Ok(())
}
