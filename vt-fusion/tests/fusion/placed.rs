//! Targets that are placed from outside, as an evaluation does after a failed frame.

use std::sync::{Arc, Mutex};

use nalgebra::{Matrix2, Vector2};
use vt_core::belief::Gaussian;
use vt_core::error::{EstimateError, MeasureError};
use vt_core::evidence::{Evidence, EvidenceKey};
use vt_core::lie::Vector;
use vt_core::measurement::{Measurement, Modality};
use vt_core::report::{BeliefRecord, Status};
use vt_fusion::TrackingLoop;
use vt_fusion::reinitialization::PriorPoses;
use vt_fusion::tracking::StepError;

use crate::sensors::{Direct, Plane, filter, frame, target};

fn near(x: f64, y: f64) -> Gaussian<Plane> {
    Gaussian::from_sigmas(Vector(Vector2::new(x, y)), &Vector2::repeat(0.5))
}

fn record(x: f64, y: f64) -> BeliefRecord {
    let mut out = BeliefRecord::default();
    out.set(&near(x, y));
    out
}

/// Sees within one unit, and notes where it looked and when it forgot.
struct Learner(Direct<Plane>, Arc<Mutex<Vec<String>>>);

impl Modality<Plane> for Learner {
    fn needs(&self) -> &[EvidenceKey] {
        &[]
    }
    fn measure(
        &mut self,
        evidence: &Evidence,
        prior: &Gaussian<Plane>,
    ) -> Result<Option<&dyn Measurement<Plane>>, MeasureError> {
        self.1.lock().expect("no panic").push(format!("look {:.0}", prior.mean.0.x));
        self.0.measure(evidence, prior)
    }
    fn last(&self) -> Option<&dyn Measurement<Plane>> {
        self.0.last()
    }
    fn forget(&mut self) {
        self.1.lock().expect("no panic").push("forget".into());
    }
}

fn learner(priors: Option<PriorPoses<Plane>>) -> (TrackingLoop, Arc<Mutex<Vec<String>>>) {
    let notes = Arc::new(Mutex::new(vec![]));
    let direct = Direct { reach: 1.0, ..Direct::new(0, Matrix2::identity() * 100.0) };
    let modality: Box<dyn Modality<Plane>> = Box::new(Learner(direct, notes.clone()));
    let reinitializer = priors.map(|p| Box::new(p) as _);
    let one = target("one", &[0], vec![modality], filter(0.0, 0.0), reinitializer);
    (TrackingLoop::new(vec![Box::new(one)]), notes)
}

fn notes(of: &Mutex<Vec<String>>) -> Vec<String> {
    core::mem::take(&mut *of.lock().expect("no panic"))
}

#[test]
fn a_placed_target_is_at_rest_trusted_and_learns_from_the_frame_at_hand() {
    let (mut tracker, seen) = learner(None);
    for k in 0..10 {
        tracker.step([frame(0, 40 * k, vec![0.04 * k as f64, 0.0])]).expect("a step");
    }
    for k in 10..14 {
        tracker.step([frame(0, 40 * k, vec![7.0, 3.0])]).expect("a step");
    }
    let report = &tracker.step([frame(0, 560, vec![7.0, 3.0])]).expect("a step")[0];
    assert_eq!(report.verdict.status, Status::Lost);
    notes(&seen);
    tracker.place(0, &record(7.0, 3.0)).expect("a belief of the plane");
    assert_eq!(notes(&seen), ["forget", "look 7"]);
    // Nothing of the speed before is left, and the frame at hand was no correction.
    let report = &tracker.step([frame(0, 600, vec![7.0, 3.0])]).expect("a step")[0];
    assert_eq!(report.verdict.status, Status::Tracking);
    let prediction = report.prediction.get::<Plane>().expect("a belief");
    assert!((prediction.mean.0 - Vector2::new(7.0, 3.0)).amax() < 1e-12);
    assert!(prediction.covariance[(0, 0)] > 0.25, "{}", prediction.covariance);
}

#[test]
fn a_belief_that_does_not_fit_changes_nothing() {
    let (mut tracker, seen) = learner(None);
    tracker.step([frame(0, 0, vec![0.0, 0.0])]).expect("a step");
    notes(&seen);
    let wrong = BeliefRecord { space: "se3", ..record(1.0, 1.0) };
    let error = tracker.place(0, &wrong).expect_err("another space");
    assert!(matches!(error, StepError::Estimate(EstimateError::Space { .. })), "{error}");
    let broken = BeliefRecord { covariance: vec![f64::NAN; 4], ..record(1.0, 1.0) };
    assert!(tracker.place(0, &broken).is_err());
    assert_eq!(notes(&seen), [] as [&str; 0]);
    let report = &tracker.step([frame(0, 40, vec![0.0, 0.0])]).expect("a step")[0];
    assert!(report.prediction.coordinates[0].abs() < 0.5);
}

/// Each proposal is judged without what the wrong place or another proposal taught.
#[test]
fn a_reinitialisation_forgets_before_every_proposal_and_after_them() {
    let places = PriorPoses { priors: vec![near(5.0, 5.0)], last_trusted: Some(1.0) };
    let (mut tracker, seen) = learner(Some(places));
    tracker.step([frame(0, 0, vec![0.0, 0.0])]).expect("a step");
    for k in 1..3 {
        tracker.step([frame(0, 40 * k, vec![])]).expect("a step");
    }
    notes(&seen);
    let report = &tracker.step([frame(0, 120, vec![5.0, 5.0])]).expect("a step")[0];
    assert!(report.reinitialized);
    assert_eq!(notes(&seen), ["look 0", "forget", "look 0", "forget", "look 5", "forget"]);
}
