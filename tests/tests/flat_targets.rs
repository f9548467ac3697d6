//! Flat targets by task files: any measurement under any estimator by one line, the same bytes at any number of threads.

use std::path::Path;

use vt_core::agent::Estimator;
use vt_core::belief::Gaussian;
use vt_core::error::{ConfigError, EstimateError};
use vt_core::frame::SensorId;
use vt_core::least_squares::LeastSquares;
use vt_core::lie::{Sim2, picture_from_plane};
use vt_core::measurement::Measurement;
use vt_core::report::Innovation;
use vt_core::time::Seconds;
use vt_estimators::kalman::KalmanFilter;
use vt_models::outline::Outline;
use vt_sim::planar::{Fill, PlanarCamera, Settings, Walk};
use vt_task::assembly::Scene;
use vt_task::language::Level;
use vt_task::registry::{Method, NoParams};
use vt_task::roles::{EstimatorContext, Estimators, Motion};
use vt_task::{Document, Registry, check};

const FRAMES: usize = 40;

/// What is learnt in the first frame starts at the truth, since it would keep the error of its start; outlines start off it.
fn task(modality: &str, estimator: &str) -> String {
    let learnt = modality.contains("color") || modality.contains("template");
    let [x, y, angle] = if learnt { [119.5, 89.5, 0.0] } else { [121.5, 89.0, 1.0] };
    format!(
        r#"
version = 1
seed = 5
[[sensors]]
name = "camera"
kind = "simulated-planar"
picture = "colour"
[sensors.params]
model = "object"
size = [240, 180]
frames = {FRAMES}
rate = "25 Hz"
translation = "1.5 px"
rotation = "0.5 deg"
scale = 0.003
colours = 4
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

/// The poses of the same scene.
fn truth() -> Vec<Sim2> {
    let settings = Settings {
        size: [240, 180],
        frames: FRAMES as u64,
        rate: 25.0,
        walk: Walk { translation: 1.5, rotation: 0.5_f64.to_radians(), scale: 0.003 },
        fill: Fill::Patches(4),
        colour: true,
        seed: 5,
        ..Settings::default()
    };
    let shape = Outline::rectangle(50.0, 36.0).expect("a shape");
    let camera = PlanarCamera::new(SensorId(0), shape, settings).expect("a scene");
    camera.truth().into_values().collect()
}

/// Coordinates of the estimates of all frames.
fn track(text: &str) -> Vec<Vec<f64>> {
    let map = "maximum a posteriori by Levenberg and Marquardt";
    let map = Method::<Estimators<Sim2>>::new("map", map, MaximumAPosteriori::build);
    let registry = Registry::standard().with(map.levels(&[Level::Pixel, Level::Object]));
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

const MODALITIES: [&str; 5] = [
    r#"{ kind = "contour", level = "pixel", sensor = "camera" }"#,
    r#"{ kind = "contour", level = "pixel", sensor = "camera", params = { hypotheses = "single" } }"#,
    r#"{ kind = "chamfer", level = "pixel", sensor = "camera" }"#,
    r#"{ kind = "color", level = "pixel", sensor = "camera", params = { rows = 2, lambda = 60.0 } }"#,
    r#"{ kind = "template", level = "pixel", sensor = "camera", params = { smoothing = 1.0 } }"#,
];

const ESTIMATORS: [&str; 4] = [
    r#"{ kind = "particle", params = { particles = 300 } }"#,
    r#"{ kind = "kalman" }"#,
    r#"{ kind = "kalman", params = { iterations = 10 } }"#,
    r#"{ kind = "map" }"#,
];

/// Root mean square error that every pair of them keeps, pixels: the deviation of a coordinate's step from frame to frame.
const BOUND: f64 = 1.5;

/// The maximum a posteriori of prediction and measurement by Levenberg and Marquardt's method: an estimator that a user adds.
struct MaximumAPosteriori(Box<dyn Estimator<Sim2>>);

impl MaximumAPosteriori {
    fn build(_: NoParams, context: EstimatorContext<Sim2>) -> Result<Box<dyn Estimator<Sim2>>, ConfigError> {
        let Motion::Pose(motion) = context.motion else { panic!("the state is the pose") };
        let filter =
            KalmanFilter::<Sim2, Sim2, _>::new(&context.prior, vec![], motion, 1).expect("a finite prior");
        Ok(Box::new(Self(Box::new(filter))))
    }
}

impl Estimator<Sim2> for MaximumAPosteriori {
    fn predict(&mut self, dt: Seconds) -> Result<(), EstimateError> {
        self.0.predict(dt)
    }

    fn correct(&mut self, z: &dyn Measurement<Sim2>) -> Result<Innovation, EstimateError> {
        let prior = self.0.pose();
        let found = LeastSquares::levenberg_marquardt().fit(z, &prior.mean, Some(&prior))?;
        self.0.reset(&found.belief())?;
        Ok(Innovation { iterations: found.iterations, stop: found.stop, ..Innovation::default() })
    }

    fn pose(&self) -> Gaussian<Sim2> {
        self.0.pose()
    }

    fn reset(&mut self, prior: &Gaussian<Sim2>) -> Result<(), EstimateError> {
        self.0.reset(prior)
    }
}

#[test]
fn any_measurement_runs_under_any_estimator() {
    let mut wrong = vec![];
    for modality in MODALITIES {
        for estimator in ESTIMATORS {
            let error = error(&track(&task(modality, estimator)));
            println!("{error:6.2} px  {modality} {estimator}");
            if error.is_nan() || error >= BOUND {
                wrong.push(format!("{error:.2} px of {BOUND}: {modality} under {estimator}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

const CENTRES: &str = r#"{ kind = "color-centre", level = "object", sensor = "camera" }, { kind = "motion-centre", level = "object", sensor = "camera", params = { duration = "400 ms" } }"#;

/// Static and dynamic fusion of mass centres, at one thread and at two.
#[test]
fn mass_centres_follow_the_object_however_they_are_fused() {
    let run = |fusion: &str, threads| {
        // One colour: a linear discriminant does not part hues all around from the grey in their middle.
        let text = task(CENTRES, r#"{ kind = "kalman" }"#)
            .replace("colours = 4", "colours = 1")
            .replace("[targets.init]", &format!("fusion = {fusion}\n[targets.init]"));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| track(&text))
    };
    for fusion in
        [r#"{ kind = "stacked" }"#, r#"{ kind = "equivalent-measurements" }"#, r#"{ kind = "intersection" }"#]
    {
        let one = run(fusion, 1);
        let error = error(&one);
        println!("{error:6.2} px  {fusion}");
        assert!(error < 3.0, "{error} px with {fusion}");
        assert_eq!(one, run(fusion, 2), "{fusion}");
    }
    // For linear measurements, places of a model that is only moved, it does not matter how static ones are fused.
    let moved = |fusion: &str| {
        let text = task(CENTRES, r#"{ kind = "kalman" }"#)
            .replace("colours = 4", "colours = 1")
            .replace("sim2", "translation")
            .replace(r#", rotation = "4 deg/s^0.5", scale = "3 %/s^0.5""#, "")
            .replace(r#", rotation = "2 deg", scale = "1 %""#, "")
            .replace("[targets.init]", &format!("fusion = {{ kind = \"{fusion}\" }}\n[targets.init]"));
        track(&text)
    };
    let (stacked, one_by_one) = (moved("stacked"), moved("sequential"));
    let apart = stacked.iter().flatten().zip(one_by_one.iter().flatten()).map(|(a, b)| (a - b).abs());
    assert!(apart.fold(0.0, f64::max) < 1e-6);
}

/// Every modality alone, and all of them in each kind of static fusion.
#[test]
fn the_same_bytes_at_one_and_two_threads() {
    let all = MODALITIES.join(", ");
    let particles = ESTIMATORS[0];
    let mut tasks: Vec<String> = MODALITIES.iter().map(|modality| task(modality, particles)).collect();
    tasks.push(task(&all, particles));
    for fusion in ["stacked", "sequential", "information-sum"] {
        let fused = format!("{}\nfusion = {{ kind = \"{fusion}\" }}", ESTIMATORS[1]);
        tasks.push(task(&all, &fused));
    }
    for task in tasks {
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            pool.install(|| track(&task))
        };
        assert_eq!(run(1), run(2), "{task}");
    }
}
