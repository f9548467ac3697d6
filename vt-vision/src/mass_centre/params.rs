//! Parameters of mass centres.

use vt_core::error::ConfigError;

/// Parameters of a [`super::MassCentreModality`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MassCentreParams {
    /// Share of the object's box that its mass fills; what the first frame shows where that is known.
    pub share: f64,
    /// Share of the expected mass below which nothing was seen.
    pub least_share: f64,
    /// Square pixels that share their error: so much fewer than pixels are the independent ones.
    pub patch: f64,
    /// Error of the mass centre as the place of the object, as a standard deviation over the object's width and height: limbs swing,
    /// parts are of other colours.
    pub wobble: f64,
    /// Size of the window over that of the object's box.
    pub window: f64,
    /// Half size of the search in predicted deviations, and deviations of prediction and measurement beyond which it is not the
    /// target that was seen.
    pub deviations: f64,
}

impl Default for MassCentreParams {
    fn default() -> Self {
        Self { share: 0.3, least_share: 0.15, patch: 25.0, wobble: 0.05, window: 1.0, deviations: 4.0 }
    }
}

impl MassCentreParams {
    /// Checks all ranges.
    ///
    /// # Errors
    /// [`ConfigError::Parameter`] with the first parameter that is out of its range.
    pub fn check(self) -> Result<Self, ConfigError> {
        for (key, v) in [("share", self.share), ("least_share", self.least_share)] {
            if !(v > 0.0 && v <= 1.0) {
                return Err(ConfigError::parameter(key, v, "above 0, at most 1"));
            }
        }
        for (key, v) in [("patch", self.patch), ("wobble", self.wobble), ("deviations", self.deviations)] {
            if !(v > 0.0 && v.is_finite()) {
                return Err(ConfigError::parameter(key, v, "a positive number"));
            }
        }
        if !(1.0..=3.0).contains(&self.window) {
            return Err(ConfigError::parameter("window", self.window, "a number from 1 to 3"));
        }
        Ok(self)
    }
}
