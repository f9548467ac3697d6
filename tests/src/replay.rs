//! A task with all its frames in memory, to be run again and again.

use std::path::Path;

use anyhow::{Context, Result};
use cpu_time::ProcessTime;
use vt_core::frame::Frame;
use vt_core::report::StepReport;
use vt_fusion::tracking::TrackingLoop;
use vt_io::summary::Summary;
use vt_task::assembly::Scene;
use vt_task::{Document, Registry, check};

/// A checked task and its decoded frames.
pub struct Replay {
    document: Document,
    registry: Registry,
    frames: Vec<Frame>,
}

/// What one run gave.
pub struct Run {
    /// Reports of all steps of the first target.
    pub reports: Vec<StepReport>,
    /// Errors and conditions.
    pub summary: Summary,
    /// Time of the process's CPU clock from decoded pixels to the posterior, milliseconds a step.
    pub cpu_ms: Vec<f64>,
}

impl Replay {
    /// Loads a task of one sensor with the overrides `set`, such as `targets.cube.estimator.params.iterations=1`.
    ///
    /// # Errors
    /// When the task is wrong or a frame cannot be read.
    pub fn load(task: impl AsRef<Path>, set: &[&str]) -> Result<Self> {
        let set: Vec<String> = set.iter().map(ToString::to_string).collect();
        let registry = Registry::standard();
        let document = Document::load(task.as_ref(), &set)?;
        let checked = check(&document, &registry)?;
        let mut scene = Scene::build(&document, &checked, &registry)?;
        let sensor = scene.sensors.first_mut().context("the task has no sensor")?;
        let mut frames = vec![];
        while let Some(frame) = sensor.next()? {
            frames.push(frame);
        }
        Ok(Self { document, registry, frames })
    }

    /// The frames.
    pub fn frames(&self) -> &[Frame] {
        &self.frames
    }

    /// A fresh loop and an empty summary.
    ///
    /// # Errors
    /// When the task cannot be assembled.
    pub fn start(&self) -> Result<(TrackingLoop, Summary)> {
        let task = check(&self.document, &self.registry)?;
        let scene = Scene::build(&self.document, &task, &self.registry)?;
        let first = self.frames.get(..1).context("the sensor has no frames")?;
        let tracking = scene.tracking(&self.document, &task, &self.registry, first)?;
        Ok((tracking, scene.summary(&task)))
    }

    /// Runs the task from its first frame to its last.
    ///
    /// # Errors
    /// When the task cannot be assembled or a step fails.
    pub fn run(&self) -> Result<Run> {
        let (mut tracking, mut summary) = self.start()?;
        let mut reports = Vec::with_capacity(self.frames.len());
        let mut cpu_ms = Vec::with_capacity(self.frames.len());
        for frame in &self.frames {
            let frame = frame.clone();
            let begin = ProcessTime::now();
            let step = tracking.step([frame])?;
            cpu_ms.push(begin.elapsed().as_secs_f64() * 1e3);
            reports.extend(step.first().cloned());
            tracking.with_step(|s| summary.add(s));
        }
        Ok(Run { reports, summary, cpu_ms })
    }
}

/// Middle value (nearest rank); NaN without values.
pub fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(f64::NAN)
}
