//! Figures of a whole run: conditions, errors against truth, consistency, time.

use std::time::{Duration, Instant};

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use serde::Serialize;
use vt_core::agent::Step;
use vt_core::lie::SE3;
use vt_core::report::{Status, StepReport};

use crate::boxes::{Bounds, around, seen};
use crate::truth::Truth;

/// Mean, median, 95 % and largest of some values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Statistics {
    /// Mean.
    pub mean: f64,
    /// Median.
    pub median: f64,
    /// 95th percentile.
    pub p95: f64,
    /// Largest.
    pub max: f64,
}

impl Statistics {
    /// Of these values; `None` without any.
    pub fn of(values: &[f64]) -> Option<Self> {
        let mut v = values.to_vec();
        v.sort_by(f64::total_cmp);
        let last = v.len().checked_sub(1)?;
        let quantile = |q: f64| {
            let at = q * last as f64;
            let k = at as usize;
            v[k] + (v[(k + 1).min(last)] - v[k]) * (at - k as f64)
        };
        let mean = v.iter().sum::<f64>() / v.len() as f64;
        Some(Self { mean, median: quantile(0.5), p95: quantile(0.95), max: v[last] })
    }
}

/// Figures of one target.
#[derive(Clone, Debug, Default)]
pub struct TargetSummary {
    /// Name.
    pub name: String,
    /// Steps in each condition: tracking, doubtful, lost.
    pub states: [usize; 3],
    /// Steps with a re-initialisation.
    pub reinitialized: usize,
    /// Steps without a measurement because something failed.
    pub failures: usize,
    /// Distance from the true position in metres, of steps that are not lost.
    pub translation_errors: Vec<f64>,
    /// Angle from the true orientation in radians, of the same steps.
    pub rotation_errors: Vec<f64>,
    /// Distance in pixels between the centres of the upright boxes around a flat shape and around its truth, of the same steps.
    pub centre_errors: Vec<f64>,
    /// Overlap of these boxes, intersection over union.
    pub overlaps: Vec<f64>,
    /// Time for tracking in seconds, each step, without outputs.
    pub seconds: Vec<f64>,
    truth: Option<Truth>,
    bounds: Bounds,
}

/// Figures of a run.
#[derive(Clone, Debug)]
pub struct Summary {
    /// Number of steps.
    pub steps: usize,
    /// One for each target.
    pub targets: Vec<TargetSummary>,
    started: Instant,
    /// Time from the first step to the last, with sensors and outputs.
    pub wall: Duration,
}

impl Summary {
    /// An empty summary of these targets, with truth where it is known, and with the bounds of those that are flat.
    pub fn new(targets: impl IntoIterator<Item = (String, Option<Truth>, Bounds)>) -> Self {
        let target = |(name, truth, bounds)| TargetSummary { name, truth, bounds, ..Default::default() };
        Self {
            steps: 0,
            targets: targets.into_iter().map(target).collect(),
            started: Instant::now(),
            wall: Duration::ZERO,
        }
    }

    /// Takes in a step.
    pub fn add(&mut self, step: &Step<'_>) {
        self.steps += 1;
        for (target, report) in self.targets.iter_mut().zip(step.reports) {
            target.add(report);
        }
        self.wall = self.started.elapsed();
    }

    /// Frames per second of the whole run, with sensors and outputs.
    pub fn frames_per_second(&self) -> f64 {
        self.steps as f64 / self.wall.as_secs_f64().max(1e-9)
    }
}

impl TargetSummary {
    fn add(&mut self, report: &StepReport) {
        self.states[report.verdict.status as usize] += 1;
        self.reinitialized += usize::from(report.reinitialized);
        self.failures += usize::from(report.failure.is_some());
        let t = &report.timings;
        self.seconds.push((t.predict + t.measure + t.correct + t.assess + t.reinitialize) as f64 * 1e-9);
        let Some(truth) = self.truth.as_ref().filter(|_| report.verdict.status != Status::Lost) else {
            return;
        };
        if let Some((truth, pose)) = truth.poses.get(&report.frame).zip(pose(report)) {
            self.translation_errors.push((truth.translation - pose.translation).norm());
            self.rotation_errors.push(truth.rotation.angle_to(&pose.rotation));
        }
        if let Some((truth, corners)) = truth.corners.get(&report.frame).zip(seen(report, &self.bounds)) {
            let [truth, found] = [truth, &corners].map(around);
            self.centre_errors.push(truth.centre_error(&found));
            self.overlaps.push(truth.iou(&found));
        }
    }

    /// What is true, where that is known.
    pub fn truth(&self) -> Option<&Truth> {
        self.truth.as_ref()
    }
}

/// The posterior pose of a report, where it is one of SE(3).
pub fn pose(report: &StepReport) -> Option<SE3> {
    let c = &report.posterior.coordinates;
    (report.posterior.space == "se3" && c.len() == 7).then(|| SE3 {
        rotation: UnitQuaternion::from_quaternion(Quaternion::new(c[6], c[3], c[4], c[5])),
        translation: Vector3::new(c[0], c[1], c[2]),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statistics_of_known_values() {
        let s = Statistics::of(&[4.0, 1.0, 2.0, 3.0, 5.0]).unwrap();
        assert_eq!((s.mean, s.median, s.max), (3.0, 3.0, 5.0));
        assert!((s.p95 - 4.8).abs() < 1e-12);
        assert_eq!(Statistics::of(&[]), None);
    }
}
