//! The law harness on all spaces, models and measurements of this crate, and on models of users.

use nalgebra::{
    DMatrix, DVector, Matrix2, Matrix6, Point2, Point3, SMatrix, Vector1, Vector2, Vector3, Vector6,
};
use proptest::prelude::*;
use vt_core::agent::{Dynamics, Posed, Warp};
use vt_core::belief::{Accelerating, Moving};
use vt_core::dynamics::{
    Brownian, CameraVelocity, ConstantAcceleration, ConstantVelocity, CoordinatedTurn, Custom,
    DiscreteWhiteAcceleration, LinearRate, LinearStep, OrnsteinUhlenbeck, Singer,
};
use vt_core::error::EstimateError;
use vt_core::laws::{self, Dual64, MeasurementTolerance, group, proptest};
use vt_core::lie::{
    Affine2, DynVector, LieGroup, Product, SE2, SE3, SL3, SO2, SO3, Sim2, Sim3, TranslationScale, Vector,
};
use vt_core::manifold::{Manifold, Square, Tangent};
use vt_core::measurement::{Level, Linearized, Measurement, NormalEquations, Quality};
use vt_core::measurement_model::{Angular, Function, Instrument, Linear, MeasurementModel};
use vt_core::pose_measurement::PoseMeasurement;
use vt_core::robust::Robust;
use vt_core::time::Seconds;
use vt_core::{dynamics_laws, lie_group_laws, manifold_laws, math, measurement_laws, warp_laws};

lie_group_laws!(so2: SO2);
lie_group_laws!(se2: SE2);
lie_group_laws!(so3: SO3);
lie_group_laws!(se3: SE3);
lie_group_laws!(sim3: Sim3);
lie_group_laws!(translation_scale: TranslationScale);
lie_group_laws!(sim2: Sim2);
lie_group_laws!(affine2: Affine2, tolerance = 1e-6);
lie_group_laws!(sl3: SL3, tolerance = 1e-6);
lie_group_laws!(vector: Vector<4>);
lie_group_laws!(product: Product<SE3, Vector<2>>);
lie_group_laws!(product_of_products: Product<Product<SO2, SE2>, Sim3>);

fn numbers(n: usize) -> impl Strategy<Value = DVector<f64>> {
    prop::collection::vec(-1.0..1.0, n).prop_map(DVector::from_vec)
}

fn dynamic(n: usize) -> impl Strategy<Value = DynVector> {
    numbers(n).prop_map(DynVector)
}

fn tangents() -> impl Strategy<Value = Vector6<f64>> {
    numbers(6).prop_map(|d| Vector6::from_column_slice(d.as_slice()))
}

fn moving() -> impl Strategy<Value = Moving<SE3>> {
    (group::<SE3>(1.0), tangents()).prop_map(|(pose, velocity)| Moving { pose, velocity })
}

fn accelerating() -> impl Strategy<Value = Accelerating<SE3>> {
    (group::<SE3>(1.0), tangents(), tangents()).prop_map(|(pose, velocity, acceleration)| Accelerating {
        pose,
        velocity,
        acceleration,
    })
}

fn moving_joints() -> impl Strategy<Value = Moving<Product<SE3, DynVector>>> {
    (group::<SE3>(1.0), dynamic(2), numbers(8))
        .prop_map(|(first, second, velocity)| Moving { pose: Product { first, second }, velocity })
}

manifold_laws!(manifold_so2: group::<SO2>(1.0));
manifold_laws!(manifold_se2: group::<SE2>(1.0));
manifold_laws!(manifold_so3: group::<SO3>(1.0));
manifold_laws!(manifold_se3: group::<SE3>(1.0));
manifold_laws!(manifold_se3_at_identity: Just(SE3::identity()));
manifold_laws!(manifold_sim3: group::<Sim3>(1.0));
manifold_laws!(manifold_translation_scale: group::<TranslationScale>(1.0));
manifold_laws!(manifold_sim2: group::<Sim2>(1.0));
manifold_laws!(manifold_affine2: group::<Affine2>(1.0), tolerance = 1e-6);
manifold_laws!(manifold_sl3: group::<SL3>(1.0), tolerance = 1e-6);
manifold_laws!(manifold_vector: group::<Vector<3>>(5.0));
manifold_laws!(manifold_dyn_vector: dynamic(5));
manifold_laws!(manifold_product: group::<Product<SE3, Vector<2>>>(1.0));
manifold_laws!(manifold_free_base: (group::<SE3>(1.0), dynamic(3)).prop_map(|(first, second)| Product { first, second }));
manifold_laws!(manifold_moving: moving());
manifold_laws!(manifold_moving_joints: moving_joints());
manifold_laws!(manifold_accelerating: accelerating());

/// A direction in space, as a user would write it: retraction only, Jacobians by the defaults.
#[derive(Clone, Copy, Debug)]
struct CustomDirection(Vector3<f64>);

impl CustomDirection {
    /// Two unit vectors across: the x and y axes, turned the shortest way with the z axis. Smooth except at -z.
    fn basis(&self) -> SMatrix<f64, 3, 2> {
        let [x, y, z] = self.0.into();
        let f = 1.0 / (1.0 + z);
        SMatrix::<f64, 3, 2>::from_columns(&[
            Vector3::new(1.0 - x * x * f, -x * y * f, -x),
            Vector3::new(-x * y * f, 1.0 - y * y * f, -y),
        ])
    }
}

impl Manifold for CustomDirection {
    type D = nalgebra::Const<2>;
    fn dim(&self) -> Self::D {
        nalgebra::Const
    }
    fn retract(&self, d: &Tangent<Self>) -> Self {
        Self((self.0 + self.basis() * d).normalize())
    }
    fn local(&self, other: &Self) -> Tangent<Self> {
        self.basis().tr_mul(&(other.0 / other.0.dot(&self.0)))
    }
}
manifold_laws!(custom_manifold: group::<SO3>(0.5).prop_map(|r| CustomDirection(r.rotation * Vector3::z())), tolerance = 1e-6);

fn density() -> Vector6<f64> {
    Vector6::new(0.1, 0.2, 0.0, 1.0, 0.5, 2.0)
}

/// The group element of a state over dual numbers, moved by `e`.
fn perturbed(pose: &SE3, e: &[Dual64]) -> SE3<Dual64> {
    SE3::exp(&laws::lift(&pose.log())).compose(&SE3::exp(&Vector6::from_column_slice(e)))
}

fn lifted(d: &Vector6<f64>) -> Vector6<Dual64> {
    laws::lift(d)
}

fn cv_dual(s: &Moving<SE3>, Seconds(dt): Seconds, e: &[Dual64]) -> Vec<Dual64> {
    let velocity = lifted(&s.velocity) + Vector6::from_column_slice(&e[6..]);
    let ahead = |pose: SE3<Dual64>, v: &Vector6<Dual64>| pose.compose(&SE3::exp(&(v * Dual64::from_re(dt))));
    let from = ahead(perturbed(&s.pose, &[Dual64::from_re(0.0); 6]), &lifted(&s.velocity));
    let d = from.inverse().compose(&ahead(perturbed(&s.pose, &e[..6]), &velocity)).log();
    d.iter().chain((velocity - lifted(&s.velocity)).iter()).copied().collect()
}

fn ca_dual(s: &Accelerating<SE3>, Seconds(dt): Seconds, e: &[Dual64]) -> Vec<Dual64> {
    let (v0, a0) = (lifted(&s.velocity), lifted(&s.acceleration));
    let (v, a) = (v0 + Vector6::from_column_slice(&e[6..12]), a0 + Vector6::from_column_slice(&e[12..]));
    let c = Dual64::from_re;
    let ahead = |pose: SE3<Dual64>, v: &Vector6<Dual64>, a: &Vector6<Dual64>| {
        let half = v * c(0.5 * dt);
        let early = SE3::exp(&(half + a * c(dt * dt / 12.0)));
        pose.compose(&early).compose(&SE3::exp(&(half + a * c(dt * dt * 5.0 / 12.0))))
    };
    let from = ahead(perturbed(&s.pose, &[c(0.0); 6]), &v0, &a0);
    let d = from.inverse().compose(&ahead(perturbed(&s.pose, &e[..6]), &v, &a)).log();
    let end = (v - v0) + (a - a0) * c(dt);
    d.iter().chain(end.iter()).chain((a - a0).iter()).copied().collect()
}

dynamics_laws!(brownian_se3: Brownian::<SE3>::new(density()).expect("valid"), group::<SE3>(1.0), composes = 1e-13);
dynamics_laws!(cv_se3: ConstantVelocity::<SE3>::new(density()).expect("valid"), moving(), composes = 1e-9, dual = cv_dual);
dynamics_laws!(ca_se3: ConstantAcceleration::<SE3>::new(density()).expect("valid"), accelerating(), composes = 1e-4, dual = ca_dual);
dynamics_laws!(
    cv_joints: ConstantVelocity::<Product<SE3, DynVector>>::new(DVector::repeat(8, 0.3)).expect("valid"),
    moving_joints(),
    composes = 1e-9
);
dynamics_laws!(
    ca_flat: ConstantAcceleration::<Vector<1>>::new(Vector1::new(2.0)).expect("valid"),
    numbers(3).prop_map(|d| Accelerating {
        pose: Vector(Vector1::new(d[0])),
        velocity: Vector1::new(d[1]),
        acceleration: Vector1::new(d[2]),
    }),
    tolerance = 1e-8,
    composes = 1e-12
);
dynamics_laws!(
    custom_oscillator: Custom {
        motion: |s: &Vector<2>, Seconds(t): Seconds| {
            let (sin, cos) = math::sin_cos(2.0 * t);
            Vector(Matrix2::new(cos, sin / 2.0, -2.0 * sin, cos) * s.0)
        },
        noise: |_: &Vector<2>, Seconds(t): Seconds| Matrix2::new(0.0, 0.0, 0.0, t.abs()),
    },
    group::<Vector<2>>(1.0)
);

dynamics_laws!(ou_se3: OrnsteinUhlenbeck::<SE3>::new(Seconds(0.7), density()).expect("valid"), moving(), composes = 1e-8);
dynamics_laws!(singer_se3: Singer::<SE3>::new(Seconds(0.7), density()).expect("valid"), accelerating(), composes = 1e-4);
dynamics_laws!(camera_se3: CameraVelocity::<SE3>::new(density()).expect("valid"), moving(), composes = 1e-8);
dynamics_laws!(dwna_se3: DiscreteWhiteAcceleration::<SE3>::new(density()).expect("valid"), moving());
dynamics_laws!(
    singer_flat: Singer::<DynVector>::new(Seconds(0.3), DVector::repeat(2, 1.3)).expect("valid"),
    numbers(6).prop_map(|d| Accelerating {
        pose: DynVector(d.rows(0, 2).into_owned()),
        velocity: d.rows(2, 2).into_owned(),
        acceleration: d.rows(4, 2).into_owned(),
    }),
    composes = 1e-12
);
dynamics_laws!(
    ou_flat: OrnsteinUhlenbeck::<DynVector>::new(Seconds(0.3), DVector::repeat(2, 1.3)).expect("valid"),
    numbers(4).prop_map(|d| Moving { pose: DynVector(d.rows(0, 2).into_owned()), velocity: d.rows(2, 2).into_owned() }),
    composes = 1e-12
);
dynamics_laws!(
    turn: CoordinatedTurn::new(0.5, 0.1).expect("valid"),
    (group::<Vector<5>>(2.0), 0_usize..4).prop_map(|(mut s, k)| {
        // Straight on, nearly so, and turning fast.
        s.0[4] *= [0.0, 1e-9, 1.0, 3.0][k];
        s
    }),
    composes = 1e-10
);
dynamics_laws!(
    rate: LinearRate::new(
        SMatrix::<f64, 3, 3>::new(-0.5, 2.0, 0.3, -2.0, 0.1, 1.0, 0.0, 0.4, -3.0),
        SMatrix::<f64, 3, 3>::new(1.0, 0.2, 0.0, 0.2, 0.5, 0.1, 0.0, 0.1, 0.3),
    )
    .expect("valid"),
    group::<Vector<3>>(2.0),
    composes = 1e-12
);

/// A step is a step: no law of zero time, but `F` and `Q` are what was given.
#[test]
fn linear_steps_are_their_matrices() {
    let (f, q) = (Matrix2::new(1.0, 0.1, 0.0, 1.0), Matrix2::new(0.2, 0.1, 0.1, 0.3));
    let model = LinearStep::new(f, q).expect("valid");
    let x = Vector(Vector2::new(1.0, 2.0));
    assert_eq!(Dynamics::<Vector<2>>::jacobian(&model, &x, Seconds(7.0)), f);
    assert_eq!(Dynamics::<Vector<2>>::noise(&model, &x, Seconds(7.0)), q);
    assert_eq!(model.propagate(&x, Seconds(7.0)).0, f * x.0);
    assert!(LinearStep::new(f, -q).is_err() && LinearStep::new(f * f64::NAN, q).is_err());
    assert!(LinearRate::new(DMatrix::<f64>::zeros(2, 2), DMatrix::zeros(3, 3)).is_err());
}

fn bearing() -> Instrument<Vector<4>, impl MeasurementModel<Vector<4>, M = nalgebra::Const<2>>> {
    let h = Function(|s: &Vector<4>| {
        Vector2::new(math::atan2(s.0[1], s.0[0] - 9.0), math::hypot(s.0[1], s.0[0] - 9.0))
    });
    Instrument::new(Angular::new(h, [0]), Matrix2::new(0.02, 0.01, 0.01, 0.3)).expect("a covariance")
}
measurement_laws!(bearing_and_range: bearing().read(Vector2::new(3.0, 8.0)).expect("finite"), group::<Vector<4>>(2.0));
measurement_laws!(
    robust_readings: {
        let h = Linear(SMatrix::<f64, 2, 3>::new(1.0, 2.0, 0.0, -1.0, 0.3, 0.8));
        let noise = Matrix2::new(0.2, 0.05, 0.05, 0.1);
        Instrument::robust(h, noise, Robust::Cauchy(2.0)).expect("valid").read(Vector2::new(1.0, -2.0)).expect("finite")
    },
    group::<Vector<3>>(2.0)
);

#[test]
fn readings_are_checked() {
    let h = || Linear(SMatrix::<f64, 2, 3>::zeros());
    for bad in [Matrix2::zeros(), -Matrix2::identity(), Matrix2::new(1.0, 0.5, 0.0, 1.0)] {
        assert!(matches!(
            Instrument::<Vector<3>, _>::new(h(), bad),
            Err(EstimateError::NotPositiveDefinite(_))
        ));
    }
    assert!(matches!(
        Instrument::<Vector<3>, _>::new(h(), Matrix2::repeat(f64::NAN)),
        Err(EstimateError::NotFinite(_))
    ));
    let fit = Instrument::<Vector<3>, _>::new(h(), Matrix2::identity()).expect("valid");
    assert!(matches!(fit.read(Vector2::new(f64::INFINITY, 0.0)), Err(EstimateError::NotFinite(_))));
    let any = Instrument::<DynVector, _>::new(Linear(DMatrix::zeros(2, 3)), DMatrix::identity(2, 2))
        .expect("valid");
    assert!(matches!(
        any.read(DVector::zeros(3)),
        Err(EstimateError::Dimension { found: 3, expected: 2, .. })
    ));
}

/// A pinhole camera, as a user would write it.
struct CustomPinhole {
    focal: f64,
}

struct PosedPinhole<'a> {
    warp: &'a CustomPinhole,
    pose: SE3,
}

impl Warp<SE3> for CustomPinhole {
    type Body = Point3<f64>;
    type Posed<'a> = PosedPinhole<'a>;
    fn at<'a>(&'a self, pose: &SE3) -> PosedPinhole<'a> {
        PosedPinhole { warp: self, pose: *pose }
    }
}

impl Posed<SE3> for PosedPinhole<'_> {
    type Body = Point3<f64>;
    fn locate(&self, point: &Point3<f64>) -> Option<Point2<f64>> {
        let q = self.pose.act(point);
        (q.z > 0.1)
            .then(|| Point2::new(320.0 + self.warp.focal * q.x / q.z, 240.0 + self.warp.focal * q.y / q.z))
    }
    fn linearize(&self, point: &Point3<f64>) -> Option<(Point2<f64>, SMatrix<f64, 2, 6>)> {
        let y = self.locate(point)?;
        let q = self.pose.act(point);
        let f = self.warp.focal / q.z;
        let image = SMatrix::<f64, 2, 3>::new(f, 0.0, -f * q.x / q.z, 0.0, f, -f * q.y / q.z);
        let turn = image * self.pose.rotation.to_rotation_matrix().into_inner();
        let mut j = SMatrix::<f64, 2, 6>::zeros();
        j.fixed_view_mut::<2, 3>(0, 0).copy_from(&turn);
        j.fixed_view_mut::<2, 3>(0, 3).copy_from(&(-turn * point.coords.cross_matrix()));
        Some((y, j))
    }
}

fn pinhole_dual(warp: &CustomPinhole, pose: &SE3, p: &Point3<f64>, e: &[Dual64]) -> Option<[Dual64; 2]> {
    let q = perturbed(pose, e).act(&p.map(Dual64::from_re));
    (q.z.re > 0.1).then(|| [q.x / q.z * warp.focal + 320.0, q.y / q.z * warp.focal + 240.0])
}

fn before_the_camera() -> impl Strategy<Value = SE3> {
    group::<SE3>(1.0).prop_map(|m| SE3::new(m.rotation, m.translation + Vector3::new(0.0, 0.0, 3.0)))
}

fn bodies() -> impl Strategy<Value = Vec<Point3<f64>>> {
    prop::collection::vec(numbers(3).prop_map(|d| Point3::new(d[0], d[1], d[2])), 5)
}

warp_laws!(custom_warp: CustomPinhole { focal: 500.0 }, before_the_camera(), bodies(), tolerance = 1e-7, dual = pinhole_dual);

fn information() -> Matrix6<f64> {
    let a = Matrix6::from_fn(|r, c| if r <= c { 1.0 + (r * 6 + c) as f64 * 0.1 } else { 0.0 });
    a * a.transpose()
}

measurement_laws!(
    pose_measurement: PoseMeasurement::new(SE3::identity(), information(), Quality::default()),
    group::<SE3>(1.0)
);
measurement_laws!(
    pose_measurement_nearby: PoseMeasurement::new(SE3::identity(), information(), Quality::default()),
    group::<SE3>(1e-3)
);

/// Robust distances to points in the plane, as a user would write it.
struct CustomRanges {
    anchors: Vec<(Vector2<f64>, f64)>,
    kernel: Robust,
    sigma: f64,
}

impl Measurement<Vector<2>> for CustomRanges {
    fn log_likelihoods(&self, poses: &[Vector<2>], out: &mut [f64]) {
        for (x, l) in poses.iter().zip(out) {
            *l = -self
                .anchors
                .iter()
                .map(|(a, d)| self.kernel.rho((d - (x.0 - a).norm()) / self.sigma))
                .sum::<f64>();
        }
    }
    fn residuals(&self, at: &Vector<2>, out: &mut Linearized<Vector<2>>) {
        out.clear();
        for (a, d) in &self.anchors {
            let r = d - (at.0 - a).norm();
            out.push(r, (at.0 - a).normalize(), self.sigma * self.sigma, self.kernel.weight(r / self.sigma));
        }
    }
    fn normal_equations(&self, at: &Vector<2>, out: &mut NormalEquations<Vector<2>>) {
        out.clear();
        let mut rows = Linearized::default();
        self.residuals(at, &mut rows);
        rows.accumulate(out);
        out.cost = rows.residuals.iter().map(|r| self.kernel.rho(r / self.sigma)).sum();
    }
    fn quality(&self, _: &Vector<2>) -> Quality {
        Quality { expected: 3, inliers: 3, inlier_ratio: 1.0, log_ratio: 0.0, normalized_rms: 1.0 }
    }
    fn level(&self) -> Level {
        Level::Feature
    }
}

fn ranges(kernel: Robust) -> CustomRanges {
    let anchors =
        vec![(Vector2::new(3.0, 1.0), 2.0), (Vector2::new(-2.0, 2.5), 3.0), (Vector2::new(0.5, -4.0), 9.0)];
    CustomRanges { anchors, kernel, sigma: 0.5 }
}

measurement_laws!(custom_measurement: ranges(Robust::CAUCHY), group::<Vector<2>>(1.0));
measurement_laws!(
    custom_measurement_tight: ranges(Robust::Square),
    group::<Vector<2>>(1.0),
    tolerance = MeasurementTolerance { step: 1e-3, gradient: 1e-8, accumulation: 1e-14 }
);

/// The text of the failure of `check`.
fn failure(check: impl Fn() + std::panic::UnwindSafe) -> String {
    let payload = std::panic::catch_unwind(check).expect_err("a broken law must fail");
    payload.downcast::<String>().map_or_else(|_| "no text".into(), |text| *text)
}

#[test]
fn a_wrong_jacobian_of_a_model_is_found_and_its_block_named() {
    struct Wrong(ConstantVelocity<SE3>, usize);
    impl Dynamics<Moving<SE3>> for Wrong {
        fn propagate(&self, s: &Moving<SE3>, dt: Seconds) -> Moving<SE3> {
            self.0.propagate(s, dt)
        }
        fn jacobian(&self, s: &Moving<SE3>, dt: Seconds) -> Square<Moving<SE3>> {
            let mut f = self.0.jacobian(s, dt);
            match self.1 {
                0 => f.fixed_view_mut::<6, 6>(0, 0).fill_with_identity(),
                1 => f.fixed_view_mut::<3, 3>(0, 9).fill(0.0),
                _ => f.fixed_view_mut::<6, 6>(6, 6).scale_mut(0.999),
            }
            f
        }
        fn noise(&self, s: &Moving<SE3>, dt: Seconds) -> Square<Moving<SE3>> {
            self.0.noise(s, dt)
        }
    }
    let velocity = Vector6::new(0.5, 0.2, -0.4, 0.9, -0.7, 0.3);
    for (kind, block) in [(0, "/"), (1, "translation/velocity of rotation"), (2, "velocity of")] {
        let text = failure(move || {
            let model = Wrong(ConstantVelocity::new(density()).expect("valid"), kind);
            laws::check_dynamics(&model, &Moving { pose: SE3::identity(), velocity }, 1e-7);
        });
        assert!(text.contains("F(") && text.contains(block), "{text}");
    }
}

#[test]
fn a_measurement_whose_forms_differ_is_found() {
    struct Wrong(CustomRanges, usize);
    impl Measurement<Vector<2>> for Wrong {
        fn log_likelihoods(&self, poses: &[Vector<2>], out: &mut [f64]) {
            self.0.log_likelihoods(poses, out);
            out.iter_mut().for_each(|l| *l *= if self.1 == 0 { 1.01 } else { 1.0 });
        }
        fn residuals(&self, at: &Vector<2>, out: &mut Linearized<Vector<2>>) {
            self.0.residuals(at, out);
            if self.1 == 1 {
                out.weights[0] *= 0.99;
            }
        }
        fn normal_equations(&self, at: &Vector<2>, out: &mut NormalEquations<Vector<2>>) {
            self.0.normal_equations(at, out);
            if self.1 == 2 {
                out.gradient = -out.gradient;
            }
        }
        fn quality(&self, at: &Vector<2>) -> Quality {
            self.0.quality(at)
        }
        fn level(&self) -> Level {
            Level::Feature
        }
    }
    for (kind, law) in [(0, "log_likelihoods"), (1, "of the residuals"), (2, "gradient")] {
        let text = failure(move || {
            let z = Wrong(ranges(Robust::CAUCHY), kind);
            laws::check_measurement(&z, &Vector(Vector2::new(0.3, 0.2)), MeasurementTolerance::default());
        });
        assert!(text.contains(law), "{text}");
    }
}

#[test]
fn a_warp_without_its_rotation_columns_is_found() {
    struct Wrong(CustomPinhole);
    struct WrongPosed<'a>(PosedPinhole<'a>);
    impl Warp<SE3> for Wrong {
        type Body = Point3<f64>;
        type Posed<'a> = WrongPosed<'a>;
        fn at<'a>(&'a self, pose: &SE3) -> WrongPosed<'a> {
            WrongPosed(self.0.at(pose))
        }
    }
    impl Posed<SE3> for WrongPosed<'_> {
        type Body = Point3<f64>;
        fn locate(&self, point: &Point3<f64>) -> Option<Point2<f64>> {
            self.0.locate(point)
        }
        fn linearize(&self, point: &Point3<f64>) -> Option<(Point2<f64>, SMatrix<f64, 2, 6>)> {
            let (y, mut j) = self.0.linearize(point)?;
            j.fixed_view_mut::<2, 3>(0, 3).fill(0.0);
            Some((y, j))
        }
    }
    let text = failure(|| {
        let pose = SE3::new(nalgebra::UnitQuaternion::identity(), Vector3::new(0.0, 0.0, 2.0));
        laws::check_warp(&Wrong(CustomPinhole { focal: 500.0 }), &pose, &[Point3::new(0.1, 0.2, 0.3)], 1e-6);
    });
    assert!(text.contains("/rotation"), "{text}");
}

#[test]
fn cases_repeat_exactly() {
    let draw = || {
        let cases = std::cell::RefCell::new(vec![]);
        laws::for_each(group::<SE3>(1.0), |x| cases.borrow_mut().push(format!("{x:?}")));
        cases.into_inner()
    };
    assert_eq!(draw(), draw());
    assert_eq!(draw().len(), laws::CASES as usize);
}
