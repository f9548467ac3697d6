//! Parameters of the search of views.

use vt_core::error::ConfigError;

#[cfg(doc)]
use super::alignment::Support;
use super::alignment::TRUSTED;
use super::scan;

/// Parameters of the search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewSearchParams {
    /// Smallest and largest size of the object, pixels for the diameter of its bounding sphere.
    pub sizes: [f64; 2],
    /// Smallest step in grey levels that counts as an edge.
    pub min_contrast: f64,
    /// Directions from which the model is looked at.
    pub directions: u32,
    /// Candidates that are aligned, of each size.
    pub hits: usize,
    /// Candidates that are compared in detail.
    pub compared: usize,
    /// Candidates that are refined by the edge modality.
    pub refined: usize,
    /// Least log-likelihood ratio of a pose against chance, nats.
    pub least_log_ratio: f64,
    /// Least share of the contour that lies on edges.
    pub least_share: f64,
    /// Least [`Support::trust`] of a pose that is proposed for a lost target, nats.
    pub least_trust: f64,
}

impl Default for ViewSearchParams {
    fn default() -> Self {
        Self {
            sizes: [60.0, 800.0],
            min_contrast: 3.0,
            directions: 300,
            hits: 400,
            compared: 240,
            refined: 24,
            least_log_ratio: 15.0,
            least_share: 0.5,
            least_trust: TRUSTED,
        }
    }
}

impl ViewSearchParams {
    /// Checks all ranges.
    ///
    /// # Errors
    /// [`ConfigError::Parameter`] with the first parameter that is out of its range.
    pub fn check(self) -> Result<Self, ConfigError> {
        let [least, most] = self.sizes;
        if !(least >= scan::SIZE && least <= most && most <= 1e4) {
            let expected = format!("ascending from at least {} px to at most 10000 px", scan::SIZE);
            return Err(ConfigError::parameter("sizes", format!("[{least}, {most}]"), expected));
        }
        for (key, v) in [
            ("min_contrast", self.min_contrast),
            ("least_log_ratio", self.least_log_ratio),
            ("least_trust", self.least_trust),
        ] {
            if !(v > 0.0 && v.is_finite()) {
                return Err(ConfigError::parameter(key, v, "a positive number"));
            }
        }
        if !(0.0..=1.0).contains(&self.least_share) {
            return Err(ConfigError::parameter("least_share", self.least_share, "a share from 0 to 1"));
        }
        for (key, v, low, high) in [
            ("directions", self.directions as usize, 12, 5000),
            ("hits", self.hits, 1, 10_000),
            ("compared", self.compared, 1, 10_000),
            ("refined", self.refined, 1, 1000),
        ] {
            if !(low..=high).contains(&v) {
                return Err(ConfigError::parameter(key, v, format!("{low} to {high}")));
            }
        }
        Ok(self)
    }
}
