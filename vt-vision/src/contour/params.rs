//! Parameters of the contour likelihood.

use vt_core::error::ConfigError;

use super::lines::REACH;
use crate::edge::Hypotheses;

/// Most points of a contour.
pub const MOST_SAMPLES: usize = 256;

/// Parameters of a [`ContourModality`](super::ContourModality); lengths in pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContourParams {
    /// Edges on a normal that may be the contour's: all of them, or the nearest one.
    pub hypotheses: Hypotheses,
    /// Half range of the search along a normal.
    pub range: f64,
    /// Distance of the contour's edge from its prediction, as a standard deviation σ: how well shape and pose space can
    /// follow the object.
    pub sigma: f64,
    /// Probability `q` that a contour point gives no edge.
    pub miss_probability: f64,
    /// Clutter edges λ per pixel of normal.
    pub clutter_density: f64,
    /// Temperature τ, the divisor of the log-likelihood; by default an eighth of the number of normals.
    pub temperature: Option<f64>,
}

impl Default for ContourParams {
    fn default() -> Self {
        Self {
            hypotheses: Hypotheses::Multiple,
            range: 12.0,
            sigma: 2.0,
            miss_probability: 0.1,
            clutter_density: 0.03,
            temperature: None,
        }
    }
}

impl ContourParams {
    /// Checks all ranges.
    ///
    /// # Errors
    /// [`ConfigError::Parameter`] with the first parameter that is out of its range.
    pub fn check(self) -> Result<Self, ConfigError> {
        let temperature = self.temperature.unwrap_or(1.0);
        for (key, v) in [
            ("range", self.range),
            ("sigma", self.sigma),
            ("clutter_density", self.clutter_density),
            ("temperature", temperature),
        ] {
            if !(v > 0.0 && v.is_finite()) {
                return Err(ConfigError::parameter(key, v, "a positive number"));
            }
        }
        if self.range > REACH {
            return Err(ConfigError::parameter("range", self.range, format!("at most {REACH} px")));
        }
        if !(self.miss_probability > 0.0 && self.miss_probability < 1.0) {
            let expected = "a probability between 0 and 1, both excluded";
            return Err(ConfigError::parameter("miss_probability", self.miss_probability, expected));
        }
        Ok(self)
    }
}
