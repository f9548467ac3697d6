//! Models adapt to steps that are trusted, and to no others.

use std::sync::{Arc, Mutex};

use nalgebra::{Matrix2, Vector2};
use vt_core::agent::Reinitializer;
use vt_core::belief::Gaussian;
use vt_core::error::MeasureError;
use vt_core::evidence::{Evidence, EvidenceKey};
use vt_core::lie::Vector;
use vt_core::measurement::{Measurement, Modality};
use vt_core::report::{BeliefRecord, Status};
use vt_fusion::TrackingLoop;

use crate::sensors::{Direct, Plane, filter, frame, target};

type Notes = Arc<Mutex<Vec<String>>>;

fn note(notes: &Notes, what: impl Into<String>) {
    notes.lock().expect("no panic").push(what.into());
}

fn notes(of: &Notes) -> Vec<String> {
    core::mem::take(&mut *of.lock().expect("no panic"))
}

/// Sees within one unit, and notes what it adapts to.
struct Adaptive(Direct<Plane>, Notes);

impl Modality<Plane> for Adaptive {
    fn needs(&self) -> &[EvidenceKey] {
        &[]
    }
    fn measure(
        &mut self,
        evidence: &Evidence,
        prior: &Gaussian<Plane>,
    ) -> Result<Option<&dyn Measurement<Plane>>, MeasureError> {
        self.0.measure(evidence, prior)
    }
    fn last(&self) -> Option<&dyn Measurement<Plane>> {
        self.0.last()
    }
    fn forget(&mut self) {
        note(&self.1, "forget");
    }
    fn adapt(&mut self, evidence: &Evidence, posterior: &Gaussian<Plane>) -> Result<(), MeasureError> {
        note(&self.1, format!("adapt {:.0}", posterior.mean.0.x));
        evidence.frame(self.0.sensor).map(drop)
    }
    fn revert(&mut self) {
        note(&self.1, "revert");
    }
}

/// Proposes one place, and notes what it learns.
struct Place(Gaussian<Plane>, Notes);

impl Reinitializer<Plane> for Place {
    fn adapt(&mut self, _: &Evidence, posterior: &Gaussian<Plane>) -> Result<(), MeasureError> {
        note(&self.1, format!("learn {:.0}", posterior.mean.0.x));
        Ok(())
    }
    fn forget(&mut self) {
        note(&self.1, "forget places");
    }
    fn propose(
        &mut self,
        _: &Evidence,
        _: &Gaussian<Plane>,
        out: &mut Vec<Gaussian<Plane>>,
    ) -> Result<(), MeasureError> {
        out.push(self.0.clone());
        Ok(())
    }
}

fn tracker(place: bool) -> (TrackingLoop, Notes) {
    let seen = Notes::default();
    let direct = Direct { reach: 1.0, ..Direct::new(0, Matrix2::identity() * 100.0) };
    let modality: Box<dyn Modality<Plane>> = Box::new(Adaptive(direct, seen.clone()));
    let there = Gaussian::from_sigmas(Vector(Vector2::new(5.0, 5.0)), &Vector2::repeat(0.5));
    let reinitializer = place.then(|| Box::new(Place(there, seen.clone())) as _);
    let one = target("one", &[0], vec![modality], filter(0.0, 0.0), reinitializer);
    (TrackingLoop::new(vec![Box::new(one)]), seen)
}

#[test]
fn nothing_adapts_while_doubtful_lost_or_unseen() {
    let (mut tracker, seen) = tracker(false);
    let (here, nowhere) = (vec![0.0, 0.0], vec![]);
    let mut adapted = vec![];
    for (k, z) in [&here, &here, &nowhere, &nowhere, &nowhere, &here, &here, &here, &here, &here, &here]
        .into_iter()
        .enumerate()
    {
        let status = tracker.step([frame(0, 40 * k as i64, z.clone())]).expect("a step")[0].verdict.status;
        let did = notes(&seen);
        assert_eq!(did, if status == Status::Tracking { vec!["adapt 0"] } else { vec![] }, "step {k}");
        adapted.push(!did.is_empty());
    }
    let expected = [true, true, false, false, false, false, false, false, false, true, true];
    assert_eq!(adapted, expected);
    // A step of another sensor is none of this target's.
    tracker.step([frame(1, 500, here)]).expect("a step");
    assert!(notes(&seen).is_empty());
}

/// Before each proposal and after them; and after a place was found nothing adapts until it is confirmed.
#[test]
fn a_reinitialisation_reverts_and_a_placement_forgets() {
    let (mut tracker, seen) = tracker(true);
    let mut step = |k: i64, z: Vec<f64>| {
        let report = &tracker.step([frame(0, 40 * k, z)]).expect("a step")[0];
        (report.verdict.status, report.reinitialized, notes(&seen))
    };
    assert_eq!(step(0, vec![0.0, 0.0]).2, ["adapt 0", "learn 0"]);
    for k in 1..3 {
        assert_eq!(step(k, vec![]).2, [] as [&str; 0]);
    }
    let expected = ["revert", "revert"].map(String::from).to_vec();
    assert_eq!(step(3, vec![5.0, 5.0]), (Status::Doubtful, true, expected));
    assert_eq!(step(4, vec![5.0, 5.0]), (Status::Doubtful, false, vec![]));
    assert_eq!(step(5, vec![5.0, 5.0]).2, ["adapt 5", "learn 5"]);
    let mut record = BeliefRecord::default();
    record.set(&Gaussian::from_sigmas(Vector(Vector2::new(7.0, 3.0)), &Vector2::repeat(0.5)));
    tracker.place(0, &record).expect("a belief of the plane");
    assert_eq!(notes(&seen), ["forget", "forget places"]);
}
