//! Narrow likelihoods far from most particles: annealed and partitioned sampling reach what weights alone miss with as many
//! evaluations of the likelihood.

use std::sync::atomic::{AtomicUsize, Ordering};

use nalgebra::{DefaultAllocator, Vector3, Vector6};
use vt_core::agent::Estimator;
use vt_core::belief::Gaussian;
use vt_core::dynamics::Brownian;
use vt_core::lie::{SE2, SE3, Vector};
use vt_core::manifold::{Alloc, Manifold, Square, Tangent};
use vt_core::measurement::{Level, Linearized, Measurement, NormalEquations, Quality};
use vt_core::pose_measurement::PoseMeasurement;
use vt_core::random::Random;
use vt_core::time::Seconds;
use vt_estimators::particle::{Annealing, Method, ParticleFilter, ParticleParams};

use crate::problems::{before_camera, normals, random};

/// Counts the poses that are weighed.
struct Counted<P: Manifold>(PoseMeasurement<P>, AtomicUsize)
where
    DefaultAllocator: Alloc<P::D>;

impl<P: Manifold> Measurement<P> for Counted<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    fn log_likelihoods(&self, poses: &[P], out: &mut [f64]) {
        self.1.fetch_add(poses.len(), Ordering::Relaxed);
        self.0.log_likelihoods(poses, out);
    }
    fn residuals(&self, at: &P, out: &mut Linearized<P>) {
        self.0.residuals(at, out);
    }
    fn normal_equations(&self, at: &P, out: &mut NormalEquations<P>) {
        self.0.normal_equations(at, out);
    }
    fn quality(&self, at: &P) -> Quality {
        self.0.quality(at)
    }
    fn level(&self) -> Level {
        Level::Pixel
    }
}

const RUNS: u64 = 20;

/// Squared distance of the estimate from what is seen, in deviations of the likelihood per degree of freedom, and the
/// number of evaluations.
fn distance<P: Manifold>(
    prior: &Gaussian<P>,
    z: &Counted<P>,
    noise: &Tangent<P>,
    params: ParticleParams,
) -> (f64, usize)
where
    DefaultAllocator: Alloc<P::D>,
{
    let still = Brownian::new(noise.map(|s| s * s)).expect("not negative");
    let mut filter = ParticleFilter::<P, P, _>::new(prior, vec![], still, params).expect("a prior");
    filter.predict(Seconds(1.0)).expect("finite");
    z.1.store(0, Ordering::Relaxed);
    filter.correct(z).expect("likely");
    let mut l = [0.0];
    let used = z.1.load(Ordering::Relaxed);
    z.log_likelihoods(&[filter.pose().mean], &mut l);
    (-2.0 * l[0] / noise.len() as f64, used)
}

/// `narrow` is the number of deviations of the likelihood in one of the prior; parts are single coordinates in the order
/// `parts`. On groups a step is short: the likelihood of a part alone is that of all but for what coordinates do to each
/// other, in the second order of the step.
fn compare<P: Manifold>(
    space: &str,
    start: impl Fn(&mut Random) -> P,
    noise: Tangent<P>,
    narrow: f64,
    parts: &[usize],
) where
    DefaultAllocator: Alloc<P::D>,
{
    let parts = parts.iter().map(|k| vec![*k]).collect();
    let methods = [
        ("annealed", Method::Annealed(Annealing::default()), 500),
        ("partitioned", Method::Partitioned(parts), 6000),
    ];
    for (name, method, count) in methods {
        let (mut missed, mut worst, mut all) = (0, 0.0_f64, 0);
        for run in 0..RUNS {
            let random = &mut random(300 + run);
            let at = start(random);
            // Known well before, free to move: the noise of the step is what has to be searched.
            let prior = Gaussian::from_sigmas(at.clone(), &(&noise * 1e-4));
            let seen = at.retract(&(normals(&noise, random) * 0.7));
            let information = Square::<P>::from_diagonal(&noise.map(|s| narrow * narrow / (s * s)));
            let z = Counted(PoseMeasurement::new(seen, information, Quality::default()), AtomicUsize::new(0));
            let params =
                ParticleParams { count, method: method.clone(), seed: run, ..ParticleParams::default() };
            let (found, used) = distance(&prior, &z, &noise, params);
            let plain = ParticleParams { count: used, seed: run, ..ParticleParams::default() };
            let (without, same) = distance(&prior, &z, &noise, plain);
            assert_eq!(used, same);
            worst = worst.max(found);
            missed += u32::from(without > 4.0);
            all += used;
        }
        println!(
            "{space}, {name}: at most {:.2} deviations away; weights alone more than 2 in {missed} of {RUNS}, {} evaluations",
            worst.sqrt(),
            all / RUNS as usize
        );
        assert!(worst < 1.0, "{space}, {name}: {worst}");
        assert!(missed >= 18, "{space}, {name}: weights alone missed in {missed} of {RUNS} only");
    }
}

#[test]
fn narrow_likelihoods_are_reached_in_vector_spaces() {
    compare(
        "R6",
        |_| Vector(Vector6::zeros()),
        Vector6::new(1.0, 2.0, 0.5, 1.0, 3.0, 1.0),
        60.0,
        &[0, 1, 2, 3, 4, 5],
    );
}

#[test]
fn narrow_likelihoods_are_reached_in_the_plane() {
    compare(
        "SE(2)",
        |r| SE2::new(r.normal(), r.normal(), 3.0 * r.normal()),
        Vector3::new(0.02, 0.02, 0.02),
        100.0,
        &[2, 0, 1],
    );
}

#[test]
fn narrow_likelihoods_are_reached_in_space() {
    compare::<SE3>("SE(3)", before_camera, Vector6::repeat(0.03), 30.0, &[3, 4, 5, 0, 1, 2]);
}
