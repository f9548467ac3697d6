//! Filters of static size and particle filters that run take no memory from the heap: alone in this program, since the count is of the whole process.

use std::alloc::System;

use nalgebra::{Matrix6, SVector, Vector6};
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use vt_core::agent::Estimator;
use vt_core::belief::{Gaussian, Moving};
use vt_core::dynamics::ConstantVelocity;
use vt_core::lie::SE3;
use vt_core::manifold::Manifold;
use vt_core::measurement::Quality;
use vt_core::measurement_model::{Function, Instrument};
use vt_core::pose_measurement::PoseMeasurement;
use vt_core::time::Seconds;
use vt_estimators::adaptive::{Adaptive, Noise, NoiseFactor};
use vt_estimators::imm::{Imm, Switching, mode};
use vt_estimators::information::InformationFilter;
use vt_estimators::kalman::KalmanFilter;
use vt_estimators::particle::{Annealing, Method, ParticleFilter, ParticleParams};
use vt_estimators::retrodiction::RetrodictionFilter;
use vt_estimators::sigma_point::{Rule, SigmaPointFilter};
use vt_estimators::smoother::Smoother;
use vt_estimators::square_root::SquareRootFilter;
use vt_tests::estimators;

#[global_allocator]
static GLOBAL: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

fn assert_takes_nothing(name: &str, step: &mut dyn FnMut()) {
    let region = Region::new(GLOBAL);
    (0..50).for_each(|_| step());
    let change = region.change();
    assert_eq!(change.allocations + change.reallocations, 0, "{name}: {change:?}");
}

/// A step on SE(3) with velocity: predict, correct, mean and covariance.
fn particle_step(params: ParticleParams) -> impl FnMut() {
    let sigma = Vector6::repeat(0.01);
    let start = SE3::from_rotation_vector(&[0.3, -0.2, 0.5].into(), [0.1, 0.0, 0.8].into());
    let prior = Gaussian::from_sigmas(start, &sigma);
    let motion = ConstantVelocity::new(Vector6::repeat(0.01)).expect("not negative");
    let mut filter =
        ParticleFilter::<SE3, Moving<SE3>, _>::new(&prior, vec![sigma], motion, params).expect("a prior");
    let seen = start.retract(&Vector6::repeat(0.002));
    let z = PoseMeasurement::new(seen, Matrix6::identity() * 1e4, Quality::default());
    move || {
        filter.predict(Seconds(0.03)).expect("finite");
        std::hint::black_box(filter.correct(&z).expect("likely"));
        std::hint::black_box(filter.pose());
    }
}

/// Every Gaussian filter on SE(3) with velocity, by a measured pose and by a reading; the latter only for the unscented one, since
/// the number of rows of a measured pose is known at run time only.
fn gaussian_steps() -> Vec<(&'static str, Box<dyn FnMut()>)> {
    type S = Moving<SE3>;
    let sigma = Vector6::repeat(0.01);
    let start = SE3::from_rotation_vector(&[0.3, -0.2, 0.5].into(), [0.1, 0.0, 0.8].into());
    let prior = Gaussian::from_sigmas(start, &sigma);
    let motion = || ConstantVelocity::new(Vector6::repeat(0.01)).expect("not negative");
    let z =
        PoseMeasurement::new(start.retract(&(sigma * 0.2)), Matrix6::identity() * 1e4, Quality::default());
    let chart =
        Instrument::<SE3, _>::new(Function(move |p: &SE3| start.local(p)), Matrix6::identity() * 1e-4);
    let reading = chart.expect("a covariance").read(sigma * 0.2).expect("finite");
    let kalman = || KalmanFilter::<SE3, S, _>::new(&prior, vec![sigma], motion(), 1).expect("a prior");
    let root = || SquareRootFilter::<SE3, S, _>::new(&prior, vec![sigma], motion()).expect("a prior");
    let information = InformationFilter::<SE3, S, _>::new(&prior, vec![sigma], motion()).expect("a prior");
    let sigma_points = SigmaPointFilter::<SE3, S, _>::new(&prior, vec![sigma], motion(), Rule::UNSCENTED);
    let late = RetrodictionFilter::<S, _>::new(kalman().belief().clone(), motion()).expect("a prior");
    let considered = SVector::<f64, 12>::from_fn(|k, _| f64::from(u8::from(k >= 6)));
    let modes = vec![mode::<SE3, S, S, _>(kalman()), mode(root())];
    let imm =
        Imm::new(modes, &[0.5, 0.5], Switching::every(Seconds(1.0), 2), kalman().belief()).expect("models");
    let factor = NoiseFactor::new(9, 0.9, (0.1, 10.0)).expect("valid");
    let mut steps: Vec<(&'static str, Box<dyn FnMut()>)> = vec![];
    macro_rules! step {
        ($name:literal, $filter:expr, $update:ident, $z:expr) => {
            let (mut filter, z) = ($filter, $z.clone());
            steps.push((
                $name,
                Box::new(move || {
                    filter.predict(Seconds(0.03)).expect("finite");
                    std::hint::black_box(filter.$update(&z).expect("finite"));
                }),
            ));
        };
    }
    step!("extended", kalman(), correct, z);
    step!("extended, reading", kalman(), update, reading);
    step!("row by row", kalman(), update_by_rows, reading);
    step!("Schmidt", kalman().considering(considered), update, reading);
    step!("iterated", kalman().iterated(5), correct, z);
    step!("iterated, reading", kalman().iterated(5), update, reading);
    step!("square root", root(), correct, z);
    step!("square root, reading", root(), update, reading);
    step!("information", information, correct, z);
    step!("unscented, reading", sigma_points.expect("a prior"), update, reading);
    step!("retrodiction", late, update, reading);
    step!("mixture by rates", imm, correct, z);
    step!("smoother", Smoother::<S, _>::fixed_lag(kalman(), 5), correct, z);
    step!("adaptive", Adaptive::<S, _>::new(kalman(), Noise::Process, factor), correct, z);
    steps
}

#[test]
fn running_filters_allocate_nothing() {
    for (name, mut step) in estimators::cases().into_iter().chain(gaussian_steps()) {
        // Mixtures and smoothers fill their storage in the first steps.
        (0..8).for_each(|_| step());
        assert_takes_nothing(name, &mut step);
    }
    let parts = vec![vec![3, 4, 5], vec![0, 1, 2]];
    let annealing = Annealing { survival: 0.7, ..Annealing::default() };
    let methods =
        [Method::Bootstrap, Method::Auxiliary, Method::Annealed(annealing), Method::Partitioned(parts)];
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    for method in methods {
        for marginal in [false, true] {
            let name = format!("{method:?}, marginal {marginal}");
            let params =
                ParticleParams { count: 300, method: method.clone(), marginal, ..ParticleParams::default() };
            let mut step = particle_step(params);
            pool.install(|| {
                (0..20).for_each(|_| step());
                assert_takes_nothing(&name, &mut step);
            });
        }
    }
}
