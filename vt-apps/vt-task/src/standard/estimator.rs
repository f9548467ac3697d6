//! Kalman filters.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use vt_core::agent::Estimator;
use vt_core::error::{ConfigError, EstimateError};
use vt_core::lie::SE3;
use vt_estimators::kalman::KalmanFilter;

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

pub(super) fn unfit(e: EstimateError) -> ConfigError {
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
