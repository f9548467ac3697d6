//! Corrections on SE(3) against least squares on prior and data.

use nalgebra::{Vector1, Vector6};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use vt_core::agent::Estimator;
use vt_core::belief::{Gaussian, Moving, State};
use vt_core::dynamics::Brownian;
use vt_core::error::EstimateError;
use vt_core::least_squares::LeastSquares;
use vt_core::lie::{SE3, Vector};
use vt_core::manifold::{Manifold, Square};
use vt_core::math;
use vt_core::measurement::{Level, Linearized, Measurement, NormalEquations, Quality};
use vt_core::pose_measurement::PoseMeasurement;
use vt_core::report::StopReason;
use vt_core::time::Seconds;
use vt_estimators::kalman::KalmanFilter;
use vt_estimators::map::maximum_a_posteriori;

use crate::problems::{Pixels, Rows, before_camera, corners, deviations, normals, random};

fn config(cases: u32) -> ProptestConfig {
    ProptestConfig {
        cases,
        rng_seed: RngSeed::Fixed(3),
        failure_persistence: None,
        ..ProptestConfig::default()
    }
}

/// Steps until nothing moves any more.
fn exhaustive() -> LeastSquares {
    LeastSquares { max_iterations: 40, step_tolerance: 1e-10, ..LeastSquares::gauss_newton() }
}

/// `-ln P(z|x) + ½ ‖x ⊟ prior‖²`.
fn cost(z: &dyn Measurement<SE3>, prior: &Gaussian<SE3>, at: &SE3) -> f64 {
    let mut l = [0.0];
    z.log_likelihoods(&[*at], &mut l);
    0.5 * prior.nees(at).expect("regular") - l[0]
}

proptest! {
    #![proptest_config(config(60))]

    /// The iterated filter stops within 10⁻³ deviations of a Gauss–Newton step and takes that step; what is left is
    /// of second order in it, here below 10⁻⁸ (metres, radians).
    #[test]
    fn iterated_filter_is_gauss_newton_on_prior_and_data(seed: u64) {
        let random = &mut random(seed);
        let truth = before_camera(random);
        let z = Pixels::simulate(&corners(), &truth, 0.1, random);
        let sigmas = deviations(0.02, 0.05);
        let prior = Gaussian::from_sigmas(truth.retract(&normals(&sigmas, random)), &sigmas);
        let (found, innovation) = maximum_a_posteriori(&prior, &z, 30).expect("finite");
        prop_assert_eq!(innovation.stop, StopReason::SmallStep);
        let expected = exhaustive().fit(&z, &prior.mean, Some(&prior)).expect("finite");
        let error = expected.pose.local(&found.mean).amax();
        prop_assert!(error < 1e-8, "{error}");
        let spread = (found.covariance - expected.covariance).amax() / expected.covariance.amax();
        prop_assert!(spread < 1e-5, "{spread}");
    }

    /// A velocity that is correlated with the pose moves along.
    #[test]
    fn iterated_filter_corrects_the_whole_state(seed: u64) {
        let random = &mut random(seed);
        let truth = before_camera(random);
        let z = Pixels::simulate(&corners(), &truth, 0.1, random);
        let sigmas = deviations(0.02, 0.05);
        let start = truth.retract(&normals(&sigmas, random));
        let mut prior = Moving::spread(&Gaussian::from_sigmas(start, &sigmas), &[deviations(0.3, 0.5)]);
        for k in 0..6 {
            let shared = 0.8 * (prior.covariance[(k, k)] * prior.covariance[(k + 6, k + 6)]).sqrt();
            prior.covariance[(k, k + 6)] = shared;
            prior.covariance[(k + 6, k)] = shared;
        }
        let (found, _) = maximum_a_posteriori(&prior, &z, 30).expect("finite");
        let expected = exhaustive().minimize(&prior.mean, Some(&prior), |at, out| {
            let mut pose = NormalEquations::empty(&at.pose);
            z.normal_equations(&at.pose, &mut pose);
            out.information.fixed_view_mut::<6, 6>(0, 0).copy_from(&pose.information);
            out.gradient.fixed_rows_mut::<6>(0).copy_from(&pose.gradient);
            (out.cost, out.rows) = (pose.cost, pose.rows);
        }).expect("finite");
        let error = expected.pose.local(&found.mean);
        prop_assert!(error.fixed_rows::<6>(0).amax() < 1e-8 && error.amax() < 1e-6, "{error}");
        prop_assert!(error.fixed_rows::<6>(6).amax() < 1e-6 && found.mean.velocity.norm() > 1e-4);
        let spread = (found.covariance - expected.covariance).amax() / expected.covariance.amax();
        prop_assert!(spread < 1e-5, "{spread}");
    }

    /// Motions in the plane z = const with turns about z: the other three coordinates stay, to rounding.
    #[test]
    fn locked_coordinates_stay_locked(seed: u64) {
        let random = &mut random(seed);
        let truth = before_camera(random);
        let sigmas = Vector6::new(0.02, 0.02, 0.0, 0.0, 0.0, 0.05);
        let prior = Gaussian::from_sigmas(truth.retract(&normals(&sigmas, random)), &sigmas);
        let z = Pixels::simulate(&corners(), &truth, 0.1, random);
        let (found, innovation) = maximum_a_posteriori(&prior, &z, 30).expect("finite");
        prop_assert_eq!(innovation.stop, StopReason::SmallStep);
        let moved = prior.mean.local(&found.mean);
        prop_assert!(moved.fixed_rows::<3>(2).amax() < 1e-14 && moved.amax() > 1e-5, "{moved}");
        for k in 2..5 {
            prop_assert!(found.covariance.row(k).amax() < 1e-18, "{}", found.covariance);
        }
        let expected = exhaustive().fit(&z, &prior.mean, Some(&prior)).expect("finite");
        prop_assert!(expected.pose.local(&found.mean).amax() < 1e-8);
        prop_assert!((found.covariance - expected.covariance).amax() < 1e-5 * expected.covariance.amax());
    }

    /// Far starts, few iterations: no number of iterations above one leaves a cost above that of the prior, and one
    /// more never raises it.
    #[test]
    fn iterations_never_raise_the_cost(seed: u64) {
        let random = &mut random(seed);
        let truth = before_camera(random);
        let z = Pixels::simulate(&corners(), &truth, 0.5, random);
        let sigmas = deviations(0.1, 0.9);
        let prior = Gaussian::from_sigmas(truth.retract(&normals(&sigmas, random)), &sigmas);
        let mut last = cost(&z, &prior, &prior.mean);
        for iterations in 2..12 {
            let Ok((found, _)) = maximum_a_posteriori(&prior, &z, iterations) else { continue };
            let now = cost(&z, &prior, &found.mean);
            prop_assert!(now <= last * (1.0 + 1e-9) + 1e-6, "{iterations} iterations: {now} after {last}");
            last = now;
        }
    }
}

/// `0 = atan x + noise`: a full Gauss–Newton step from beyond 1.39 goes farther away on the other side.
struct Arctangent(f64);

impl Measurement<Vector<1>> for Arctangent {
    fn log_likelihoods(&self, poses: &[Vector<1>], out: &mut [f64]) {
        for (p, l) in poses.iter().zip(out) {
            let r = math::atan(p.0[0]);
            *l = -0.5 * r * r / self.0;
        }
    }
    fn residuals(&self, at: &Vector<1>, out: &mut Linearized<Vector<1>>) {
        out.clear();
        let x = at.0[0];
        out.push(-math::atan(x), Vector1::new(1.0 / (1.0 + x * x)), self.0, 1.0);
    }
    fn normal_equations(&self, at: &Vector<1>, out: &mut NormalEquations<Vector<1>>) {
        let mut rows = Linearized::default();
        self.residuals(at, &mut rows);
        out.clear();
        rows.accumulate(out);
    }
    fn quality(&self, _: &Vector<1>) -> Quality {
        Quality::default()
    }
    fn level(&self) -> Level {
        Level::Feature
    }
}

#[test]
fn halved_steps_save_what_full_steps_lose() {
    let z = Arctangent(1e-4);
    let prior = Gaussian::from_sigmas(Vector(Vector1::new(3.0)), &Vector1::new(100.0));
    // One iteration is the full step: from 3 to −9.5.
    let (full, _) = maximum_a_posteriori(&prior, &z, 1).expect("finite");
    assert!(full.mean.0[0] < -9.0, "{full:?}");
    let (found, innovation) = maximum_a_posteriori(&prior, &z, 50).expect("finite");
    let expected =
        LeastSquares::levenberg_marquardt().fit(&z, &prior.mean, Some(&prior)).expect("finite").pose;
    assert!((found.mean.0 - expected.0).norm() < 1e-8, "{found:?} {expected:?} {innovation:?}");
    assert!(innovation.iterations > 3 && innovation.stop == StopReason::SmallStep);
    // A locked coordinate beside it changes nothing: no regular prior is needed to see that a step was too long.
    let wide = Gaussian::from_sigmas(Beside(3.0), &nalgebra::Vector2::new(100.0, 0.0));
    let (beside, same) = maximum_a_posteriori::<Beside, Beside>(&wide, &First(z), 50).expect("finite");
    assert!((beside.mean.0 - found.mean.0[0]).abs() < 1e-12, "{beside:?}");
    assert_eq!(same.iterations, innovation.iterations);
}

/// A number with a locked one beside it.
#[derive(Clone, Debug)]
struct Beside(f64);

impl Manifold for Beside {
    type D = nalgebra::U2;
    fn dim(&self) -> Self::D {
        nalgebra::Const
    }
    fn retract(&self, d: &nalgebra::Vector2<f64>) -> Self {
        Self(self.0 + d.x)
    }
    fn local(&self, other: &Self) -> nalgebra::Vector2<f64> {
        nalgebra::Vector2::new(other.0 - self.0, 0.0)
    }
}

struct First(Arctangent);

impl Measurement<Beside> for First {
    fn log_likelihoods(&self, poses: &[Beside], out: &mut [f64]) {
        let poses: Vec<Vector<1>> = poses.iter().map(|p| Vector(Vector1::new(p.0))).collect();
        self.0.log_likelihoods(&poses, out);
    }
    fn residuals(&self, at: &Beside, out: &mut Linearized<Beside>) {
        let mut rows = Linearized::default();
        self.0.residuals(&Vector(Vector1::new(at.0)), &mut rows);
        out.clear();
        out.push(rows.residuals[0], nalgebra::Vector2::new(rows.jacobians[0].x, 0.0), rows.variances[0], 1.0);
    }
    fn normal_equations(&self, at: &Beside, out: &mut NormalEquations<Beside>) {
        let mut rows = Linearized::default();
        self.residuals(at, &mut rows);
        out.clear();
        rows.accumulate(out);
    }
    fn quality(&self, _: &Beside) -> Quality {
        Quality::default()
    }
    fn level(&self) -> Level {
        Level::Feature
    }
}

/// Directions without information keep the prior, mean and variance.
#[test]
fn what_data_do_not_say_stays_at_the_prior() {
    let random = &mut random(8);
    let prior = Gaussian::from_sigmas(before_camera(random), &deviations(0.1, 0.2));
    let mut information = Square::<SE3>::zeros();
    information[(0, 0)] = 1e4;
    information[(4, 4)] = 1e4;
    let seen = prior.mean.retract(&(Vector6::x() * 0.05));
    let z = PoseMeasurement::new(seen, information, Quality::default());
    let (found, innovation) = maximum_a_posteriori(&prior, &z, 1).expect("finite");
    assert_eq!(innovation.dof, 2);
    let moved = prior.mean.local(&found.mean);
    assert!((moved - Vector6::x() * (0.05 * 0.01 / (0.01 + 1e-4))).amax() < 1e-12, "{moved}");
    // Turns act on the 5 cm between the charts at prior and posterior: 10⁻³ m² and less.
    for k in [1, 2, 3, 5] {
        let kept = found.covariance[(k, k)] / prior.covariance[(k, k)];
        assert!((kept - 1.0).abs() < 0.01, "coordinate {k}: {kept}");
    }
}

/// Nothing seen: prior and evidence stay.
#[test]
fn no_data_change_nothing() {
    let prior = Gaussian::from_sigmas(before_camera(&mut random(1)), &deviations(0.1, 0.2));
    let z = Pixels { points: vec![], seen: vec![], sigma: 1.0 };
    for iterations in [0, 1, 5] {
        let (found, innovation) = maximum_a_posteriori(&prior, &z, iterations).expect("finite");
        assert!(prior.mean.local(&found.mean).amax() < 1e-15);
        assert!((found.covariance - prior.covariance).amax() < 1e-17);
        assert_eq!((innovation.dof, innovation.nis, innovation.log_evidence), (0, 0.0, 0.0));
    }
}

/// The same equations at every pose.
struct Fixed(NormalEquations<SE3>);

impl Measurement<SE3> for Fixed {
    fn log_likelihoods(&self, _: &[SE3], out: &mut [f64]) {
        out.fill(f64::NAN);
    }
    fn residuals(&self, _: &SE3, out: &mut Linearized<SE3>) {
        out.clear();
    }
    fn normal_equations(&self, _: &SE3, out: &mut NormalEquations<SE3>) {
        out.clone_from(&self.0);
    }
    fn quality(&self, _: &SE3) -> Quality {
        Quality::default()
    }
    fn level(&self) -> Level {
        Level::Feature
    }
}

#[test]
fn errors_are_values_and_change_nothing() {
    let pose = before_camera(&mut random(2));
    let prior = Gaussian::from_sigmas(pose, &deviations(0.1, 0.2));
    let motion = Brownian::new(deviations(0.01, 0.01)).expect("not negative");
    let spoil: [fn(&mut NormalEquations<SE3>); 3] =
        [|e| e.gradient[2] = f64::NAN, |e| e.information[(1, 1)] = f64::INFINITY, |e| e.cost = f64::NAN];
    for (k, spoil) in spoil.into_iter().enumerate() {
        for iterations in [1, 4] {
            let mut filter = KalmanFilter::<SE3, SE3, _>::new(&prior, vec![], motion.clone(), iterations)
                .expect("a prior");
            filter.predict(Seconds(0.1)).expect("finite");
            let before = format!("{:?}", filter.belief());
            let mut equations = NormalEquations::empty(&pose);
            spoil(&mut equations);
            assert!(filter.correct(&Fixed(equations)).is_err(), "fault {k}, {iterations} iterations");
            assert_eq!(before, format!("{:?}", filter.belief()), "fault {k}");
        }
    }
}

#[test]
fn priors_of_no_use_are_refused() {
    let pose = before_camera(&mut random(2));
    let motion = Brownian::new(deviations(0.01, 0.01)).expect("not negative");
    let good = Gaussian::from_sigmas(pose, &deviations(0.1, 0.2));
    let make = |prior: &Gaussian<SE3>| KalmanFilter::<SE3, SE3, _>::new(prior, vec![], motion.clone(), 1);
    let refused = |prior: &Gaussian<SE3>, error: EstimateError| {
        assert_eq!(make(prior).err().as_ref(), Some(&error));
        let mut filter = make(&good).expect("a prior");
        assert_eq!(filter.reset(prior), Err(error));
        assert_eq!(filter.belief().covariance, good.covariance);
    };
    let mut bad = good.clone();
    bad.covariance[(3, 3)] = f64::NAN;
    refused(&bad, EstimateError::NotFinite("the prior"));
    bad.covariance[(3, 3)] = -1e-4;
    refused(&bad, EstimateError::NotPositiveDefinite("the prior's covariance"));
    bad.covariance[(3, 3)] = 0.0;
    assert!(make(&bad).is_ok(), "a locked coordinate");
    bad.covariance[(3, 2)] = 1e-3;
    bad.covariance[(2, 3)] = 1e-3;
    refused(&bad, EstimateError::NotPositiveDefinite("the prior's covariance"));
    let vector = vt_core::lie::DynVector(nalgebra::DVector::zeros(3));
    let prior = Gaussian::from_sigmas(vector, &nalgebra::DVector::repeat(3, 1.0));
    let motion =
        vt_core::dynamics::ConstantVelocity::new(nalgebra::DVector::repeat(3, 1.0)).expect("positive");
    let short = vec![nalgebra::DVector::repeat(2, 1.0)];
    let refused = KalmanFilter::<_, Moving<vt_core::lie::DynVector>, _>::new(&prior, short, motion, 1).err();
    let what = "the deviation of a derivative";
    assert_eq!(refused, Some(EstimateError::Dimension { what, found: 2, expected: 3 }));
}

#[test]
fn iterations_do_not_move_a_settled_state() {
    let prior = Gaussian::from_sigmas(Vector(Vector1::new(0.0)), &Vector1::new(1.0));
    let z = Rows::<Vector<1>> { rows: vec![Vector1::new(1.0)], values: vec![0.0], variances: vec![1.0] };
    let (found, innovation) = maximum_a_posteriori(&prior, &z, 100).expect("finite");
    assert_eq!((found.mean.0[0], innovation.iterations), (0.0, 1));
    assert!((found.covariance[0] - 0.5).abs() < 1e-15);
}

#[test]
fn overflow_is_an_error() {
    let prior = Gaussian::from_sigmas(Vector(Vector1::new(0.0)), &Vector1::new(1e120));
    let z = Rows::<Vector<1>> { rows: vec![Vector1::new(1e100)], values: vec![0.0], variances: vec![1e-20] };
    for iterations in [1, 5] {
        let found = maximum_a_posteriori(&prior, &z, iterations);
        assert_eq!(found.err(), Some(EstimateError::NotPositiveDefinite("the innovation's covariance")));
    }
}
