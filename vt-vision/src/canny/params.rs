//! What counts as an edge.

use vt_core::error::ConfigError;

use super::suppression::magnitude;
use crate::gaussian::Gaussian;
use crate::gradient::Gradient;

/// Size of a gradient.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Norm {
    /// `|g_x| + |g_y|`: up to √2 more on diagonal edges.
    L1,
    /// `√(g_x² + g_y²)`: the same in all directions.
    #[default]
    L2,
}

/// Bounds of the gradient's size: an edge pixel exceeds the higher, or exceeds the lower and touches another edge pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Thresholds {
    /// Steps in grey levels (Sobel answers with four times as much). OpenCV's 50 and 150 are 12.5 and 37.5.
    Fixed {
        /// Lower bound.
        low: f64,
        /// Higher bound.
        high: f64,
    },
    /// Relative to the picture, so that edges do not come and go with its contrast.
    Share {
        /// Share of pixels below the higher bound, 0 to 1.
        below: f64,
        /// Lower over higher bound, 0 to 1.
        ratio: f64,
        /// The higher bound is never below this, grey levels.
        least: f64,
    },
}

/// Parameters of the edge detector.
#[derive(Clone, Debug, PartialEq)]
pub struct CannyParams {
    /// Smoothing before the gradient, if any.
    pub blur: Option<Gaussian>,
    /// Size of a gradient.
    pub norm: Norm,
    /// Bounds of that size.
    pub thresholds: Thresholds,
    /// Colour pictures by the structure tensor of their channels; by their grey levels otherwise.
    pub color: bool,
}

impl CannyParams {
    /// Smoothing by `σ = 1.1` over 5 × 5 pixels, Euclidean size.
    ///
    /// # Errors
    /// As for [`Self::check`].
    pub fn new(thresholds: Thresholds) -> Result<Self, ConfigError> {
        let blur = Some(Gaussian::with_reach(1.1, 2)?);
        Self { blur, norm: Norm::L2, thresholds, color: false }.check()
    }

    /// Checks the parameters.
    ///
    /// # Errors
    /// [`ConfigError::Parameter`] with the first that is out of its range.
    pub fn check(self) -> Result<Self, ConfigError> {
        let within = |key, v: f64, range: core::ops::RangeInclusive<f64>| {
            if range.contains(&v) {
                return Ok(());
            }
            Err(ConfigError::parameter(key, v, format!("{} to {}", range.start(), range.end())))
        };
        match self.thresholds {
            Thresholds::Fixed { low, high } => {
                within("high", high, 0.0..=1e4)?;
                within("low", low, 0.0..=high)?;
            }
            Thresholds::Share { below, ratio, least } => {
                within("below", below, 0.0..=1.0)?;
                within("ratio", ratio, 0.0..=1.0)?;
                within("least", least, 0.0..=1e4)?;
            }
        }
        Ok(self)
    }

    /// Text that names the parameters in a key.
    pub(crate) fn name(&self) -> String {
        let blur = self.blur.as_ref().map_or("none".into(), |b| format!("{}within{}", b.sigma(), b.reach()));
        let Self { norm, thresholds, color, .. } = self;
        format!("blur={blur}/{norm:?}/{thresholds:?}/color={color}")
    }
}

/// Sizes are counted in bins of so many units of Sobel's mask.
const BIN: f32 = 2.0;

/// Every so many rows are counted.
const STRIDE: usize = 4;

impl Thresholds {
    /// Lower and higher bound in units of Sobel's mask.
    pub(super) fn raw(&self, gradient: &Gradient, norm: Norm, counts: &mut Vec<u32>) -> [f32; 2] {
        let raw = |contrast: f64| (contrast * Gradient::STEP) as f32;
        match *self {
            Self::Fixed { low, high } => [raw(low), raw(high)],
            Self::Share { below, ratio, least } => {
                let high = quantile(gradient, norm, below, counts).max(raw(least));
                [high * ratio as f32, high]
            }
        }
    }
}

/// Size of the gradient that the share `below` of pixels does not exceed.
fn quantile(gradient: &Gradient, norm: Norm, below: f64, counts: &mut Vec<u32>) -> f32 {
    counts.clear();
    // The greatest size is that of the L1 norm of two gradients of three channels each.
    counts.resize((2.0 * 4.0 * 255.0 * 2.0 / BIN) as usize + 1, 0);
    let width = gradient.region.map_or(1, |r| r.width as usize);
    let mut total = 0u64;
    for (gx, gy) in gradient.x.chunks_exact(width).zip(gradient.y.chunks_exact(width)).step_by(STRIDE) {
        let mut sizes = [0.0f32; 64];
        for (gx, gy) in gx.chunks(64).zip(gy.chunks(64)) {
            magnitude(gx, gy, norm, &mut sizes[..gx.len()]);
            for size in &sizes[..gx.len()] {
                let bin = ((size / BIN) as usize).min(counts.len() - 1);
                counts[bin] += 1;
            }
        }
        total += width as u64;
    }
    let wanted = (below * total as f64).ceil() as u64;
    let mut seen = 0;
    let bin = counts.iter().position(|&n| {
        seen += u64::from(n);
        seen >= wanted
    });
    (bin.unwrap_or(counts.len() - 1) + 1) as f32 * BIN
}
