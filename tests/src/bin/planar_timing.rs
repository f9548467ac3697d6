//! Times of the likelihoods of flat targets on one thread, at 640 x 480, for several numbers of particles:
//! `cargo run --release -p vt-tests --bin planar_timing [PYTHON OPENCV_PEERS.py]`. With the script, OpenCV's Canny runs on
//! the same picture in the same run, and ratios to it are printed. All times are those of the process's CPU clock.

use std::process::Command;

use anyhow::{Context, Result};
use cpu_time::ProcessTime;
use image::RgbImage;
use vt_core::math;
use vt_tests::planar::PlanarScene;
use vt_tests::replay::median;

/// Median and least time of some runs, milliseconds.
fn time(runs: usize, mut f: impl FnMut()) -> [f64; 2] {
    let mut once = || {
        let start = ProcessTime::now();
        f();
        start.elapsed().as_secs_f64() * 1e3
    };
    let times: Vec<f64> = (0..runs).map(|_| once()).collect();
    [median(&times), times.iter().fold(f64::INFINITY, |a, &b| a.min(b))]
}

fn main() -> Result<()> {
    let (scene, modalities) = PlanarScene::new()?;
    let canny = peer(&scene.picture)?;
    for (name, mut modality) in modalities {
        let [prepared, _] = time(20, || {
            let _ = modality.measure(&scene.evidence, &scene.prior);
        });
        let z = modality.measure(&scene.evidence, &scene.prior)?.context("nothing to see")?;
        for count in [200, 2_000, 20_000] {
            let poses = scene.particles(count);
            let mut l = vec![0.0; count];
            let runs = if count > 2000 { 5 } else { 60 };
            let [middle, least] = time(runs, || z.log_likelihoods(&poses, &mut l));
            let most = l.iter().fold(f64::NEG_INFINITY, |a, &b| a.max(b));
            let weights = || l.iter().map(|l| math::exp(l - most));
            let effective = weights().sum::<f64>().powi(2) / weights().map(|w| w * w).sum::<f64>();
            let ratio = canny.map_or(String::new(), |c| format!(", {:.2} x OpenCV's Canny", middle / c));
            println!(
                "{name}: {count} particles {middle:.3} ms, least {least:.3} ({:.0} ns each{ratio}), once a frame {prepared:.3} ms, effective number {effective:.0}",
                middle * 1e6 / count as f64
            );
        }
    }
    Ok(())
}

/// CPU time of OpenCV's Canny on the picture, one thread, milliseconds, median.
fn peer(image: &RgbImage) -> Result<Option<f64>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(python), Some(script)) = (arguments.next(), arguments.next()) else { return Ok(None) };
    let path = std::env::temp_dir().join("planar_timing.ppm");
    let mut ppm = format!("P6\n{} {}\n255\n", image.width(), image.height()).into_bytes();
    ppm.extend_from_slice(image.as_raw());
    std::fs::write(&path, ppm)?;
    let output = Command::new(python)
        .arg(script)
        .args(["--only", "Canny_50_150", "--runs", "50", "--image"])
        .arg(&path)
        .output()?;
    let text = String::from_utf8(output.stdout)?;
    println!("{}{}", text, String::from_utf8_lossy(&output.stderr));
    let first = text.lines().find(|l| l.contains("Canny_50_150"));
    let number = first.and_then(|l| {
        let rest = &l[l.find("\"cpu_ms\":")? + 9..];
        rest.trim_start().split([',', '}']).next()?.trim().parse().ok()
    });
    Ok(number)
}
