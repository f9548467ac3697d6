//! Prediction does not depend on how time is cut or where the world frame lies.

use nalgebra::Vector6;
use vt_core::agent::Estimator;
use vt_core::belief::{Gaussian, Moving};
use vt_core::dynamics::{Brownian, ConstantVelocity};
use vt_core::lie::{LieGroup, SE3};
use vt_core::manifold::{Manifold, Square};
use vt_core::measurement::Quality;
use vt_core::pose_measurement::PoseMeasurement;
use vt_core::time::Seconds;
use vt_estimators::imm::{Imm, Switching, mode};
use vt_estimators::information::InformationFilter;
use vt_estimators::kalman::KalmanFilter;
use vt_estimators::particle::ParticleFilter;
use vt_estimators::sigma_point::{Rule, SigmaPointFilter};
use vt_estimators::smoother::Smoother;
use vt_estimators::square_root::SquareRootFilter;

use crate::particle_methods::methods;
use crate::problems::{before_camera, deviations, normals, random};

type Filter = KalmanFilter<SE3, Moving<SE3>, ConstantVelocity<SE3>>;

/// A filter that has seen the object move.
fn moving(case: u64) -> Filter {
    let random = &mut random(case);
    let start = before_camera(random);
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
        let (mut whole, mut parts) = (moving(case), moving(case));
        whole.predict(Seconds(0.2)).expect("finite");
        for part in [0.07, 0.0, 0.01, 0.12] {
            parts.predict(Seconds(part)).expect("finite");
        }
        assert_same(whole.belief(), parts.belief(), 1e-12, 1e-9);
    }
}

/// An estimator in another world frame differs by that frame: same covariance, since errors live in the body frame.
#[test]
fn the_world_frame_does_not_matter() {
    for case in 0..20 {
        let world = SE3::exp(&normals(&deviations(2.0, 1.0), &mut random(100 + case)));
        let random = &mut random(case);
        let start = before_camera(random);
        let twist = normals(&deviations(0.3, 0.8), random);
        let information = Square::<SE3>::from_diagonal(&Vector6::new(4e4, 4e4, 1e4, 1e4, 1e4, 4e4));
        for ((name, mut here), (_, mut there)) in all(&start).into_iter().zip(all(&world.compose(&start))) {
            for k in 1..=5 {
                let seen = start.retract(&(twist * 0.1 * f64::from(k)));
                let see = |at| PoseMeasurement::new(at, information, Quality::default());
                for (estimator, z) in [(&mut here, see(seen)), (&mut there, see(world.compose(&seen)))] {
                    estimator.predict(Seconds(0.1)).expect("finite");
                    estimator.correct(&z).expect("finite");
                }
            }
            let [a, b] = [here, there].map(|e| e.pose());
            let apart = world.compose(&a.mean).local(&b.mean).norm();
            let spread = (a.covariance - b.covariance).amax() / a.covariance.amax();
            assert!(apart < 1e-9 && spread < 1e-9, "{name}: {apart:e} {spread:e}");
        }
    }
}

/// One of each that knows a pose and its velocity.
fn all(start: &SE3) -> Vec<(String, Box<dyn Estimator<SE3>>)> {
    type S = Moving<SE3>;
    let prior = Gaussian::from_sigmas(*start, &deviations(0.01, 0.02));
    let rest = || vec![deviations(0.5, 1.0)];
    let motion = || ConstantVelocity::new(deviations(0.1, 0.3)).expect("not negative");
    let kalman = |iterations| Filter::new(&prior, rest(), motion(), iterations).expect("a prior");
    let sigma = |rule| SigmaPointFilter::<SE3, S, _>::new(&prior, rest(), motion(), rule).expect("a prior");
    let root = SquareRootFilter::<SE3, S, _>::new(&prior, rest(), motion()).expect("a prior");
    let information = InformationFilter::<SE3, S, _>::new(&prior, rest(), motion()).expect("a prior");
    let common = kalman(1).belief().clone();
    let still = Brownian::new(deviations(0.01, 0.02)).expect("not negative");
    let still = KalmanFilter::<SE3, SE3, _>::new(&prior, vec![], still, 1).expect("a prior");
    let modes = vec![mode::<SE3, SE3, S, _>(still), mode(sigma(Rule::Cubature))];
    let imm = Imm::new(modes, &[0.5, 0.5], Switching::every(Seconds(1.0), 2), &common).expect("models");
    let gaussian: [(&str, Box<dyn Estimator<SE3>>); 8] = [
        ("extended", Box::new(kalman(1))),
        ("iterated", Box::new(kalman(5))),
        ("square root", Box::new(root)),
        ("information", Box::new(information)),
        ("cubature", Box::new(sigma(Rule::Cubature))),
        ("unscented", Box::new(sigma(Rule::UNSCENTED))),
        ("mixture", Box::new(imm)),
        ("smoother", Box::new(Smoother::<S, _>::fixed_lag(kalman(1), 2))),
    ];
    let mut all: Vec<_> = gaussian.into_iter().map(|(name, e)| (name.to_owned(), e)).collect();
    for (name, params) in methods(&[&[3, 4, 5], &[0, 1, 2]]) {
        let filter = ParticleFilter::<SE3, S, _>::new(&prior, rest(), motion(), params).expect("a prior");
        all.push((name, Box::new(filter) as Box<dyn Estimator<SE3>>));
    }
    all
}

#[test]
fn a_span_that_is_no_number_changes_nothing() {
    let mut filter = moving(0);
    let before = format!("{:?}", filter.belief());
    assert!(filter.predict(Seconds(f64::NAN)).is_err());
    assert_eq!(before, format!("{:?}", filter.belief()));
}
