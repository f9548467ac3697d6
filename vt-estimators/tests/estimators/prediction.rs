//! Prediction does not depend on how time is cut or where the world frame lies.

use nalgebra::Vector6;
use vt_core::agent::Estimator;
use vt_core::belief::{Gaussian, Moving};
use vt_core::dynamics::ConstantVelocity;
use vt_core::lie::{LieGroup, SE3};
use vt_core::manifold::{Manifold, Square};
use vt_core::measurement::Quality;
use vt_core::pose_measurement::PoseMeasurement;
use vt_core::time::Seconds;
use vt_estimators::kalman::KalmanFilter;

use crate::problems::{before_camera, deviations, normals, random};

type Filter = KalmanFilter<SE3, Moving<SE3>, ConstantVelocity<SE3>>;

/// A filter that has seen the object move.
fn moving(world: &SE3, case: u64) -> Filter {
    let random = &mut random(case);
    let start = world.compose(&before_camera(random));
    let twist = normals(&deviations(0.3, 0.8), random);
    let prior = Gaussian::from_sigmas(start, &deviations(0.01, 0.02));
    let motion = ConstantVelocity::new(deviations(0.1, 0.3)).expect("not negative");
    let mut filter = Filter::new(&prior, vec![deviations(0.5, 1.0)], motion, 1).expect("a prior");
    let information = Square::<SE3>::from_diagonal(&Vector6::new(4e4, 4e4, 1e4, 1e4, 1e4, 4e4));
    for k in 1..=5 {
        filter.predict(Seconds(0.1)).expect("finite");
        let seen = start.retract(&(twist * 0.1 * f64::from(k)));
        filter.correct(&PoseMeasurement::new(seen, information, Quality::default())).expect("finite");
    }
    filter
}

fn assert_same(a: &Gaussian<Moving<SE3>>, b: &Gaussian<Moving<SE3>>, mean: f64, covariance: f64) {
    assert!(a.mean.local(&b.mean).norm() < mean, "{a:?} {b:?}");
    let error = (a.covariance - b.covariance).amax() / a.covariance.amax();
    assert!(error < covariance, "{error}");
}

/// The mean composes exactly; the rule of the noise integral is exact to the sixth order in the rotation of a step
/// (up to 0.3 rad here).
#[test]
fn parts_of_a_span_are_the_span() {
    for case in 0..20 {
        let (mut whole, mut parts) = (moving(&SE3::identity(), case), moving(&SE3::identity(), case));
        whole.predict(Seconds(0.2)).expect("finite");
        for part in [0.07, 0.0, 0.01, 0.12] {
            parts.predict(Seconds(part)).expect("finite");
        }
        assert_same(whole.belief(), parts.belief(), 1e-12, 1e-9);
    }
}

/// A filter in another world frame differs by that frame: same covariance, since errors live in the body frame.
#[test]
fn the_world_frame_does_not_matter() {
    for case in 0..20 {
        let world = SE3::exp(&normals(&deviations(2.0, 1.0), &mut random(100 + case)));
        let (mut here, mut there) = (moving(&SE3::identity(), case), moving(&world, case));
        here.predict(Seconds(0.2)).expect("finite");
        there.predict(Seconds(0.2)).expect("finite");
        let mut moved = here.belief().clone();
        moved.mean.pose = world.compose(&moved.mean.pose);
        assert_same(&moved, there.belief(), 1e-11, 1e-11);
    }
}

#[test]
fn a_span_that_is_no_number_changes_nothing() {
    let mut filter = moving(&SE3::identity(), 0);
    let before = format!("{:?}", filter.belief());
    assert!(filter.predict(Seconds(f64::NAN)).is_err());
    assert_eq!(before, format!("{:?}", filter.belief()));
}
