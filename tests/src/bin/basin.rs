//! Convergence basin: how many start poses around the truth a task's tracker brings home on a single frame.
//!
//! Start poses come from a file, several for a frame, as `make_starts.py` of the comparison sources writes them; the
//! same file goes through ViSP's tracker by `visp_mbt castle edge --starts FILE --passes 3 --range 32`. Every start has
//! a fresh tracker and sees its frame once.

use std::path::PathBuf;

use anyhow::Result;
use clap::Parser;
use vt_tests::basin::{Basin, Outcome, read_starts};
use vt_tests::replay::median;

/// Share of start poses that end below 2 mm and 0.5 deg, and the CPU time of a start.
#[derive(Parser)]
struct Arguments {
    /// Lines `frame tx ty tz qx qy qz qw`, camera_from_object, metres.
    starts: PathBuf,
    /// Task of one sensor and one target with truth.
    #[arg(long, default_value = "vt-apps/tasks/castle-simu.toml")]
    task: PathBuf,
    /// Deviation of a start's translation along each axis, millimetres.
    #[arg(long, default_value_t = 12.0)]
    mm: f64,
    /// Deviation of a start's rotation about each axis, degrees.
    #[arg(long, default_value_t = 3.0)]
    deg: f64,
    /// Overrides of the task.
    #[arg(long = "set")]
    set: Vec<String>,
    /// Prints every start that fails.
    #[arg(long)]
    failures: bool,
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    let basin = Basin::load(&arguments.task, &arguments.set)?;
    let sigma = [1e-3 * arguments.mm, arguments.deg.to_radians()];
    let mut outcomes = vec![];
    for (frame, start) in read_starts(&arguments.starts)? {
        let outcome = basin.try_start(frame, &start, sigma)?;
        if arguments.failures && !outcome.converged() {
            let (t, r) = (1e3 * outcome.error.translation, outcome.error.rotation.to_degrees());
            println!("frame {frame}: {t:.2} mm {r:.2} deg, loss probability {:.2}", outcome.loss_probability);
        }
        outcomes.push(outcome);
    }
    let (good, bad): (Vec<_>, Vec<_>) = outcomes.iter().copied().partition(Outcome::converged);
    let of = |value: fn(&Outcome) -> f64| median(&good.iter().map(value).collect::<Vec<_>>());
    let lost = |some: &[Outcome]| some.iter().filter(|o| o.loss_probability > 0.5).count();
    let cpu: Vec<f64> = outcomes.iter().map(|o| o.cpu_ms).collect();
    println!(
        "{} starts: converged {:.3} (median {:.2} mm, {:.2} deg); CPU ms a start {:.2} median, {:.2} mean; judged lost: {} of \
         {} failures, {} of {} successes",
        cpu.len(),
        good.len() as f64 / cpu.len().max(1) as f64,
        1e3 * of(|o| o.error.translation),
        of(|o| o.error.rotation).to_degrees(),
        median(&cpu),
        cpu.iter().sum::<f64>() / cpu.len().max(1) as f64,
        lost(&bad),
        bad.len(),
        lost(&good),
        good.len(),
    );
    Ok(())
}
