//! Closed forms, hard valleys, poses from points, directions without data, priors.

use nalgebra::{DMatrix, DVector, Matrix2, Matrix3, Matrix6, Point3, SMatrix, Vector2, Vector3, Vector6};

use super::*;
use crate::lie::{DynVector, LieGroup, SE3, Vector};
use crate::random::{Random, Stream};

fn points(n: u32) -> Vec<Point3<f64>> {
    let mut random = Random::new(11, Stream::Sim, 0, 0, 0);
    (0..n).map(|_| Point3::new(random.normal(), random.normal(), random.normal())).collect()
}

fn truth() -> SE3 {
    SE3::exp(&Vector6::new(0.3, -1.2, 0.7, 0.5, -0.9, 1.1))
}

/// Rows of `z - T p` for the pairs, only in the coordinates of `kept`.
fn pairs<'a>(
    model: &'a [Point3<f64>],
    seen: &'a [Point3<f64>],
    weight: f64,
    kept: &'a [usize],
) -> impl FnMut(&SE3, &mut NormalEquations<SE3>) + 'a {
    move |pose, out| {
        let r = pose.rotation.to_rotation_matrix().into_inner();
        for (p, z) in model.iter().zip(seen) {
            let e = z - pose.act(p);
            // ∂ T Exp(δ) p = R (v + ω × p)
            let turn = -r * p.coords.cross_matrix();
            for &k in kept {
                let j = Vector6::from_fn(|c, _| if c < 3 { r[(k, c)] } else { turn[(k, c - 3)] });
                out.add(e[k], &j, weight);
            }
        }
    }
}

#[test]
fn eigenvalues_rebuild_the_matrix() {
    let a = SMatrix::<f64, 5, 5>::from_fn(|r, c| 1.0 / (r + c + 1) as f64);
    let (values, vectors) = symmetric_eigen(&a);
    assert!(
        (vectors * SMatrix::<f64, 5, 5>::from_diagonal(&values) * vectors.transpose() - a).amax() < 1e-15
    );
    assert!((vectors.transpose() * vectors - SMatrix::identity()).amax() < 1e-14);
    // Smallest eigenvalue of the Hilbert matrix of order five.
    assert!((values.min() / 3.287928772171e-6 - 1.0).abs() < 1e-9, "{values}");
    let (values, _) = symmetric_eigen(&SMatrix::<f64, 3, 3>::zeros());
    assert_eq!(values, Vector3::zeros());
}

#[test]
fn a_quadratic_problem_takes_one_step() {
    let (a, b) = (Matrix2::new(4.0, 1.0, 1.0, 3.0), Vector2::new(1.0, 2.0));
    for solver in [LeastSquares::gauss_newton(), LeastSquares::levenberg_marquardt()] {
        let s = solver
            .minimize(&Vector(Vector2::zeros()), None, |x, out| {
                out.information = a;
                out.gradient = b - a * x.0;
                out.cost = 0.5 * (x.0.dot(&(a * x.0))) - b.dot(&x.0) + 10.0;
                out.rows = 2;
            })
            .expect("finite");
        assert!((s.pose.0 - a.try_inverse().expect("regular") * b).norm() < 1e-6, "{s:?}");
        assert!((s.covariance * a - Matrix2::identity()).amax() < 1e-14 && s.information == a);
        assert_eq!(
            (s.stop, s.unobservable.len(), s.posterior_information),
            (StopReason::SmallStep, 0, Some(a))
        );
        assert!(solver.method != Method::GaussNewton || s.iterations == 1);
    }
}

#[test]
fn a_curved_valley_is_followed_to_its_end() {
    // Rosenbrock's function as residuals 10 (y - x²) and 1 - x.
    let s = LeastSquares::levenberg_marquardt()
        .minimize(&Vector(Vector2::new(-1.2, 1.0)), None, |p, out| {
            let (x, y) = (p.0.x, p.0.y);
            out.add(-10.0 * (y - x * x), &Vector2::new(-20.0 * x, 10.0), 1.0);
            out.add(1.0 - x, &Vector2::new(1.0, 0.0), 1.0);
        })
        .expect("finite");
    assert!((s.pose.0 - Vector2::new(1.0, 1.0)).norm() < 1e-6, "{s:?}");
    assert!(s.iterations < 40 && s.cost < 1e-12);
}

#[test]
fn damping_saves_what_full_steps_lose() {
    // atan has its only minimum at zero; full Newton steps from 1.5 diverge.
    let fill = |x: &Vector<1>, out: &mut NormalEquations<Vector<1>>| {
        let d = 1.0 / (1.0 + x.0.x * x.0.x);
        out.add(-crate::math::atan(x.0.x), &[d].into(), 1.0);
    };
    let start = Vector([1.5].into());
    let full = LeastSquares::gauss_newton().minimize(&start, None, fill).expect("finite");
    assert!(full.pose.0.x.abs() > 10.0 && full.stop != StopReason::SmallStep, "{full:?}");
    let damped = LeastSquares::levenberg_marquardt().minimize(&start, None, fill).expect("finite");
    assert!(damped.pose.0.x.abs() < 1e-6, "{damped:?}");
}

#[test]
fn a_pose_from_point_pairs_equals_the_closed_form() {
    let model = points(12);
    let mut random = Random::new(5, Stream::Sim, 0, 1, 0);
    let seen: Vec<_> = model
        .iter()
        .map(|p| truth().act(p) + Vector3::new(random.normal(), random.normal(), random.normal()) * 0.02)
        .collect();
    // Closed form: centroids and the singular value decomposition of the cross-covariance (Kabsch, Umeyama).
    let centre = |x: &[Point3<f64>]| x.iter().map(|p| p.coords).sum::<Vector3<f64>>() / x.len() as f64;
    let (cm, cs) = (centre(&model), centre(&seen));
    let h: Matrix3<f64> =
        model.iter().zip(&seen).map(|(p, z)| (z.coords - cs) * (p.coords - cm).transpose()).sum();
    let svd = h.svd(true, true);
    let (u, v) = (svd.u.expect("asked for"), svd.v_t.expect("asked for"));
    let rotation = u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (u * v).determinant())) * v;
    let mut matrix = nalgebra::Matrix4::identity();
    matrix.fixed_view_mut::<3, 3>(0, 0).copy_from(&rotation);
    matrix.fixed_view_mut::<3, 1>(0, 3).copy_from(&(cs - rotation * cm));
    let closed = SE3::from_matrix(&matrix, 1e-9).expect("a rotation");
    for mut solver in [LeastSquares::gauss_newton(), LeastSquares::levenberg_marquardt()] {
        solver.step_tolerance = 1e-9;
        let s = solver
            .minimize(&SE3::identity(), None, pairs(&model, &seen, 2500.0, &[0, 1, 2]))
            .expect("finite");
        assert!(s.pose.local(&closed).norm() < 1e-9, "{solver:?}: {}", s.pose.local(&closed));
        assert!(matches!(s.stop, StopReason::SmallStep | StopReason::SmallDecrease) && s.rows == 36);
        assert!((s.covariance * s.information - Matrix6::identity()).amax() < 1e-10);
        // The cost is half a χ² with 30 degrees of freedom.
        assert!(2.0 * s.cost > crate::math::chi_square_quantile(0.001, 30.0));
        assert!(2.0 * s.cost < crate::math::chi_square_quantile(0.999, 30.0));
    }
}

#[test]
fn directions_without_data_stay_and_are_named() {
    // Points on the body's z axis: turning about it changes nothing.
    let model: Vec<_> = (0..6).map(|k| Point3::new(0.0, 0.0, f64::from(k) - 2.0)).collect();
    let seen: Vec<_> = model.iter().map(|p| truth().act(p)).collect();
    let start = truth().retract(&Vector6::new(0.1, 0.2, -0.1, 0.2, -0.3, 0.4));
    for solver in [LeastSquares::gauss_newton(), LeastSquares::levenberg_marquardt()] {
        let s = solver.minimize(&start, None, pairs(&model, &seen, 1.0, &[0, 1, 2])).expect("finite");
        let [null] = &s.unobservable[..] else { panic!("one direction, not {:?}", s.unobservable) };
        assert!((null.abs() - Vector6::new(0.0, 0.0, 0.0, 0.0, 0.0, 1.0)).norm() < 1e-7, "{null}");
        assert!((null.norm() - 1.0).abs() < 1e-15);
        assert!(model.iter().zip(&seen).all(|(p, z)| (s.pose.act(p) - z).norm() < 1e-6), "{:?}", s.stop);
        assert!((s.covariance * null).norm() < 1e-12 && (s.information * null).norm() < 1e-9);
        assert!((s.information * s.covariance * s.information - s.information).amax() < 1e-9);
    }
    // One step moves by nothing along the axis.
    let one = LeastSquares { max_iterations: 1, ..LeastSquares::gauss_newton() };
    let s = one.minimize(&start, None, pairs(&model, &seen, 1.0, &[0, 1, 2])).expect("finite");
    assert!(
        start.local(&s.pose)[5].abs() < 1e-12
            && start.local(&s.pose).norm() > 0.1
            && s.stop == StopReason::Iterations
    );
}

#[test]
fn oblique_null_directions_get_no_step() {
    // One equation 3x + 4y = 10 in the plane: the nearest solution, whatever the scaling of the columns.
    for scale in [1.0, 1e3] {
        let s = LeastSquares::gauss_newton()
            .minimize(&Vector(Vector2::new(1.0, 1.0)), None, |x, out| {
                let j = Vector2::new(3.0, 4.0 * scale);
                out.add(10.0 - j.dot(&x.0), &j, 1.0);
            })
            .expect("finite");
        let null = Vector2::new(4.0 * scale, -3.0).normalize();
        assert!((s.pose.0 - Vector2::new(1.0, 1.0)).dot(&null).abs() < 1e-12, "{s:?}");
        assert!((3.0 * s.pose.0.x + 4.0 * scale * s.pose.0.y - 10.0).abs() < 1e-6);
        assert!(s.unobservable.len() == 1 && s.unobservable[0].dot(&null).abs() > 1.0 - 1e-12);
    }
}

#[test]
fn units_do_not_decide_what_is_observable() {
    // A coordinate in tenths of millimetres beside one in metres.
    let s = LeastSquares::gauss_newton()
        .minimize(&Vector(Vector2::zeros()), None, |x, out| {
            out.add(1.0 - 1e4 * x.0.x, &Vector2::new(1e4, 0.0), 1.0);
            out.add(1.0 - x.0.y, &Vector2::new(0.0, 1.0), 1.0);
        })
        .expect("finite");
    assert!(s.unobservable.is_empty() && (s.pose.0 - Vector2::new(1e-4, 1.0)).norm() < 1e-6);
}

#[test]
fn without_any_data_nothing_moves() {
    let s = LeastSquares::gauss_newton().minimize(&truth(), None, |_, _| {}).expect("finite");
    assert_eq!((s.pose, s.stop, s.unobservable.len(), s.rows), (truth(), StopReason::Singular, 6, 0));
    assert_eq!(s.covariance, Matrix6::zeros());
    let prior = Gaussian::from_sigmas(truth(), &Vector6::repeat(0.1));
    let s = LeastSquares::gauss_newton().minimize(&truth(), Some(&prior), |_, _| {}).expect("finite");
    assert!(s.pose.local(&truth()).norm() < 1e-15 && (s.covariance - prior.covariance).amax() < 1e-16);
    assert_eq!((s.unobservable.len(), s.prior_cost), (6, 0.0));
}

#[test]
fn a_prior_on_a_line_is_the_kalman_update() {
    let prior =
        Gaussian { mean: Vector(Vector2::new(1.0, 2.0)), covariance: Matrix2::new(2.0, 0.6, 0.6, 1.0) };
    let (h, z, r) = (Vector2::new(1.0, -2.0), 0.5, 0.3);
    // K = P h / (hᵀ P h + r)
    let gain = prior.covariance * h / (h.dot(&(prior.covariance * h)) + r);
    let mean = prior.mean.0 + gain * (z - h.dot(&prior.mean.0));
    let covariance = prior.covariance - gain * h.transpose() * prior.covariance;
    for start in [Vector2::zeros(), prior.mean.0] {
        let s = LeastSquares::gauss_newton()
            .minimize(&Vector(start), Some(&prior), |x, out| out.add(z - h.dot(&x.0), &h, 1.0 / r))
            .expect("finite");
        assert!((s.pose.0 - mean).norm() < 1e-12 && (s.covariance - covariance).amax() < 1e-14, "{s:?}");
        let posterior = s.posterior_information.expect("regular prior");
        assert!((posterior * covariance - Matrix2::identity()).amax() < 1e-12);
        assert!(s.unobservable.len() == 1 && (s.unobservable[0].dot(&h)).abs() < 1e-12);
        // Cost at the minimum: ½ (z - h m)² / (hᵀ P h + r).
        let nis = (z - h.dot(&prior.mean.0)).powi(2) / (h.dot(&(prior.covariance * h)) + r);
        assert!((2.0 * (s.cost + s.prior_cost) - nis).abs() < 1e-12);
    }
}

#[test]
fn a_prior_on_se3_gives_the_mode_in_any_order() {
    let model = points(3);
    let seen: Vec<_> = model.iter().map(|p| truth().act(p)).collect();
    let far = truth().retract(&Vector6::new(0.3, 0.2, -0.3, 0.5, -0.4, 0.6));
    let prior = Gaussian::from_sigmas(far, &Vector6::new(0.3, 0.4, 0.2, 0.3, 0.5, 0.4));
    let mut solver = LeastSquares::levenberg_marquardt();
    (solver.step_tolerance, solver.decrease_tolerance) = (1e-8, 0.0);
    let data = |at: &SE3, out: &mut NormalEquations<SE3>| pairs(&model, &seen, 50.0, &[0, 2])(at, out);
    let s = solver.minimize(&far, Some(&prior), data).expect("finite");
    let again = solver.minimize(&truth(), Some(&prior), data).expect("finite");
    assert!(s.pose.local(&again.pose).norm() < 1e-7);
    // Total cost around the mode: its gradient is zero and its curvature the inverse covariance.
    let total = |x: &SE3| {
        let mut e = NormalEquations::empty(x);
        data(x, &mut e);
        e.cost + 0.5 * prior.nees(x).expect("regular")
    };
    let (best, h) = (total(&s.pose), 1e-4);
    assert!((best - s.cost - s.prior_cost).abs() < 1e-12);
    for k in 0..6 {
        let mut d = Vector6::zeros();
        d[k] = h;
        let slope = (total(&s.pose.retract(&d)) - total(&s.pose.retract(&-d))) / (2.0 * h);
        assert!(slope.abs() < 1e-5, "{k}: {slope}");
    }
    let posterior = s.posterior_information.expect("regular prior");
    assert!((posterior * s.covariance - Matrix6::identity()).amax() < 1e-9);
    // Nothing is seen along the camera's y axis.
    let [null] = &s.unobservable[..] else { panic!("one direction, not {:?}", s.unobservable) };
    assert!((s.pose.rotation * null.fixed_rows::<3>(0)).y.abs() > 1.0 - 1e-9, "{null}");
}

#[test]
fn a_locked_coordinate_stays_at_the_prior() {
    let model = points(6);
    let seen: Vec<_> = model.iter().map(|p| truth().act(p)).collect();
    let mean = truth().retract(&Vector6::new(0.1, 0.0, 0.0, 0.0, 0.1, 0.0));
    let prior = Gaussian::from_sigmas(mean, &Vector6::new(0.0, 1.0, 1.0, 1.0, 0.0, 1.0));
    let s = LeastSquares::levenberg_marquardt()
        .minimize(&truth(), Some(&prior), pairs(&model, &seen, 1e4, &[0, 1, 2]))
        .expect("finite");
    let moved = mean.local(&s.pose);
    assert!(moved[0].abs() < 1e-12 && moved[4].abs() < 1e-12 && moved.norm() > 1e-3, "{moved}");
    assert!(s.posterior_information.is_none());
    assert!(s.covariance.iter().all(|v| v.is_finite()));
}

#[test]
fn run_time_dimensions_go_the_same_way() {
    let a = DMatrix::from_row_slice(4, 3, &[1.0, 2.0, 0.0, 0.0, 1.0, 1.0, 2.0, 0.0, 1.0, 1.0, 1.0, 1.0]);
    let z = DVector::from_column_slice(&[1.0, 2.0, 3.0, 4.0]);
    let s = LeastSquares::gauss_newton()
        .minimize(&DynVector(DVector::zeros(3)), None, |x, out| {
            let r = &z - &a * &x.0;
            for k in 0..4 {
                out.add(r[k], &a.row(k).transpose(), 1.0);
            }
        })
        .expect("finite");
    let expected = (a.transpose() * &a).try_inverse().expect("regular") * a.transpose() * &z;
    assert!((s.pose.0 - expected).norm() < 1e-12);
}

#[test]
fn nonsense_is_refused() {
    let solver = LeastSquares::gauss_newton();
    let start = Vector(Vector2::new(f64::NAN, 0.0));
    assert_eq!(solver.minimize(&start, None, |_, _| {}).err(), Some(EstimateError::NotFinite("start")));
    let start = DynVector(DVector::zeros(2));
    let prior = Gaussian { mean: DynVector(DVector::zeros(3)), covariance: DMatrix::identity(3, 3) };
    let error = solver.minimize(&start, Some(&prior), |_, _| {}).err();
    assert_eq!(error, Some(EstimateError::Dimension { what: "prior", found: 3, expected: 2 }));
    let mut prior = Gaussian { mean: start.clone(), covariance: DMatrix::identity(2, 2) };
    prior.covariance[(0, 0)] = f64::INFINITY;
    assert_eq!(
        solver.minimize(&start, Some(&prior), |_, _| {}).err(),
        Some(EstimateError::NotFinite("prior"))
    );
    let error = solver.minimize(&start, None, |_, out| out.cost = f64::NAN).err();
    assert_eq!(error, Some(EstimateError::NotFinite("normal equations")));
}
