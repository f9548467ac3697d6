//! Parameters of the colour likelihood.

use vt_core::error::ConfigError;

use crate::adaptation::AdaptationParams;
use crate::histogram::BinningParams;

/// Parameters of a [`ColorModality`](super::ColorModality).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColorParams {
    /// Layout of the histograms.
    pub binning: BinningParams,
    /// Inverse temperature λ.
    pub lambda: f64,
    /// Parts side by side.
    pub columns: u32,
    /// Parts one above the other.
    pub rows: u32,
    /// Outer radius, in radii of the object, of the ring whose colours count less; `None` for plain histograms.
    pub background: Option<f64>,
    /// About how many pixels of a part are looked at.
    pub samples: usize,
    /// Share of the whole that every bin has without a pixel, so that the square root has a derivative everywhere; 0 is
    /// Pérez' distance to the letter.
    pub floor: f64,
    /// How the reference follows what is seen; `None` for not at all.
    pub adapt: Option<AdaptationParams>,
}

impl Default for ColorParams {
    fn default() -> Self {
        Self {
            binning: BinningParams::default(),
            lambda: 20.0,
            columns: 1,
            rows: 1,
            background: None,
            samples: 400,
            floor: 1e-4,
            adapt: None,
        }
    }
}

impl ColorParams {
    /// Checks all ranges.
    ///
    /// # Errors
    /// [`ConfigError::Parameter`] with the first parameter that is out of its range.
    pub fn check(self) -> Result<Self, ConfigError> {
        self.binning.check()?;
        if !(self.lambda > 0.0 && self.lambda.is_finite()) {
            return Err(ConfigError::parameter("lambda", self.lambda, "a positive number"));
        }
        for (key, n) in [("columns", self.columns), ("rows", self.rows)] {
            if !(1..=16).contains(&n) {
                return Err(ConfigError::parameter(key, n, "1 to 16"));
            }
        }
        if let Some(ring) = self.background.filter(|ring| !(*ring > 1.0 && *ring <= 10.0)) {
            return Err(ConfigError::parameter("background", ring, "above 1, up to 10"));
        }
        if !(16..=1_000_000).contains(&self.samples) {
            return Err(ConfigError::parameter("samples", self.samples, "16 to a million"));
        }
        if !(0.0..=0.01).contains(&self.floor) {
            return Err(ConfigError::parameter("floor", self.floor, "0 to 0.01"));
        }
        self.adapt.map(AdaptationParams::check).transpose()?;
        Ok(self)
    }
}
