//! Directions that the data of a step do not determine.

use nalgebra::{Matrix6, Vector6};
use vt_core::belief::Gaussian;
use vt_core::dynamics::Brownian;
use vt_core::lie::{LieGroup, SE3};
use vt_core::measurement::Modality;
use vt_core::report::StepReport;
use vt_estimators::kalman::KalmanFilter;
use vt_fusion::TrackingLoop;

use crate::sensors::{Direct, frame, target};

fn report(information: Vector6<f64>, sigmas: Vector6<f64>) -> StepReport {
    let start = SE3::exp(&Vector6::new(0.1, -0.2, 0.9, 0.4, 0.3, -0.5));
    let prior = Gaussian::from_sigmas(start, &sigmas);
    let motion = Brownian::new(sigmas * 0.01).expect("not negative");
    let filter = KalmanFilter::<SE3, SE3, _>::new(&prior, vec![], motion, 1).expect("a prior");
    let modality: Box<dyn Modality<SE3>> = Box::new(Direct::new(0, Matrix6::from_diagonal(&information)));
    let mut tracker = TrackingLoop::new(vec![Box::new(target("one", &[0, 1], vec![modality], filter, None))]);
    let mut seen = vec![];
    vt_core::manifold::Coordinates::write(&start, &mut seen);
    tracker.step([frame(0, 0, seen)]).expect("a step")[0].clone()
}

#[test]
fn positions_leave_rotations_open() {
    let all = Vector6::repeat(0.1);
    let found = report(Vector6::new(1e6, 1e6, 1e2, 0.0, 0.0, 0.0), all).unobservable;
    assert_eq!(found.len(), 18, "{found:?}");
    for (k, direction) in found.chunks(6).enumerate() {
        assert!(
            (direction.iter().map(|v| v * v).sum::<f64>() - 1.0).abs() < 1e-12,
            "of length one: {direction:?}"
        );
        assert!(direction[..3].iter().all(|v| v.abs() < 1e-12), "a rotation: {direction:?}");
        for other in found.chunks(6).skip(k + 1) {
            let shared: f64 = direction.iter().zip(other).map(|(a, b)| a * b).sum();
            assert!(shared.abs() < 1e-12, "different: {direction:?} {other:?}");
        }
    }
}

#[test]
fn full_and_no_information() {
    let all = Vector6::repeat(0.1);
    // Precise or not: what data say, however little, they determine.
    assert!(report(Vector6::new(1e6, 1e6, 1.0, 1e2, 1.0, 1e-2), all).unobservable.is_empty());
    assert_eq!(report(Vector6::zeros(), all).unobservable.len(), 36);
    // A locked coordinate is not asked for.
    let locked = Vector6::new(0.1, 0.1, 0.1, 0.0, 0.0, 0.1);
    let found = report(Vector6::new(1e4, 1e4, 1e4, 0.0, 0.0, 0.0), locked).unobservable;
    assert_eq!(found.iter().map(|v| v.abs()).collect::<Vec<f64>>(), [0.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
}
