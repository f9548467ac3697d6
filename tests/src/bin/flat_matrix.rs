//! Any measurement of flat targets under any estimator, over several scenes: errors and honesty.

use anyhow::Result;
use clap::Parser;
use rayon::prelude::*;
use vt_tests::flat::{self, CENTRES, ESTIMATORS, MODALITIES};

/// Prints, for every measurement under every estimator, the root mean square error of the position in the second half of each scene
/// (mean and largest of the scenes, pixels) and the mean squared Mahalanobis error per degree of freedom.
#[derive(Parser)]
struct Arguments {
    /// First seed of the scenes.
    #[arg(long, default_value_t = 5)]
    from: u64,
    /// Number of scenes.
    #[arg(long, default_value_t = 10)]
    scenes: u64,
    /// Only measurements whose text contains this.
    #[arg(long, default_value = "")]
    only: String,
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    for modality in MODALITIES.iter().chain(&CENTRES).filter(|m| m.contains(&arguments.only)) {
        for estimator in ESTIMATORS {
            let scenes = (arguments.from..arguments.from + arguments.scenes).into_par_iter();
            let figures = scenes.map(|seed| {
                let truth = flat::truth(seed, modality)?;
                let found = flat::track(&flat::task(seed, modality, estimator))?;
                Ok([flat::error(&found, &truth), flat::nees(&found, &truth)])
            });
            let figures: Vec<[f64; 2]> = figures.collect::<Result<_>>()?;
            let mean = |k: usize| figures.iter().map(|f| f[k]).sum::<f64>() / figures.len() as f64;
            let largest = figures.iter().map(|f| f[0]).fold(0.0, f64::max);
            let within = figures.iter().filter(|f| f[0] < 1.5).count();
            println!(
                "{:5.2} px, largest {largest:5.2}, {within:2} below 1.5; NEES {:5.2}  {modality} {estimator}",
                mean(0),
                mean(1)
            );
        }
    }
    Ok(())
}
