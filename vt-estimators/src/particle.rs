//! Particle filters on any manifold (Gordon, Salmond and Smith 1993; paper Fig. 5 and 6).
//!
//! One filter, and what can be chosen about it independently of everything else:
//!
//! | choice | what |
//! |---|---|
//! | [`Method`] | how a measurement is taken in: by weights alone, by a look ahead, layer by layer, link by link |
//! | [`ParticleParams::marginal`] | velocities by a Kalman filter a particle instead of by particles (Rao–Blackwell) |
//! | [`Resampling`] | how particles are drawn again, when [`ParticleParams::effective_share`] says so |
//! | [`ParticleParams::roughening`] | jitter after drawing again |
//! | [`ParticleParams::adaptive`] | number of particles by the bins that they occupy |

use core::cell::OnceCell;

use nalgebra::DefaultAllocator;
use vt_core::agent::{Dynamics, Estimator};
use vt_core::batch::{LANES, Row, with_rows};
use vt_core::belief::{Gaussian, State};
use vt_core::error::EstimateError;
use vt_core::manifold::{Alloc, AllocPair, Manifold, Square, Tangent};
use vt_core::measurement::Measurement;
use vt_core::measurement_model::{MeasurementModel, Reading};
use vt_core::random::{Random, Source, Stream};
use vt_core::report::Innovation;
use vt_core::time::Seconds;

use crate::prior::at_rest;
use crate::resampling::{Resampling, effective_number};

mod adaptive;
mod annealed;
mod auxiliary;
mod cloud;
mod diffusion;
mod partitioned;
mod summary;

pub use adaptive::Adaptive;
pub use annealed::Annealing;
use cloud::{Cloud, likelihoods};
use diffusion::Diffusion;

/// How a measurement is taken in. Likelihoods are evaluated once a particle unless said otherwise.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub enum Method {
    /// Sequential importance resampling: particles move as the dynamics say and are weighted (Gordon 1993).
    #[default]
    Bootstrap,
    /// Particles are chosen by the likelihood of where they would go without noise, then moved and weighted (M. Pitt,
    /// N. Shephard, "Filtering via simulation: auxiliary particle filters", 1999). Two evaluations a particle; pays
    /// where the noise of a step is small against what is not known before it.
    Auxiliary,
    /// From a broad likelihood to the true one in layers. See [`Annealing`].
    Annealed(Annealing),
    /// Coordinates are placed in parts, the root of an articulated body first, each by weighted resampling with
    /// [`Measurement::importances`] (J. MacCormick, M. Isard, "Partitioned sampling, articulated objects, and
    /// interface-quality hand tracking", 2000). Each part lists coordinates of the pose's tangent space; derivatives go
    /// with their coordinates. On SE(3), rotations come first: they change what translations mean. One evaluation a
    /// particle and part.
    Partitioned(Vec<Vec<usize>>),
}

/// Parameters of a [`ParticleFilter`].
#[derive(Clone, Debug, PartialEq)]
pub struct ParticleParams {
    /// Number of particles; of the start, where it adapts.
    pub count: usize,
    /// Resampling scheme.
    pub resampling: Resampling,
    /// Share of the particles below which the effective number triggers resampling.
    pub effective_share: f64,
    /// How measurements are taken in.
    pub method: Method,
    /// True: particles are drawn for poses only, and each carries the mean of its velocity (and acceleration) given its
    /// path; the covariance of these is the same for all, computed once a step (A. Doucet et al., "Rao–Blackwellised
    /// particle filtering for dynamic Bayesian networks", 2000). Exact for dynamics that are linear with constant noise;
    /// elsewhere linearised at the heaviest particle.
    pub marginal: bool,
    /// `K` of the jitter `σ = K E N^(−1/d)` after each resampling, with `E` the range of a coordinate and `d` the
    /// dimension (Gordon 1993, who takes 0.2); 0 for none. It widens the belief by what it adds.
    pub roughening: f64,
    /// Number of particles by KLD-sampling; `None` for a fixed one.
    pub adaptive: Option<Adaptive>,
    /// Seed of the run.
    pub seed: u64,
    /// Number of the target, which keeps the random numbers of targets apart.
    pub target: u64,
}

impl Default for ParticleParams {
    fn default() -> Self {
        Self {
            count: 200,
            resampling: Resampling::Deterministic,
            effective_share: 0.5,
            method: Method::Bootstrap,
            marginal: false,
            roughening: 0.0,
            adaptive: None,
            seed: 0,
            target: 0,
        }
    }
}

/// Particles of a state `S` with a pose `P` under the dynamics `M`.
///
/// Order of a step: resample where the effective number is low → predict → weight → estimate (before the next
/// resampling). Random numbers are addressed by frame and particle, so that threads do not change a bit. Process
/// noise is that at the heaviest particle for all of them. After an error the particles are those of before. Storage is
/// used again from step to step.
#[derive(Clone)]
pub struct ParticleFilter<P, S, M>
where
    P: Manifold,
    S: Manifold,
    DefaultAllocator: Alloc<P::D> + Alloc<S::D>,
{
    params: ParticleParams,
    dynamics: M,
    rest: Vec<Tangent<P>>,
    cloud: Cloud<P, S>,
    /// Clouds in the making.
    next: Cloud<P, S>,
    spare: Cloud<P, S>,
    diffusion: Diffusion<S>,
    next_diffusion: Diffusion<S>,
    chosen: Vec<usize>,
    bins: Vec<u64>,
    frame: u64,
    resets: u64,
    /// True until the particles have been weighted since they last moved: their noise may still be drawn in another way.
    fresh: bool,
    estimate: OnceCell<Gaussian<P>>,
}

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
    /// [`EstimateError::NoParticles`]; [`EstimateError::Dimension`] when the parts of [`Method::Partitioned`] do not name
    /// each coordinate of the pose once or the bins of [`Adaptive`] are not those of the pose; when the prior is not finite,
    /// not positive semi-definite, or of another dimension than its deviations.
    pub fn new(
        prior: &Gaussian<P>,
        rest: Vec<Tangent<P>>,
        dynamics: M,
        params: ParticleParams,
    ) -> Result<Self, EstimateError> {
        let expected = prior.mean.zero().len();
        if params.count == 0 {
            return Err(EstimateError::NoParticles);
        }
        let parts = match &params.method {
            Method::Partitioned(parts) => parts.as_slice(),
            _ => &[],
        };
        let mut listed: Vec<usize> = parts.iter().flatten().copied().collect();
        listed.sort_unstable();
        if !(parts.is_empty() || listed.iter().copied().eq(0..expected)) {
            listed.dedup();
            let found = listed.iter().filter(|k| **k < expected).count();
            return Err(EstimateError::Dimension { what: "the list of parts", found, expected });
        }
        if let Some(found) = params.adaptive.as_ref().map(|a| a.widths.len()).filter(|n| *n != expected) {
            return Err(EstimateError::Dimension { what: "the list of bin widths", found, expected });
        }
        let size = S::at_rest(prior.mean.clone()).dim();
        let diffusion = Diffusion::new(size, expected, parts, params.marginal);
        let mut filter = Self {
            params,
            dynamics,
            rest,
            cloud: Cloud::default(),
            next: Cloud::default(),
            spare: Cloud::default(),
            next_diffusion: diffusion.clone(),
            diffusion,
            chosen: vec![],
            bins: vec![],
            frame: 0,
            resets: 0,
            fresh: false,
            estimate: OnceCell::new(),
        };
        filter.reset(prior)?;
        Ok(filter)
    }

    /// Takes in a reading by its likelihood: [`Estimator::correct`] under the name that all filters have.
    ///
    /// # Errors
    /// As there; the particles are then unchanged.
    pub fn update<H>(&mut self, reading: &Reading<P, H>) -> Result<Innovation, EstimateError>
    where
        H: MeasurementModel<P> + 'static,
        DefaultAllocator: AllocPair<P::D, H::M>,
    {
        self.correct(reading)
    }

    /// The particles with their normalised weights. With [`ParticleParams::marginal`] the derivatives are means.
    pub fn states(&self) -> (&[S], &[f64]) {
        (&self.cloud.states, &self.cloud.weights)
    }

    /// Covariance of the derivatives given the pose, in the tangent order of the state and zero for the pose; zero
    /// without [`ParticleParams::marginal`].
    pub fn conditional_covariance(&self) -> &Square<S> {
        self.diffusion.remainder()
    }

    /// Maximum a posteriori: the mode of the particles' kernel density, to which the bandwidth of Silverman (1986) in the
    /// metric of the covariance applies. Unlike the mean it lies at one of several modes. Effort: some 50 times the
    /// number of particles.
    pub fn mode(&self) -> P {
        summary::mode(&self.cloud.poses, &self.cloud.weights, &self.pose())
    }

    /// Chooses the particles that go on; true when they were drawn again.
    fn choose(&mut self, frame: u64) -> bool {
        let (p, weights) = (&self.params, &self.cloud.weights);
        let draw = |stage, count, out: &mut Vec<usize>| {
            let mut random = Random::new(p.seed, Stream::Resample, p.target, frame, stage);
            p.resampling.draw(weights, count, &mut random, out);
        };
        let count = weights.len();
        if let Some(adaptive) = &p.adaptive {
            draw(0, count, &mut self.chosen);
            let enough = adaptive.count(&self.cloud.poses, &self.chosen, &mut self.bins);
            draw(0, enough, &mut self.chosen);
            return true;
        }
        if effective_number(weights) >= p.effective_share * count as f64 {
            self.chosen.clear();
            self.chosen.extend(0..count);
            return false;
        }
        draw(0, count, &mut self.chosen);
        true
    }

    /// Deviations of the jitter of the chosen particles.
    fn jitter(&self) -> Option<Tangent<S>> {
        let mut states = self.chosen.iter().map(|&k| &self.cloud.states[k]);
        let at = states.next().filter(|_| self.params.roughening > 0.0)?;
        let (mut low, mut high) = (at.zero(), at.zero());
        for state in states {
            let offset = at.local(state);
            low = low.inf(&offset);
            high = high.sup(&offset);
        }
        let spacing = vt_core::math::pow(self.chosen.len() as f64, -1.0 / low.len() as f64);
        Some((high - low) * (self.params.roughening * spacing))
    }

    /// Takes over the cloud `next` with its new weights.
    fn commit(&mut self) {
        core::mem::swap(&mut self.cloud, &mut self.next);
        self.estimate = OnceCell::new();
    }

    /// True when the method wants to know where particles were going and by which noise.
    fn keeps_paths(&self) -> bool {
        self.params.method != Method::Bootstrap
    }

    /// Weights alone.
    fn weigh(&mut self, z: &dyn Measurement<P>) -> Result<(f64, u32), EstimateError> {
        let (now, next) = (&mut self.cloud, &mut self.next);
        likelihoods(z, &now.poses, &mut next.logs)?;
        next.logs.iter_mut().zip(&now.logs).for_each(|(l, w)| *l += w);
        let log_evidence = next.normalize()?;
        core::mem::swap(&mut now.logs, &mut next.logs);
        core::mem::swap(&mut now.weights, &mut next.weights);
        self.estimate = OnceCell::new();
        Ok((log_evidence, 1))
    }
}

impl<P, S, M> Estimator<P> for ParticleFilter<P, S, M>
where
    P: Manifold,
    S: State<P>,
    M: Dynamics<S>,
    DefaultAllocator: Alloc<P::D> + Alloc<S::D>,
{
    fn predict(&mut self, dt: Seconds) -> Result<(), EstimateError> {
        let frame = self.frame + 1;
        let redrawn = self.choose(frame);
        let heaviest = self.cloud.heaviest().ok_or(EstimateError::NoParticles)?;
        self.next_diffusion.prepare(&self.dynamics, heaviest, dt, &self.diffusion)?;
        let jitter = if redrawn { self.jitter() } else { None };
        let p = &self.params;
        let [source, roughen] = [Stream::Predict, Stream::Roughen].map(|s| Source::new(p.seed, s, p.target));
        let (dynamics, from, chosen) = (&self.dynamics, &self.cloud.states, &self.chosen);
        let place = |chunk: usize, states: &mut [S]| {
            states.iter_mut().zip(&chosen[chunk * LANES..]).for_each(|(s, &k)| s.clone_from(&from[k]));
            if let Some(jitter) = &jitter {
                with_rows(jitter.len(), |rows| {
                    roughen.normal_rows(frame, (chunk * LANES) as u32, rows);
                    rows.iter_mut().zip(jitter).for_each(|(row, s)| row.iter_mut().for_each(|v| *v *= s));
                    S::retract_each(states, |s| s, rows);
                });
            }
        };
        let go = |states: &mut [S], noise: Option<&[Row]>| match noise {
            Some(noise) => dynamics.disturb_each(states, dt, noise),
            None => dynamics.propagate_each(states, dt),
        };
        let (count, keep) = (chosen.len(), self.keeps_paths());
        self.next.scatter((count, heaviest), place, go, &self.next_diffusion, (&source, frame), keep)?;
        if !redrawn {
            self.next.weights.clone_from(&self.cloud.weights);
            self.next.logs.clone_from(&self.cloud.logs);
        }
        core::mem::swap(&mut self.diffusion, &mut self.next_diffusion);
        self.commit();
        self.frame = frame;
        self.fresh = true;
        Ok(())
    }

    fn correct(&mut self, z: &dyn Measurement<P>) -> Result<Innovation, EstimateError> {
        self.cloud.poses.first().map_or(Err(EstimateError::NoParticles), |pose| z.fits(pose))?;
        let (log_evidence, iterations) = match &self.params.method {
            Method::Auxiliary if self.fresh => self.look_ahead(z)?,
            Method::Annealed(annealing) if self.fresh => self.anneal(z, *annealing)?,
            Method::Partitioned(_) if self.fresh => self.place_parts(z)?,
            _ => self.weigh(z)?,
        };
        self.fresh = false;
        let effective_particles = Some(effective_number(&self.cloud.weights));
        Ok(Innovation { log_evidence, effective_particles, iterations, ..Innovation::default() })
    }

    fn pose(&self) -> Gaussian<P> {
        self.estimate.get_or_init(|| summary::gaussian(&self.cloud.poses, &self.cloud.weights)).clone()
    }

    fn reset(&mut self, prior: &Gaussian<P>) -> Result<(), EstimateError> {
        let state: Gaussian<S> = at_rest(prior, &self.rest, &self.dynamics)?;
        let resets = self.resets + 1;
        self.next_diffusion.spread(&state.covariance);
        let source = Source::new(self.params.seed, Stream::Reinit, self.params.target);
        let (count, keep) = (self.params.count, self.keeps_paths());
        let place = |_: usize, states: &mut [S]| states.fill(state.mean.clone());
        let go = |states: &mut [S], noise: Option<&[Row]>| {
            S::retract_each(states, |s| s, noise.unwrap_or_default())
        };
        self.next.scatter((count, &state.mean), place, go, &self.next_diffusion, (&source, resets), keep)?;
        core::mem::swap(&mut self.diffusion, &mut self.next_diffusion);
        self.commit();
        self.resets = resets;
        self.fresh = true;
        Ok(())
    }

    fn particles(&self) -> Option<(&[P], &[f64])> {
        Some((&self.cloud.poses, &self.cloud.weights))
    }
}
