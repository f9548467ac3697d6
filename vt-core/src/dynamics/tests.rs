//! Closed forms, composition of steps, locked coordinates, models of users.

use nalgebra::{DVector, Matrix2, Matrix3, SMatrix, SVector, Vector1, Vector6};

use super::*;
use crate::agent::Dynamics;
use crate::belief::{Accelerating, Moving};
use crate::lie::{DynVector, LieGroup, SE3, Vector};
use crate::manifold::{Manifold, Square};
use crate::math;
use crate::time::Seconds;

#[test]
fn noise_on_the_line_has_its_closed_form() {
    let d = 0.7_f64;
    let cv = ConstantVelocity::<Vector<1>>::new(Vector1::new(2.0)).expect("valid");
    let q = cv.noise(&Moving { pose: Vector(Vector1::new(1.0)), velocity: Vector1::new(3.0) }, Seconds(d));
    assert!((q - Matrix2::new(d * d * d / 3.0, d * d / 2.0, d * d / 2.0, d) * 2.0).amax() < 1e-15);
    let ca = ConstantAcceleration::<Vector<1>>::new(Vector1::new(2.0)).expect("valid");
    let zero = Vector1::new(0.0);
    let q = ca.noise(&Accelerating { pose: Vector(zero), velocity: zero, acceleration: zero }, Seconds(d));
    let (a, b, c) = (d.powi(5) / 20.0, d.powi(4) / 8.0, d.powi(3) / 6.0);
    let expected = Matrix3::new(a, b, c, b, 2.0 * c, d * d / 2.0, c, d * d / 2.0, d) * 2.0;
    assert!((q - expected).amax() < 1e-15);
}

#[test]
fn motion_on_the_line_is_a_parabola() {
    let ca = ConstantAcceleration::<Vector<1>>::new(Vector1::new(0.0)).expect("valid");
    let s = Accelerating {
        pose: Vector(Vector1::new(1.0)),
        velocity: Vector1::new(2.0),
        acceleration: Vector1::new(3.0),
    };
    let t = ca.propagate(&s, Seconds(2.0));
    assert!((t.pose.0.x - (1.0 + 2.0 * 2.0 + 0.5 * 3.0 * 4.0)).abs() < 1e-14 && t.velocity.x == 8.0);
    let f = ca.jacobian(&s, Seconds(2.0));
    assert!((f - Matrix3::new(1.0, 2.0, 2.0, 0.0, 1.0, 2.0, 0.0, 0.0, 1.0)).amax() < 1e-15);
}

fn screw(scale: f64) -> Accelerating<SE3> {
    Accelerating {
        pose: SE3::exp(&Vector6::new(0.1, -0.3, 0.5, 0.4, 0.2, -0.6)),
        velocity: Vector6::new(0.5, 0.2, -0.4, 0.9, -0.7, 0.3) * scale,
        acceleration: Vector6::new(-0.3, 0.8, 0.1, 0.2, 0.6, -0.9) * scale,
    }
}

/// How far two half steps are from one step: in the state, in `F`, in `Q` relative to `Q`.
fn composition<S: Manifold>(model: &impl Dynamics<S>, s: &S, dt: f64) -> [f64; 3]
where
    nalgebra::DefaultAllocator: crate::manifold::Alloc<S::D>,
{
    let half = Seconds(0.5 * dt);
    let middle = model.propagate(s, half);
    let (f1, f2, f) =
        (model.jacobian(s, half), model.jacobian(&middle, half), model.jacobian(s, Seconds(dt)));
    let q = model.noise(s, Seconds(dt));
    let composed = &f2 * model.noise(s, half) * f2.transpose() + model.noise(&middle, half);
    [
        model.propagate(s, Seconds(dt)).local(&model.propagate(&middle, half)).norm(),
        (f2 * f1 - f).amax(),
        (composed - &q).amax() / q.amax(),
    ]
}

#[test]
fn steps_of_constant_velocity_compose_on_se3() {
    let model = ConstantVelocity::<SE3>::new(Vector6::new(0.1, 0.2, 0.3, 1.0, 2.0, 3.0)).expect("valid");
    let Accelerating { pose, velocity, .. } = screw(1.0);
    let s = Moving { pose, velocity };
    for (dt, bound) in [(0.02, 1e-13), (0.1, 2e-11), (-0.1, 2e-11), (0.4, 1e-7), (1.0, 2e-5)] {
        let [state, f, q] = composition(&model, &s, dt);
        assert!(state < 1e-14 && f < 1e-14 && q < bound, "{dt}: {state:e} {f:e} {q:e}");
    }
}

#[test]
fn steps_of_constant_acceleration_compose_to_fifth_order_on_se3() {
    let model = ConstantAcceleration::<SE3>::new(Vector6::repeat(1.0)).expect("valid");
    let [coarse, fine] = [0.4, 0.2].map(|dt| composition(&model, &screw(1.0), dt));
    assert!(coarse[0] > 1e-7 && coarse[0] < 1e-4, "{coarse:?}");
    assert!(coarse[0] / fine[0] > 24.0 && fine[1] < 1e-5 && fine[2] < 1e-5, "{coarse:?} {fine:?}");
    // Against many small steps of constant velocity.
    let (mut s, n) = (screw(1.0), 20_000);
    let h = 0.4 / f64::from(n);
    for _ in 0..n {
        s.pose = s.pose.retract(&((s.velocity + s.acceleration * (0.5 * h)) * h));
        s.velocity += s.acceleration * h;
    }
    assert!(model.propagate(&screw(1.0), Seconds(0.4)).pose.local(&s.pose).norm() < 2.0 * coarse[0]);
}

#[test]
fn parallel_acceleration_is_exact_on_se3() {
    let model = ConstantAcceleration::<SE3>::new(Vector6::repeat(1.0)).expect("valid");
    let mut s = screw(1.0);
    s.acceleration = s.velocity * -0.7;
    assert!(composition(&model, &s, 1.0)[0] < 1e-14);
    let expected = s.pose.retract(&(s.velocity * (1.0 - 0.35)));
    assert!(model.propagate(&s, Seconds(1.0)).pose.local(&expected).norm() < 1e-14);
}

#[test]
fn steps_compose_exactly_where_space_is_flat() {
    let x = DynVector(DVector::from_column_slice(&[1.0, 2.0, 3.0]));
    let q = DVector::from_column_slice(&[1.0, 2.0, 0.5]);
    let s = Accelerating { pose: x.clone(), velocity: q.clone(), acceleration: -q.clone() };
    let ca = ConstantAcceleration::<DynVector>::new(q.clone()).expect("valid");
    let cv = ConstantVelocity::<DynVector>::new(q.clone()).expect("valid");
    let b = Brownian::<DynVector>::new(q.clone()).expect("valid");
    for dt in [-2.0, 0.01, 1.0, 30.0] {
        for error in composition(&ca, &s, dt)
            .into_iter()
            .chain(composition(&cv, &Moving { pose: x.clone(), velocity: q.clone() }, dt))
            .chain(composition(&b, &x, dt))
        {
            assert!(error < 1e-12, "{dt}: {error:e}");
        }
    }
}

#[test]
fn going_back_spreads_as_going_forward_undone() {
    let model = ConstantVelocity::<Vector<1>>::new(Vector1::new(2.0)).expect("valid");
    let s = Moving { pose: Vector(Vector1::new(1.0)), velocity: Vector1::new(3.0) };
    let back = model.jacobian(&s, Seconds(-0.5));
    let expected = back * model.noise(&s, Seconds(0.5)) * back.transpose();
    assert!((model.noise(&s, Seconds(-0.5)) - expected).amax() < 1e-15);
}

#[test]
fn locked_coordinates_stay_without_noise() {
    let density = Vector6::new(1.0, 0.0, 1.0, 0.0, 0.0, 1.0);
    let cv = ConstantVelocity::<SE3>::new(density).expect("valid");
    let rest = Moving { pose: screw(1.0).pose, velocity: Vector6::zeros() };
    let q = cv.noise(&rest, Seconds(0.1));
    let root = cv.noise_root(&rest, Seconds(0.1));
    assert!((root * root.transpose() - q).amax() < 1e-17);
    for locked in [1, 3, 4, 7, 9, 10] {
        assert!(q.row(locked).amax() == 0.0 && root.row(locked).amax() == 0.0, "{locked}");
    }
    let b = Brownian::<SE3>::new(density).expect("valid");
    assert!(b.noise_root(&rest.pose, Seconds(4.0)) == Square::<SE3>::from_diagonal(&(density * 2.0)));
}

#[test]
fn densities_are_checked() {
    for bad in [-1.0, f64::NAN, f64::INFINITY] {
        let error = Brownian::<Vector<1>>::new(Vector1::new(bad)).expect_err("not a density");
        assert!(error.to_string().contains("noise density"));
        assert!(ConstantVelocity::<Vector<1>>::new(Vector1::new(bad)).is_err());
        assert!(ConstantAcceleration::<Vector<1>>::new(Vector1::new(bad)).is_err());
    }
}

#[test]
fn noise_of_fading_models_has_its_closed_form() {
    let (tau, q, d) = (0.4, 2.0, 0.9_f64);
    let decay = |k: f64| math::exp(-k * d / tau);
    let ou = OrnsteinUhlenbeck::<Vector<1>>::new(Seconds(tau), Vector1::new(q)).expect("valid");
    let found =
        ou.noise(&Moving { pose: Vector(Vector1::new(1.0)), velocity: Vector1::new(3.0) }, Seconds(d));
    let vv = 0.5 * q * tau * (1.0 - decay(2.0));
    let xv = 0.5 * q * tau * tau * (1.0 - decay(1.0)).powi(2);
    let xx = q * tau * tau * (d - 2.0 * tau * (1.0 - decay(1.0)) + 0.5 * tau * (1.0 - decay(2.0)));
    assert!((found - Matrix2::new(xx, xv, xv, vv)).amax() < 1e-13, "{found}");
    // Singer 1970 as in Bar-Shalom, Li, Kirubarajan 2001, Eq. 8.2.2-9, with α = 1/τ and q = 2α σ².
    let singer = Singer::<Vector<1>>::new(Seconds(tau), Vector1::new(q)).expect("valid");
    let zero = Vector1::new(0.0);
    let found =
        singer.noise(&Accelerating { pose: Vector(zero), velocity: zero, acceleration: zero }, Seconds(d));
    let (a, u) = (1.0 / tau, d / tau);
    let (e1, e2) = (math::exp(-u), math::exp(-2.0 * u));
    let q11 = (1.0 - e2 + 2.0 * u + 2.0 * u.powi(3) / 3.0 - 2.0 * u * u - 4.0 * u * e1) / (2.0 * a.powi(5));
    let q12 = (e2 + 1.0 - 2.0 * e1 + 2.0 * u * e1 - 2.0 * u + u * u) / (2.0 * a.powi(4));
    let q13 = (1.0 - e2 - 2.0 * u * e1) / (2.0 * a.powi(3));
    let q22 = (4.0 * e1 - 3.0 - e2 + 2.0 * u) / (2.0 * a.powi(3));
    let q23 = (e2 + 1.0 - 2.0 * e1) / (2.0 * a * a);
    let q33 = (1.0 - e2) / (2.0 * a);
    let expected = Matrix3::new(q11, q12, q13, q12, q22, q23, q13, q23, q33) * q;
    assert!((found - expected).amax() < 1e-12, "{found} {expected}");
}

#[test]
fn fading_models_have_their_limits() {
    let s = Accelerating {
        pose: Vector(Vector1::new(1.0)),
        velocity: Vector1::new(2.0),
        acceleration: Vector1::new(3.0),
    };
    let (slow, never) = (
        Singer::<Vector<1>>::new(Seconds(1e9), Vector1::new(0.5)).expect("valid"),
        ConstantAcceleration::<Vector<1>>::new(Vector1::new(0.5)).expect("valid"),
    );
    let dt = Seconds(0.8);
    assert!(slow.propagate(&s, dt).local(&never.propagate(&s, dt)).norm() < 1e-8);
    assert!((slow.noise(&s, dt) - never.noise(&s, dt)).amax() < 1e-8);
    // Both sides of where the series ends.
    for u in [0.4999999, 0.5000001, -0.4999999, -0.5000001] {
        let tau = Seconds(1.0);
        let model = Singer::<Vector<1>>::new(tau, Vector1::new(0.0)).expect("valid");
        let f = model.jacobian(&s, Seconds(u));
        let e = math::exp(-u);
        assert!((f[(0, 2)] - (u - 1.0 + e)).abs() < 1e-14 && (f[(1, 2)] - (1.0 - e)).abs() < 1e-14);
    }
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(Singer::<Vector<1>>::new(Seconds(bad), Vector1::new(0.0)).is_err());
    }
}

#[test]
fn discrete_noise_is_that_of_the_textbook() {
    let model = DiscreteWhiteAcceleration::<Vector<1>>::new(Vector1::new(2.0)).expect("valid");
    let d = 0.7_f64;
    let q = model.noise(&Moving { pose: Vector(Vector1::new(1.0)), velocity: Vector1::new(3.0) }, Seconds(d));
    let expected = Matrix2::new(d.powi(4) / 4.0, d.powi(3) / 2.0, d.powi(3) / 2.0, d * d) * 2.0;
    assert!((q - expected).amax() < 1e-15, "{q}");
}

/// Without rotation both frames are one; with it, the path of the camera's frame is a left factor.
#[test]
fn camera_velocity_moves_on_the_left() {
    let s = Moving { pose: screw(1.0).pose, velocity: screw(1.0).velocity };
    let model = CameraVelocity::<SE3>::new(Vector6::repeat(1.0)).expect("valid");
    let moved = model.propagate(&s, Seconds(0.3));
    let expected = SE3::exp(&(s.velocity * 0.3)).compose(&s.pose);
    assert!(moved.pose.local(&expected).norm() < 1e-15);
    // The same motion as a body twist.
    let body = Moving { pose: s.pose, velocity: s.pose.inverse().adjoint() * s.velocity };
    let same =
        ConstantVelocity::<SE3>::new(Vector6::repeat(1.0)).expect("valid").propagate(&body, Seconds(0.3));
    assert!(moved.pose.local(&same.pose).norm() < 1e-14);
}

#[test]
fn custom_model_from_two_closures() {
    // An oscillator ẍ = -ω² x with velocity noise, as a user would write it.
    let w = 2.0;
    let model = Custom {
        motion: move |s: &Vector<2>, Seconds(t): Seconds| {
            let (sin, cos) = math::sin_cos(w * t);
            Vector(SMatrix::<f64, 2, 2>::new(cos, sin / w, -w * sin, cos) * s.0)
        },
        noise: |_: &Vector<2>, Seconds(t): Seconds| Matrix2::new(0.0, 0.0, 0.0, t.abs()),
    };
    let s = Vector([1.0, -0.5].into());
    let quarter = Seconds(core::f64::consts::FRAC_PI_4);
    assert!((model.propagate(&s, quarter).0 - nalgebra::Vector2::new(-0.25, -2.0)).norm() < 1e-15);
    assert!((model.jacobian(&s, quarter) - Matrix2::new(0.0, 0.5, -2.0, 0.0)).amax() < 1e-9);
    assert_eq!(model.noise_root(&s, Seconds(4.0))[(1, 1)], 2.0);
}

#[test]
fn custom_model_as_a_type() {
    /// Velocity that decays with the time constant `tau` and is driven by white noise (Ornstein–Uhlenbeck).
    struct Damped {
        tau: f64,
        density: [f64; 1],
    }
    impl Dynamics<Moving<Vector<1>>> for Damped {
        fn propagate(&self, s: &Moving<Vector<1>>, Seconds(t): Seconds) -> Moving<Vector<1>> {
            let f = math::exp(-t / self.tau);
            Moving { pose: s.pose.retract(&(s.velocity * self.tau * (1.0 - f))), velocity: s.velocity * f }
        }
        fn noise(&self, s: &Moving<Vector<1>>, dt: Seconds) -> Square<Moving<Vector<1>>> {
            driven_noise(self, s, dt, &self.density)
        }
    }
    let model = Damped { tau: 2.0, density: [0.3] };
    let s = Moving { pose: Vector(Vector1::new(0.0)), velocity: Vector1::new(1.0) };
    // Var ν(Δ) = q τ/2 (1 - e^{-2Δ/τ}).
    let q = model.noise(&s, Seconds(0.5));
    assert!((q[(1, 1)] / (0.3 * (1.0 - math::exp(-0.5))) - 1.0).abs() < 1e-7, "{q}");
}

#[test]
fn roots_of_semidefinite_matrices_are_exact_across_units() {
    let a = SMatrix::<f64, 3, 3>::new(1e6, 0.0, 0.0, 1.0, 1e-6, 0.0, 0.0, 0.0, 0.0);
    let m = a * a.transpose();
    for l in [semidefinite_root(&m), pivoted_root(&m)] {
        assert!(
            (l * l.transpose() - m).abs().component_div(&m.map(|v| v.abs().max(1e-30))).max() < 1e-9,
            "{l}"
        );
    }
}

#[test]
fn roots_of_singular_matrices_lose_no_digits() {
    // Rank 7 of 12 with correlations close to one, where unpivoted elimination loses half the digits.
    let mut random = crate::random::Random::new(8, crate::random::Stream::Sim, 0, 0, 0);
    for _ in 0..200 {
        let a = SMatrix::<f64, 12, 7>::from_fn(|r, _| 1.0 + random.normal() * if r < 6 { 1e-4 } else { 1.0 });
        let m = a * a.transpose();
        let l = pivoted_root(&m);
        assert!((l * l.transpose() - m).amax() < 1e-13 * m.amax());
        assert_eq!(l.column_iter().filter(|c| c.amax() > 0.0).count(), 7);
        // `L⁺ (L y)` is `y` where `L` has columns.
        let factor = PivotedFactor::new(&m);
        let y =
            SVector::<f64, 12>::from_fn(|k, _| if l.column(k).amax() > 0.0 { random.normal() } else { 0.0 });
        assert_eq!(factor.rank, 7);
        assert!((factor.root * factor.solve(&(l * y)) - l * y).amax() < 1e-10 * (l * y).amax());
        // The triangular root keeps its form, not its digits.
        let l = semidefinite_root(&m);
        assert!(
            (0..12).all(|c| l[(c, c)] > 0.0 || l.column(c).amax() == 0.0)
                && l.upper_triangle() == SMatrix::from_diagonal(&l.diagonal())
        );
    }
    let diagonal = SMatrix::<f64, 4, 4>::from_diagonal(&[4.0, 0.0, 9.0, 1e-20].into());
    assert_eq!(pivoted_root(&diagonal).diagonal(), nalgebra::Vector4::new(2.0, 0.0, 3.0, 1e-10));
}
