//! Times of the likelihoods of flat targets on one thread, at 640 x 480, for several numbers of particles:
//! `cargo run --release -p vt-vision --example planar_timing [PYTHON OPENCV_PEERS.py]`. With the script, OpenCV's Canny runs on
//! the same picture in the same run, and ratios to it are printed.

use std::process::Command;
use std::sync::Arc;
use std::time::Instant;

use image::{Rgb, RgbImage};
use nalgebra::{Point2, Vector4};
use vt_core::belief::Gaussian;
use vt_core::evidence::{Evidence, Processing};
use vt_core::frame::{Frame, Payload, SensorId};
use vt_core::lie::Sim2;
use vt_core::manifold::Manifold;
use vt_core::measurement::Modality;
use vt_core::random::{Random, Stream};
use vt_core::time::Timestamp;
use vt_models::outline::Outline;
use vt_models::warp::PlanarWarp;
use vt_vision::canny::{CannyParams, Thresholds};
use vt_vision::color_likelihood::{ColorModality, ColorParams};
use vt_vision::contour::{ChamferModality, ChamferParams, ContourModality, ContourParams};
use vt_vision::template::{TemplateModality, TemplateParams};

const SENSOR: SensorId = SensorId(0);

type Failure = Box<dyn std::error::Error>;

/// Coloured tiles with an ellipse of other tiles in the middle, and noise.
fn picture(pose: &Sim2, outline: &Outline) -> RgbImage {
    let mut random = Random::new(1, Stream::Sim, 0, 0, 0);
    let inverse = vt_core::lie::LieGroup::inverse(pose);
    RgbImage::from_fn(640, 480, |x, y| {
        let place = Point2::new(f64::from(x), f64::from(y));
        let p = vt_core::lie::LieGroup::act(&inverse, &place);
        let (tile, base) = if outline.contains(&p) {
            ((p.x / 9.0).floor() as i64 * 3 + (p.y / 9.0).floor() as i64, 120)
        } else {
            (i64::from(x / 23) * 7 + i64::from(y / 19) * 5, 30)
        };
        let mut level =
            |k: i64| base + (tile * (k + 2) * 29).rem_euclid(100) + (random.uniform() * 12.0) as i64;
        Rgb([level(0) as u8, level(1) as u8, level(2) as u8])
    })
}

/// Least time of some runs, milliseconds.
fn time(runs: usize, mut f: impl FnMut()) -> f64 {
    (0..runs)
        .map(|_| {
            let start = Instant::now();
            f();
            start.elapsed().as_secs_f64() * 1e3
        })
        .fold(f64::INFINITY, f64::min)
}

fn main() -> Result<(), Failure> {
    let outline = Outline::ellipse(60.0, 60.0)?;
    let truth = Sim2::new(320.0, 240.0, 0.2, 1.0);
    let image = picture(&truth, &outline);
    let canny = peer(&image)?;
    let canny_params = CannyParams::new(Thresholds::Fixed { low: 12.5, high: 37.5 })?;
    let hand = Outline::ellipse(110.0, 150.0)?.sample(60);
    let contour = ContourModality::new(
        ContourParams { sigma: 3.0, range: 15.0, ..ContourParams::default() },
        canny_params.clone(),
        SENSOR,
        PlanarWarp::default(),
        hand.clone(),
    )?;
    let chamfer =
        ChamferModality::new(ChamferParams::default(), canny_params, SENSOR, PlanarWarp::default(), hand)?;
    let color = |params: ColorParams| -> Result<_, Failure> {
        Ok(ColorModality::new(params, SENSOR, PlanarWarp::default(), [60.0, 60.0])?)
    };
    let (coarse, fine) =
        (color(ColorParams::default())?, color(ColorParams { samples: 4000, ..ColorParams::default() })?);
    let template =
        TemplateModality::new(TemplateParams::default(), SENSOR, PlanarWarp::default(), [60.0, 60.0])?;
    let mut evidence = Evidence::default();
    let units: [Box<dyn Processing>; 3] =
        [Box::new(contour.processing()), Box::new(chamfer.processing()), Box::new(coarse.processing())];
    let keys: Vec<_> = units.iter().map(|unit| unit.key().clone()).collect();
    units.into_iter().for_each(|unit| evidence.add(unit));
    let payload = Payload::Rgb(Arc::new(image));
    evidence.begin([Frame { sensor: SENSOR, number: 0, time: Timestamp(0), payload }]);
    for key in &keys {
        evidence.prepare(key, None)?;
    }
    let prior = Gaussian::from_sigmas(truth, &Vector4::new(6.0, 6.0, 0.05, 0.03));
    let modalities: [(&str, Box<dyn Modality<Sim2>>); 5] = [
        ("contour, 60 normals", Box::new(contour)),
        ("chamfer, 60 points", Box::new(chamfer)),
        ("colour, 60x60 px, 110 bins, 400 samples", Box::new(coarse)),
        ("colour, 60x60 px, 110 bins, every pixel", Box::new(fine)),
        ("template, 400 samples", Box::new(template)),
    ];
    for (name, mut modality) in modalities {
        let prepared = time(20, || {
            let _ = modality.measure(&evidence, &prior);
        });
        let z = modality.measure(&evidence, &prior)?.ok_or("nothing to see")?;
        for count in [200, 2_000, 20_000] {
            let mut random = Random::new(2, Stream::Sim, 0, 0, 0);
            let poses: Vec<Sim2> = (0..count)
                .map(|_| {
                    let n = |s: f64, r: &mut Random| s * r.normal();
                    let d = Vector4::new(
                        n(6.0, &mut random),
                        n(6.0, &mut random),
                        n(0.05, &mut random),
                        n(0.03, &mut random),
                    );
                    truth.retract(&d)
                })
                .collect();
            let mut l = vec![0.0; count];
            let ms = time(if count > 2000 { 5 } else { 40 }, || z.log_likelihoods(&poses, &mut l));
            let most = l.iter().fold(f64::NEG_INFINITY, |a, &b| a.max(b));
            let weights = || l.iter().map(|l| vt_core::math::exp(l - most));
            let effective = weights().sum::<f64>().powi(2) / weights().map(|w| w * w).sum::<f64>();
            let ratio = canny.map_or(String::new(), |c| format!(", {:.2} x OpenCV's Canny", ms / c));
            println!(
                "{name}: {count} particles {ms:.3} ms ({:.0} ns each{ratio}), once a frame {prepared:.3} ms, effective number {effective:.0}",
                ms * 1e6 / count as f64
            );
        }
    }
    Ok(())
}

/// CPU time of OpenCV's Canny on the picture, one thread, milliseconds.
fn peer(image: &RgbImage) -> Result<Option<f64>, Failure> {
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
