//! Particle filters.

use nalgebra::{DefaultAllocator, DimAdd, DimSum};
use schemars::JsonSchema;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use vt_core::agent::Estimator;
use vt_core::error::ConfigError;
use vt_core::manifold::Coordinates;
use vt_estimators::particle::{Adaptive, Annealing, Method, ParticleFilter, ParticleParams};
use vt_estimators::resampling;

use super::estimator::{over_states, unfit};
use crate::registry::Params;
use crate::roles::{Deviations, EstimatorContext, Motion, StateAlloc};

/// How particles are drawn anew.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Resampling {
    /// Systematic with the fixed offset 1/2.
    Deterministic,
    /// Systematic with a random offset.
    Systematic,
    /// One draw in each stratum.
    Stratified,
    /// Integer parts for certain, the rest at random.
    Residual,
    /// Independent draws.
    Multinomial,
}

/// How measurements are taken in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Scheme {
    /// Sequential importance resampling.
    Bootstrap,
    /// Particles are chosen by the likelihood of where they would go without noise: two likelihoods a particle.
    Auxiliary,
    /// From a broad likelihood to the true one in layers, see `annealing`.
    Annealed,
}

/// Layers of the method `annealed`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Layers {
    /// Share of the particles that survives a layer.
    pub survival: f64,
    /// Diffusions a layer, a likelihood a particle each.
    pub moves: u32,
    /// Most layers; the last one goes to the true likelihood.
    pub most_layers: u32,
}

impl Default for Layers {
    fn default() -> Self {
        let Annealing { survival, moves, most_layers } = Annealing::default();
        Self { survival, moves, most_layers }
    }
}

/// A number of particles that follows the spread of the belief (KLD-sampling).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Number<B> {
    /// Widths of a bin in each coordinate.
    pub bins: B,
    /// Fewest particles.
    pub least: usize,
    /// Most particles.
    pub most: usize,
    /// Bound of the Kullback-Leibler distance in nats.
    #[serde(default = "epsilon")]
    pub epsilon: f64,
    /// Probability with which it holds.
    #[serde(default = "confidence")]
    pub confidence: f64,
}

fn epsilon() -> f64 {
    0.05
}

fn confidence() -> f64 {
    0.99
}

/// Parameters of the estimator `particle`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, bound = "B: Serialize + DeserializeOwned")]
pub struct Particle<B> {
    /// Number of particles; of the start, where it is `adaptive`.
    pub particles: usize,
    /// How particles are drawn anew.
    pub resampling: Resampling,
    /// Share of the particles below which the effective number triggers resampling.
    pub effective_share: f64,
    /// How measurements are taken in.
    pub method: Scheme,
    /// Layers of the method `annealed`.
    pub annealing: Layers,
    /// Velocities (and accelerations) by a Kalman filter a particle instead of by particles.
    pub rao_blackwellized: bool,
    /// Jitter after resampling, as a part of the particles' range for one particle; 0 for none.
    pub roughening: f64,
    /// Number of particles by the bins that they occupy; a fixed number when absent.
    pub adaptive: Option<Number<B>>,
}

impl<B> Default for Particle<B> {
    fn default() -> Self {
        let p = ParticleParams::default();
        Self {
            particles: p.count,
            resampling: Resampling::Deterministic,
            effective_share: p.effective_share,
            method: Scheme::Bootstrap,
            annealing: Layers::default(),
            rao_blackwellized: p.marginal,
            roughening: p.roughening,
            adaptive: None,
        }
    }
}

/// More particles than this are refused.
const MOST_PARTICLES: usize = 1_000_000;

impl<B: Params + Copy> Params for Particle<B> {
    fn check(&self) -> Result<(), ConfigError> {
        let count = |key, n: usize| {
            let expected = format!("at least 1 particle, at most {MOST_PARTICLES}");
            if (1..=MOST_PARTICLES).contains(&n) {
                Ok(())
            } else {
                Err(ConfigError::parameter(key, n, expected))
            }
        };
        let within = |key, x: f64, fits: bool, expected| {
            if fits { Ok(()) } else { Err(ConfigError::parameter(key, x, expected)) }
        };
        count("particles", self.particles)?;
        let share = self.effective_share;
        within("effective_share", share, (0.0..=1.0).contains(&share), "a number from 0 to 1")?;
        let roughening = self.roughening;
        within("roughening", roughening, (0.0..=10.0).contains(&roughening), "a number from 0 to 10")?;
        let Layers { survival, moves, most_layers } = self.annealing;
        within("survival", survival, survival > 0.0 && survival < 1.0, "a number between 0 and 1")?;
        for (key, n) in [("moves", moves), ("most_layers", most_layers)] {
            within(key, n.into(), (1..=1000).contains(&n), "1 to 1000")?;
        }
        let Some(number) = &self.adaptive else { return Ok(()) };
        count("least", number.least)?;
        count("most", number.most)?;
        if number.least > number.most {
            return Err(ConfigError::parameter(
                "least",
                number.least,
                format!("at most `most`, {}", number.most),
            ));
        }
        let (epsilon, confidence) = (number.epsilon, number.confidence);
        within("epsilon", epsilon, epsilon > 0.0 && epsilon <= 10.0, "a number above 0, at most 10")?;
        within("confidence", confidence, (0.5..1.0).contains(&confidence), "a number from 0.5 to below 1")?;
        number.bins.check()
    }
}

impl<B: Copy> Particle<B> {
    fn params(&self, widths: Vec<f64>, seed: u64, target: u64) -> ParticleParams {
        let Layers { survival, moves, most_layers } = self.annealing;
        ParticleParams {
            count: self.particles,
            resampling: match self.resampling {
                Resampling::Deterministic => resampling::Resampling::Deterministic,
                Resampling::Systematic => resampling::Resampling::Systematic,
                Resampling::Stratified => resampling::Resampling::Stratified,
                Resampling::Residual => resampling::Resampling::Residual,
                Resampling::Multinomial => resampling::Resampling::Multinomial,
            },
            effective_share: self.effective_share,
            method: match self.method {
                Scheme::Bootstrap => Method::Bootstrap,
                Scheme::Auxiliary => Method::Auxiliary,
                Scheme::Annealed => Method::Annealed(Annealing { survival, moves, most_layers }),
            },
            marginal: self.rao_blackwellized,
            roughening: self.roughening,
            adaptive: self.adaptive.map(|n| Adaptive {
                widths,
                epsilon: n.epsilon,
                confidence: n.confidence,
                least: n.least,
                most: n.most,
            }),
            seed,
            target,
        }
    }
}

pub(super) fn particle<P: Coordinates, B: Deviations<P> + Copy>(
    p: Particle<B>,
    c: EstimatorContext<P>,
) -> Result<Box<dyn Estimator<P>>, ConfigError>
where
    P::D: DimAdd<P::D>,
    DimSum<P::D, P::D>: DimAdd<P::D>,
    DefaultAllocator: StateAlloc<P::D>,
{
    let widths = p.adaptive.map_or(Ok(vec![]), |n| Ok(n.bins.tangent()?.as_slice().to_vec()))?;
    let params = p.params(widths, c.seed, c.target);
    let prior = c.prior;
    Ok(over_states!(c, |m, rest| ParticleFilter::<P, _, _>::new(&prior, rest, m, params)))
}
