//! Image processing beside OpenCV's in the same run, on one thread: the same picture at 640 × 480.
//!
//! Both sides are timed by the CPU clock of their process; a round is the median of many runs, rounds alternate, and the lowest of
//! each counts. OpenCV's Canny gets the picture as it is, and so does ours in its row.
//!
//! usage: `vision_vs_opencv --python PYTHON OPENCV_PEERS.PY`

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, ensure};
use clap::Parser;
use cpu_time::ProcessTime;
use image::imageops::{FilterType, resize};
use image::{GrayImage, RgbImage};
use vt_core::time::{Seconds, Timestamp};
use vt_tests::replay::median;
use vt_vision::canny::{Canny, CannyParams, Thresholds};
use vt_vision::color::{Hsv, HueRange, rgb_to_grey};
use vt_vision::distance_transform::DistanceTransform;
use vt_vision::gaussian::{Blur, Gaussian};
use vt_vision::gradient::Gradient;
use vt_vision::histogram::{Achromatic, BinningParams, Histogram, back_project, scaled_table};
use vt_vision::motion::{MotionHistory, difference};
use vt_vision::plane::Plane;

/// Compares the speed of image processing with OpenCV's.
#[derive(Parser)]
struct Arguments {
    /// The program `opencv_peers.py` of the comparison sources.
    script: PathBuf,
    /// The interpreter that has OpenCV.
    #[arg(long, default_value = "python3")]
    python: PathBuf,
    /// Folder with the pictures.
    #[arg(long, env = "VT_DATA", default_value = "../shared/data")]
    data: PathBuf,
    /// Alternating rounds.
    #[arg(long, default_value_t = 5)]
    rounds: usize,
    /// Runs in a round.
    #[arg(long, default_value_t = 60)]
    runs: usize,
    /// Ours alone.
    #[arg(long)]
    alone: bool,
}

/// What is compared: our name, OpenCV's functions whose times are added, and whether ours must not be slower.
const ROWS: [(&str, &[&str], bool); 8] = [
    ("Canny and Gaussian 5 x 5", &["Canny_50_150", "GaussianBlur_5x5"], true),
    ("Canny alone", &["Canny_50_150"], false),
    ("Gaussian 5 x 5 alone", &["GaussianBlur_5x5"], false),
    ("Sobel, both axes", &["Sobel_xy_s16"], false),
    ("RGB to HSV", &["cvtColor_bgr2hsv"], true),
    ("histogram 30 x 32 and back-projection", &["calcHist_hs_30x32", "calcBackProject_hs"], true),
    ("exact distance transform", &["distanceTransform_l2_exact"], true),
    ("motion history", &["updateMotionHistory"], true),
];

/// Median CPU time of a call, milliseconds.
fn time(runs: usize, mut call: impl FnMut()) -> f64 {
    call();
    let times: Vec<f64> = (0..runs)
        .map(|_| {
            let start = ProcessTime::now();
            call();
            1e3 * start.elapsed().as_secs_f64()
        })
        .collect();
    median(&times)
}

/// Our times in the order of [`ROWS`].
fn ours(image: &RgbImage, runs: usize) -> Result<[f64; 8]> {
    let (width, height) = image.dimensions();
    let mut grey = GrayImage::new(width, height);
    rgb_to_grey(image.as_raw(), &mut grey);

    let thresholds = Thresholds::Fixed { low: 50.0 / Gradient::STEP, high: 150.0 / Gradient::STEP };
    let plain = CannyParams { blur: None, ..CannyParams::new(thresholds)? };
    let mut canny = Canny::default();
    let canny_alone = time(runs, || canny.compute(&grey, None, &plain));
    let kernel = Gaussian::with_reach(1.1, 2)?;
    let (mut blur, mut smooth) = (Blur::default(), GrayImage::default());
    let gaussian = time(runs, || blur.picture(&grey, None, &kernel, &mut smooth));
    let mut gradient = Gradient::default();
    let sobel = time(runs, || gradient.compute(&grey, None));

    let mut hsv = Hsv::default();
    let conversion = time(runs, || hsv.compute(image, None, HueRange::Half));
    let layout = BinningParams {
        hue: 30,
        saturation: 32,
        achromatic: Achromatic::AsColor,
        ..BinningParams::default()
    };
    let binning = layout.check()?;
    let (mut bins, mut back, mut table) = (Plane::default(), Plane::default(), vec![]);
    let mut histogram = Histogram::new(usize::from(binning.count()));
    let histograms = time(runs, || {
        let room = bins.reshape(hsv.hue.region());
        binning.assign(hsv.hue.values(), hsv.saturation.values(), hsv.value.values(), room);
        histogram.clear();
        histogram.add_region(&bins, bins.region());
        scaled_table(&histogram, &mut table);
        back_project(&bins, &table, &mut back);
    });

    let mut transform = DistanceTransform::default();
    let distance = time(runs, || transform.compute(canny.mask()));

    let moved =
        GrayImage::from_fn(width, height, |x, y| *grey.get_pixel(x.saturating_sub(3), y.saturating_sub(2)));
    let (mut mask, mut history) = (Plane::default(), MotionHistory::default());
    difference(&grey, &moved, 30, mask.reshape(hsv.hue.region()));
    let mut frame = 0;
    let motion = time(runs, || {
        frame += 1;
        history.update(&mask, Timestamp(33_333_333 * frame), Seconds(0.5));
    });
    Ok([canny_alone + gaussian, canny_alone, gaussian, sobel, conversion, histograms, distance, motion])
}

/// OpenCV's times in the order of [`ROWS`].
fn theirs(arguments: &Arguments, image: &Path) -> Result<[f64; 8]> {
    let names: Vec<&str> = ROWS.iter().flat_map(|(_, names, _)| names.iter().copied()).collect();
    let output = Command::new(&arguments.python)
        .arg(&arguments.script)
        .arg("--image")
        .arg(image)
        .args(["--runs", &arguments.runs.to_string(), "--only", &names.join(",")])
        .output()
        .with_context(|| format!("cannot run {}", arguments.python.display()))?;
    ensure!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout)?;
    let lines: Vec<serde_json::Value> = text.lines().map(serde_json::from_str).collect::<Result<_, _>>()?;
    let one = |name: &str| {
        let line = lines.iter().find(|l| l["name"] == name && l["threads"] == 1);
        line.and_then(|l| l["cpu_ms"].as_f64()).with_context(|| format!("no time of {name}"))
    };
    let mut times = [0.0; 8];
    for (time, (_, names, _)) in times.iter_mut().zip(ROWS) {
        *time = names.iter().map(|name| one(name)).sum::<Result<f64>>()?;
    }
    Ok(times)
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    let path = arguments.data.join("planar/graf/graf1.png");
    let picture = image::open(&path).with_context(|| path.display().to_string())?.to_rgb8();
    let image = resize(&picture, 640, 480, FilterType::Triangle);
    let (mut own, mut other) = ([f64::INFINITY; 8], [f64::INFINITY; 8]);
    let lower =
        |times: &mut [f64; 8], new: [f64; 8]| times.iter_mut().zip(new).for_each(|(t, n)| *t = t.min(n));
    for _ in 0..arguments.rounds {
        lower(&mut own, ours(&image, arguments.runs)?);
        if !arguments.alone {
            lower(&mut other, theirs(&arguments, &path)?);
        }
    }
    println!("| 640 x 480, one thread | ours ms | OpenCV ms | ours / OpenCV |");
    println!("|---|---|---|---|");
    for ((name, _, _), (o, t)) in ROWS.into_iter().zip(own.into_iter().zip(other)) {
        println!("| {name} | {o:.3} | {t:.3} | {:.2} |", o / t);
    }
    let slower =
        ROWS.into_iter().zip(own.into_iter().zip(other)).filter(|((_, _, must), (o, t))| *must && o > t);
    let slower: Vec<&str> = slower.map(|((name, _, _), _)| name).collect();
    ensure!(slower.is_empty(), "slower than OpenCV: {}", slower.join(", "));
    Ok(())
}
