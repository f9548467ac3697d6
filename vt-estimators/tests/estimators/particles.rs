//! The particle filter against the Kalman filter, against itself on other threads, and against bad luck.

use nalgebra::{Matrix2, Vector2};
use vt_core::agent::Estimator;
use vt_core::belief::{Gaussian, Moving};
use vt_core::dynamics::{Brownian, ConstantVelocity};
use vt_core::error::EstimateError;
use vt_core::lie::{SE3, Vector};
use vt_core::measurement::{Level, Linearized, Measurement, NormalEquations, Quality};
use vt_core::pose_measurement::PoseMeasurement;
use vt_core::time::Seconds;
use vt_estimators::kalman::KalmanFilter;
use vt_estimators::particle::{ParticleFilter, ParticleParams};
use vt_estimators::resampling::Resampling;

use crate::problems::{Pixels, before_camera, corners, deviations, random};

type Plane = ParticleFilter<Vector<2>, Vector<2>, Brownian<Vector<2>>>;

fn prior() -> Gaussian<Vector<2>> {
    Gaussian::from_sigmas(Vector(Vector2::new(0.5, -1.0)), &Vector2::new(0.5, 1.0))
}

fn motion() -> Brownian<Vector<2>> {
    Brownian::new(Vector2::new(0.3, 0.1)).expect("not negative")
}

fn seen(step: u64) -> PoseMeasurement<Vector<2>> {
    let random = &mut random(step);
    let place = Vector(Vector2::new(0.3 * random.normal(), 0.5 * random.normal()));
    PoseMeasurement::new(place, Matrix2::new(6.0, 2.0, 2.0, 4.0), Quality::default())
}

fn particles(count: usize, seed: u64, resampling: Resampling) -> Plane {
    let params = ParticleParams { count, seed, resampling, ..ParticleParams::default() };
    Plane::new(&prior(), vec![], motion(), params).expect("a prior")
}

/// Five steps; the sum of the log evidences.
fn run(filter: &mut dyn Estimator<Vector<2>>) -> f64 {
    (0..5)
        .map(|step| {
            filter.predict(Seconds(0.5)).expect("finite");
            filter.correct(&seen(step)).expect("likely").log_evidence
        })
        .sum()
}

/// Root mean square over 60 seeds of the errors of mean, covariance and log evidence against the exact filter.
fn errors(count: usize, resampling: Resampling) -> [f64; 3] {
    let mut exact = KalmanFilter::<_, Vector<2>, _>::new(&prior(), vec![], motion(), 1).expect("a prior");
    let evidence = run(&mut exact);
    let exact = exact.pose();
    let mut sums = [0.0; 3];
    for seed in 0..60 {
        let mut filter = particles(count, seed, resampling);
        let log_evidence = run(&mut filter);
        let found = filter.pose();
        sums[0] += (found.mean.0 - exact.mean.0).norm_squared();
        sums[1] += (found.covariance - exact.covariance).norm_squared();
        sums[2] += (log_evidence - evidence) * (log_evidence - evidence);
    }
    sums.map(|s| (s / 60.0_f64).sqrt())
}

/// Four times the particles, half the error. Sixty seeds know a ratio to about 13 %, three standard errors are 40 %.
#[test]
fn errors_fall_as_one_over_the_root_of_the_number() {
    for resampling in [Resampling::Deterministic, Resampling::Systematic] {
        let table = [500, 2000, 8000].map(|n| errors(n, resampling));
        for k in 0..3 {
            for (few, many) in [(table[0][k], table[1][k]), (table[1][k], table[2][k])] {
                let ratio = few / many;
                assert!((1.2..2.8).contains(&ratio), "{resampling:?}, figure {k}: {ratio} in {table:?}");
            }
            // Sixteen times the particles, a quarter.
            assert!(
                (2.8..5.2).contains(&(table[0][k] / table[2][k])),
                "{resampling:?}, figure {k}: {table:?}"
            );
        }
        assert!(table[2].iter().all(|e| *e < 0.05), "{table:?}");
    }
}

/// All numbers of a run on SE(3) with velocity, to the last bit.
fn rigid_run(threads: usize) -> String {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    pool.install(|| {
        let random = &mut random(3);
        let truth = before_camera(random);
        let params = ParticleParams { count: 700, resampling: Resampling::Systematic, ..Default::default() };
        let motion = ConstantVelocity::new(deviations(0.1, 0.1)).expect("not negative");
        let prior = Gaussian::from_sigmas(truth, &deviations(0.02, 0.05));
        let rest = vec![deviations(0.1, 0.1)];
        let mut filter =
            ParticleFilter::<SE3, Moving<SE3>, _>::new(&prior, rest, motion, params).expect("a prior");
        let mut log = String::new();
        for step in 0..6 {
            filter.predict(Seconds(0.05)).expect("finite");
            let z = Pixels::simulate(&corners(), &truth, 5.0, random);
            let innovation = filter.correct(&z).expect("likely");
            log += &format!("{innovation:?} {:?} {:?}\n", filter.pose(), filter.states());
            if step == 3 {
                filter.reset(&prior).expect("a prior");
            }
        }
        log
    })
}

#[test]
fn threads_do_not_change_a_bit() {
    let one = rigid_run(1);
    assert!(one == rigid_run(2), "one and two threads differ");
    assert!(one == rigid_run(5), "one and five threads differ");
}

#[test]
fn seed_and_target_make_other_numbers_and_the_same_ones_again() {
    let at = |seed, target| {
        let params = ParticleParams { seed, target, ..ParticleParams::default() };
        let mut filter = Plane::new(&prior(), vec![], motion(), params).expect("a prior");
        run(&mut filter).to_bits()
    };
    assert_eq!(at(1, 1), at(1, 1));
    assert!(at(1, 1) != at(2, 1) && at(1, 1) != at(1, 2));
}

/// A log-likelihood of one number for every pose.
pub fn constant(value: f64) -> Any<impl Fn(&Vector<2>) -> f64> {
    Any(move |_: &Vector<2>| value)
}

/// Any log-likelihood.
pub struct Any<F>(pub F);

impl<F: Fn(&Vector<2>) -> f64 + Sync> Measurement<Vector<2>> for Any<F> {
    fn log_likelihoods(&self, poses: &[Vector<2>], out: &mut [f64]) {
        poses.iter().zip(out).for_each(|(pose, l)| *l = (self.0)(pose));
    }
    fn residuals(&self, _: &Vector<2>, out: &mut Linearized<Vector<2>>) {
        out.clear();
    }
    fn normal_equations(&self, _: &Vector<2>, out: &mut NormalEquations<Vector<2>>) {
        out.clear();
    }
    fn quality(&self, _: &Vector<2>) -> Quality {
        Quality::default()
    }
    fn level(&self) -> Level {
        Level::Pixel
    }
}

#[test]
fn errors_are_values_and_change_nothing() {
    let params = ParticleParams { count: 0, ..ParticleParams::default() };
    let none = Plane::new(&prior(), vec![], motion(), params);
    assert_eq!(none.err(), Some(EstimateError::NoParticles));

    let mut filter = particles(300, 1, Resampling::Deterministic);
    run(&mut filter);
    let state = |f: &Plane| format!("{:?} {:?} {:?}", f.states(), f.particles(), f.pose());
    let before = state(&filter);
    assert_eq!(filter.correct(&constant(f64::NEG_INFINITY)), Err(EstimateError::ZeroLikelihood));
    for bad in [f64::NAN, f64::INFINITY] {
        assert_eq!(filter.correct(&constant(bad)), Err(EstimateError::NotFinite("the likelihood")));
    }
    assert!(filter.predict(Seconds(f64::NAN)).is_err());
    let mut nowhere = prior();
    nowhere.mean.0.x = f64::NAN;
    assert_eq!(filter.reset(&nowhere), Err(EstimateError::NotFinite("the prior")));
    nowhere = prior();
    nowhere.covariance[(0, 1)] = 9.0;
    nowhere.covariance[(1, 0)] = 9.0;
    let indefinite = EstimateError::NotPositiveDefinite("the prior's covariance");
    assert_eq!(filter.reset(&nowhere), Err(indefinite));
    assert_eq!(before, state(&filter));
    // A constant says nothing and is its own evidence.
    let innovation = filter.correct(&constant(-3.0)).expect("likely");
    assert!((innovation.log_evidence + 3.0).abs() < 1e-12);
    // It goes on.
    run(&mut filter);
}

/// Locked coordinates of singular, correlated priors stay locked in every particle.
#[test]
fn particles_stay_in_the_support_of_a_singular_prior() {
    let covariance = Matrix2::new(1.0, 2.0, 2.0, 4.0);
    let prior = Gaussian { mean: Vector(Vector2::zeros()), covariance };
    let still = Brownian::new(Vector2::zeros()).expect("not negative");
    let filter = Plane::new(&prior, vec![], still, ParticleParams::default()).expect("a prior");
    let (states, _) = filter.states();
    assert!(states.iter().all(|s| (s.0.y - 2.0 * s.0.x).abs() < 1e-12));
    assert!(states.iter().any(|s| s.0.x.abs() > 0.5));
}
