//! Tracks of one object as one target of the loop.

use nalgebra::{Matrix2, Vector2};
use vt_core::belief::Gaussian;
use vt_core::frame::Frame;
use vt_core::lie::Vector;
use vt_core::measurement::Modality;
use vt_core::report::{BeliefRecord, Status, StepReport};
use vt_fusion::tracks::{Criterion, EquivalentMeasurements, Intersection, TrackFusion};
use vt_fusion::{AnyTarget, FusedTarget, Target, TrackingLoop};

use crate::sensors::{Direct, Plane, content, filter, frame, random, target};

const INFORMATION: [f64; 2] = [100.0, 300.0];

fn modality(sensor: u32, reach: f64) -> Box<dyn Modality<Plane>> {
    let information = Matrix2::identity() * INFORMATION[sensor as usize];
    Box::new(Direct { reach, ..Direct::new(sensor, information) })
}

fn track(sensor: u32, reach: f64) -> Target<Plane> {
    let name = ["left", "right"][sensor as usize];
    target(name, &[sensor], vec![modality(sensor, reach)], filter(0.0, 0.0), None)
}

fn fused(rule: impl TrackFusion<Plane> + 'static, reach: f64) -> FusedTarget<Plane> {
    let tracks = vec![track(0, reach), track(1, reach)];
    FusedTarget::new("object", tracks, Box::new(rule), Vector2::repeat(1.0)).expect("tracks")
}

fn central() -> EquivalentMeasurements<Plane> {
    EquivalentMeasurements::new(Box::new(filter(0.0, 0.0)))
}

fn intersection() -> Intersection<Plane> {
    Intersection::new(Criterion::Determinant)
}

/// Frames of two sensors at 30 and 50 Hz, at times together.
fn stream() -> Vec<Vec<Frame>> {
    let random = &mut random(2);
    let steps = (0..200).map(|k| 10 * k).filter(|t| t % 30 == 0 || t % 50 == 0);
    let mut place = |t: i64| vec![t as f64 * 1e-3 + 0.05 * random.normal(), 0.05 * random.normal()];
    steps
        .map(|t| {
            let of = |sensor, period, numbers| (t % period == 0).then(|| frame(sensor, t, numbers));
            [of(0, 30, place(t)), of(1, 50, place(t))].into_iter().flatten().collect()
        })
        .collect()
}

fn belief(report: &StepReport) -> Gaussian<Plane> {
    report.posterior.get().expect("a belief")
}

/// Dynamic fusion by equivalent measurements is the static one.
#[test]
fn tracks_that_tell_what_they_learnt_are_one_filter() {
    let both = vec![modality(0, f64::INFINITY), modality(1, f64::INFINITY)];
    let mut stacked =
        TrackingLoop::new(vec![Box::new(target("object", &[0, 1], both, filter(0.0, 0.0), None))]);
    let mut dynamic = TrackingLoop::new(vec![Box::new(fused(central(), f64::INFINITY))]);
    for frames in stream() {
        let expected = &stacked.step(frames.clone()).expect("a step")[0];
        let found = &dynamic.step(frames).expect("a step")[0];
        let (a, b) = (belief(expected), belief(found));
        assert!((a.mean.0 - b.mean.0).amax() < 1e-9 && (a.covariance - b.covariance).amax() < 1e-9);
        let (a, b) = (&expected.prediction.coordinates, &found.prediction.coordinates);
        assert!((a[0] - b[0]).abs() < 1e-9);
        assert_eq!(
            (&expected.target, expected.time, expected.frame),
            (&found.target, found.time, found.frame)
        );
        assert_eq!(expected.verdict.status, found.verdict.status);
        assert_eq!(expected.assessment.quality, found.assessment.quality);
    }
}

/// Where the object is: it goes right and turns back while the second sensor does not see it.
fn place(t: i64) -> f64 {
    let seconds = 1e-3 * t as f64;
    if seconds < 2.0 { seconds } else { 4.0 - seconds }
}

/// Steps in which both sensors see the object, or the second something else.
fn both_see(t: i64, second: bool) -> [Frame; 2] {
    let place = vec![place(t), 0.0];
    [frame(0, t, place.clone()), frame(1, t, if second { place } else { vec![90.0, 90.0] })]
}

/// A track that is lost does not count; with feedback it comes back.
#[test]
fn a_lost_track_leaves_the_others_alone() {
    for feedback in [false, true] {
        let mut object = fused(intersection(), 0.5).with_tracks_listed();
        if feedback {
            object = object.with_feedback();
        }
        let mut tracker = TrackingLoop::new(vec![Box::new(object)]);
        let status = |reports: &[StepReport]| reports.iter().map(|r| r.verdict.status).collect::<Vec<_>>();
        let mut lost = 0;
        for k in 0..60 {
            let reports = tracker.step(both_see(100 * k, !(10..40).contains(&k))).expect("a step");
            assert_eq!(reports[0].verdict.status, Status::Tracking, "{k}");
            assert_eq!(reports[1].verdict.status, Status::Tracking, "{k}");
            if reports[2].verdict.status == Status::Lost {
                lost += 1;
                let (object, first) = (belief(&reports[0]), belief(&reports[1]));
                assert!((object.mean.0 - first.mean.0).amax() < 1e-12);
                assert!((object.covariance - first.covariance).amax() < 1e-12);
            }
            assert!((belief(&reports[0]).mean.0.x - place(100 * k)).abs() < 0.2, "{k}");
        }
        assert!(lost > 5, "{lost}");
        let end = tracker.step(both_see(6000, true)).expect("a step");
        let second = if feedback { Status::Tracking } else { Status::Lost };
        assert_eq!(status(end), [Status::Tracking, Status::Tracking, second]);
    }
}

/// Nothing to be seen by anyone: the object is lost, and says so.
#[test]
fn an_object_is_lost_when_all_its_tracks_are() {
    let mut tracker = TrackingLoop::new(vec![Box::new(fused(intersection(), 0.5))]);
    for k in 0..20 {
        let far = || vec![90.0, 90.0];
        let report = &tracker.step([frame(0, 40 * k, far()), frame(1, 40 * k, far())]).expect("a step")[0];
        if k == 19 {
            assert_eq!(report.verdict.status, Status::Lost);
            assert!(report.verdict.loss_probability > 0.5 && report.assessment.quality.is_none());
        }
    }
    // Placed where it is, it is tracked again.
    let mut there = BeliefRecord::default();
    there.set(&Gaussian::from_sigmas(Vector(Vector2::new(90.0, 90.0)), &Vector2::repeat(0.3)));
    tracker.place(0, &there).expect("a belief");
    let far = || vec![90.0, 90.0];
    let report = &tracker.step([frame(0, 800, far()), frame(1, 800, far())]).expect("a step")[0];
    assert_eq!(report.verdict.status, Status::Tracking);
    assert!((belief(report).mean.0.x - 90.0).abs() < 1e-6);
}

#[test]
fn tracks_have_names_and_reports() {
    let object = fused(intersection(), 1.0).with_tracks_listed();
    assert_eq!(object.count(), 3);
    assert_eq!([0, 1, 2].map(|k| object.name(k).to_owned()), ["object", "left", "right"]);
    let alone = fused(intersection(), 1.0);
    assert_eq!((alone.count(), alone.tracks().len(), alone.sensors().len()), (1, 2, 2));
}

#[test]
fn threads_do_not_change_a_byte_of_fused_tracks() {
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| {
            let targets: Vec<Box<dyn AnyTarget>> = vec![
                Box::new(fused(intersection(), 1.0).with_tracks_listed()),
                Box::new(fused(central(), 1.0).with_feedback()),
            ];
            let mut tracker = TrackingLoop::new(targets);
            stream().into_iter().map(|f| content(tracker.step(f).expect("a step"))).collect::<String>()
        })
    };
    let one = run(1);
    assert!(one.len() > 10_000 && one == run(2), "one and two threads differ");
}
