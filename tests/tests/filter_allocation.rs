//! Filters of static size and particle filters that run take no memory from the heap: alone in this program, since the count is of the whole process.

use std::alloc::System;

use nalgebra::{Matrix6, Vector6};
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use vt_core::agent::Estimator;
use vt_core::belief::{Gaussian, Moving};
use vt_core::dynamics::ConstantVelocity;
use vt_core::lie::SE3;
use vt_core::manifold::Manifold;
use vt_core::measurement::Quality;
use vt_core::pose_measurement::PoseMeasurement;
use vt_core::time::Seconds;
use vt_estimators::particle::{Annealing, Method, ParticleFilter, ParticleParams};
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

#[test]
fn running_filters_allocate_nothing() {
    for (name, mut step) in estimators::cases() {
        // Mixtures of models fill their storage in the first step.
        (0..3).for_each(|_| step());
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
