//! Loss detectors.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use vt_core::agent::LossDetector;
use vt_core::error::ConfigError;
use vt_fusion::loss::{CovarianceLoss, Direction, FusedLoss, Hysteresis, LossWeights};

use crate::registry::Params;

/// Parameters of the loss detector `fused`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Fused {
    /// Steps in a row, each more likely a loss than not, after which the target counts as lost.
    pub on: u32,
    /// Steps in a row, each more likely none, after which it counts as lost no longer.
    pub off: u32,
    /// Probability of a loss above which a step is doubtful, from 0 to 1.
    pub doubt: f64,
    /// Constant of the logistic model.
    pub bias: f64,
    /// Weight of the share of the model that is not supported.
    pub unsupported: f64,
    /// Weight of the mean log-likelihood ratio against clutter.
    pub log_ratio: f64,
    /// Weight of the normalised root mean square of the inliers.
    pub misfit: f64,
    /// Weight of `ln(1 + NIS / dof)`.
    pub surprise: f64,
    /// Weight of the spread of the covariance.
    pub spread: f64,
    /// Least log-odds that one step can tell, negative: how much a good step vouches for those after it.
    pub least: f64,
    /// Share of the log-odds kept from step to step, from 0 to 1.
    pub memory: f64,
}

impl Default for Fused {
    fn default() -> Self {
        let (h, w) = (Hysteresis::default(), LossWeights::default());
        let LossWeights { bias, unsupported, log_ratio, misfit, surprise, spread, least } = w;
        let memory = FusedLoss::MEMORY;
        let doubt = FusedLoss::DOUBT;
        Self {
            on: h.on,
            off: h.off,
            doubt,
            bias,
            unsupported,
            log_ratio,
            misfit,
            surprise,
            spread,
            least,
            memory,
        }
    }
}

fn hysteresis(on: u32, off: u32) -> Result<(), ConfigError> {
    match [("on", on), ("off", off)].into_iter().find(|(_, n)| *n == 0) {
        Some((key, n)) => Err(ConfigError::parameter(key, n, "a number of steps from 1")),
        None => Ok(()),
    }
}

impl Params for Fused {
    fn check(&self) -> Result<(), ConfigError> {
        if !(0.0..1.0).contains(&self.memory) {
            return Err(ConfigError::parameter("memory", self.memory, "a share from 0 to below 1"));
        }
        if !(0.0..=1.0).contains(&self.doubt) {
            return Err(ConfigError::parameter("doubt", self.doubt, "a probability, from 0 to 1"));
        }
        if !(self.least < 0.0 && self.least.is_finite()) {
            return Err(ConfigError::parameter("least", self.least, "a negative number"));
        }
        hysteresis(self.on, self.off)
    }
}

/// Parameters of the loss detector `covariance`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Covariance {
    /// `ln` of the squared ratio between the spread and its design value.
    pub threshold: f64,
    /// Side of the threshold that fires.
    #[serde(default)]
    pub direction: Side,
    /// Doubtful steps in a row after which the target counts as lost.
    #[serde(default = "three")]
    pub on: u32,
    /// Good steps in a row after which it counts as tracked again.
    #[serde(default = "five")]
    pub off: u32,
}

/// Side of a threshold.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Side {
    /// Above: a lost filter spreads.
    #[default]
    Above,
    /// Below: the paper's literal text.
    Below,
}

fn three() -> u32 {
    3
}

fn five() -> u32 {
    5
}

impl Params for Covariance {
    fn check(&self) -> Result<(), ConfigError> {
        hysteresis(self.on, self.off)
    }
}

type Built = Result<Box<dyn LossDetector>, ConfigError>;

pub(super) fn fused(p: Fused, _: ()) -> Built {
    let Fused { on, off, doubt, bias, unsupported, log_ratio, misfit, surprise, spread, least, memory } = p;
    let weights = LossWeights { bias, unsupported, log_ratio, misfit, surprise, spread, least };
    Ok(Box::new(FusedLoss::new(weights, memory, Hysteresis::new(on, off).doubtful_above(doubt))))
}

pub(super) fn covariance(p: Covariance, _: ()) -> Built {
    let direction = match p.direction {
        Side::Above => Direction::Above,
        Side::Below => Direction::Below,
    };
    let hysteresis = Hysteresis::new(p.on, p.off);
    Ok(Box::new(CovarianceLoss { threshold: p.threshold, direction, hysteresis }))
}
