//! Keypoints and matches on six planar pairs with a true homography, beside OpenCV's SIFT in the same run.
//!
//! Both sides keep the same number of keypoints, use the same ratio test and one thread; the comparison program scores both in the
//! same way. Times are those of detection and description of one picture on the CPU clock, medians of runs.
//!
//! usage: `sift_pairs [--out DIR] [--script SIFT_MATCHES.PY --python PYTHON]`

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, ensure};
use clap::Parser;
use cpu_time::ProcessTime;
use image::{DynamicImage, GrayImage};
use nalgebra::{Point2, Vector2};
use serde_json::Value;
use vt_core::agent::{Posed, Warp};
use vt_core::math;
use vt_core::random::{Random, Stream};
use vt_models::homography::{Consensus, ConsensusParams};
use vt_models::reprojection::{Pair, RefinementParams, refine};
use vt_models::warp::PlanarWarp;
use vt_vision::color::rgb_to_grey;
use vt_vision::matching::{Match, MatchParams, Matcher};
use vt_vision::sift::{Descriptor, Keypoint, Sift, SiftParams};

/// Compares keypoints with OpenCV's SIFT.
#[derive(Parser)]
struct Arguments {
    /// Folder with the pictures.
    #[arg(long, env = "VT_DATA", default_value = "../shared/data")]
    data: PathBuf,
    /// Folder for keypoints and matches.
    #[arg(long, default_value = "target/sift_pairs")]
    out: PathBuf,
    /// The program `sift_matches.py` of the comparison sources.
    #[arg(long)]
    script: Option<PathBuf>,
    /// The interpreter that has OpenCV.
    #[arg(long, default_value = "python3")]
    python: PathBuf,
    /// Most keypoints of a picture.
    #[arg(long, default_value_t = 2000)]
    keep: usize,
    /// Ratio test.
    #[arg(long, default_value_t = 0.8)]
    ratio: f64,
    /// Timed runs of a picture.
    #[arg(long, default_value_t = 9)]
    runs: usize,
    /// Descriptors as they are, without their root.
    #[arg(long)]
    plain: bool,
    /// The first octave at the resolution of the picture.
    #[arg(long)]
    single: bool,
    /// Contrast threshold.
    #[arg(long, default_value_t = SiftParams::default().contrast)]
    contrast: f64,
    /// Smoothing that the pictures have already, pixels.
    #[arg(long, default_value_t = SiftParams::default().input_blur)]
    input_blur: f64,
    /// Smoothing of the first level.
    #[arg(long, default_value_t = SiftParams::default().sigma)]
    sigma: f64,
    /// Threads.
    #[arg(long, default_value_t = 1)]
    threads: usize,
}

/// Pictures by name.
const PICTURES: [(&str, &str); 9] = [
    ("boat_1", "boat/img1.pgm"),
    ("boat_2", "boat/img2.pgm"),
    ("boat_3", "boat/img3.pgm"),
    ("boat_5", "boat/img5.pgm"),
    ("graf_1", "graf/graf1.png"),
    ("graf_3", "graf/graf3.png"),
    ("dogman_1", "dogman/1.ppm"),
    ("dogman_2", "dogman/2.ppm"),
    ("dogman_3", "dogman/3.ppm"),
];

/// Pairs by scene and numbers of both pictures.
const PAIRS: [[&str; 3]; 6] = [
    ["boat", "1", "2"],
    ["boat", "1", "3"],
    ["boat", "1", "5"],
    ["graf", "1", "3"],
    ["dogman", "1", "2"],
    ["dogman", "1", "3"],
];

/// What was found in a picture.
struct Found {
    keypoints: Vec<Keypoint>,
    descriptors: Vec<Descriptor>,
    milliseconds: f64,
}

fn grey(path: &Path) -> Result<GrayImage> {
    let picture = image::open(path).with_context(|| path.display().to_string())?;
    if let DynamicImage::ImageLuma8(grey) = picture {
        return Ok(grey);
    }
    let colour = picture.to_rgb8();
    let mut grey = GrayImage::new(colour.width(), colour.height());
    rgb_to_grey(colour.as_raw(), &mut grey);
    Ok(grey)
}

/// Median CPU time of a call, milliseconds.
fn time(runs: usize, mut call: impl FnMut()) -> f64 {
    call();
    let times = (0..runs.max(1)).map(|_| {
        let start = ProcessTime::now();
        call();
        1e3 * start.elapsed().as_secs_f64()
    });
    let mut times: Vec<f64> = times.collect();
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

/// The homography that the matches agree with, in words, and its time.
fn homography(a: &Found, b: &Found, matches: &[Match], runs: usize) -> Result<String> {
    let mut order: Vec<&Match> = matches.iter().collect();
    order.sort_by(|m, n| m.ratio.total_cmp(&n.ratio));
    let centre = a.keypoints.iter().map(|k| k.at.coords).sum::<Vector2<f64>>() / a.keypoints.len() as f64;
    let pair = |m: &&Match| {
        let (p, q) = (&a.keypoints[m.first], &b.keypoints[m.second]);
        // Errors in both pictures, those of the first one as large in the second as its keypoint.
        let deviation = 0.5 * math::hypot(q.spacing, p.spacing * q.scale / p.scale);
        Pair { body: p.at - centre, seen: q.at, deviation }
    };
    let pairs: Vec<Pair<Point2<f64>>> = order.iter().map(pair).collect();
    let (params, refinement) = (ConsensusParams::default().check()?, RefinementParams::default().check()?);
    let (mut search, mut last) = (Consensus::default(), None);
    let milliseconds = time(runs, || {
        let mut random = Random::new(0, Stream::Reinit, 0, 0, 0);
        last = search.find(&pairs, &params, &mut random).map(|found| {
            let agreeing: Vec<_> = search.agreeing().iter().map(|&k| pairs[k as usize]).collect();
            (found, refine(&PlanarWarp::default(), &agreeing, &found.homography, &refinement))
        });
    });
    let Some((found, refined)) = last else { return Ok("no homography".into()) };
    let refined = refined?;
    // Of the middle of the keypoints: the first two coordinates of the tangent, turned into the second picture.
    let (warp, origin) = (PlanarWarp::default(), Point2::origin());
    let (_, jacobian) = warp.at(&refined.belief.mean).linearize(&origin).context("the middle is not seen")?;
    let covariance = jacobian * refined.belief.covariance * jacobian.transpose();
    Ok(format!(
        "{} of {} matches agree after {} samples, deviation of the middle {:.3} px, deviations x {:.2}, {milliseconds:.2} ms",
        search.agreeing().len(),
        pairs.len(),
        found.samples,
        (0.5 * covariance.trace()).sqrt(),
        refined.scale,
    ))
}

/// Keypoints of all pictures, and matches of all pairs, into files; returns the times by picture and those of matching by pair.
fn ours(arguments: &Arguments) -> Result<(BTreeMap<String, f64>, BTreeMap<String, f64>)> {
    let params = SiftParams {
        budget: arguments.keep,
        root: !arguments.plain,
        doubled: !arguments.single,
        contrast: arguments.contrast,
        sigma: arguments.sigma,
        input_blur: arguments.input_blur,
        ..SiftParams::default()
    };
    let mut sift = Sift::new(params)?;
    let mut found = BTreeMap::new();
    for (name, path) in PICTURES {
        let picture = grey(&arguments.data.join("planar").join(path))?;
        let milliseconds = time(arguments.runs, || sift.compute(&picture, None));
        let (keypoints, descriptors) = (sift.keypoints().to_vec(), sift.descriptors().to_vec());
        let lines = keypoints.iter().map(|k| {
            format!("{:.4},{:.4},{:.4},{:.4},{:.4}\n", k.at.x, k.at.y, k.scale, k.angle, k.response)
        });
        std::fs::write(arguments.out.join(format!("{name}.csv")), lines.collect::<String>())?;
        found.insert(name.to_string(), Found { keypoints, descriptors, milliseconds });
    }
    let mut matcher = Matcher::default();
    let params = MatchParams { ratio: arguments.ratio, mutual: true }.check()?;
    let mut times = BTreeMap::new();
    for [scene, one, two] in PAIRS {
        let [a, b] = [one, two].map(|n| &found[&format!("{scene}_{n}")]);
        let milliseconds = time(arguments.runs, || {
            matcher.compute(&a.descriptors, &b.descriptors, &params);
        });
        let matches = matcher.compute(&a.descriptors, &b.descriptors, &params);
        let lines = matches.iter().map(|m| {
            let (p, q) = (a.keypoints[m.first].at, b.keypoints[m.second].at);
            format!("{:.4},{:.4},{:.4},{:.4}\n", p.x, p.y, q.x, q.y)
        });
        let name = format!("{scene}_{one}_{two}");
        println!("{name}: {}", homography(a, b, matches, arguments.runs)?);
        std::fs::write(arguments.out.join(format!("{name}.csv")), lines.collect::<String>())?;
        times.insert(name, milliseconds);
    }
    Ok((found.into_iter().map(|(name, f)| (name, f.milliseconds)).collect(), times))
}

/// Lines of the comparison program.
fn script(arguments: &Arguments, script: &Path, more: &[&str]) -> Result<Vec<Value>> {
    let mut command = Command::new(&arguments.python);
    command.arg(script).arg("--data").arg(&arguments.data).args(more);
    let output = command.output().with_context(|| format!("cannot run {}", arguments.python.display()))?;
    ensure!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout)?;
    Ok(text.lines().map(serde_json::from_str).collect::<Result<_, _>>()?)
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    std::fs::create_dir_all(&arguments.out)?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(arguments.threads).build()?;
    let (pictures, matching) = pool.install(|| ours(&arguments))?;
    for (name, milliseconds) in &pictures {
        println!("{name}: {milliseconds:.1} ms");
    }
    let Some(path) = &arguments.script else { return Ok(()) };
    let out = arguments.out.to_string_lossy();
    let given = script(&arguments, path, &["--matches", &out, "--keypoints", &out])?;
    let (keep, runs, ratio) =
        (arguments.keep.to_string(), arguments.runs.to_string(), arguments.ratio.to_string());
    let peer = script(&arguments, path, &["--keep", &keep, "--runs", &runs, "--ratio", &ratio])?;
    println!(
        "| ours ; OpenCV | keypoints | matches | correct | precision | repeatability | px median | CPU ms | \
         times OpenCV's | matching ms |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    for (a, b) in given.iter().zip(&peer) {
        let name = a["pair"].as_str().context("a line without pair")?;
        ensure!(b["pair"] == name, "pairs in another order");
        let (scene, numbers) = name.split_once('_').context("an odd pair")?;
        let (one, two) = numbers.split_once('_').context("an odd pair")?;
        let [m1, m2] = [one, two].map(|n| pictures[&format!("{scene}_{n}")]);
        let [o1, o2] = ["cpu_ms_1", "cpu_ms_2"].map(|key| b[key].as_f64().unwrap_or(f64::NAN));
        let both = |key: &str| format!("{} ; {}", a[key], b[key]);
        println!(
            "| {name} | {} / {} ; {} / {} | {} | {} | {} | {} | {} | {m1:.0} / {m2:.0} ; {o1:.0} / {o2:.0} | {:.2} | {:.1} |",
            a["keypoints_1"],
            a["keypoints_2"],
            b["keypoints_1"],
            b["keypoints_2"],
            both("matches"),
            both("correct"),
            both("precision"),
            both("repeatability"),
            both("correct_px_median"),
            (m1 + m2) / (o1 + o2),
            matching[name],
        );
    }
    Ok(())
}
