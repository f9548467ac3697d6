//! Calibration of the edge modality's covariance: normalised squared errors of the tracker on random scenes.

use std::path::PathBuf;

use anyhow::Result;
use clap::Parser;
use vt_core::math;
use vt_core::report::Status;
use vt_sim::scenario::Disturbance;
use vt_tests::monte_carlo::{FITTED, JUDGED, picture, track};
use vt_tests::replay::median;
use vt_vision::edge::EdgeParams;

/// Mean NEES per degree of freedom and coverage of the 95 % ellipsoid, over random scenes.
#[derive(Parser)]
struct Arguments {
    /// Frames a scene; those from the second on count.
    #[arg(long, default_value_t = 10)]
    frames: u64,
    /// Standard deviation of the localisation, pixels.
    #[arg(long)]
    sigma: Option<f64>,
    /// Least standard deviation of the localisation, pixels.
    #[arg(long)]
    localization: Option<f64>,
    /// Correlation length along a contour, pixels.
    #[arg(long)]
    correlation_length: Option<f64>,
    /// Prints the worst records.
    #[arg(long, default_value_t = 0)]
    worst: usize,
    /// Folder for pictures of the worst records.
    #[arg(long)]
    pictures: Option<PathBuf>,
}

fn main() -> Result<()> {
    let a = Arguments::parse();
    let mut params = EdgeParams::default();
    params.sigma = a.sigma.unwrap_or(params.sigma);
    params.localization = a.localization.unwrap_or(params.localization);
    params.correlation_length = a.correlation_length.unwrap_or(params.correlation_length);
    let inside = math::chi_square_quantile(0.95, 6.0);
    for (name, seeds) in FITTED.map(|b| (b, 0..100)).into_iter().chain(JUDGED.map(|b| (b, 100..300))) {
        let mut records = track(name, seeds.clone(), Disturbance::None, a.frames, params)?;
        records.retain(|r| r.frame > 0);
        let wrong =
            |r: &vt_tests::monte_carlo::Record| r.relative > 0.1 || r.error.rotation > 10f64.to_radians();
        let lost = records.iter().filter(|r| wrong(r)).count();
        let told = records.iter().filter(|r| wrong(r) && r.verdict.status != Status::Tracking).count();
        records.retain(|r| r.verdict.status == Status::Tracking);
        let n = records.len() as f64;
        let mean = records.iter().map(|r| r.nees).sum::<f64>() / n / 6.0;
        let covered = records.iter().filter(|r| r.nees <= inside).count() as f64 / n;
        let nees: Vec<f64> = records.iter().map(|r| r.nees / 6.0).collect();
        let rms: Vec<f64> =
            records.iter().filter_map(|r| r.assessment.quality).map(|q| q.normalized_rms).collect();
        println!(
            "{name} {seeds:?}: NEES/dof mean {mean:.3} median {:.3}, in 95 % ellipsoid {:.3}, {lost} lost ({told} told), {} judged, T {:.3} mm R \
             {:.3} deg rms {:.2}",
            median(&nees),
            covered,
            records.len(),
            1e3 * median(&records.iter().map(|r| r.error.translation).collect::<Vec<_>>()),
            median(&records.iter().map(|r| r.error.rotation).collect::<Vec<_>>()).to_degrees(),
            median(&rms),
        );
        records.sort_by(|a, b| b.nees.total_cmp(&a.nees));
        for r in records.iter().take(a.worst) {
            if let Some(folder) = &a.pictures {
                let file = folder.join(format!("{name}_{}_{}.png", r.seed, r.frame));
                picture(name, Disturbance::None, r)?.save(file)?;
            }
            println!(
                "  seed {} frame {}: NEES/dof {:.1}, NIS/dof {:.1}, {:.2} mm {:.2} deg, spread {:.2}, loss {:.3}, {:?}",
                r.seed,
                r.frame,
                r.nees / 6.0,
                r.assessment.innovation.map_or(f64::NAN, |i| i.nis / i.dof as f64),
                1e3 * r.error.translation,
                r.error.rotation.to_degrees(),
                r.assessment.log_det.unwrap_or(0.0),
                r.verdict.loss_probability,
                r.assessment.quality.map(|q| (q.expected, q.inlier_ratio, q.log_ratio, q.normalized_rms))
            );
        }
    }
    Ok(())
}
