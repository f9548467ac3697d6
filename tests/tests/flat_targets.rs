//! Flat targets by task files: any measurement under any estimator by one line, the same bytes at any number of threads.

use std::path::Path;

use nalgebra::Vector4;
use vt_core::lie::{Sim2, picture_from_plane};
use vt_sim::backdrop::Background;
use vt_sim::noise::Noise;
use vt_sim::planar::PlanarScene;
use vt_task::assembly::Scene;
use vt_task::{Document, Registry, check};

const FRAMES: usize = 40;

/// What is learnt in the first frame starts at the truth, since it would keep the error of its start; outlines start off it.
fn task(modality: &str, estimator: &str) -> String {
    let learnt = modality.contains("color") || modality.contains("template");
    let [x, y, angle] = if learnt { [120.0, 90.0, 0.0] } else { [121.5, 89.0, 1.0] };
    format!(
        r#"
version = 1
seed = 5
[[sensors]]
name = "camera"
kind = "planar-scene"
picture = "colour"
[sensors.params]
model = "object"
size = [240, 180]
colours = [[0.9, 0.35, 0.2], [0.2, 0.8, 0.9], [0.8, 0.8, 0.3], [0.6, 0.2, 0.7]]
columns = 2
start = {{ translation = ["120 px", "90 px"] }}
step = {{ translation = "1.5 px", rotation = "0.5 deg", scale = "0.3 %" }}
margin = "50 px"
background = {{ kind = "clutter", params = {{ size = "30 px", density = 0.4, brightness = 0.3, contrast = 0.4 }} }}
frames = {FRAMES}
rate = "25 Hz"
[[models]]
name = "object"
shape = {{ kind = "rectangle", params = {{ size = ["50 px", "36 px"] }} }}
warp = {{ kind = "sim2" }}
dynamics = {{ kind = "brownian", params = {{ translation = "10 px/s^0.5", rotation = "4 deg/s^0.5", scale = "3 %/s^0.5" }} }}
[[targets]]
name = "object"
model = "object"
modalities = [{modality}]
estimator = {estimator}
[targets.init]
kind = "pose"
params = {{ picture_from_object = {{ translation = ["{x} px", "{y} px"], rotation = "{angle} deg" }}, sigma = {{ translation = "2 px", rotation = "2 deg", scale = "1 %" }} }}
"#
    )
}

fn truth() -> Vec<Sim2> {
    let scene = PlanarScene {
        loops: vec![],
        colours: vec![],
        columns: 1,
        start: Sim2::new(120.0, 90.0, 0.0, 1.0),
        step: Vector4::new(1.5, 1.5, 0.5_f64.to_radians(), 0.003),
        margin: 50.0,
        background: Background::Plain(0.0),
        size: [240, 180],
        frames: FRAMES as u64,
        rate: 25.0,
        hidden: vec![],
        noise: Noise::default(),
        colour: true,
        seed: 5,
    };
    scene.poses()
}

/// Coordinates of the estimates of all frames.
fn track(text: &str) -> Vec<Vec<f64>> {
    let registry = Registry::standard();
    let document = Document::parse("flat", text, Path::new(""), &[], &|_| None).expect("a text");
    let task = check(&document, &registry).expect("a task");
    let mut scene = Scene::build(&document, &task, &registry).expect("a scene");
    let mut first = scene.sensors[0].next().expect("a frame");
    let frames: Vec<_> = first.iter().cloned().collect();
    let mut tracker = scene.tracking(&document, &task, &registry, &frames).expect("a tracker");
    let mut out = vec![];
    while let Some(frame) = first.take() {
        let reports = tracker.step([frame]).expect("a step");
        assert_eq!(reports[0].failure, None);
        assert!(picture_from_plane(&reports[0].posterior).is_some());
        out.push(reports[0].posterior.coordinates.clone());
        first = scene.sensors[0].next().expect("a frame");
    }
    out
}

/// Distance of the position from the truth, root mean square of the second half, pixels.
fn error(estimates: &[Vec<f64>]) -> f64 {
    let truth = truth();
    assert_eq!(estimates.len(), truth.len());
    let squares = estimates.iter().zip(&truth).skip(FRAMES / 2);
    let squares = squares.map(|(e, t)| (e[0] - t.translation.x).powi(2) + (e[1] - t.translation.y).powi(2));
    (squares.sum::<f64>() / (FRAMES - FRAMES / 2) as f64).sqrt()
}

const MODALITIES: [(&str, f64); 5] = [
    (r#"{ kind = "contour", level = "pixel", sensor = "camera" }"#, 1.5),
    (r#"{ kind = "contour", level = "pixel", sensor = "camera", params = { hypotheses = "single" } }"#, 1.5),
    (r#"{ kind = "chamfer", level = "pixel", sensor = "camera" }"#, 1.5),
    (r#"{ kind = "color", level = "pixel", sensor = "camera", params = { rows = 2, lambda = 60.0 } }"#, 1.5),
    // One linearisation a frame lags behind steps of two pixels.
    (r#"{ kind = "template", level = "pixel", sensor = "camera" }"#, 2.5),
];

const ESTIMATORS: [&str; 3] = [
    r#"{ kind = "particle", params = { particles = 300 } }"#,
    r#"{ kind = "kalman" }"#,
    r#"{ kind = "kalman", params = { iterations = 10 } }"#,
];

#[test]
fn any_measurement_runs_under_any_estimator() {
    let mut wrong = vec![];
    for (modality, bound) in MODALITIES {
        for estimator in ESTIMATORS {
            let error = error(&track(&task(modality, estimator)));
            println!("{error:6.2} px  {modality} {estimator}");
            if !(error < bound) {
                wrong.push(format!("{error:.2} px of {bound}: {modality} under {estimator}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn the_same_bytes_at_one_and_two_threads() {
    let both = MODALITIES.map(|(m, _)| m).join(", ");
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| track(&task(&both, ESTIMATORS[0])))
    };
    assert_eq!(run(1), run(2));
}
