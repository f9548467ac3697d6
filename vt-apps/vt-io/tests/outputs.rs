//! Outputs: formats, repeated frames, several targets, and files that are valid after an interruption.

use std::path::Path;
use std::sync::Arc;

use image::AnimationDecoder;
use vt_core::agent::{Output, Step};
use vt_core::belief::Gaussian;
use vt_core::evidence::Evidence;
use vt_core::frame::{Frame, Payload, SensorId};
use vt_core::lie::{SE3, Vector};
use vt_core::nalgebra::{Point3, UnitQuaternion, Vector3};
use vt_core::report::{BeliefRecord, Status, StepReport};
use vt_core::sketch::{Mark, Role};
use vt_core::time::Timestamp;
use vt_io::covariances::Covariances;
use vt_io::gif::{Gif, GifSettings};
use vt_io::overlay::{Drawing, Overlays, Settings};
use vt_io::poses::Poses;
use vt_io::report::{Header, Report};
use vt_io::run_plot::{Plotted, RunPlot};
use vt_io::steps::Steps;
use vt_io::summary::Summary;
use vt_io::truth::Truth;

fn report(target: &str, frame: u64, angle: f64, status: Status) -> StepReport {
    let pose = SE3::from_rotation_vector(&Vector3::new(0.0, 0.0, angle), Vector3::new(0.1, -0.2, 1.0 / 3.0));
    let q = pose.rotation.coords;
    // The quaternion with a negative real part is the same rotation.
    let coordinates = vec![0.1, -0.2, 1.0 / 3.0, -q.x, -q.y, -q.z, -q.w];
    let covariance = (0..36).map(|k| if k % 7 == 0 { 1e-6 * (k / 7 + 1) as f64 } else { 1e-9 }).collect();
    let posterior = BeliefRecord { space: "se3", coordinates, covariance };
    let mut report = StepReport { target: target.into(), frame, posterior, ..StepReport::default() };
    report.verdict.status = status;
    report
}

fn play(outputs: &mut [Box<dyn Output>], steps: &[Vec<StepReport>]) {
    let mut evidence = Evidence::default();
    for (k, reports) in steps.iter().enumerate() {
        let payload = Payload::Grey(Arc::new(image::GrayImage::from_pixel(160, 120, image::Luma([60]))));
        let frame =
            Frame { sensor: SensorId(0), number: reports[0].frame, time: Timestamp(k as i64), payload };
        evidence.begin([frame]);
        let sketch = |_: usize, out: &mut Vec<Mark>| {
            out.push(Mark::Segment { from: [20.0, 30.0], to: [140.0, 90.0], role: Role::Model });
            out.push(Mark::Point { at: [80.0, 60.0], role: Role::Outlier });
        };
        for output in outputs.iter_mut() {
            assert!(
                output.step(&Step { evidence: &evidence, reports, sketch: &sketch }).unwrap().is_continue()
            );
        }
    }
}

fn one(frames: &[u64]) -> Vec<Vec<StepReport>> {
    frames.iter().map(|&f| vec![report("castle", f, 0.3, Status::Tracking)]).collect()
}

fn numbers(path: &Path) -> Vec<Vec<f64>> {
    let text = std::fs::read_to_string(path).unwrap();
    let lines = text.lines().filter(|l| !l.starts_with('#'));
    lines.map(|l| l.split([' ', ',']).map(|v| v.parse().unwrap()).collect()).collect()
}

#[test]
fn poses_and_covariances_have_the_format_of_the_scorer() {
    let dir = tempfile::tempdir().unwrap();
    let names = ["castle".to_owned()];
    let mut outputs: Vec<Box<dyn Output>> = vec![
        Box::new(Poses::create(dir.path(), &names, false).unwrap()),
        Box::new(Covariances::create(dir.path(), &names, false).unwrap()),
    ];
    // Ping-pong: frame 1 comes twice. No `finish`: files are valid after every step.
    play(&mut outputs, &one(&[1, 2, 1]));
    let poses = numbers(&dir.path().join("poses.tum"));
    assert_eq!(poses.iter().map(|p| p[0]).collect::<Vec<_>>(), [1.0, 2.0, 1.0]);
    for p in &poses {
        assert_eq!(p.len(), 8);
        assert!(p[7] >= 0.0 && (p[4..].iter().map(|v| v * v).sum::<f64>() - 1.0).abs() < 1e-9);
        assert!((p[3] - 1.0 / 3.0).abs() < 1e-9 && p[6] > 0.0);
    }
    let covariances = numbers(&dir.path().join("covariances.csv"));
    assert!(covariances.iter().all(|c| c.len() == 22));
    // Upper triangle by rows: the diagonal is at 0, 6, 11, 15, 18, 20.
    let diagonal: Vec<f64> = [0, 6, 11, 15, 18, 20].map(|k| covariances[0][k + 1]).to_vec();
    assert_eq!(diagonal, [1e-6, 2e-6, 3e-6, 4e-6, 5e-6, 6e-6]);
    assert_eq!(Truth::read_tum(&dir.path().join("poses.tum")).unwrap().poses.len(), 2);
}

#[test]
fn lost_targets_are_left_out_unless_wanted_and_targets_have_their_own_files() {
    let names = ["a".to_owned(), "b/c".to_owned()];
    for (lost, count) in [(false, 1), (true, 2)] {
        let dir = tempfile::tempdir().unwrap();
        let mut outputs: Vec<Box<dyn Output>> =
            vec![Box::new(Poses::create(dir.path(), &names, lost).unwrap())];
        let step = |f, s| vec![report("a", f, 0.1, s), report("b/c", f, 0.2, Status::Tracking)];
        play(&mut outputs, &[step(0, Status::Tracking), step(1, Status::Lost)]);
        assert_eq!(numbers(&dir.path().join("poses-a.tum")).len(), count);
        assert_eq!(numbers(&dir.path().join("poses-b_c.tum")).len(), 2);
    }
}

#[test]
fn steps_are_json_lines_with_a_running_index_and_the_same_bytes_every_time() {
    let dir = tempfile::tempdir().unwrap();
    let mut texts = vec![];
    for _ in 0..2 {
        let mut steps = one(&[3, 3]);
        steps[1][0].timings.measure = texts.len() as u64;
        let mut outputs: Vec<Box<dyn Output>> = vec![Box::new(Steps::create(dir.path(), false).unwrap())];
        play(&mut outputs, &steps);
        texts.push(std::fs::read_to_string(dir.path().join("steps.jsonl")).unwrap());
    }
    assert_eq!(texts[0], texts[1], "wall-clock times are not part of the result");
    let lines: Vec<serde_json::Value> = texts[0].lines().map(|l| serde_json::from_str(l).unwrap()).collect();
    assert_eq!(
        lines.iter().map(|l| (l["step"].as_u64(), l["frame"].as_u64())).collect::<Vec<_>>(),
        [(Some(0), Some(3)), (Some(1), Some(3))]
    );
    assert_eq!(lines[0]["posterior"]["covariance"].as_array().unwrap().len(), 36);
    assert!(lines[0]["quality"].is_null());
}

#[test]
fn the_report_has_conditions_and_errors_and_an_old_one_is_removed() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("report.json"), "old").unwrap();
    let mut truth = Truth::default();
    let rotation = UnitQuaternion::from_scaled_axis(Vector3::new(0.0, 0.0, 0.3 + 0.01));
    truth.poses.insert(1, SE3::new(rotation, Vector3::new(0.1, -0.2, 1.0 / 3.0 + 0.002)));
    let summary = Summary::new([("castle".to_owned(), Some(truth), None)]);
    let header = Header { task: "t.toml".into(), seed: 5, ..Header::default() };
    header.interrupted.store(true, std::sync::atomic::Ordering::Relaxed);
    let mut outputs: Vec<Box<dyn Output>> =
        vec![Box::new(Report::create(dir.path(), header, summary).unwrap())];
    assert!(!dir.path().join("report.json").exists());
    let mut steps = one(&[1, 2]);
    steps[1][0].verdict.status = Status::Doubtful;
    play(&mut outputs, &steps);
    outputs[0].finish().unwrap();
    let text = std::fs::read_to_string(dir.path().join("report.json")).unwrap();
    let report: serde_json::Value = serde_json::from_str(&text).unwrap();
    let target = &report["targets"][0];
    assert_eq!(target["states"], serde_json::json!({ "tracking": 1, "doubtful": 1, "lost": 0 }));
    assert_eq!(target["errors"]["compared"], 1);
    assert!((target["errors"]["translation_mm"]["mean"].as_f64().unwrap() - 2.0).abs() < 1e-9);
    let degrees = target["errors"]["rotation_deg"]["max"].as_f64().unwrap();
    assert!((degrees - 0.01 * 180.0 / core::f64::consts::PI).abs() < 1e-6);
    assert_eq!((report["interrupted"].as_bool(), report["seed"].as_u64()), (Some(true), Some(5)));
    assert!(!dir.path().join("report.partial").exists());
}

#[test]
fn overlays_show_marks_in_their_colours_and_the_projected_uncertainty() {
    let dir = tempfile::tempdir().unwrap();
    let project = |p: &Point3<f64>| Some([100.0 * p.x / p.z + 79.5, 100.0 * p.y / p.z + 59.5].into());
    let settings = Settings { every: 2, ..Settings::default() };
    let overlays = Overlays::create(dir.path(), SensorId(0), Some(Box::new(project)), settings).unwrap();
    let mut outputs: Vec<Box<dyn Output>> = vec![Box::new(overlays)];
    let mut steps = one(&[7, 8, 7]);
    // One per cent of the distance: an ellipse of 2.45 px.
    steps.iter_mut().for_each(|s| {
        s[0].posterior.covariance.iter_mut().for_each(|v| *v = if *v > 1e-7 { 1.1e-5 } else { 0.0 })
    });
    play(&mut outputs, &steps);
    outputs[0].finish().unwrap();
    let read = |name: &str| image::open(dir.path().join(name)).unwrap().into_rgb8();
    let picture = read("overlays/step_00000_frame_0007.png");
    assert!(dir.path().join("overlays/step_00002_frame_0007.png").exists());
    assert!(!dir.path().join("overlays/step_00001_frame_0008.png").exists());
    let [r, g, b] = picture.get_pixel(50, 45).0;
    assert!(r > 200 && g > 150 && b < 90, "the model is yellow: {r} {g} {b}");
    let [r, g, b] = picture.get_pixel(30, 100).0;
    assert_eq!([r, g, b], [60; 3], "nothing is drawn where there is nothing");
    // The origin is seen at (109.5, -0.5): outside. Text is on a dark bar.
    assert!(picture.get_pixel(159, 0).0[0] < 40);
    let sheet = read("contact_sheet.png");
    assert_eq!(sheet.width(), 3 * 324 + 4);
}

fn gif(dir: &Path, settings: GifSettings) -> Box<dyn Output> {
    let drawing = Drawing::new(SensorId(0), None, true);
    Box::new(Gif::create(dir, drawing, settings).unwrap())
}

/// Frames of a GIF with their size, read by a decoder that refuses broken files.
fn frames(dir: &Path) -> Vec<(u32, u32)> {
    let file = std::io::BufReader::new(std::fs::File::open(dir.join("overlays.gif")).unwrap());
    let decoder = image::codecs::gif::GifDecoder::new(file).unwrap();
    let frames = decoder.into_frames().collect_frames().unwrap();
    frames.iter().map(|f| f.buffer().dimensions()).collect()
}

#[test]
fn the_animation_is_a_valid_file_after_every_frame() {
    let dir = tempfile::tempdir().unwrap();
    let settings = GifSettings { every: 2, scale: 0.5, ..GifSettings::default() };
    let mut outputs = vec![gif(dir.path(), settings)];
    // No `finish`: the run is interrupted.
    for (steps, expected) in [(1, 1), (1, 1), (1, 2), (4, 4)] {
        play(&mut outputs, &one(&vec![3; steps]));
        assert_eq!(frames(dir.path()), vec![(80, 60); expected]);
    }
    let bytes = std::fs::read(dir.path().join("overlays.gif")).unwrap();
    assert_eq!(bytes.last(), Some(&0x3b));
    let file = std::io::BufReader::new(std::fs::File::open(dir.path().join("overlays.gif")).unwrap());
    let decoder = image::codecs::gif::GifDecoder::new(file).unwrap();
    let first = decoder.into_frames().next().unwrap().unwrap();
    let yellow = first.buffer().pixels().filter(|p| p.0[0] > p.0[2] + 50 && p.0[1] > p.0[2] + 30).count();
    assert!(yellow > 50, "the model keeps its colour: {yellow} pixels");
}

#[test]
fn the_animation_ends_at_its_largest_size_and_an_old_one_is_removed() {
    let dir = tempfile::tempdir().unwrap();
    let settings = GifSettings { every: 1, scale: 1.0, max_bytes: 1, ..GifSettings::default() };
    let mut outputs = vec![gif(dir.path(), settings)];
    play(&mut outputs, &one(&[1, 2, 3]));
    assert_eq!(frames(dir.path()), [(160, 120)], "the frame that reaches the size is the last");
    outputs[0] = gif(dir.path(), settings);
    assert!(!dir.path().join("overlays.gif").exists());
}

/// A report of a flat target at (x, 60), 2 px uncertain across and 6 px along the picture's rows.
fn flat(frame: u64, x: f64) -> StepReport {
    let mut report = StepReport { target: "card".into(), frame, ..StepReport::default() };
    report.posterior.set(&Gaussian::from_sigmas(Vector([x, 60.0].into()), &[6.0, 2.0].into()));
    report
}

#[test]
fn flat_targets_have_their_ellipse_too() {
    let dir = tempfile::tempdir().unwrap();
    let settings = Settings { sheet: false, ..Settings::default() };
    let overlays = Overlays::create(dir.path(), SensorId(0), None, settings).unwrap();
    play(&mut [Box::new(overlays)], &[vec![flat(1, 80.0)]]);
    let picture = image::open(dir.path().join("overlays/step_00000_frame_0001.png")).unwrap().into_rgb8();
    let cyan = |x: u32, y: u32| picture.get_pixel(x, y).0[2] > 200 && picture.get_pixel(x, y).0[0] < 140;
    // 95 % of a plane lie within 2.45 deviations.
    let across: Vec<u32> = (62..80).filter(|&x| cyan(x, 60)).collect();
    let down: Vec<u32> = (40..60).filter(|&y| cyan(80, y)).collect();
    assert!(across.contains(&65) && across.iter().all(|x| x.abs_diff(65) < 2), "{across:?}");
    assert!(down.contains(&55) && down.iter().all(|y| y.abs_diff(55) < 2), "{down:?}");
}

#[test]
fn flat_targets_are_plotted_in_pixels() {
    let dir = tempfile::tempdir().unwrap();
    let corners = |x: f64| {
        [(x - 9.0, 50.0), (x + 9.0, 50.0), (x + 9.0, 70.0), (x - 9.0, 70.0)].map(|(x, y)| [x, y].into())
    };
    let truth = Truth::of_corners((1..4).map(|k| (k, corners(80.0))).collect());
    let bounds = Some([(-9.0, -10.0), (9.0, -10.0), (9.0, 10.0), (-9.0, 10.0)].map(|(x, y)| [x, y].into()));
    let card = Plotted { name: "card".to_owned(), truth: Some(truth), bounds };
    let mut plot = RunPlot::create(dir.path(), vec![card]).unwrap();
    for k in 1..4 {
        let reports = [flat(k, 80.0 + k as f64)];
        let step = Step { evidence: &Evidence::default(), reports: &reports, sketch: &|_, _| {} };
        assert!(plot.step(&step).unwrap().is_continue());
    }
    plot.finish().unwrap();
    let svg = std::fs::read_to_string(dir.path().join("plot.svg")).unwrap();
    for title in ["error and deviation of the centre, px", "overlap of the box with the true one"] {
        assert!(svg.contains(title), "{title}");
    }
    assert!(!svg.contains("residuals") && !svg.contains("mm"));
}

#[test]
fn the_plot_of_an_interrupted_run_is_whole_in_both_forms() {
    let mut truth = Truth::default();
    truth.poses.insert(1, SE3::new(UnitQuaternion::identity(), Vector3::new(0.1, -0.2, 0.33)));
    for (truth, word) in [(Some(truth), "error and deviation"), (None, "residuals")] {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("plot.svg"), "old").unwrap();
        let plot =
            RunPlot::create(dir.path(), vec![Plotted { name: "castle".to_owned(), truth, bounds: None }])
                .unwrap();
        assert!(!dir.path().join("plot.svg").exists());
        let mut outputs: Vec<Box<dyn Output>> = vec![Box::new(plot)];
        let mut steps = one(&[1, 2, 3]);
        steps[1][0].verdict.status = Status::Lost;
        play(&mut outputs, &steps);
        outputs[0].finish().unwrap();
        let svg = std::fs::read_to_string(dir.path().join("plot.svg")).unwrap();
        assert!(svg.trim_end().ends_with("</svg>") && svg.contains(word), "{word}");
        assert!(svg.contains("castle over 3 steps"));
        let picture = image::open(dir.path().join("plot.png")).unwrap().into_rgb8();
        let red = picture.pixels().filter(|p| p.0[0] > 230 && p.0[1] < 210 && p.0[2] < 210).count();
        assert!(red > 1000, "the lost step is red: {red} pixels");
    }
}

/// A long run is plotted from joined samples, none of which hides a failure.
#[test]
fn the_plot_of_a_long_run_keeps_its_one_bad_step() {
    let dir = tempfile::tempdir().unwrap();
    let plot =
        RunPlot::create(dir.path(), vec![Plotted { name: "castle".to_owned(), truth: None, bounds: None }])
            .unwrap();
    let mut outputs: Vec<Box<dyn Output>> = vec![Box::new(plot)];
    let mut steps = one(&vec![1; 10_001]);
    steps[5001][0].verdict = vt_core::report::Verdict { status: Status::Lost, loss_probability: 1.0 };
    play(&mut outputs, &steps);
    outputs[0].finish().unwrap();
    let svg = std::fs::read_to_string(dir.path().join("plot.svg")).unwrap();
    assert!(svg.contains("#E62828"), "the colour of a loss");
    assert!(svg.len() < 1_000_000, "{} bytes", svg.len());
}
