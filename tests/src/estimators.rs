//! The problems of the estimator comparison, as the Python programs of the peers set them.

use std::hint::black_box;

use cpu_time::ProcessTime;
use nalgebra::{Matrix2, Matrix4, RowVector4, SMatrix, SVector, Vector2, Vector4};
use vt_core::agent::Estimator;
use vt_core::belief::Gaussian;
use vt_core::dynamics::LinearStep;
use vt_core::lie::Vector;
use vt_core::math;
use vt_core::measurement_model::{Angular, Differentiable, Instrument, Linear, MeasurementModel};
use vt_core::time::Seconds;
use vt_estimators::gaussian_filter::GaussianFilter;
use vt_estimators::imm::{Imm, Switching, mode};
use vt_estimators::kalman::KalmanFilter;
use vt_estimators::sigma_point::{Rule, SigmaPointFilter};

/// State `x, ẋ, y, ẏ`.
pub type Plane = Vector<4>;

/// A sensor with two rows.
pub trait TwoRows: MeasurementModel<Plane, M = nalgebra::Const<2>> + 'static {}
impl<H: MeasurementModel<Plane, M = nalgebra::Const<2>> + 'static> TwoRows for H {}

/// `F` and `Q` of constant velocity over `dt` with the density `q` on both axes.
pub fn constant_velocity(dt: f64, q: f64) -> (Matrix4<f64>, Matrix4<f64>) {
    let (mut f, mut noise) = (Matrix4::identity(), Matrix4::zeros());
    for k in [0, 2] {
        f[(k, k + 1)] = dt;
        let block = Matrix2::new(dt * dt * dt / 3.0, dt * dt / 2.0, dt * dt / 2.0, dt) * q;
        noise.fixed_view_mut::<2, 2>(k, k).copy_from(&block);
    }
    (f, noise)
}

/// Bearing from the x axis (rad) and range from a sensor at `from`, with the analytic Jacobian.
pub fn bearing_range(from: Vector2<f64>) -> impl TwoRows {
    let apart = move |s: &Plane| Vector2::new(s.0[0] - from.x, s.0[2] - from.y);
    let model = Differentiable {
        function: move |s: &Plane| {
            let d = apart(s);
            Vector2::new(math::atan2(d.y, d.x), d.norm())
        },
        jacobian: move |s: &Plane| {
            let d = apart(s);
            let (square, r) = (d.norm_squared(), d.norm());
            SMatrix::<f64, 2, 4>::from_rows(&[
                RowVector4::new(-d.y / square, 0.0, d.x / square, 0.0),
                RowVector4::new(d.x / r, 0.0, d.y / r, 0.0),
            ])
        },
    };
    Angular::new(model, [0])
}

/// Name and a call that does one prediction and one update.
pub type Case = (&'static str, Box<dyn FnMut()>);

macro_rules! linear {
    ($n:literal, $m:literal, $factor:expr) => {{
        let mut f = SMatrix::<f64, $n, $n>::identity();
        for k in 0..$n / 2 {
            f[(k, k + $n / 2)] = 0.1;
        }
        let q = SMatrix::<f64, $n, $n>::identity() * (1e-3 * $factor);
        let motion = LinearStep::new(f, q).expect("valid");
        let mean = Vector(SVector::<f64, $n>::zeros());
        let prior = Gaussian { mean, covariance: SMatrix::<f64, $n, $n>::identity() };
        KalmanFilter::<Vector<$n>, Vector<$n>, _>::from_belief(prior, motion).expect("a prior")
    }};
}

macro_rules! kalman_case {
    ($n:literal, $m:literal) => {{
        let mut filter = linear!($n, $m, 1.0);
        let h = Linear(SMatrix::<f64, $m, $n>::identity());
        let sensor = Instrument::new(h, SMatrix::<f64, $m, $m>::identity() * 1e-2).expect("valid");
        let z = SVector::<f64, $m>::from_fn(|k, _| 0.1 * (k as f64 - 0.7));
        Box::new(move || {
            filter.predict(Seconds(0.1)).expect("finite");
            black_box(filter.update(&sensor.read(black_box(z)).expect("finite")).expect("finite"));
        })
    }};
}

/// The cases that the peers have too, under their names.
pub fn cases() -> Vec<Case> {
    let target = Vector(Vector4::new(50.0, 0.1, 40.0, 0.1));
    let (f, q) = constant_velocity(1.0, 0.05);
    let motion = LinearStep::new(f, q).expect("valid");
    let prior = Gaussian { mean: target, covariance: Matrix4::identity() };
    let noise = Matrix2::from_diagonal(&Vector2::new(1e-4, 0.25));
    let radar = || Instrument::new(bearing_range(Vector2::new(-20.0, -30.0)), noise).expect("valid");
    let model = radar();
    let z = model.model().predict(&target);
    let mut extended =
        KalmanFilter::<Plane, Plane, _>::from_belief(prior.clone(), motion.clone()).expect("a prior");
    let rule = Rule::Unscented { alpha: 0.5, beta: 2.0, kappa: -1.0 };
    let mut unscented =
        SigmaPointFilter::<Plane, Plane, _>::from_belief(prior, motion, rule).expect("a prior");
    let (sensor, other) = (radar(), radar());
    let modes = vec![mode::<Plane, Plane, Plane, _>(linear!(4, 2, 1.0)), mode(linear!(4, 2, 100.0))];
    let transition = nalgebra::DMatrix::from_row_slice(2, 2, &[0.95, 0.05, 0.05, 0.95]);
    let common = linear!(4, 2, 1.0).belief().clone();
    let mut imm = Imm::new(modes, &[0.5, 0.5], Switching::Step(transition), &common).expect("models");
    let position =
        Instrument::<Plane, _>::new(Linear(SMatrix::<f64, 2, 4>::identity()), Matrix2::identity() * 1e-2);
    let position = position.expect("valid");
    vec![
        ("KF_4_2", kalman_case!(4, 2)),
        ("KF_12_6", kalman_case!(12, 6)),
        (
            "EKF_4_2_bearing_range",
            Box::new(move || {
                extended.predict(Seconds(1.0)).expect("finite");
                let belief = Gaussian { mean: target, covariance: extended.belief().covariance };
                extended.set_belief(belief).expect("finite");
                black_box(extended.update(&sensor.read(black_box(z)).expect("finite")).expect("finite"));
            }),
        ),
        (
            "UKF_4_2_bearing_range",
            Box::new(move || {
                unscented.predict(Seconds(1.0)).expect("finite");
                let belief = Gaussian { mean: target, covariance: unscented.belief().covariance };
                unscented.set_belief(belief).expect("finite");
                black_box(unscented.update(&other.read(black_box(z)).expect("finite")).expect("finite"));
            }),
        ),
        (
            "IMM_2x_4_2",
            Box::new(move || {
                imm.predict(Seconds(0.1)).expect("finite");
                let z = position.read(black_box(Vector2::new(0.03, -0.02))).expect("finite");
                black_box(imm.correct(&z).expect("finite"));
            }),
        ),
    ]
}

/// Median CPU microseconds of a call; each of `runs` repeats it for 20 ms or more.
pub fn microseconds(call: &mut dyn FnMut(), runs: usize) -> f64 {
    let timed = |repeat: u32, call: &mut dyn FnMut()| {
        let begin = ProcessTime::now();
        (0..repeat).for_each(|_| call());
        begin.elapsed().as_secs_f64()
    };
    timed(1000, call);
    let repeat = (0.02 / (timed(1000, call) / 1000.0).max(1e-9)).ceil().clamp(1.0, 1e8) as u32;
    let mut spent: Vec<f64> = (0..runs).map(|_| timed(repeat, call) / f64::from(repeat)).collect();
    spent.sort_by(f64::total_cmp);
    1e6 * spent[runs / 2]
}
