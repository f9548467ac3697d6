//! Loss and re-initialisation in the loop.

use nalgebra::{Matrix2, Vector2};
use vt_core::agent::LossDetector;
use vt_core::belief::Gaussian;
use vt_core::error::MeasureError;
use vt_core::evidence::{Evidence, EvidenceKey, Processing, Slot};
use vt_core::frame::{Frame, Roi, SensorId};
use vt_core::lie::Vector;
use vt_core::measurement::{Measurement, Modality};
use vt_core::report::{Assessment, Status, Verdict};
use vt_fusion::loss::Hysteresis;
use vt_fusion::reinitialization::PriorPoses;
use vt_fusion::{Target, TrackingLoop};

use crate::sensors::{Direct, Plane, filter, frame, target};

fn near(x: f64, y: f64) -> Gaussian<Plane> {
    Gaussian::from_sigmas(Vector(Vector2::new(x, y)), &Vector2::repeat(0.5))
}

/// Sees only what is within one unit of the prediction.
fn short_sighted() -> Box<dyn Modality<Plane>> {
    Box::new(Direct { reach: 1.0, ..Direct::new(0, Matrix2::identity() * 100.0) })
}

fn statuses(tracker: &mut TrackingLoop, from: i64, seen: &[Vec<f64>]) -> Vec<(Status, bool)> {
    let steps = seen.iter().enumerate();
    steps
        .map(|(k, z)| {
            let report = &tracker.step([frame(0, from + 40 * k as i64, z.clone())]).expect("a step")[0];
            (report.verdict.status, report.reinitialized)
        })
        .collect()
}

use Status::{Doubtful as D, Lost as L, Tracking as T};

#[test]
fn a_target_without_measurement_coasts_is_doubtful_then_lost() {
    let mut tracker =
        TrackingLoop::new(vec![Box::new(target("one", &[0], vec![short_sighted()], filter(0.0, 0.0), None))]);
    for k in 0..10 {
        tracker.step([frame(0, 40 * k, vec![0.04 * k as f64, 0.0])]).expect("a step");
    }
    let mut last = (0.36, 0.0);
    for k in 10..20 {
        let report = &tracker.step([frame(0, 40 * k, vec![])]).expect("a step")[0];
        let now = (report.posterior.coordinates[0], report.posterior.covariance[0]);
        // One unit a second, and ever less certain.
        assert!((now.0 - last.0 - 0.04).abs() < 0.005 && now.1 > last.1, "{now:?} after {last:?}");
        last = now;
        assert_eq!(report.posterior, report.prediction);
        assert!(report.assessment.quality.is_none() && report.assessment.innovation.is_none());
        assert!(report.verdict.loss_probability > 0.5 && report.failure.is_none());
        assert_eq!(report.verdict.status, if k < 12 { D } else { L });
    }
    // Without a re-initialiser it is found where it coasts, after five good steps.
    let seen: Vec<Vec<f64>> = (20..26).map(|k| vec![0.04 * f64::from(k), 0.0]).collect();
    assert_eq!(bare(&statuses(&mut tracker, 800, &seen)), [L, L, L, L, T, T]);
}

/// Statuses alone.
fn bare(seen: &[(Status, bool)]) -> Vec<Status> {
    seen.iter().map(|(s, _)| *s).collect()
}

/// Seen, gone, back at one of the priors, seen again.
#[test]
fn a_lost_target_is_found_at_a_prior() {
    let places = PriorPoses { priors: vec![near(-5.0, 0.0), near(5.0, 5.0)], last_trusted: Some(1.5) };
    let one = target("one", &[0], vec![short_sighted()], filter(0.0, 0.0), Some(Box::new(places)));
    let mut tracker = TrackingLoop::new(vec![Box::new(one)]);
    let (home, away, elsewhere) = (vec![0.1, 0.0], vec![5.2, 4.9], vec![50.0, 50.0]);
    assert_eq!(statuses(&mut tracker, 0, &[home.clone(), home.clone()]), [(T, false); 2]);
    // Elsewhere: doubtful, lost, no prior fits.
    let seen = statuses(&mut tracker, 80, &vec![elsewhere; 6]);
    assert_eq!(seen, [(D, false), (D, false), (L, false), (L, false), (L, false), (L, false)]);
    // At a prior: found in that very step, and tracked when two more have confirmed it.
    let seen = statuses(&mut tracker, 400, &vec![away; 4]);
    assert_eq!(seen, [(D, true), (D, false), (T, false), (T, false)]);
    let report = &tracker.step([frame(0, 600, vec![5.2, 4.9])]).expect("a step")[0];
    assert!(
        (report.posterior.coordinates[0] - 5.2).abs() < 0.02
            && (report.posterior.coordinates[1] - 4.9).abs() < 0.02
    );
    // Gone again, then back where it was last trusted.
    let seen = statuses(&mut tracker, 640, &vec![vec![]; 4]);
    assert_eq!(bare(&seen), [D, D, L, L]);
    let seen = statuses(&mut tracker, 800, &[vec![5.2, 4.9], vec![5.2, 4.9]]);
    assert!(bare(&seen) == [T, T]);
}

/// Remembers the region it was asked for.
struct Region(EvidenceKey);

impl Processing for Region {
    fn key(&self) -> &EvidenceKey {
        &self.0
    }
    fn run(&self, _: &Frame, roi: Option<Roi>, slot: &mut Slot) -> Result<(), MeasureError> {
        *slot.buffer::<Option<Roi>>() = roi;
        Ok(())
    }
}

/// Looks at a region while it knows where, and refuses to look outside of what was prepared.
struct Restricted {
    needs: [EvidenceKey; 1],
    inner: Box<dyn Modality<Plane>>,
    home: f64,
}

impl Modality<Plane> for Restricted {
    fn needs(&self) -> &[EvidenceKey] {
        &self.needs
    }
    fn region(&self, _: &Gaussian<Plane>) -> Option<Roi> {
        Some(Roi { x: 0, y: 0, width: 1, height: 1 })
    }
    fn measure(
        &mut self,
        evidence: &Evidence,
        prior: &Gaussian<Plane>,
    ) -> Result<Option<&dyn Measurement<Plane>>, MeasureError> {
        let region = evidence.get::<Option<Roi>>(&self.needs[0])?;
        let outside = (prior.mean.0.x - self.home).abs() > 1.0;
        assert!(region.is_none() || !outside, "measured at {} inside of {region:?}", prior.mean.0.x);
        self.inner.measure(evidence, prior)
    }
    fn last(&self) -> Option<&dyn Measurement<Plane>> {
        self.inner.last()
    }
}

/// Priors far from the prediction are tried on the whole picture only.
#[test]
fn the_search_for_a_lost_target_is_not_restricted() {
    let key = EvidenceKey { sensor: SensorId(0), name: "region".into() };
    let modality = Restricted { needs: [key.clone()], inner: short_sighted(), home: 0.0 };
    let places = PriorPoses { priors: vec![near(5.0, 5.0)], last_trusted: None };
    let one = target("one", &[0], vec![Box::new(modality)], filter(0.0, 0.0), Some(Box::new(places)));
    let mut tracker = TrackingLoop::new(vec![Box::new(one)]);
    tracker.add_processing(Box::new(Region(key)));
    let (home, away) = (vec![0.0, 0.0], vec![5.0, 5.0]);
    let seen = statuses(&mut tracker, 0, &[home.clone(), away.clone(), away.clone(), away]);
    assert_eq!(seen, [(T, false), (D, false), (D, false), (D, true)]);
}

/// Judges by whether anything was seen.
struct Sight(Hysteresis);

impl LossDetector for Sight {
    fn assess(&mut self, figures: &Assessment) -> Verdict {
        let loss_probability = if figures.quality.is_some() { 0.1 } else { 0.9 };
        Verdict { status: self.0.step(loss_probability), loss_probability }
    }
    fn reset(&mut self) {
        self.0.reset();
    }
}

/// A proposal that the next picture contradicts was no re-appearance: what was trusted before it is tried again.
#[test]
fn a_proposal_counts_as_tracked_when_the_next_steps_confirm_it() {
    let places = PriorPoses { priors: vec![near(5.0, 5.0)], last_trusted: Some(1.5) };
    let estimator = Box::new(filter(0.0, 0.0));
    let (loss, places) = (Box::new(Sight(Hysteresis::default())), Some(Box::new(places) as Box<_>));
    let scale = Vector2::repeat(1.0);
    let one = Target::new("one", vec![], vec![short_sighted()], estimator, loss, places, scale);
    let mut tracker = TrackingLoop::new(vec![Box::new(one)]);
    let (home, away, elsewhere) = (vec![0.1, 0.0], vec![5.2, 4.9], vec![50.0, 50.0]);
    let seen = [&home, &elsewhere, &elsewhere, &away, &elsewhere, &away, &away, &away, &away];
    let seen = statuses(&mut tracker, 0, &seen.map(Clone::clone));
    let taken = [(T, false), (D, false), (D, false), (D, true), (L, false)];
    assert_eq!(seen[..5], taken);
    assert_eq!(seen[5..], [(D, true), (D, false), (T, false), (T, false)]);
}
