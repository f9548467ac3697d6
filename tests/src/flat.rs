//! Flat targets by task files: any measurement under any estimator, on one simulated scene.

use std::path::Path;

use anyhow::{Context, Result, anyhow};
use vt_core::agent::Estimator;
use vt_core::belief::Gaussian;
use vt_core::error::{ConfigError, EstimateError};
use vt_core::frame::SensorId;
use vt_core::least_squares::LeastSquares;
use vt_core::lie::Sim2;
use vt_core::measurement::Measurement;
use vt_core::report::{BeliefRecord, Innovation};
use vt_core::time::Seconds;
use vt_estimators::kalman::KalmanFilter;
use vt_models::outline::Outline;
use vt_sim::planar::{Fill, PlanarCamera, Settings, Walk};
use vt_task::assembly::Scene;
use vt_task::language::Level;
use vt_task::registry::{Method, NoParams};
use vt_task::roles::{EstimatorContext, Estimators, Motion};
use vt_task::{Document, Registry, check};

/// Frames of the scene.
pub const FRAMES: usize = 40;

/// The scene's seed in the tests.
pub const SEED: u64 = 5;

/// Measurements of a patch of four colours.
pub const MODALITIES: [&str; 5] = [
    r#"{ kind = "contour", level = "pixel", sensor = "camera" }"#,
    r#"{ kind = "contour", level = "pixel", sensor = "camera", params = { hypotheses = "single" } }"#,
    r#"{ kind = "chamfer", level = "pixel", sensor = "camera" }"#,
    r#"{ kind = "color", level = "pixel", sensor = "camera", params = { rows = 2, lambda = 60.0 } }"#,
    r#"{ kind = "template", level = "pixel", sensor = "camera", params = { smoothing = 1.0 } }"#,
];

/// Mass centres; a linear discriminant does not part hues all around from the grey in their middle, so the patch has one colour.
pub const CENTRES: [&str; 2] = [
    r#"{ kind = "color-centre", level = "object", sensor = "camera" }"#,
    r#"{ kind = "motion-centre", level = "object", sensor = "camera", params = { duration = "400 ms" } }"#,
];

/// Estimators; the last is one that a user adds.
pub const ESTIMATORS: [&str; 4] = [
    r#"{ kind = "particle", params = { particles = 300 } }"#,
    r#"{ kind = "kalman" }"#,
    r#"{ kind = "kalman", params = { iterations = 10 } }"#,
    r#"{ kind = "map" }"#,
];

/// A task on a simulated scene of a patch of 50 x 36 px.
pub struct Patch<'a> {
    /// Of scene and filter.
    pub seed: u64,
    /// Frames of the scene.
    pub frames: usize,
    /// Further parameters of the scene, a line each.
    pub scene: &'a str,
    /// Kind of the warp.
    pub warp: &'a str,
    /// Deviations of the random walk that the filter expects, a table.
    pub noise: &'a str,
    /// Modalities, separated by commas.
    pub modalities: &'a str,
    /// Estimator, a table.
    pub estimator: &'a str,
    /// Parameters of the first pose, a table.
    pub start: &'a str,
}

impl Patch<'_> {
    /// Text of the task.
    pub fn task(&self) -> String {
        let Self { seed, frames, scene, warp, noise, modalities, estimator, start } = self;
        format!(
            r#"
version = 1
seed = {seed}
[[sensors]]
name = "camera"
kind = "simulated-planar"
picture = "colour"
[sensors.params]
model = "object"
size = [240, 180]
frames = {frames}
rate = "25 Hz"
translation = "1.5 px"
scale = 0.003
{scene}
[[models]]
name = "object"
shape = {{ kind = "rectangle", params = {{ size = ["50 px", "36 px"] }} }}
warp = {{ kind = "{warp}" }}
dynamics = {{ kind = "brownian", params = {noise} }}
[[targets]]
name = "object"
model = "object"
modalities = [{modalities}]
estimator = {estimator}
init = {{ kind = "pose", params = {start} }}
"#
        )
    }
}

/// The task with these modalities. What is learnt in the first frame starts at the truth, since it would keep the error of its start;
/// outlines start off it.
pub fn task(seed: u64, modalities: &str, estimator: &str) -> String {
    let learnt = modalities.contains("color") || modalities.contains("template");
    let [x, y, angle] = if learnt { [119.5, 89.5, 0.0] } else { [121.5, 89.0, 1.0] };
    let start = format!(
        r#"{{ picture_from_object = {{ translation = ["{x} px", "{y} px"], rotation = "{angle} deg" }}, sigma = {{ translation = "2 px", rotation = "2 deg", scale = "1 %" }} }}"#
    );
    Patch {
        seed,
        frames: FRAMES,
        scene: &format!("rotation = \"0.5 deg\"\ncolours = {}", colours(modalities)),
        warp: "sim2",
        noise: r#"{ translation = "10 px/s^0.5", rotation = "4 deg/s^0.5", scale = "3 %/s^0.5" }"#,
        modalities,
        estimator,
        start: &start,
    }
    .task()
}

/// Colours of the patch.
fn colours(modalities: &str) -> u32 {
    if modalities.contains("-centre") { 1 } else { 4 }
}

/// True poses of the scene of these modalities.
///
/// # Errors
/// When the scene cannot be made.
pub fn truth(seed: u64, modalities: &str) -> Result<Vec<Sim2>> {
    let settings = Settings {
        size: [240, 180],
        frames: FRAMES as u64,
        rate: 25.0,
        walk: Walk { translation: 1.5, rotation: 0.5_f64.to_radians(), scale: 0.003 },
        fill: Fill::Patches(colours(modalities)),
        colour: true,
        seed,
        ..Settings::default()
    };
    let camera = PlanarCamera::new(SensorId(0), Outline::rectangle(50.0, 36.0)?, settings)?;
    Ok(camera.truth().into_values().collect())
}

/// Posterior beliefs of all frames.
///
/// # Errors
/// When the task is wrong, or a step or a measurement fails.
pub fn track(text: &str) -> Result<Vec<BeliefRecord>> {
    let map = "maximum a posteriori by Levenberg and Marquardt";
    let map = Method::<Estimators<Sim2>>::new("map", map, MaximumAPosteriori::build);
    let registry = Registry::standard().with(map.levels(&[Level::Pixel, Level::Object]));
    let document = Document::parse("flat", text, Path::new(""), &[], &|_| None)?;
    let task = check(&document, &registry)?;
    let mut scene = Scene::build(&document, &task, &registry)?;
    let mut first = scene.sensors[0].next()?;
    let frames: Vec<_> = first.iter().cloned().collect();
    let mut tracker = scene.tracking(&document, &task, &registry, &frames)?;
    let mut out = vec![];
    while let Some(frame) = first.take() {
        let report = tracker.step([frame])?.first().context("a target")?;
        if let Some(failure) = &report.failure {
            return Err(anyhow!("{failure}"));
        }
        out.push(report.posterior.clone());
        first = scene.sensors[0].next()?;
    }
    Ok(out)
}

/// Distance of the position from the truth, root mean square of the second half, pixels.
pub fn error(estimates: &[BeliefRecord], truth: &[Sim2]) -> f64 {
    let apart = |(e, t): (&BeliefRecord, &Sim2)| {
        (e.coordinates[0] - t.translation.x).powi(2) + (e.coordinates[1] - t.translation.y).powi(2)
    };
    let half = truth.len() / 2;
    (estimates.iter().zip(truth).skip(half).map(apart).sum::<f64>() / (truth.len() - half) as f64).sqrt()
}

/// Mean squared Mahalanobis length of the errors of a similarity's four coordinates, over four; 1 is honest.
pub fn nees(estimates: &[BeliefRecord], truth: &[Sim2]) -> f64 {
    let of = |(e, t): (&BeliefRecord, &Sim2)| e.get::<Sim2>()?.nees(t);
    let all: Vec<f64> = estimates.iter().zip(truth).filter_map(of).collect();
    all.iter().sum::<f64>() / (4 * all.len()) as f64
}

/// The maximum a posteriori of prediction and measurement by Levenberg and Marquardt's method: an estimator that a user adds.
struct MaximumAPosteriori(Box<dyn Estimator<Sim2>>);

impl MaximumAPosteriori {
    fn build(_: NoParams, context: EstimatorContext<Sim2>) -> Result<Box<dyn Estimator<Sim2>>, ConfigError> {
        let Motion::Pose(motion) = context.motion else {
            return Err(ConfigError::parameter("estimator", "map", "a state that is the pose alone"));
        };
        let filter = KalmanFilter::<Sim2, Sim2, _>::new(&context.prior, vec![], motion, 1)
            .map_err(|e| ConfigError::parameter("prior", e, "a finite one"))?;
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
