//! Filters.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use vt_core::agent::Estimator;
use vt_core::error::{ConfigError, EstimateError};
use vt_core::lie::SE3;
use vt_estimators::kalman::KalmanFilter;
use vt_estimators::particle::{ParticleFilter, ParticleParams};
use vt_estimators::resampling;

use crate::registry::Params;
use crate::roles::{EstimatorContext, Motion};

/// Parameters of the estimator `kalman`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Kalman {
    /// Linearisations a correction: 1 is the extended filter (loose mode), more the iterated one (tight mode).
    pub iterations: u32,
}

impl Default for Kalman {
    fn default() -> Self {
        Self { iterations: 1 }
    }
}

impl Params for Kalman {
    fn check(&self) -> Result<(), ConfigError> {
        if !(1..=100).contains(&self.iterations) {
            return Err(ConfigError::parameter("iterations", self.iterations, "1 to 100"));
        }
        Ok(())
    }
}

fn unfit(e: EstimateError) -> ConfigError {
    ConfigError::Mismatch {
        found: e.to_string(),
        expected: "a prior that an estimator can start from".into(),
    }
}

pub(super) fn kalman(p: Kalman, c: EstimatorContext<SE3>) -> Result<Box<dyn Estimator<SE3>>, ConfigError> {
    Ok(match c.motion {
        Motion::Pose(m) => {
            Box::new(KalmanFilter::<SE3, _, _>::new(&c.prior, vec![], m, p.iterations).map_err(unfit)?)
        }
        Motion::Moving(m, rest) => {
            Box::new(KalmanFilter::<SE3, _, _>::new(&c.prior, rest, m, p.iterations).map_err(unfit)?)
        }
        Motion::Accelerating(m, rest) => {
            Box::new(KalmanFilter::<SE3, _, _>::new(&c.prior, rest, m, p.iterations).map_err(unfit)?)
        }
    })
}

/// How particles are drawn anew.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Resampling {
    /// Systematic with the fixed offset 1/2.
    Deterministic,
    /// Systematic with a random offset.
    Systematic,
}

/// Parameters of the estimator `particle`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Particle {
    /// Number of particles.
    pub particles: usize,
    /// How particles are drawn anew.
    pub resampling: Resampling,
    /// Share of the particles below which the effective number triggers resampling.
    pub effective_share: f64,
}

impl Default for Particle {
    fn default() -> Self {
        let p = ParticleParams::default();
        Self { particles: p.count, resampling: Resampling::Deterministic, effective_share: p.effective_share }
    }
}

/// More particles than this are refused.
const MOST_PARTICLES: usize = 1_000_000;

impl Params for Particle {
    fn check(&self) -> Result<(), ConfigError> {
        if !(1..=MOST_PARTICLES).contains(&self.particles) {
            let expected = format!("at least 1 particle, at most {MOST_PARTICLES}");
            return Err(ConfigError::parameter("particles", self.particles, expected));
        }
        if !(0.0..=1.0).contains(&self.effective_share) {
            return Err(ConfigError::parameter(
                "effective_share",
                self.effective_share,
                "a number from 0 to 1",
            ));
        }
        Ok(())
    }
}

pub(super) fn particle(
    p: Particle,
    c: EstimatorContext<SE3>,
) -> Result<Box<dyn Estimator<SE3>>, ConfigError> {
    let resampling = match p.resampling {
        Resampling::Deterministic => resampling::Resampling::Deterministic,
        Resampling::Systematic => resampling::Resampling::Systematic,
    };
    let Particle { particles: count, effective_share, .. } = p;
    let params = ParticleParams { count, resampling, effective_share, seed: c.seed, target: c.target };
    Ok(match c.motion {
        Motion::Pose(m) => {
            Box::new(ParticleFilter::<SE3, _, _>::new(&c.prior, vec![], m, params).map_err(unfit)?)
        }
        Motion::Moving(m, rest) => {
            Box::new(ParticleFilter::<SE3, _, _>::new(&c.prior, rest, m, params).map_err(unfit)?)
        }
        Motion::Accelerating(m, rest) => {
            Box::new(ParticleFilter::<SE3, _, _>::new(&c.prior, rest, m, params).map_err(unfit)?)
        }
    })
}
