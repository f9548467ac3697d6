//! One JSON file with the figures of a run.

use core::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use serde_json::{Value, json};
use vt_core::agent::{Output, Step};
use vt_core::error::DeviceError;

use crate::files::{forget, replace};
use crate::summary::{Statistics, Summary, TargetSummary};

/// What a report says about the run besides its figures.
#[derive(Clone, Debug, Default)]
pub struct Header {
    /// Name of the task file.
    pub task: String,
    /// Title of the task.
    pub title: Option<String>,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Set when the run is ended before its time.
    pub interrupted: Arc<AtomicBool>,
}

/// Writes `report.json` at the end of a run, also of an interrupted one: conditions, errors against truth in mm and
/// degrees, and under `timing` what differs from run to run.
pub struct Report {
    path: PathBuf,
    header: Header,
    summary: Summary,
}

impl Report {
    /// A report in `folder`, written when the run finishes.
    ///
    /// # Errors
    /// [`DeviceError`] when an old report cannot be removed: it would be mistaken for that of this run.
    pub fn create(folder: &Path, header: Header, summary: Summary) -> Result<Self, DeviceError> {
        let path = folder.join("report.json");
        forget(&path)?;
        Ok(Self { path, header, summary })
    }
}

impl Output for Report {
    fn step(&mut self, step: &Step<'_>) -> Result<ControlFlow<()>, DeviceError> {
        self.summary.add(step);
        Ok(ControlFlow::Continue(()))
    }

    fn finish(&mut self) -> Result<(), DeviceError> {
        let report = json!({
            "task": self.header.task, "title": self.header.title, "seed": self.header.seed,
            "version": env!("CARGO_PKG_VERSION"),
            "frames": self.summary.steps,
            "interrupted": self.header.interrupted.load(Ordering::Relaxed),
            "targets": self.summary.targets.iter().map(target).collect::<Vec<_>>(),
            "timing": {
                "seconds": self.summary.wall.as_secs_f64(),
                "frames_per_second": self.summary.frames_per_second(),
                "tracking_ms": self.summary.targets.iter().map(|t| scaled(&t.seconds, 1e3)).collect::<Vec<_>>(),
            },
        });
        replace(&self.path, format!("{report:#}\n").as_bytes())
    }
}

fn scaled(values: &[f64], factor: f64) -> Option<Statistics> {
    Statistics::of(&values.iter().map(|v| v * factor).collect::<Vec<_>>())
}

fn target(t: &TargetSummary) -> Value {
    let errors = t.truth().map(|_| {
        json!({
            "compared": t.translation_errors.len().max(t.centre_errors.len()),
            "translation_mm": scaled(&t.translation_errors, 1e3),
            "rotation_deg": scaled(&t.rotation_errors, 180.0 / core::f64::consts::PI),
            "centre_px": Statistics::of(&t.centre_errors),
            "overlap": Statistics::of(&t.overlaps),
        })
    });
    json!({
        "name": t.name,
        "states": { "tracking": t.states[0], "doubtful": t.states[1], "lost": t.states[2] },
        "reinitialized": t.reinitialized, "failures": t.failures, "errors": errors,
    })
}
