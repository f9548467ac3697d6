//! Parameters of mass centres.

use vt_core::error::ConfigError;
use vt_core::time::Seconds;

/// Parameters of a [`super::MassCentreModality`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MassCentreParams {
    /// Share of the object's box that its mass fills; what the first frame shows where that is known.
    pub share: f64,
    /// Part of the expected mass that is as good as all of it: more may be another's.
    pub enough: f64,
    /// Log-likelihood that a place loses where all that mass is missing.
    pub sharpness: f64,
    /// Likelihood that the object is hidden, over that of a place with its mass.
    pub hidden: f64,
    /// Time in which the expected mass follows what is seen of a trusted target by two thirds.
    pub follows: Seconds,
    /// Error of the mass centre as the place of the object, as a standard deviation over the object's width and height: limbs swing,
    /// parts are of other colours.
    pub wobble: f64,
    /// Half size of the search in predicted deviations, and deviations of prediction and measurement beyond which it is not the
    /// target that was seen.
    pub deviations: f64,
}

impl Default for MassCentreParams {
    fn default() -> Self {
        Self {
            share: 0.3,
            enough: 0.9,
            sharpness: 10.0,
            hidden: 1e-3,
            follows: Seconds(2.0),
            wobble: 0.05,
            deviations: 3.0,
        }
    }
}

impl MassCentreParams {
    /// Checks all ranges.
    ///
    /// # Errors
    /// [`ConfigError::Parameter`] with the first parameter that is out of its range.
    pub fn check(self) -> Result<Self, ConfigError> {
        for (key, v) in [("share", self.share), ("enough", self.enough)] {
            if !(v > 0.0 && v <= 1.0) {
                return Err(ConfigError::parameter(key, v, "above 0, at most 1"));
            }
        }
        for (key, v) in [
            ("sharpness", self.sharpness),
            ("hidden", self.hidden),
            ("follows", self.follows.0),
            ("wobble", self.wobble),
            ("deviations", self.deviations),
        ] {
            if !(v > 0.0 && v.is_finite()) {
                return Err(ConfigError::parameter(key, v, "a positive number"));
            }
        }
        Ok(self)
    }
}
