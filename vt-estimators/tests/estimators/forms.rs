//! One posterior, many forms: covariance, information, square root, sigma points; by a reading, by normal equations, row
//! by row; with sizes known at compile time and at run time.

use nalgebra::{
    Const, DMatrix, DVector, Dim, Dyn, Matrix2, Matrix3, OMatrix, OVector, SMatrix, Vector2, Vector3,
};
use proptest::prelude::*;
use vt_core::agent::{Dynamics, Estimator};
use vt_core::belief::{Gaussian, Moving};
use vt_core::dynamics::{Brownian, ConstantVelocity, Custom, LinearStep};
use vt_core::error::EstimateError;
use vt_core::least_squares::symmetric_eigen;
use vt_core::lie::{DynVector, Vector, VectorSpace};
use vt_core::manifold::{AllocPair, Manifold};
use vt_core::measurement_model::{Differentiable, Function, Instrument, Linear, Reading};
use vt_core::report::Innovation;
use vt_core::robust::Robust;
use vt_core::time::Seconds;
use vt_estimators::gaussian_filter::GaussianFilter;
use vt_estimators::imm::{Imm, Switching, mode};
use vt_estimators::information::InformationFilter;
use vt_estimators::kalman::KalmanFilter;
use vt_estimators::sigma_point::{Rule, SigmaPointFilter};
use vt_estimators::smoother::Smoother;
use vt_estimators::square_root::SquareRootFilter;

use crate::linear::{LinearProblem, batch, config};
use crate::problems::{dense, random};

const UNSCENTED: Rule = Rule::Unscented { alpha: 0.5, beta: 2.0, kappa: -1.0 };

fn close(a: &DMatrix<f64>, b: &DMatrix<f64>) -> bool {
    (a - b).amax() <= 1e-9 * b.amax().max(1.0)
}

/// All forms over `steps` against the batch solution, and NIS and evidence against each other.
fn all_forms<S, M>(problem: &LinearProblem, m: M, n: S::D)
where
    S: VectorSpace,
    M: Dim,
    nalgebra::DefaultAllocator: AllocPair<S::D, M> + AllocPair<S::D, S::D>,
{
    let square = |a: &DMatrix<f64>| OMatrix::<f64, S::D, S::D>::from_fn_generic(n, n, |r, c| a[(r, c)]);
    let mean = S::from_components(OVector::from_fn_generic(n, Const::<1>, |k, _| problem.mean[k]));
    let prior = Gaussian { mean, covariance: square(&problem.covariance) };
    let s = &problem.steps[0];
    let motion = LinearStep::new(square(&s.f), square(&s.q)).expect("sizes fit");
    let kalman = || KalmanFilter::<S, S, _>::from_belief(prior.clone(), motion.clone()).expect("a prior");
    let sigma = |rule| {
        SigmaPointFilter::<S, S, _>::from_belief(prior.clone(), motion.clone(), rule).expect("a prior")
    };
    let (mut direct, mut dual, mut rows, mut iterated) = (kalman(), kalman(), kalman(), kalman().iterated(5));
    let mut root = SquareRootFilter::<S, S, _>::from_belief(prior.clone(), motion.clone()).expect("a prior");
    let mut root_dual = root.clone();
    let mut information =
        InformationFilter::<S, S, _>::from_belief(prior.clone(), motion.clone()).expect("a prior");
    let (mut cubature, mut unscented) = (sigma(Rule::Cubature), sigma(UNSCENTED));
    let (mut cubature_dual, mut wide) = (sigma(Rule::Cubature), sigma(Rule::UNSCENTED));
    for (k, s) in problem.steps.iter().enumerate() {
        let h = OMatrix::<f64, M, S::D>::from_fn_generic(m, n, |r, c| s.h[(r, c)]);
        let r = OMatrix::<f64, M, M>::from_fn_generic(m, m, |r, c| if r == c { s.r[r] } else { 0.0 });
        let instrument = Instrument::<S, _>::new(Linear(h), r).expect("a covariance");
        let reading =
            instrument.read(OVector::from_fn_generic(m, Const::<1>, |k, _| s.z[k])).expect("finite");
        let z = &reading;
        let dt = Seconds(1.0);
        let mut results: Vec<(&str, Innovation, Gaussian<S>)> = vec![];
        macro_rules! step {
            ($name:literal, $filter:ident, $update:expr) => {
                $filter.predict(dt).expect("finite");
                let innovation = $update.expect("finite");
                results.push(($name, innovation, GaussianFilter::<S, S>::belief(&$filter)));
            };
        }
        step!("direct", direct, direct.update(z));
        step!("normal equations", dual, dual.correct(z));
        step!("iterated", iterated, iterated.correct(z));
        step!("row by row", rows, rows.update_by_rows(z));
        step!("square root", root, root.update(z));
        step!("square root, normal equations", root_dual, root_dual.correct(z));
        step!("information", information, information.correct(z));
        step!("cubature", cubature, cubature.update(z));
        step!("cubature, residuals", cubature_dual, cubature_dual.correct(z));
        step!("unscented", unscented, unscented.update(z));
        step!("unscented, wide", wide, wide.update(z));
        let (mean, covariance) = batch(&problem.mean, &problem.covariance, &problem.steps[..=k]);
        let first = results[0].1;
        for (name, innovation, belief) in &results {
            assert!(close(&dense(belief.mean.components()), &dense(&mean)), "{name}, step {k}: mean");
            assert!(close(&dense(&belief.covariance), &covariance), "{name}, step {k}: covariance");
            assert_eq!(innovation.dof, first.dof, "{name}");
            let scale = 1.0 + first.nis.abs() + first.log_evidence.abs();
            assert!(
                (innovation.nis - first.nis).abs() < 1e-8 * scale,
                "{name}: NIS {innovation:?} {first:?}"
            );
            // Up to what no state explains: with at most as many rows as coordinates there is nothing.
            assert!(
                (innovation.log_evidence - first.log_evidence).abs() < 1e-8 * scale,
                "{name} {innovation:?} {first:?}"
            );
        }
    }
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn every_form_is_the_batch_solution_of_static_size(seed: u64) {
        all_forms::<Vector<4>, _>(&LinearProblem::random(4, 2, 6, &mut random(seed)), Const::<2>, Const::<4>);
    }

    #[test]
    fn every_form_is_the_batch_solution_of_run_time_size(seed: u64, n in 2_usize..6, m in 1_usize..3) {
        all_forms::<DynVector, _>(&LinearProblem::random(n, m, 5, &mut random(seed)), Dyn(m), Dyn(n));
    }

    /// Without a prior the information filter is least squares as soon as the data determine the state.
    #[test]
    fn information_needs_no_prior(seed: u64) {
        let random = &mut random(seed);
        let motion = LinearStep::new(SMatrix::<f64, 3, 3>::identity(), SMatrix::zeros()).expect("valid");
        let mut filter = InformationFilter::<Vector<3>, Vector<3>, _>::ignorant(Vector(Vector3::repeat(7.0)), motion);
        let (mut a, mut b) = (Matrix3::zeros(), Vector3::zeros());
        for k in 0..5 {
            let h = nalgebra::RowVector3::from_fn(|_, _| random.normal());
            let (z, r) = (random.normal() * 5.0, 0.1 + random.uniform());
            a += h.transpose() * h / r;
            b += h.transpose() * (z / r);
            let instrument = Instrument::<Vector<3>, _>::new(Linear(h), SMatrix::<f64, 1, 1>::new(r)).expect("valid");
            filter.predict(Seconds(1.0)).expect("finite");
            let innovation = filter.correct(&instrument.read(SMatrix::<f64, 1, 1>::new(z)).expect("finite")).expect("finite");
            prop_assert_eq!(filter.determined().is_some(), k >= 2);
            prop_assert_eq!(innovation.dof, usize::from(k > 2));
            if let Some(belief) = filter.determined() {
                let covariance = a.try_inverse().expect("regular");
                prop_assert!((belief.mean.0 - covariance * b).norm() < 1e-6 * (1.0 + covariance.amax()));
                prop_assert!((belief.covariance - covariance).amax() < 1e-6 * (1.0 + covariance.amax()));
            } else {
                prop_assert!(filter.pose().covariance[(0, 0)].is_infinite());
            }
        }
    }

    /// `E[x + x²]` and `E[h]` of a quadratic `h` are exact, whatever the rule.
    #[test]
    fn sigma_points_are_exact_on_quadratic_means(seed: u64, which in 0_usize..3) {
        let random = &mut random(seed);
        let rule = [Rule::Cubature, UNSCENTED, Rule::UNSCENTED][which];
        let side = SMatrix::<f64, 3, 3>::from_fn(|_, _| random.normal());
        let covariance = side * side.transpose();
        let mean = Vector3::from_fn(|_, _| random.normal());
        let motion = Custom {
            motion: |s: &Vector<3>, _: Seconds| Vector(s.0 + s.0.component_mul(&s.0)),
            noise: |_: &Vector<3>, _: Seconds| Matrix3::zeros(),
        };
        let prior = Gaussian { mean: Vector(mean), covariance };
        let still = Brownian::<Vector<3>>::new(Vector3::zeros()).expect("valid");
        let mut moved = SigmaPointFilter::<Vector<3>, Vector<3>, _>::from_belief(prior.clone(), motion, rule).expect("a prior");
        moved.predict(Seconds(1.0)).expect("finite");
        let expected = mean + mean.component_mul(&mean) + covariance.diagonal();
        let scale = 1.0 + expected.amax();
        prop_assert!((moved.pose().mean.0 - expected).amax() < 1e-9 * scale);
        // z = E[h]: nothing to correct.
        let h = Function(|s: &Vector<3>| Vector2::new(s.0.x * s.0.y, s.0.z * s.0.z + s.0.x));
        let z = Vector2::new(mean.x * mean.y + covariance[(0, 1)], mean.z * mean.z + covariance[(2, 2)] + mean.x);
        let instrument = Instrument::<Vector<3>, _>::new(h, Matrix2::identity()).expect("valid");
        let mut seen = SigmaPointFilter::<Vector<3>, Vector<3>, _>::from_belief(prior, still, rule).expect("a prior");
        let innovation = seen.update(&instrument.read(z).expect("finite")).expect("finite");
        prop_assert!(innovation.nis < 1e-16 * (1.0 + z.norm_squared()) && (seen.pose().mean.0 - mean).amax() < 1e-8 * scale);
    }

    /// Iterated with an M-estimator: the posterior mean is a stationary point of `ρ` and prior together.
    #[test]
    fn iterated_filter_with_a_robust_loss_is_the_maximum_a_posteriori(seed: u64, which in 0_usize..3) {
        let random = &mut random(seed);
        let robust = [Robust::HUBER, Robust::CAUCHY, Robust::StudentT(4.0)][which];
        let h = |s: &Vector<3>| Vector2::new(s.0.x + 0.1 * s.0.y * s.0.y, s.0.z - 0.1 * s.0.x * s.0.y);
        let noise = Matrix2::new(0.2, 0.05, 0.05, 0.1);
        let instrument = Instrument::<Vector<3>, _>::robust(Function(h), noise, robust).expect("valid");
        let z = Vector2::new(4.0 * random.normal(), 4.0 * random.normal());
        let reading = instrument.read(z).expect("finite");
        let prior = Gaussian::from_sigmas(Vector(Vector3::new(0.3, -0.2, 0.1)), &Vector3::new(1.0, 0.5, 2.0));
        let still = Brownian::<Vector<3>>::new(Vector3::zeros()).expect("valid");
        let mut filter = KalmanFilter::<Vector<3>, Vector<3>, _>::from_belief(prior.clone(), still).expect("a prior").iterated(200);
        filter.update(&reading).expect("finite");
        let cost = |x: &Vector3<f64>| {
            let r = z - h(&Vector(*x));
            let d = x - prior.mean.0;
            robust.rho((noise.try_inverse().expect("regular") * r).dot(&r).sqrt()) + 0.5 * d.component_div(&Vector3::new(1.0, 0.25, 4.0)).dot(&d)
        };
        let x = filter.pose().mean.0;
        for k in 0..3 {
            let step = Vector3::ith(k, 1e-5);
            let slope = (cost(&(x + step)) - cost(&(x - step))) / 2e-5;
            // The iteration ends at steps of a thousandth of a deviation.
            prop_assert!(slope.abs() * filter.belief().covariance[(k, k)].sqrt() < 5e-3, "{slope}");
        }
    }
}

/// A locked coordinate, a rigid sensor, a prior that is nearly nothing: a million steps (by `.ci/full`).
fn ill_conditioned(steps: u32) {
    type V = Vector<3>;
    type Z = Reading<V, Linear<Const<2>, Const<3>>>;
    type Run = Box<dyn FnMut(Seconds, &Z) -> Gaussian<V>>;
    let random = &mut random(5);
    let prior = Gaussian::from_sigmas(Vector(Vector3::zeros()), &Vector3::new(1e6, 1.0, 1e-3));
    let motion = || Brownian::new(Vector3::new(1e4, 1e-8, 0.0)).expect("not negative");
    let kalman = || KalmanFilter::<V, V, _>::from_belief(prior.clone(), motion()).expect("a prior");
    let root = || SquareRootFilter::<V, V, _>::from_belief(prior.clone(), motion()).expect("a prior");
    let sigma =
        |rule| SigmaPointFilter::<V, V, _>::from_belief(prior.clone(), motion(), rule).expect("a prior");
    let modes = vec![mode::<V, V, V, _>(kalman()), mode(sigma(Rule::Cubature))];
    let imm = Imm::new(modes, &[0.5, 0.5], Switching::every(Seconds(1.0), 2), &prior).expect("models");
    let mut information =
        InformationFilter::<V, V, _>::from_belief(prior.clone(), motion()).expect("a prior");
    let mut runs: Vec<(&str, Run)> = vec![];
    macro_rules! run {
        ($name:literal, $filter:expr, $update:ident, $belief:expr) => {
            let mut filter = $filter;
            runs.push((
                $name,
                Box::new(move |dt, z| {
                    filter.predict(dt).expect("finite");
                    filter.$update(z).expect("finite");
                    $belief(&filter)
                }),
            ));
        };
        ($name:literal, $filter:expr, $update:ident) => {
            run!($name, $filter, $update, GaussianFilter::<V, V>::belief);
        };
    }
    run!("kalman", kalman(), update);
    run!("kalman, normal equations", kalman(), correct);
    run!("iterated", kalman().iterated(3), update);
    run!("row by row", kalman(), update_by_rows);
    run!("Schmidt", kalman().considering(Vector3::y()), update);
    run!("root", root(), update);
    run!("root, normal equations", root(), correct);
    run!("cubature", sigma(Rule::Cubature), update);
    run!("unscented", sigma(Rule::UNSCENTED), update);
    run!("unscented, negative weight", sigma(UNSCENTED), update);
    run!("mixture", imm, correct, |f: &Imm<V, V>| f.belief().clone());
    let smoother = Smoother::<V, _>::fixed_lag(kalman(), 3);
    run!("smoother", smoother, correct, |f: &Smoother<V, _>| f.oldest().expect("regular"));
    for k in 0..steps {
        let dt = Seconds(if k % 7 == 0 { 1e3 } else { 1e-3 });
        let tilt = 1e-7 * random.normal();
        let h = SMatrix::<f64, 2, 3>::new(1.0, tilt, 1.0, 1.0, 1e-5, tilt);
        let noise = Matrix2::new(1e-12, 0.0, 0.0, if k % 3 == 0 { 1e-12 } else { 1e4 });
        let instrument = Instrument::<V, _>::new(Linear(h), noise).expect("valid");
        let z = instrument.read(Vector2::zeros()).expect("finite");
        information.predict(dt).expect("finite");
        information.correct(&z).expect("finite");
        let y = information.information();
        assert!(*y == y.transpose() && symmetric_eigen(y).0.min() >= -1e-15 * y.trace(), "step {k}: {y}");
        for (name, run) in &mut runs {
            let belief = run(dt, &z);
            let p = belief.covariance;
            assert_eq!(p, p.transpose(), "{name}, step {k}");
            let lowest = symmetric_eigen(&p).0.min();
            assert!(lowest >= -1e-15 * p.trace(), "{name}, step {k}: eigenvalue {lowest} of {p}");
            assert!(belief.mean.0.norm() < 1e-9, "{name}: exact data move nothing");
        }
    }
}

#[test]
fn ill_conditioned_covariances_stay_positive() {
    ill_conditioned(2_000);
}

#[test]
#[ignore = "a million steps"]
fn ill_conditioned_covariances_stay_positive_for_a_million_steps() {
    ill_conditioned(1_000_000);
}

/// A considered bias enters the uncertainty and does not move; the optimal filter would estimate it.
#[test]
fn considered_coordinates_keep_their_belief() {
    let covariance = Matrix2::new(1.0, 0.3, 0.3, 0.5);
    let prior = Gaussian { mean: Vector(Vector2::new(1.0, 2.0)), covariance };
    let still = Brownian::<Vector<2>>::new(Vector2::zeros()).expect("valid");
    let filter = KalmanFilter::<Vector<2>, Vector<2>, _>::from_belief(prior, still).expect("a prior");
    let mut schmidt = filter.considering(Vector2::new(0.0, 1.0));
    let instrument = Instrument::<Vector<2>, _>::new(
        Linear(SMatrix::<f64, 1, 2>::new(1.0, 1.0)),
        SMatrix::<f64, 1, 1>::new(0.2),
    )
    .expect("valid");
    let z = instrument.read(SMatrix::<f64, 1, 1>::new(5.0)).expect("finite");
    let mut rows = schmidt.clone();
    let innovation = schmidt.update(&z).expect("finite");
    // S = 1 + 0.5 + 0.6 + 0.2, K = [1.3/S, 0].
    let (s, k) = (2.3, 1.3 / 2.3);
    assert!((innovation.nis - 4.0 / s).abs() < 1e-12);
    let belief = schmidt.belief();
    assert!((belief.mean.0 - Vector2::new(1.0 + 2.0 * k, 2.0)).norm() < 1e-12);
    let expected = Matrix2::new(1.0 - 1.3 * k, 0.3 - k * 0.8, 0.3 - k * 0.8, 0.5);
    assert!((belief.covariance - expected).amax() < 1e-12, "{}", belief.covariance);
    rows.update_by_rows(&z).expect("finite");
    assert!((rows.belief().covariance - expected).amax() < 1e-12);
    assert!(matches!(schmidt.correct(&z), Err(EstimateError::Unsupported(_))));

    // Several rows, at once and one by one: x ← x + K_x ν with the rows K_x of the optimal gain, c as it was.
    let random = &mut random(4);
    let mut matrix = || SMatrix::<f64, 4, 4>::from_fn(|_, _| random.normal());
    let (side, h) = (matrix(), matrix().fixed_rows::<2>(0).into_owned());
    let prior =
        Gaussian { mean: Vector(matrix().column(0).into_owned()), covariance: side * side.transpose() };
    let (p, r) = (prior.covariance, Matrix2::new(0.3, 0.1, 0.1, 0.2));
    let instrument = Instrument::<Vector<4>, _>::new(Linear(h), r).expect("valid");
    let z = Vector2::new(1.0, -2.0);
    let nu = z - h * prior.mean.0;
    let mut gain = p * h.transpose() * (h * p * h.transpose() + r).try_inverse().expect("regular");
    gain.rows_mut(1, 2).fill(0.0);
    let rest = SMatrix::<f64, 4, 4>::identity() - gain * h;
    let expected = rest * p * rest.transpose() + gain * r * gain.transpose();
    let still = Brownian::<Vector<4>>::new(nalgebra::Vector4::zeros()).expect("valid");
    let schmidt =
        KalmanFilter::<Vector<4>, Vector<4>, _>::from_belief(prior.clone(), still).expect("a prior");
    let schmidt = schmidt.considering(nalgebra::Vector4::new(0.0, 1.0, 1.0, 0.0));
    let (mut at_once, mut rows) = (schmidt.clone(), schmidt);
    let reading = instrument.read(z).expect("finite");
    let innovations = [at_once.update(&reading), rows.update_by_rows(&reading)].map(|i| i.expect("finite"));
    assert!((innovations[0].nis - innovations[1].nis).abs() < 1e-9);
    for filter in [at_once, rows] {
        let found = filter.belief();
        assert!((found.mean.0 - prior.mean.0 - gain * nu).norm() < 1e-9);
        assert!((found.covariance - expected).amax() < 1e-9, "{} {expected}", found.covariance);
    }
}

/// Wrong sizes and numbers are errors and change nothing.
#[test]
fn wrong_readings_are_errors() {
    let prior = Gaussian::from_sigmas(DynVector(DVector::zeros(3)), &DVector::repeat(3, 1.0));
    let still = Brownian::<DynVector>::new(DVector::zeros(3)).expect("valid");
    let mut kalman =
        KalmanFilter::<DynVector, DynVector, _>::from_belief(prior.clone(), still.clone()).expect("a prior");
    let mut root =
        SquareRootFilter::<DynVector, DynVector, _>::from_belief(prior.clone(), still).expect("a prior");
    let narrow = Differentiable {
        function: |_: &DynVector| DVector::zeros(1),
        jacobian: |_: &DynVector| DMatrix::zeros(1, 2),
    };
    let z = Instrument::<DynVector, _>::new(narrow, DMatrix::identity(1, 1))
        .expect("valid")
        .read(DVector::zeros(1))
        .expect("finite");
    let nan = Function(|s: &DynVector| s.0.rows(0, 1).map(|v| (v - 1.0).sqrt()));
    let y = Instrument::<DynVector, _>::new(nan, DMatrix::identity(1, 1))
        .expect("valid")
        .read(DVector::zeros(1))
        .expect("finite");
    for error in [kalman.update(&z), kalman.update_by_rows(&z), root.update(&z)] {
        assert!(matches!(error, Err(EstimateError::Dimension { found: 2, expected: 3, .. })), "{error:?}");
    }
    assert!(
        kalman.update(&y).is_err()
            && kalman.correct(&y).is_err()
            && root.update(&y).is_err()
            && root.correct(&y).is_err()
    );
    assert_eq!(kalman.belief().covariance, prior.covariance);
    let narrow = Gaussian { mean: prior.mean.clone(), covariance: DMatrix::identity(2, 2) };
    let still = Brownian::<DynVector>::new(DVector::zeros(3)).expect("valid");
    assert!(matches!(
        KalmanFilter::<DynVector, DynVector, _>::from_belief(narrow, still.clone()),
        Err(EstimateError::Dimension { .. })
    ));
    for bad in [
        Rule::Unscented { alpha: 0.0, beta: 2.0, kappa: 0.0 },
        Rule::Unscented { alpha: 0.5, beta: 2.0, kappa: -3.0 },
    ] {
        assert!(matches!(
            SigmaPointFilter::<DynVector, DynVector, _>::from_belief(prior.clone(), still.clone(), bad),
            Err(EstimateError::Config(_))
        ));
    }
    let flat = Gaussian::from_sigmas(prior.mean.clone(), &DVector::from_vec(vec![1.0, 0.0, 1.0]));
    assert!(matches!(
        InformationFilter::<DynVector, DynVector, _>::from_belief(flat, still),
        Err(EstimateError::NotPositiveDefinite(_))
    ));
}

/// A span cut in parts is the span, for every form.
#[test]
fn prediction_does_not_depend_on_how_time_is_cut() {
    type S = Moving<Vector<2>>;
    let motion = ConstantVelocity::<Vector<2>>::new(Vector2::new(0.3, 0.7)).expect("valid");
    let mean = Moving { pose: Vector(Vector2::new(1.0, 2.0)), velocity: Vector2::new(-0.5, 0.3) };
    let random = &mut random(1);
    let side = SMatrix::<f64, 4, 4>::from_fn(|_, _| random.normal());
    let prior = Gaussian { mean, covariance: side * side.transpose() };
    let mut whole: Vec<Box<dyn GaussianFilter<Vector<2>, S>>> = vec![
        Box::new(KalmanFilter::from_belief(prior.clone(), motion.clone()).expect("a prior")),
        Box::new(SquareRootFilter::from_belief(prior.clone(), motion.clone()).expect("a prior")),
        Box::new(InformationFilter::from_belief(prior.clone(), motion.clone()).expect("a prior")),
        Box::new(
            SigmaPointFilter::from_belief(prior.clone(), motion.clone(), Rule::Cubature).expect("a prior"),
        ),
    ];
    for filter in &mut whole {
        filter.predict(Seconds(0.9)).expect("finite");
        let once = filter.belief();
        filter.set_belief(prior.clone()).expect("a belief");
        for part in [0.2, 0.0, 0.5, 0.2] {
            filter.predict(Seconds(part)).expect("finite");
        }
        let parts = filter.belief();
        assert!(once.mean.local(&parts.mean).norm() < 1e-11);
        assert!((once.covariance - parts.covariance).amax() < 1e-11 * once.covariance.amax());
    }
    let _: &dyn Dynamics<S> = &motion;
}
