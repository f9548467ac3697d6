//! Our estimators beside those of FilterPy, Stone Soup and OpenCV on the same problems, in the same run.
//!
//! Both sides are timed by the CPU clock of their process, one thread: the median over runs of a prediction with an update.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context, Result, ensure};
use clap::Parser;
use vt_tests::estimators::{cases, microseconds};

/// Compares speed with FilterPy, Stone Soup and OpenCV.
#[derive(Parser)]
struct Arguments {
    /// The script `estimator_peers.py` of the comparison sources.
    script: PathBuf,
    /// Python in which the peers are installed.
    #[arg(long, default_value = "python3")]
    python: PathBuf,
    /// Runs of each case, the median counts.
    #[arg(long, default_value_t = 7)]
    runs: usize,
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    let mut cases = cases();
    let names: Vec<&str> = cases.iter().map(|(name, _)| *name).collect();
    // Ours before and after the peers; the slower of both counts.
    let mut measure = || -> BTreeMap<&str, f64> {
        cases.iter_mut().map(|(name, call)| (*name, microseconds(call.as_mut(), arguments.runs))).collect()
    };
    let before = measure();
    let output = Command::new(&arguments.python)
        .arg(&arguments.script)
        .args(["--runs", &arguments.runs.to_string(), "--only", &names.join(",")])
        .output()
        .with_context(|| format!("cannot run {}", arguments.python.display()))?;
    ensure!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let after = measure();
    println!("| case | peer | peer µs | ours µs | ratio |");
    println!("|---|---|---|---|---|");
    for line in String::from_utf8(output.stdout)?.lines() {
        let peer: serde_json::Value = serde_json::from_str(line)?;
        let name = peer["name"].as_str().context("no name")?;
        let theirs = peer["us_per_step"].as_f64().context("no time")?;
        let (Some(a), Some(b)) = (before.get(name), after.get(name)) else { continue };
        let ours = a.max(*b);
        let who = peer["peer"].as_str().unwrap_or("?");
        println!("| {name} | {who} | {theirs:.2} | {ours:.3} | {:.0} |", theirs / ours);
    }
    Ok(())
}
