//! Convergence basin: what a task's tracker makes of start poses around the truth on single frames.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use cpu_time::ProcessTime;
use vt_core::frame::Frame;
use vt_core::lie::SE3;
use vt_core::metrics::PoseError;
use vt_io::truth::Truth;
use vt_task::assembly::Scene;
use vt_task::{Document, Registry, check};

/// A task with its frames, to be started again and again.
pub struct Basin {
    task: std::path::PathBuf,
    set: Vec<String>,
    target: String,
    registry: Registry,
    scene: Scene,
    frames: Vec<Frame>,
    /// True poses by frame.
    pub truth: Truth,
}

/// A start pose and what became of it.
#[derive(Clone, Copy, Debug)]
pub struct Outcome {
    /// Error of the posterior.
    pub error: PoseError,
    /// Probability of loss that the tracker states.
    pub loss_probability: f64,
    /// Time of the process's CPU clock for the step, milliseconds.
    pub cpu_ms: f64,
}

impl Outcome {
    /// Below 2 mm and 0.5 deg, as the comparison programs count.
    pub fn converged(&self) -> bool {
        self.error.within(2e-3, 0.5f64.to_radians())
    }
}

impl Basin {
    /// Loads a task of one sensor and one target with truth.
    ///
    /// # Errors
    /// When the task is wrong or a frame cannot be read.
    pub fn load(task: impl AsRef<Path>, set: &[String]) -> Result<Self> {
        let registry = Registry::standard();
        let document = Document::load(task.as_ref(), set)?;
        let checked = check(&document, &registry)?;
        let target = checked.targets.first().context("the task has no target")?.name.clone();
        let mut scene = Scene::build(&document, &checked, &registry)?;
        let truth = scene.truths.first().cloned().flatten().context("the target has no truth")?;
        let sensor = scene.sensors.first_mut().context("the task has no sensor")?;
        let mut frames = vec![];
        while let Some(frame) = sensor.next()? {
            frames.push(frame);
        }
        Ok(Self { task: task.as_ref().to_owned(), set: set.to_vec(), target, registry, scene, frames, truth })
    }

    /// One step of a fresh tracker on frame `number` from `start`, with these deviations of the prior in metres and
    /// radians.
    ///
    /// # Errors
    /// When there is no such frame or the step fails.
    pub fn try_start(&self, number: u64, start: &SE3, sigma: [f64; 2]) -> Result<Outcome> {
        let frame = self.frames.iter().find(|f| f.number == number).context("no such frame")?;
        let truth = self.truth.poses.get(&number).context("no truth of this frame")?;
        let (t, q) = (start.translation, start.rotation.coords);
        let init = format!(
            "targets.{}.init={{ kind = \"pose\", params = {{ camera_from_object = {{ translation = [\"{} m\", \"{} m\", \
             \"{} m\"], quaternion = [{}, {}, {}, {}] }}, sigma = {{ translation = \"{} m\", rotation = \"{} rad\" }} }} }}",
            self.target, t.x, t.y, t.z, q.x, q.y, q.z, q.w, sigma[0], sigma[1]
        );
        let set: Vec<String> = self.set.iter().cloned().chain([init]).collect();
        let document = Document::load(&self.task, &set)?;
        let task = check(&document, &self.registry)?;
        let mut tracking =
            self.scene.tracking(&document, &task, &self.registry, core::slice::from_ref(frame))?;
        let frame = [frame.clone()];
        let begin = ProcessTime::now();
        let report = &tracking.step(frame)?[0];
        let cpu_ms = begin.elapsed().as_secs_f64() * 1e3;
        let estimate = report.posterior.get::<SE3>().context("not a rigid pose")?.mean;
        let error = PoseError::new(&estimate, truth);
        Ok(Outcome { error, loss_probability: report.verdict.loss_probability, cpu_ms })
    }
}

/// Reads start poses: lines `frame tx ty tz qx qy qz qw`, camera_from_object, metres, any number for a frame.
///
/// # Errors
/// When the file cannot be read or a line is something else.
pub fn read_starts(path: &Path) -> Result<Vec<(u64, SE3)>> {
    let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
    let mut starts = vec![];
    for line in text.lines().filter(|l| !l.starts_with('#')) {
        let v: Vec<f64> = line.split_whitespace().map(str::parse).collect::<Result<_, _>>()?;
        ensure!(v.len() == 8, "{line}: expected frame and seven numbers");
        let rotation =
            nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(v[7], v[4], v[5], v[6]));
        starts.push((v[0] as u64, SE3::new(rotation, nalgebra::Vector3::new(v[1], v[2], v[3]))));
    }
    Ok(starts)
}
