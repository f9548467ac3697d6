//! Linear problems, where a Kalman filter is exact.

use nalgebra::{DMatrix, DVector, Vector2, Vector3};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use vt_core::agent::Estimator;
use vt_core::belief::{Gaussian, Moving};
use vt_core::dynamics::{Brownian, ConstantVelocity};
use vt_core::least_squares::{LeastSquares, symmetric_eigen};
use vt_core::lie::{DynVector, Vector};
use vt_core::math;
use vt_core::random::Random;
use vt_core::report::StopReason;
use vt_core::time::Seconds;
use vt_estimators::kalman::KalmanFilter;
use vt_estimators::map::maximum_a_posteriori;

use crate::problems::{Rows, dense, random};

pub fn config() -> ProptestConfig {
    ProptestConfig {
        cases: 60,
        rng_seed: RngSeed::Fixed(1),
        failure_persistence: None,
        ..ProptestConfig::default()
    }
}

/// One step of a linear system: `x ← F x + w`, `w ~ N(0, Q)`, then `z = H x + v`, `v ~ N(0, diag(r))`.
pub struct LinearStep {
    pub f: DMatrix<f64>,
    pub q: DMatrix<f64>,
    pub h: DMatrix<f64>,
    pub z: DVector<f64>,
    pub r: DVector<f64>,
}

/// A prior and steps with the same `F` and `Q`.
pub struct LinearProblem {
    pub mean: DVector<f64>,
    pub covariance: DMatrix<f64>,
    pub steps: Vec<LinearStep>,
}

impl LinearProblem {
    /// `n` coordinates, `m` rows a step; regular throughout.
    pub fn random(n: usize, m: usize, steps: usize, random: &mut Random) -> Self {
        let mut spread = |scale: f64| {
            let side = matrix(n, n, random) * scale;
            &side * side.transpose() + DMatrix::identity(n, n) * 0.1
        };
        let (covariance, q) = (spread(1.0), spread(0.3));
        let f = DMatrix::identity(n, n) + matrix(n, n, random) * 0.2;
        let mean = DVector::from_fn(n, |_, _| random.normal());
        let steps = (0..steps).map(|_| LinearStep {
            f: f.clone(),
            q: q.clone(),
            h: matrix(m, n, random),
            z: DVector::from_fn(m, |_, _| 3.0 * random.normal()),
            r: DVector::from_fn(m, |_, _| 0.1 + random.uniform()),
        });
        let steps = steps.collect();
        Self { mean, covariance, steps }
    }
}

fn root(m: &DMatrix<f64>) -> DMatrix<f64> {
    let eigen = m.clone().symmetric_eigen();
    &eigen.eigenvectors * DMatrix::from_diagonal(&eigen.eigenvalues.map(|v| v.max(0.0).sqrt()))
}

/// The last state from all data at once: least squares over the independent standard normal causes `a` of everything
/// (prior and noise), in information form, so that singular `P` and `Q` need no inverse.
pub fn batch(
    mean: &DVector<f64>,
    covariance: &DMatrix<f64>,
    steps: &[LinearStep],
) -> (DVector<f64>, DMatrix<f64>) {
    let n = mean.len();
    let causes = n * (steps.len() + 1);
    // x = x̄ + M a
    let mut x = mean.clone();
    let mut m = DMatrix::zeros(n, causes);
    m.view_mut((0, 0), (n, n)).copy_from(&root(covariance));
    let mut information = DMatrix::identity(causes, causes);
    let mut right = DVector::zeros(causes);
    for (k, s) in steps.iter().enumerate() {
        x = &s.f * x;
        m = &s.f * m;
        let mut fresh = m.view_mut((0, n * (k + 1)), (n, n));
        fresh += root(&s.q);
        let seen = &s.h * &m;
        let weighted = seen.transpose() * DMatrix::from_diagonal(&s.r.map(|r| 1.0 / r));
        information += &weighted * &seen;
        right += &weighted * (&s.z - &s.h * &x);
    }
    let factor = information.cholesky().expect("identity and more");
    (x + &m * factor.solve(&right), &m * factor.solve(&m.transpose()))
}

fn assert_close(found: &DMatrix<f64>, expected: &DMatrix<f64>, tolerance: f64) {
    let error = (found - expected).amax();
    assert!(error <= tolerance * expected.amax().max(1.0), "{error}: found {found}, expected {expected}");
}

pub fn matrix(rows: usize, columns: usize, random: &mut Random) -> DMatrix<f64> {
    DMatrix::from_fn(rows, columns, |_, _| random.normal())
}

fn rows_of(h: &DMatrix<f64>, z: &DVector<f64>, r: &DVector<f64>) -> Rows<DynVector> {
    Rows {
        rows: h.row_iter().map(|row| row.transpose()).collect(),
        values: z.iter().copied().collect(),
        variances: r.iter().copied().collect(),
    }
}

proptest! {
    #![proptest_config(config())]

    /// Random walks: fewer rows than unknowns at most steps (singular information), coordinate 1 locked.
    #[test]
    fn kalman_filter_is_the_batch_solution_of_a_random_walk(seed: u64, n in 2_usize..6, iterations in 1_u32..4) {
        let random = &mut random(seed);
        let side = matrix(n, n, random);
        let mut covariance = &side * side.transpose();
        covariance.row_mut(1).fill(0.0);
        covariance.column_mut(1).fill(0.0);
        let mean = DVector::from_fn(n, |_, _| random.normal());
        let density = DVector::from_fn(n, |k, _| if k == 1 { 0.0 } else { random.uniform() });
        let prior = Gaussian { mean: DynVector(mean.clone()), covariance: covariance.clone() };
        let motion = Brownian::<DynVector>::new(density.clone()).expect("not negative");
        let mut filter = KalmanFilter::<_, DynVector, _>::new(&prior, vec![], motion, iterations).expect("a prior");
        let mut steps = vec![];
        for k in 0..6 {
            let (rows, dt) = (1 + k % 3, 0.1 + random.uniform());
            let h = matrix(rows, n, random);
            let z = DVector::from_fn(rows, |_, _| 3.0 * random.normal());
            let r = DVector::from_fn(rows, |_, _| 0.01 + random.uniform());
            filter.predict(Seconds(dt)).expect("finite");
            filter.correct(&rows_of(&h, &z, &r)).expect("finite");
            let q = DMatrix::from_diagonal(&(&density * dt));
            steps.push(LinearStep { f: DMatrix::identity(n, n), q, h, z, r });
        }
        let (expected, spread) = batch(&mean, &covariance, &steps);
        let belief = filter.belief();
        assert_close(&dense(&belief.mean.0), &dense(&expected), 1e-9);
        assert_close(&belief.covariance, &spread, 1e-9);
        prop_assert_eq!(belief.mean.0[1], mean[1], "a locked coordinate moved");
        prop_assert!(belief.covariance.row(1).iter().all(|v| *v == 0.0), "a locked coordinate got variance");
    }

    /// Velocities are learnt from positions alone.
    #[test]
    fn kalman_filter_is_the_batch_solution_at_constant_velocity(seed: u64) {
        let random = &mut random(seed);
        let mean = Vector2::new(random.normal(), random.normal());
        let (position, rest) = (Vector2::new(0.5, 2.0), Vector2::new(3.0, 0.2));
        let density = Vector2::new(0.4, 0.1);
        let prior = Gaussian::from_sigmas(Vector(mean), &position);
        let motion = ConstantVelocity::<Vector<2>>::new(density).expect("not negative");
        let mut filter = KalmanFilter::<_, Moving<Vector<2>>, _>::new(&prior, vec![rest], motion, 1).expect("a prior");
        let mut steps = vec![];
        for _ in 0..8 {
            let dt = 0.05 + random.uniform();
            let h = matrix(1, 2, random);
            let (z, r) = (random.normal() * 3.0, 0.01 + random.uniform());
            filter.predict(Seconds(dt)).expect("finite");
            let rows = vec![Vector2::new(h[0], h[1])];
            filter.correct(&Rows::<Vector<2>> { rows, values: vec![z], variances: vec![r] }).expect("finite");
            let (mut f, mut q) = (DMatrix::identity(4, 4), DMatrix::zeros(4, 4));
            for k in 0..2 {
                f[(k, k + 2)] = dt;
                q[(k, k)] = density[k] * dt * dt * dt / 3.0;
                q[(k, k + 2)] = density[k] * dt * dt / 2.0;
                q[(k + 2, k)] = q[(k, k + 2)];
                q[(k + 2, k + 2)] = density[k] * dt;
            }
            let h = h.resize_horizontally(4, 0.0);
            steps.push(LinearStep { f, q, h, z: DVector::from_element(1, z), r: DVector::from_element(1, r) });
        }
        let sigmas = DVector::from_column_slice(&[position.x, position.y, rest.x, rest.y]);
        let covariance = DMatrix::from_diagonal(&sigmas.component_mul(&sigmas));
        let mean = DVector::from_column_slice(&[mean.x, mean.y, 0.0, 0.0]);
        let (expected, spread) = batch(&mean, &covariance, &steps);
        let Moving { pose, velocity } = &filter.belief().mean;
        let found = DVector::from_column_slice(&[pose.0.x, pose.0.y, velocity.x, velocity.y]);
        assert_close(&dense(&found), &dense(&expected), 1e-9);
        assert_close(&dense(&filter.belief().covariance), &spread, 1e-9);
    }

    /// `ν = z − Hx`, `S = HPHᵀ + R`: NIS `νᵀS⁻¹ν`, and `ln N(z; Hx, S)` but for the `½ ln det 2πR` that the likelihood
    /// leaves out. With more rows than unknowns only the part of ν that some state explains enters the NIS.
    #[test]
    fn nis_and_evidence_have_their_closed_forms(seed: u64, n in 1_usize..5, rows in 1_usize..7, iterations in 1_u32..3) {
        let random = &mut random(seed);
        let side = matrix(n, n, random);
        let prior = Gaussian { mean: DynVector(DVector::from_fn(n, |_, _| random.normal())), covariance: &side * side.transpose() };
        let h = matrix(rows, n, random);
        let z = DVector::from_fn(rows, |_, _| 2.0 * random.normal());
        let r = DVector::from_fn(rows, |_, _| 0.1 + random.uniform());
        let (_, found) = maximum_a_posteriori(&prior, &rows_of(&h, &z, &r), iterations).expect("finite");
        let nu = &z - &h * &prior.mean.0;
        let s = (&h * &prior.covariance * h.transpose() + DMatrix::from_diagonal(&r)).cholesky().expect("positive");
        let log_det = 2.0 * s.l_dirty().diagonal().iter().map(|d| math::ln(*d)).sum::<f64>();
        let constant: f64 = r.iter().map(|r| math::ln(*r)).sum();
        let evidence = -0.5 * (nu.dot(&s.solve(&nu)) + log_det - constant);
        prop_assert!((found.log_evidence - evidence).abs() < 1e-8 * (1.0 + evidence.abs()), "{found:?}, {evidence}");
        prop_assert_eq!(found.dof, rows.min(n));
        let whitened = DMatrix::from_diagonal(&r.map(|r| 1.0 / r.sqrt()));
        let explained = (&whitened * &h).svd(true, false).u.expect("asked for");
        let columns = explained.columns(0, rows.min(n));
        // ν without what no state explains, in whitened rows.
        let part = columns * (columns.transpose() * (&whitened * &nu));
        let part = DMatrix::from_diagonal(&r.map(f64::sqrt)) * part;
        let nis = part.dot(&s.solve(&part));
        prop_assert!((found.nis - nis).abs() < 1e-8 * (1.0 + nis), "{found:?}, {nis}");
    }

    /// Extended, iterated and least squares are one.
    #[test]
    fn one_iteration_is_enough(seed: u64, n in 1_usize..6, rows in 1_usize..6) {
        let random = &mut random(seed);
        let side = matrix(n, n, random);
        let prior = Gaussian { mean: DynVector(DVector::zeros(n)), covariance: &side * side.transpose() };
        let z = DVector::from_fn(rows, |_, _| random.normal());
        let r = DVector::from_fn(rows, |_, _| 0.1 + random.uniform());
        let z = rows_of(&matrix(rows, n, random), &z, &r);
        let (once, innovation) = maximum_a_posteriori(&prior, &z, 1).expect("finite");
        prop_assert_eq!((innovation.iterations, innovation.stop), (1, StopReason::Direct));
        let (often, innovation) = maximum_a_posteriori(&prior, &z, 20).expect("finite");
        prop_assert!(innovation.iterations <= 2 && innovation.stop == StopReason::SmallStep, "{innovation:?}");
        let solution = LeastSquares::gauss_newton().fit(&z, &prior.mean, Some(&prior)).expect("finite");
        for (mean, covariance) in [(&often.mean, &often.covariance), (&solution.pose, &solution.covariance)] {
            assert_close(&dense(&once.mean.0), &dense(&mean.0), 1e-9);
            assert_close(&once.covariance, covariance, 1e-9);
        }
    }

    /// Rows that differ by `gap` of their length and are known to a tenth of that. The information matrix is singular,
    /// its condition on the rest the square of that of the rows: so many digits are lost, and no more.
    #[test]
    fn nearly_dependent_rows_keep_their_digits(seed: u64, n in 3_usize..6, digits in 2..5) {
        let random = &mut random(seed);
        let gap = math::pow(10.0, -f64::from(digits));
        let first = DVector::from_fn(n, |_, _| random.normal());
        let h = DMatrix::from_fn(n - 1, n, |r, c| first[c] + if r == 0 { 0.0 } else { gap * random.normal() });
        let values = h.singular_values();
        let condition = (values.max() / values.min()) * (values.max() / values.min());
        prop_assume!(condition < 1e11);
        let truth = DVector::from_fn(n, |_, _| random.normal());
        let (z, r) = (&h * &truth, DVector::from_element(n - 1, 0.01 * gap * gap));
        let prior = Gaussian { mean: DynVector(DVector::zeros(n)), covariance: DMatrix::identity(n, n) };
        let (found, _) = maximum_a_posteriori(&prior, &rows_of(&h, &z, &r), 1).expect("finite");
        let (expected, covariance) = batch(&prior.mean.0, &prior.covariance, &[LinearStep {
            f: DMatrix::identity(n, n), q: DMatrix::zeros(n, n), h, z, r
        }]);
        let tolerance = 1e3 * f64::EPSILON * condition;
        let error = (&found.mean.0 - &expected).norm();
        prop_assert!(error < tolerance, "mean off by {error}, tolerance {tolerance}");
        let spread = (&found.covariance - &covariance).amax();
        prop_assert!(spread < tolerance, "covariance off by {spread}, tolerance {tolerance}");
    }
}

/// Deviations of 10⁶ against 10⁻⁶, nearly parallel rows, ten thousand times.
#[test]
fn covariances_stay_symmetric_and_positive() {
    let random = &mut random(5);
    let prior = Gaussian::from_sigmas(Vector(Vector3::zeros()), &Vector3::new(1e6, 1.0, 1e-3));
    let motion = Brownian::new(Vector3::new(1e4, 1e-8, 0.0)).expect("not negative");
    let mut filter = KalmanFilter::<_, Vector<3>, _>::new(&prior, vec![], motion, 1).expect("a prior");
    for k in 0..10_000 {
        filter.predict(Seconds(if k % 7 == 0 { 1e3 } else { 1e-3 })).expect("finite");
        let tilt = 1e-7 * random.normal();
        let rows = vec![Vector3::new(1.0, tilt, 1.0), Vector3::new(1.0, 1e-5, tilt)];
        let variances = vec![1e-12, if k % 3 == 0 { 1e-12 } else { 1e4 }];
        filter.correct(&Rows::<Vector<3>> { rows, values: vec![0.0, 0.0], variances }).expect("finite");
        let p = &filter.belief().covariance;
        assert_eq!(*p, p.transpose(), "step {k}");
        let lowest = symmetric_eigen(p).0.min();
        assert!(lowest >= -1e-15 * p.trace(), "step {k}: eigenvalue {lowest} of {p}");
        assert!(filter.belief().mean.0.norm() < 1e-9, "exact data move nothing");
    }
}
