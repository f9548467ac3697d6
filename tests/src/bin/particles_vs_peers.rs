//! Times of the particle filter beside what others need, each in the same run on one thread.
//!
//! - A step of 1,000 particles with 12 states (constant velocity in R^6 and on SE(3)) and a trivial likelihood, beside the time in
//!   which `rand_distr::StandardNormal` with ChaCha8 makes its 12,000 normal numbers.
//! - A step of 1,000 particles with 4 states, bearing and range, systematic resampling every time, beside Stone Soup's
//!   (`particle_4_2_1000` of its `estimator_peers.py`).
//!
//! A step is resampling, prediction, correction, and the mean and covariance of the pose.
//!
//! usage: `particles_vs_peers [PYTHON ESTIMATOR_PEERS.PY]`

use std::process::Command;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use nalgebra::{Vector2, Vector6};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use vt_core::agent::Estimator;
use vt_core::belief::{Gaussian, Moving};
use vt_core::dynamics::ConstantVelocity;
use vt_core::lie::{SE3, Vector};
use vt_core::manifold::{Manifold, Square};
use vt_core::math;
use vt_core::measurement::{Level, Linearized, Measurement, NormalEquations, Quality};
use vt_core::time::Seconds;
use vt_estimators::particle::{ParticleFilter, ParticleParams};
use vt_estimators::resampling::Resampling;
use vt_tests::replay::median;

const PARTICLES: usize = 1000;
const ROUNDS: usize = 41;

/// A measurement with a likelihood alone.
struct Likelihood<F>(F);

impl<P: Manifold, F: Fn(&P) -> f64 + Sync> Measurement<P> for Likelihood<F>
where
    nalgebra::DefaultAllocator: vt_core::manifold::Alloc<P::D>,
{
    fn log_likelihoods(&self, poses: &[P], out: &mut [f64]) {
        poses.iter().zip(out).for_each(|(pose, l)| *l = (self.0)(pose));
    }
    fn residuals(&self, _: &P, out: &mut Linearized<P>) {
        out.clear();
    }
    fn normal_equations(&self, _: &P, out: &mut NormalEquations<P>) {
        out.clear();
    }
    fn quality(&self, _: &P) -> Quality {
        Quality::default()
    }
    fn level(&self) -> Level {
        Level::Pixel
    }
}

fn microseconds(time: Duration, steps: u32) -> f64 {
    1e6 * time.as_secs_f64() / f64::from(steps)
}

/// Time of one round of steps.
fn steps<P: Manifold>(filter: &mut dyn Estimator<P>, z: &dyn Measurement<P>, dt: f64, n: u32) -> Result<f64>
where
    nalgebra::DefaultAllocator: vt_core::manifold::Alloc<P::D>,
{
    let begin = Instant::now();
    for _ in 0..n {
        filter.predict(Seconds(dt))?;
        filter.correct(z)?;
        std::hint::black_box(filter.pose());
    }
    Ok(microseconds(begin.elapsed(), n))
}

fn params(resampling: Resampling, effective_share: f64, marginal: bool) -> ParticleParams {
    ParticleParams { count: PARTICLES, resampling, effective_share, marginal, ..ParticleParams::default() }
}

/// A filter that can be put back to its prior.
struct Timed<P: Manifold>
where
    nalgebra::DefaultAllocator: vt_core::manifold::Alloc<P::D>,
{
    name: &'static str,
    filter: Box<dyn Estimator<P>>,
    prior: Gaussian<P>,
    times: Vec<f64>,
}

/// Twelve states at constant velocity under three ways to go on, from poses around `start`.
fn twelve<P>(start: P, names: [&'static str; 3]) -> Result<Vec<Timed<P>>>
where
    P: Manifold<D = nalgebra::Const<6>>,
{
    let sigma = Vector6::new(0.01, 0.01, 0.01, 0.02, 0.02, 0.02);
    let prior = Gaussian::from_sigmas(start, &sigma);
    // Above 1: drawn again in every step.
    let kinds = [(0.5, false), (1.1, false), (1.1, true)];
    let filter = |(name, (share, marginal))| {
        let motion = ConstantVelocity::new(Vector6::new(0.01, 0.01, 0.01, 0.04, 0.04, 0.04))?;
        let params = params(Resampling::Deterministic, share, marginal);
        let filter = Box::new(ParticleFilter::<P, Moving<P>, _>::new(&prior, vec![sigma], motion, params)?);
        Ok(Timed { name, filter, prior: prior.clone(), times: vec![] })
    };
    names.into_iter().zip(kinds).map(filter).collect()
}

/// Twelve states beside the normal numbers.
fn beside_normals() -> Result<()> {
    let start = SE3::from_rotation_vector(&[0.3, -0.2, 0.5].into(), [0.1, 0.0, 0.8].into());
    let names = ["R^6", "R^6, resampled every step", "R^6, Rao-Blackwellised"];
    let mut flat = twelve(Vector(Vector6::repeat(0.1)), names)?;
    let names = ["SE(3)", "SE(3), resampled every step", "SE(3), Rao-Blackwellised"];
    let mut rigid = twelve(start, names)?;
    let mut generator = ChaCha8Rng::seed_from_u64(0);
    let mut normals = vec![0.0; 12 * PARTICLES];
    let mut draws = vec![];
    for _ in 0..ROUNDS {
        let begin = Instant::now();
        for _ in 0..20 {
            normals.iter_mut().for_each(|n: &mut f64| *n = StandardNormal.sample(&mut generator));
            std::hint::black_box(&normals);
        }
        draws.push(microseconds(begin.elapsed(), 20));
        flat.iter_mut().try_for_each(round)?;
        rigid.iter_mut().try_for_each(round)?;
    }
    let draws = median(&draws);
    println!("12,000 normal numbers by rand_distr and ChaCha8: {draws:.1} us");
    let times = flat.iter().map(|t| (t.name, &t.times)).chain(rigid.iter().map(|t| (t.name, &t.times)));
    for (name, times) in times {
        let time = median(times);
        println!("step, 1,000 particles with 12 states, {name}: {time:.1} us, ratio {:.2}", time / draws);
    }
    Ok(())
}

/// Twenty steps of one of them.
fn round<P: Manifold<D = nalgebra::Const<6>>>(timed: &mut Timed<P>) -> Result<()> {
    timed.filter.reset(&timed.prior)?;
    timed.times.push(steps(timed.filter.as_mut(), &Likelihood(|_: &P| 0.0), 1.0 / 30.0, 20)?);
    Ok(())
}

/// Four states: the problem of `estimator_peers.py`.
fn bearing_range() -> Result<f64> {
    let at_rest =
        Gaussian { mean: Vector(Vector2::new(50.0, 40.0)), covariance: Square::<Vector<2>>::identity() };
    let rest = vec![Vector2::repeat(0.1_f64.sqrt())];
    let motion = ConstantVelocity::new(Vector2::repeat(0.05))?;
    let params = params(Resampling::Systematic, 1.1, false);
    let mut filter = ParticleFilter::<Vector<2>, Moving<Vector<2>>, _>::new(&at_rest, rest, motion, params)?;
    let sensor = Vector2::new(-20.0, -30.0);
    let d = Vector2::new(51.2, 40.3) - sensor;
    let (bearing, range) = (math::atan2(d.y, d.x), d.norm());
    let z = Likelihood(move |pose: &Vector<2>| {
        let d = pose.0 - sensor;
        let (b, r) = (math::wrap_angle(math::atan2(d.y, d.x) - bearing), d.norm() - range);
        -0.5 * (b * b / 1e-4 + r * r / 0.25)
    });
    let mut times = vec![];
    for _ in 0..ROUNDS {
        filter.reset(&at_rest)?;
        times.push(steps(&mut filter, &z, 1.0, 20)?);
    }
    let off = (filter.pose().mean.0 - Vector2::new(51.2, 40.3)).norm();
    ensure!(off < 1.0, "the filter is {off} m off");
    Ok(median(&times))
}

/// Stone Soup's time in microseconds a step.
fn stone_soup(python: &str, script: &str) -> Result<f64> {
    let output =
        Command::new(python).args([script, "--only", "particle_4_2_1000"]).output().context("Stone Soup")?;
    ensure!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let line: serde_json::Value = serde_json::from_slice(&output.stdout).context("one JSON line")?;
    line["us_per_step"].as_f64().context("us_per_step")
}

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    pool.install(beside_normals)?;
    let before = pool.install(bearing_range)?;
    println!("step, 1,000 particles, 4 states, bearing and range: {before:.1} us");
    if let [python, script] = arguments.as_slice() {
        let theirs = stone_soup(python, script)?;
        let ours = median(&[before, pool.install(bearing_range)?, pool.install(bearing_range)?]);
        println!("Stone Soup: {theirs:.1} us; ours beside it {ours:.1} us, ratio {:.1}", theirs / ours);
    }
    Ok(())
}
