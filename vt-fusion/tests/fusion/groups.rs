//! Targets that share detections.

use nalgebra::Vector2;
use vt_core::belief::Gaussian;
use vt_core::error::MeasureError;
use vt_core::evidence::{Evidence, EvidenceKey};
use vt_core::frame::SensorId;
use vt_core::lie::Vector;
use vt_core::measurement::Detector;
use vt_core::report::{Status, StepReport};
use vt_estimators::association::NearestNeighbour;
use vt_fusion::{Group, TrackingLoop};

use crate::sensors::{Direct, Plane, filter, frame, random, target};

/// Positions `x y x y …` with deviations of 5 cm; a frame of odd length is no such list.
struct Positions;

impl Detector<Plane> for Positions {
    fn needs(&self) -> &[EvidenceKey] {
        &[]
    }
    fn detect(&mut self, evidence: &Evidence, out: &mut Vec<Gaussian<Plane>>) -> Result<(), MeasureError> {
        let numbers = evidence.frame(SensorId(0))?.vector()?;
        if numbers.len() % 2 == 1 {
            let (found, expected) = ("an odd number of coordinates".into(), "pairs".into());
            return Err(MeasureError::Payload { sensor: 0, found, expected });
        }
        let places = numbers.chunks(2).map(|c| Vector(Vector2::new(c[0], c[1])));
        out.extend(places.map(|z| Gaussian::from_sigmas(z, &Vector2::repeat(0.05))));
        Ok(())
    }
}

/// Targets at these places under one detector on sensor 0.
fn group(places: &[(&str, f64, f64)]) -> Group<Plane> {
    let targets = places.iter().map(|&(name, x, y)| target(name, &[0], vec![], filter(x, y), None));
    let nearest = Box::new(NearestNeighbour::default());
    Group::new(targets.collect(), Box::new(Positions), nearest, vec![SensorId(0)], 13.8)
}

fn place(report: &StepReport) -> Vector2<f64> {
    Vector2::from_column_slice(&report.posterior.coordinates)
}

/// Two targets cross at right angles, are seen in changing order, with clutter, and for three frames around the
/// crossing only one detection is left; a third target with a modality of its own runs beside them.
#[test]
fn crossing_targets_keep_their_names() {
    let alone = target(
        "alone",
        &[1],
        vec![Box::new(Direct::new(1, nalgebra::Matrix2::identity() * 100.0))],
        filter(9.0, 9.0),
        None,
    );
    let mut tracker =
        TrackingLoop::new(vec![Box::new(group(&[("a", 0.0, 0.0), ("b", 2.0, -2.0)])), Box::new(alone)]);
    assert_eq!(tracker.count(), 3);
    let random = &mut random(1);
    for k in 0..100 {
        let t = 0.04 * k as f64;
        let noise = |random: &mut vt_core::random::Random| Vector2::from_fn(|_, _| 0.05 * random.normal());
        let truth = [Vector2::new(t, 0.0), Vector2::new(2.0, t - 2.0)];
        let seen = truth.map(|p| p + noise(random));
        let mut numbers: Vec<f64> = match k {
            49..52 => vec![seen[0].x, seen[0].y],
            _ if k % 2 == 0 => vec![seen[0].x, seen[0].y, seen[1].x, seen[1].y],
            _ => vec![seen[1].x, seen[1].y, seen[0].x, seen[0].y],
        };
        numbers.extend([6.0 * random.uniform() + 3.0, 6.0 * random.uniform() + 3.0]);
        // Every other step the sensor of the third target is there too.
        let beside = (k % 2 == 0).then(|| frame(1, 40 * k, vec![9.0, 9.0]));
        let reports = tracker.step([frame(0, 40 * k, numbers)].into_iter().chain(beside)).expect("a step");
        let names: Vec<&str> = reports.iter().map(|r| r.target.as_str()).collect();
        assert_eq!(names, ["a", "b", "alone"]);
        if k > 10 {
            for (report, truth) in reports.iter().zip(&truth) {
                let error = (place(report) - truth).norm();
                assert!(error < 0.25, "{} is {error} off at step {k}", report.target);
            }
            assert!((place(&reports[2]) - Vector2::repeat(9.0)).norm() < 1e-6);
        }
        assert!(reports.iter().all(|r| r.verdict.status != Status::Lost && r.failure.is_none()));
    }
}

/// Side by side, closer than the gate: each detection goes to the nearer one, none is used twice.
#[test]
fn parallel_targets_share_nothing() {
    let mut tracker = TrackingLoop::new(vec![Box::new(group(&[("a", 0.0, 0.0), ("b", 0.0, 0.4)]))]);
    for k in 0..50 {
        let t = 0.04 * k as f64;
        let reports = tracker.step([frame(0, 40 * k, vec![t, 0.4, t, 0.0])]).expect("a step");
        assert!(place(&reports[0]).y.abs() < 1e-9 && (place(&reports[1]).y - 0.4).abs() < 1e-9, "step {k}");
    }
    // One detection for two: the other goes without, and says so.
    let reports = tracker.step([frame(0, 2000, vec![2.0, 0.4])]).expect("a step");
    assert!(reports[0].assessment.quality.is_none() && reports[1].assessment.quality.is_some());
    assert_eq!((reports[0].verdict.status, reports[1].verdict.status), (Status::Doubtful, Status::Tracking));
    // Beyond the gate is nobody's.
    let reports = tracker.step([frame(0, 2040, vec![30.0, 0.4])]).expect("a step");
    assert!(reports.iter().all(|r| r.assessment.quality.is_none()));
}

#[test]
fn a_failing_detector_is_reported_and_a_silent_one_is_no_failure() {
    let mut tracker = TrackingLoop::new(vec![Box::new(group(&[("a", 0.0, 0.0), ("b", 1.0, 0.0)]))]);
    tracker.step([frame(0, 0, vec![0.0, 0.0, 1.0, 0.0])]).expect("a step");
    let reports = tracker.step([frame(0, 40, vec![0.0])]).expect("a step");
    assert!(reports.iter().all(|r| r.failure.as_ref().is_some_and(|f| f.contains("odd number"))));
    // Steps of other sensors only: no failure, no judgement.
    for k in 2..20 {
        let reports = tracker.step([frame(7, 40 * k, vec![])]).expect("a step");
        for r in reports {
            assert_eq!((&r.failure, r.verdict.status, r.time.0), (&None, Status::Doubtful, 40_000_000 * k));
            assert_eq!(r.posterior, r.prediction);
        }
    }
    let reports = tracker.step([frame(0, 800, vec![0.0, 0.0, 1.0, 0.0])]).expect("a step");
    assert!(reports.iter().all(|r| r.failure.is_none() && r.verdict.status == Status::Tracking));
}
