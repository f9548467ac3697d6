//! The edge tracker beside ViSP's on the same pictures, in the same run.
//!
//! Both are timed by the CPU clock of their process from decoded grey pixels to the pose, on one thread; repeats
//! alternate, and the lowest median of each counts.

use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context, Result, ensure};
use clap::Parser;
use vt_io::summary::Statistics;
use vt_tests::replay::{Replay, median};

/// Compares speed and accuracy with ViSP's `vpMbGenericTracker`.
#[derive(Parser)]
struct Arguments {
    /// The program `visp_mbt` (built from the comparison sources).
    visp: PathBuf,
    /// Folder with the task files.
    #[arg(long, default_value = "vt-apps/tasks")]
    tasks: PathBuf,
    /// Interleaved repeats.
    #[arg(long, default_value_t = 7)]
    repeats: usize,
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    println!(
        "| sequence | ours ms | ViSP ms | ratio | ours T mm mean / max | R deg mean / max | ViSP T | ViSP R |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    for (sequence, task) in
        [("castle", "castle-simu.toml"), ("castle", "castle-cube-simu.toml"), ("cube", "cube.toml")]
    {
        let replay = Replay::load(arguments.tasks.join(task), &[])?;
        let (mut ours, mut theirs) = (f64::INFINITY, f64::INFINITY);
        let (mut own_errors, mut their_errors) = (None, serde_json::Value::Null);
        for _ in 0..arguments.repeats {
            let run = replay.run()?;
            ours = ours.min(median(&run.cpu_ms));
            own_errors = run.summary.targets.into_iter().next();
            let output = Command::new(&arguments.visp)
                .args([sequence, "edge", "--repeat", "1"])
                .output()
                .with_context(|| format!("cannot run {}", arguments.visp.display()))?;
            ensure!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
            their_errors = serde_json::from_slice(&output.stdout)?;
            theirs = theirs.min(their_errors["cpu_ms_median"].as_f64().context("no cpu_ms_median")?);
        }
        let number = |key: &str| their_errors[key].as_f64().map_or("–".into(), |v| format!("{v:.2}"));
        let errors = |values: Option<&Vec<f64>>, unit: f64| {
            let statistics = values.and_then(|v| Statistics::of(v));
            statistics.map_or("–".into(), |s| format!("{:.3} / {:.3}", s.mean * unit, s.max * unit))
        };
        let t = errors(own_errors.as_ref().map(|t| &t.translation_errors), 1e3);
        let r = errors(own_errors.as_ref().map(|t| &t.rotation_errors), 1f64.to_degrees());
        println!(
            "| {task} | {ours:.3} | {theirs:.3} | {:.1} | {t} | {r} | {} / {} | {} / {} |",
            theirs / ours,
            number("t_mm_mean"),
            number("t_mm_max"),
            number("r_deg_mean"),
            number("r_deg_max"),
        );
    }
    Ok(())
}
