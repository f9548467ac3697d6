//! Everything that a step knows, one JSON object a line.

use core::ops::ControlFlow;
use std::path::Path;

use serde_json::{Value, json};
use vt_core::agent::{Output, Step};
use vt_core::error::DeviceError;
use vt_core::report::{BeliefRecord, StepReport};

use crate::files::Lines;

/// Writes `steps.jsonl`: one line for each step and target, with a running step index, since frames may repeat.
/// Wall-clock times differ from run to run, so they are written only when asked for.
pub struct Steps {
    lines: Lines,
    index: u64,
    timings: bool,
}

impl Steps {
    /// A file in `folder`.
    ///
    /// # Errors
    /// [`DeviceError`] when the file cannot be made.
    pub fn create(folder: &Path, timings: bool) -> Result<Self, DeviceError> {
        Ok(Self { lines: Lines::create(folder.join("steps.jsonl"), "")?, index: 0, timings })
    }
}

impl Output for Steps {
    fn step(&mut self, step: &Step<'_>) -> Result<ControlFlow<()>, DeviceError> {
        for report in step.reports {
            let line = record(self.index, report, self.timings).to_string();
            self.lines.buffer().push_str(&line);
            self.lines.buffer().push('\n');
        }
        self.index += 1;
        self.lines.flush()?;
        Ok(ControlFlow::Continue(()))
    }
}

fn belief(b: &BeliefRecord) -> Value {
    json!({ "space": b.space, "coordinates": b.coordinates, "covariance": b.covariance })
}

fn record(index: u64, r: &StepReport, timings: bool) -> Value {
    let quality = r.assessment.quality.map(|q| {
        json!({
            "expected": q.expected, "inliers": q.inliers, "inlier_ratio": q.inlier_ratio,
            "log_ratio": q.log_ratio, "normalized_rms": q.normalized_rms,
        })
    });
    let innovation = r.assessment.innovation.map(|i| {
        json!({
            "nis": i.nis, "dof": i.dof, "log_evidence": i.log_evidence, "iterations": i.iterations,
            "effective_particles": i.effective_particles, "stop": format!("{:?}", i.stop),
        })
    });
    let mut line = json!({
        "step": index, "frame": r.frame, "time_ns": r.time.0, "target": r.target,
        "status": r.verdict.status.name(), "loss_probability": r.verdict.loss_probability,
        "reinitialized": r.reinitialized,
        "prediction": belief(&r.prediction), "posterior": belief(&r.posterior),
        "quality": quality, "innovation": innovation, "log_det": r.assessment.log_det,
        "unobservable": r.unobservable, "failure": r.failure,
    });
    if timings {
        let t = &r.timings;
        line["timings_ns"] = json!({
            "predict": t.predict, "measure": t.measure, "correct": t.correct, "assess": t.assess,
            "reinitialize": t.reinitialize,
        });
    }
    line
}
