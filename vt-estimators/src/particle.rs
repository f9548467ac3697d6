//! Particle filter by sequential importance resampling on any manifold (Gordon 1993; paper Fig. 5 and 6).

use nalgebra::DefaultAllocator;
use rayon::prelude::*;
use vt_core::agent::{Dynamics, Estimator};
use vt_core::belief::{Gaussian, State, symmetrize};
use vt_core::dynamics::pivoted_root;
use vt_core::error::EstimateError;
use vt_core::manifold::{Alloc, Manifold, Square, Tangent};
use vt_core::math;
use vt_core::measurement::Measurement;
use vt_core::random::{Random, Source, Stream};
use vt_core::report::Innovation;
use vt_core::time::Seconds;

use crate::prior::at_rest;
use crate::resampling::{Resampling, effective_number};

/// Parameters of a [`ParticleFilter`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParticleParams {
    /// Number of particles.
    pub count: usize,
    /// Resampling scheme.
    pub resampling: Resampling,
    /// Share of the particles below which the effective number triggers resampling.
    pub effective_share: f64,
    /// Seed of the run.
    pub seed: u64,
    /// Number of the target, which keeps the random numbers of targets apart.
    pub target: u64,
}

impl Default for ParticleParams {
    fn default() -> Self {
        Self { count: 200, resampling: Resampling::Deterministic, effective_share: 0.5, seed: 0, target: 0 }
    }
}

/// Particles of a state `S` with a pose `P` under the dynamics `M`.
///
/// Order of a step: resample where the effective number is low → predict → weight → estimate (before the next
/// resampling). Random numbers are addressed by frame and particle, so that threads do not change a bit. Process
/// noise is that at the heaviest particle for all of them. After an error the particles are those of before.
pub struct ParticleFilter<P, S, M>
where
    P: Manifold,
    S: Manifold,
    DefaultAllocator: Alloc<P::D> + Alloc<S::D>,
{
    params: ParticleParams,
    dynamics: M,
    rest: Vec<Tangent<P>>,
    states: Vec<S>,
    spare: Vec<S>,
    /// Those of `states`.
    poses: Vec<P>,
    weights: Vec<f64>,
    /// Log-likelihoods, then the weights after the measurement.
    posterior: Vec<f64>,
    chosen: Vec<usize>,
    frame: u64,
    resets: u64,
    estimate: Gaussian<P>,
}

/// Particles per parallel task.
const CHUNK: usize = 64;

impl<P, S, M> ParticleFilter<P, S, M>
where
    P: Manifold,
    S: State<P>,
    M: Dynamics<S>,
    DefaultAllocator: Alloc<P::D> + Alloc<S::D>,
{
    /// A filter with particles drawn from `prior`; `rest` holds the a-priori deviations of the derivatives.
    ///
    /// # Errors
    /// [`EstimateError::NoParticles`]; when the prior is not finite, not positive semi-definite, or of another dimension
    /// than its deviations.
    pub fn new(
        prior: &Gaussian<P>,
        rest: Vec<Tangent<P>>,
        dynamics: M,
        params: ParticleParams,
    ) -> Result<Self, EstimateError> {
        if params.count == 0 {
            return Err(EstimateError::NoParticles);
        }
        let mut filter = Self {
            params,
            dynamics,
            rest,
            states: vec![],
            spare: vec![],
            poses: vec![],
            weights: vec![],
            posterior: vec![],
            chosen: vec![],
            frame: 0,
            resets: 0,
            estimate: prior.clone(),
        };
        filter.reset(prior)?;
        Ok(filter)
    }

    /// The particles with their normalised weights.
    pub fn states(&self) -> (&[S], &[f64]) {
        (&self.states, &self.weights)
    }

    /// Chooses the particles that go on; true when they were drawn again.
    fn choose(&mut self) -> bool {
        let p = &self.params;
        if effective_number(&self.weights) >= p.effective_share * p.count as f64 {
            self.chosen.clear();
            self.chosen.extend(0..p.count);
            return false;
        }
        let mut random = Random::new(p.seed, Stream::Resample, p.target, self.frame, 0);
        p.resampling.draw(&self.weights, &mut random, &mut self.chosen);
        true
    }

    /// Manifold mean and covariance of the poses under these weights.
    fn summarize(&self, weights: &[f64]) -> Result<Gaussian<P>, EstimateError> {
        let mean = P::mean(&self.poses, weights).ok_or(EstimateError::NotFinite("the particles' mean"))?;
        let n = mean.dim();
        let mut covariance = Square::<P>::zeros_generic(n, n);
        for (pose, &w) in self.poses.iter().zip(weights) {
            let d = mean.local(pose);
            covariance.ger(w, &d, &d, 1.0);
        }
        symmetrize(&mut covariance);
        Ok(Gaussian { mean, covariance })
    }
}

fn poses<P: Manifold, S: State<P>>(states: &[S], out: &mut Vec<P>)
where
    DefaultAllocator: Alloc<P::D> + Alloc<S::D>,
{
    out.clear();
    out.extend(states.iter().map(|s| s.pose().clone()));
}

/// Draws `at ⊞ root n`.
fn sample<S: Manifold>(at: &S, root: &Square<S>, random: &mut Random) -> S
where
    DefaultAllocator: Alloc<S::D>,
{
    let mut n = at.zero();
    for k in 0..n.len() {
        n[k] = random.normal();
    }
    at.retract(&(root * n))
}

impl<P, S, M> Estimator<P> for ParticleFilter<P, S, M>
where
    P: Manifold,
    S: State<P>,
    M: Dynamics<S>,
    DefaultAllocator: Alloc<P::D> + Alloc<S::D>,
{
    fn predict(&mut self, dt: Seconds) -> Result<(), EstimateError> {
        self.frame += 1;
        let redrawn = self.choose();
        let heaviest = self.weights.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1));
        let (heaviest, _) = heaviest.ok_or(EstimateError::NoParticles)?;
        let root = self.dynamics.noise_root(&self.states[heaviest], dt);
        let source = Source::new(self.params.seed, Stream::Predict, self.params.target);
        let (dynamics, frame, states, chosen) = (&self.dynamics, self.frame, &self.states, &self.chosen);
        self.spare.resize(states.len(), states[heaviest].clone());
        let finite = self.spare.par_chunks_mut(CHUNK).enumerate().map(|(chunk, moved)| {
            let mut finite = true;
            for (k, state) in (chunk * CHUNK..).zip(moved) {
                let mut random = source.at(frame, k as u32);
                *state = sample(&dynamics.propagate(&states[chosen[k]], dt), &root, &mut random);
                finite &= state.is_finite();
            }
            finite
        });
        if !finite.reduce(|| true, |a, b| a & b) {
            return Err(EstimateError::NotFinite("a predicted particle"));
        }
        core::mem::swap(&mut self.states, &mut self.spare);
        if redrawn {
            self.weights.fill(1.0 / self.params.count as f64);
        }
        poses(&self.states, &mut self.poses);
        self.estimate = self.summarize(&self.weights)?;
        Ok(())
    }

    fn correct(&mut self, z: &dyn Measurement<P>) -> Result<Innovation, EstimateError> {
        self.posterior.clear();
        self.posterior.resize(self.poses.len(), 0.0);
        self.poses
            .par_chunks(CHUNK)
            .zip(self.posterior.par_chunks_mut(CHUNK))
            .for_each(|(poses, out)| z.log_likelihoods(poses, out));
        if self.posterior.iter().any(|&l| l.is_nan() || l == f64::INFINITY) {
            return Err(EstimateError::NotFinite("the likelihood"));
        }
        for (l, w) in self.posterior.iter_mut().zip(&self.weights) {
            *l += math::ln(*w);
        }
        let log_evidence = math::log_sum_exp(&self.posterior);
        if !log_evidence.is_finite() {
            return Err(EstimateError::ZeroLikelihood);
        }
        self.posterior.iter_mut().for_each(|l| *l = math::exp(*l - log_evidence));
        let total: f64 = self.posterior.iter().sum();
        self.posterior.iter_mut().for_each(|w| *w /= total);
        self.estimate = self.summarize(&self.posterior)?;
        core::mem::swap(&mut self.weights, &mut self.posterior);
        let effective_particles = Some(effective_number(&self.weights));
        Ok(Innovation { log_evidence, effective_particles, iterations: 1, ..Innovation::default() })
    }

    fn pose(&self) -> Gaussian<P> {
        self.estimate.clone()
    }

    fn reset(&mut self, prior: &Gaussian<P>) -> Result<(), EstimateError> {
        let state: Gaussian<S> = at_rest(prior, &self.rest)?;
        let root = pivoted_root(&state.covariance);
        let p = &self.params;
        self.resets += 1;
        let source = Source::new(p.seed, Stream::Reinit, p.target);
        self.states.clear();
        for k in 0..p.count {
            let mut random = source.at(self.resets, k as u32);
            self.states.push(sample(&state.mean, &root, &mut random));
        }
        self.weights.clear();
        self.weights.resize(p.count, 1.0 / p.count as f64);
        poses(&self.states, &mut self.poses);
        self.estimate = self.summarize(&self.weights)?;
        Ok(())
    }

    fn particles(&self) -> Option<(&[P], &[f64])> {
        Some((&self.poses, &self.weights))
    }
}
