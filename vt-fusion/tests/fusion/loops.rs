//! The loop over targets and sensors.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use nalgebra::Matrix2;
use vt_core::agent::Estimator;
use vt_core::belief::Gaussian;
use vt_core::error::{EstimateError, MeasureError};
use vt_core::evidence::{Evidence, EvidenceKey, Processing, Slot};
use vt_core::frame::{Frame, Roi, SensorId};
use vt_core::lie::Vector;
use vt_core::measurement::{Measurement, Modality};
use vt_core::pose_measurement::PoseMeasurement;
use vt_core::report::{Innovation, Status};
use vt_core::time::Seconds;
use vt_estimators::particle::{ParticleFilter, ParticleParams};
use vt_fusion::tracking::StepError;
use vt_fusion::{AnyTarget, Target, TrackingLoop};

use crate::sensors::{Direct, Plane, SUPPORTED, content, filter, frame, random, target};

fn direct(sensor: u32, information: f64) -> Box<dyn Modality<Plane>> {
    Box::new(Direct::new(sensor, Matrix2::identity() * information))
}

/// Frames of two sensors at 30 and 50 Hz, at times together.
fn stream() -> Vec<Vec<Frame>> {
    let random = &mut random(2);
    let mut place = |t: i64| {
        let t = t as f64 * 1e-3;
        vec![t + 0.05 * random.normal(), 1.0 - 0.5 * t + 0.05 * random.normal()]
    };
    let steps = (0..300).map(|k| 10 * k).filter(|t| t % 30 == 0 || t % 50 == 0);
    steps
        .map(|t| {
            let of = |sensor, period, numbers| (t % period == 0).then(|| frame(sensor, t, numbers));
            [of(0, 30, place(t)), of(1, 50, place(t))].into_iter().flatten().collect()
        })
        .collect()
}

/// One target on sensor 0, one on both: each is its own filter fed with its own frames, no frame twice, none of
/// another sensor, and a step of the other sensor is no reason for doubt.
#[test]
fn asynchronous_sensors_feed_those_who_watch() {
    let one = target("one", &[0], vec![direct(0, 100.0)], filter(0.0, 1.0), None);
    let two = target("two", &[0, 1], vec![direct(0, 100.0), direct(1, 300.0)], filter(0.0, 1.0), None);
    let mut tracker = TrackingLoop::new(vec![Box::new(one), Box::new(two)]);
    let mut alone = [filter(0.0, 1.0), filter(0.0, 1.0)];
    let mut last = 0.0;
    for frames in stream() {
        let now = frames[0].time.seconds();
        let dt = Seconds(now - last);
        last = now;
        for (k, filter) in alone.iter_mut().enumerate() {
            filter.predict(dt).expect("finite");
            for f in &frames {
                let information = match (f.sensor.0, k) {
                    (0, _) => 100.0,
                    (_, 1) => 300.0,
                    _ => continue,
                };
                let z = f.vector().expect("numbers");
                let z = Vector(nalgebra::Vector2::new(z[0], z[1]));
                filter
                    .correct(&PoseMeasurement::new(z, Matrix2::identity() * information, SUPPORTED))
                    .expect("finite");
            }
        }
        let reports = tracker.step(frames).expect("a step");
        for (filter, report) in alone.iter().zip(reports) {
            let (found, expected) = (report.posterior.get::<Plane>().expect("a belief"), filter.pose());
            assert!((found.mean.0 - expected.mean.0).amax() < 1e-9, "{} at {now}", report.target);
            assert!((found.covariance - expected.covariance).amax() < 1e-9, "{} at {now}", report.target);
            assert_eq!((report.verdict.status, &report.failure), (Status::Tracking, &None));
            assert_eq!(report.time.seconds(), now);
        }
    }
}

/// Adds the numbers of a frame, and counts how often.
struct Sum(EvidenceKey, Arc<AtomicUsize>);

impl Processing for Sum {
    fn key(&self) -> &EvidenceKey {
        &self.0
    }
    fn run(&self, frame: &Frame, _: Option<Roi>, slot: &mut Slot) -> Result<(), MeasureError> {
        self.1.fetch_add(1, Ordering::Relaxed);
        *slot.buffer::<f64>() = frame.vector()?.iter().sum();
        Ok(())
    }
}

/// Reads the sum off the evidence and measures nothing.
struct Reader {
    needs: [EvidenceKey; 1],
    expected: f64,
}

impl Modality<Plane> for Reader {
    fn needs(&self) -> &[EvidenceKey] {
        &self.needs
    }
    fn measure(
        &mut self,
        evidence: &Evidence,
        _: &Gaussian<Plane>,
    ) -> Result<Option<&dyn Measurement<Plane>>, MeasureError> {
        evidence.frame(self.needs[0].sensor)?;
        assert_eq!(*evidence.get::<f64>(&self.needs[0])?, self.expected);
        Ok(None)
    }
    fn last(&self) -> Option<&dyn Measurement<Plane>> {
        None
    }
}

#[test]
fn evidence_that_two_ask_for_is_made_once() {
    let runs = Arc::new(AtomicUsize::new(0));
    let key = EvidenceKey { sensor: SensorId(0), name: "sum".into() };
    let reader = || -> Vec<Box<dyn Modality<Plane>>> {
        vec![Box::new(Reader { needs: [key.clone()], expected: 3.0 })]
    };
    let targets =
        ["a", "b"].map(|n| Box::new(target(n, &[0], reader(), filter(0.0, 0.0), None)) as Box<dyn AnyTarget>);
    let mut tracker = TrackingLoop::new(targets.into());
    // Nobody makes it: a failure of the step that names it, and the loop goes on.
    let reports = tracker.step([frame(0, 0, vec![1.0, 2.0])]).expect("a step");
    assert!(reports.iter().all(|r| r.failure.as_ref().is_some_and(|f| f.contains("`sum`"))), "{reports:?}");
    for _ in 0..2 {
        tracker.add_processing(Box::new(Sum(key.clone(), runs.clone())));
    }
    for step in 1..=5 {
        let reports = tracker.step([frame(0, 40 * step, vec![1.0, 2.0])]).expect("a step");
        assert!(reports.iter().all(|r| r.failure.is_none()));
        assert_eq!(runs.load(Ordering::Relaxed), step as usize);
    }
    // Without that sensor's frame nothing is made.
    tracker.step([frame(1, 400, vec![])]).expect("a step");
    assert_eq!(runs.load(Ordering::Relaxed), 5);
}

/// Fails in every frame but the first, in which it measures.
struct Broken(Direct<Plane>);

impl Modality<Plane> for Broken {
    fn needs(&self) -> &[EvidenceKey] {
        &[]
    }
    fn measure(
        &mut self,
        evidence: &Evidence,
        prior: &Gaussian<Plane>,
    ) -> Result<Option<&dyn Measurement<Plane>>, MeasureError> {
        if self.0.last.is_some() {
            return Err(MeasureError::Prediction("the lens fell off"));
        }
        self.0.measure(evidence, prior)
    }
    fn last(&self) -> Option<&dyn Measurement<Plane>> {
        self.0.last()
    }
}

/// What a failing modality measured before does not count again, and its neighbours do not suffer.
#[test]
fn a_failing_modality_is_reported_and_the_rest_goes_on() {
    let broken = || Box::new(Broken(Direct::new(0, Matrix2::identity() * 1e4))) as Box<dyn Modality<Plane>>;
    let targets: Vec<Box<dyn AnyTarget>> = vec![
        Box::new(target("well", &[0], vec![direct(0, 100.0)], filter(0.0, 0.0), None)),
        Box::new(target("half", &[0], vec![broken(), direct(0, 100.0)], filter(0.0, 0.0), None)),
        Box::new(target("ill", &[0], vec![broken(), broken()], filter(0.0, 0.0), None)),
    ];
    let mut tracker = TrackingLoop::new(targets);
    tracker.step([frame(0, 0, vec![0.0, 0.0])]).expect("a step");
    for k in 1..10 {
        let reports = tracker.step([frame(0, 40 * k, vec![0.4, 0.0])]).expect("a step");
        let failures: Vec<Option<&str>> = reports.iter().map(|r| r.failure.as_deref()).collect();
        let text = "prediction of no use: the lens fell off";
        assert_eq!(failures, [None, Some(text), Some(text)]);
        let measured: Vec<bool> = reports.iter().map(|r| r.assessment.quality.is_some()).collect();
        assert_eq!(measured, [true, true, false]);
        assert_eq!(reports[0].verdict.status, Status::Tracking);
        assert_eq!(reports[1].verdict.status, Status::Tracking);
    }
    let reports = tracker.step([frame(0, 400, vec![0.4, 0.0])]).expect("a step");
    assert!(reports[1].posterior.coordinates[0] > 0.35, "{:?}", reports[1].posterior);
    assert_eq!(reports[2].verdict.status, Status::Lost);
}

/// An estimator that cannot predict.
struct Stuck(Gaussian<Plane>);

impl Estimator<Plane> for Stuck {
    fn predict(&mut self, _: Seconds) -> Result<(), EstimateError> {
        Err(EstimateError::NotFinite("the predicted state"))
    }
    fn correct(&mut self, _: &dyn Measurement<Plane>) -> Result<Innovation, EstimateError> {
        Err(EstimateError::NotFinite("the measurement"))
    }
    fn pose(&self) -> Gaussian<Plane> {
        self.0.clone()
    }
    fn reset(&mut self, _: &Gaussian<Plane>) -> Result<(), EstimateError> {
        Ok(())
    }
}

/// The others are predicted all the same, so that they are at the right time in the next step.
#[test]
fn a_failing_prediction_stops_the_step_and_not_the_loop() {
    let stuck =
        |name| Box::new(target(name, &[0], vec![direct(0, 1.0)], Stuck(filter(0.0, 0.0).pose()), None));
    let mut tracker = TrackingLoop::new(vec![
        stuck("first"),
        Box::new(target("well", &[0], vec![direct(0, 100.0)], filter(0.0, 0.0), None)),
        stuck("last"),
    ]);
    // Nothing to predict in the first step; the correction fails and says so.
    let reports = tracker.step([frame(0, 0, vec![0.0, 0.0])]).expect("a step");
    assert_eq!(reports[0].failure.as_deref(), Some("the measurement is not finite"));
    assert!(reports[1].failure.is_none());
    let error = tracker.step([frame(0, 500, vec![0.0, 0.0])]).expect_err("stuck");
    assert_eq!(error, StepError::Estimate(EstimateError::NotFinite("the predicted state")));
    let mut expected = filter(0.0, 0.0);
    let z = PoseMeasurement::new(Vector(nalgebra::Vector2::zeros()), Matrix2::identity() * 100.0, SUPPORTED);
    expected.correct(&z).expect("finite");
    expected.predict(Seconds(0.5)).expect("finite");
    // No time passes to the next step.
    let reports = tracker.step([frame(0, 500, vec![0.0, 0.0])]).expect("a step");
    let found = reports[1].prediction.get::<Plane>().expect("a belief").covariance;
    assert!((found - expected.pose().covariance).amax() < 1e-12);
}

/// Late frames count as simultaneous, and the clock does not go back: no span of time is predicted twice.
#[test]
fn late_frames_do_not_turn_back_the_clock() {
    let run = |times: &[i64]| {
        let one = target("one", &[0], vec![direct(0, 100.0)], filter(0.0, 0.0), None);
        let mut tracker = TrackingLoop::new(vec![Box::new(one)]);
        for t in times {
            tracker.step([frame(0, *t, vec![0.0, 0.0])]).expect("a step");
        }
        tracker.step([frame(0, 1000, vec![])]).expect("a step")[0].posterior.covariance.clone()
    };
    assert_eq!(run(&[0, 400, 100]), run(&[0, 400, 400]));
}

#[test]
fn a_step_needs_a_frame() {
    let one = target("one", &[0], vec![direct(0, 1.0)], filter(0.0, 0.0), None);
    let mut tracker = TrackingLoop::new(vec![Box::new(one)]);
    assert_eq!(tracker.step([]).expect_err("no frame"), StepError::NoFrames);
}

/// As many modalities as anyone likes count, all of them.
#[test]
fn no_modality_is_dropped() {
    for count in [1, 2, 16, 17, 40] {
        let modalities = (0..count).map(|_| direct(0, 1.0)).collect();
        let many: Target<Plane> = target("many", &[0], modalities, filter(0.0, 0.0), None);
        let mut tracker = TrackingLoop::new(vec![Box::new(many)]);
        let report = &tracker.step([frame(0, 0, vec![1.0, 0.0])]).expect("a step")[0];
        let variance = 1.0 / (1.0 + f64::from(count));
        assert!((report.posterior.covariance[0] - variance).abs() < 1e-12, "{count}");
        assert_eq!(report.assessment.quality.expect("measured").expected, count as usize);
    }
}

/// Everything at once, on one thread and on two.
fn whole_run(threads: usize) -> String {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    pool.install(|| {
        let particles = |index| {
            let prior = filter(0.0, 1.0).pose();
            let motion =
                vt_core::dynamics::Brownian::new(nalgebra::Vector2::repeat(1.0)).expect("not negative");
            let params = ParticleParams { count: 300, target: index, ..ParticleParams::default() };
            ParticleFilter::<Plane, Plane, _>::new(&prior, vec![], motion, params).expect("a prior")
        };
        let mut targets: Vec<Box<dyn AnyTarget>> = vec![
            Box::new(target("one", &[0], vec![direct(0, 100.0)], filter(0.0, 1.0), None)),
            Box::new(target(
                "two",
                &[0, 1],
                vec![direct(0, 100.0), direct(1, 300.0)],
                filter(0.0, 1.0),
                None,
            )),
        ];
        for k in 0..4 {
            targets.push(Box::new(target(
                "cloud",
                &[k % 2],
                vec![direct(k % 2, 100.0)],
                particles(k.into()),
                None,
            )));
        }
        let mut tracker = TrackingLoop::new(targets);
        stream().into_iter().map(|frames| content(tracker.step(frames).expect("a step"))).collect()
    })
}

#[test]
fn threads_do_not_change_a_byte() {
    let one = whole_run(1);
    assert!(one.len() > 10_000 && one == whole_run(2), "one and two threads differ");
}
