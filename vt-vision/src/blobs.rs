//! Elliptical blobs: feature-level measurements with a covariance.

use nalgebra::Matrix2;
use vt_core::error::ConfigError;

use crate::components::{Component, Components, Connectivity};
use crate::moments::Ellipse;
use crate::plane::Plane;

/// What is a blob.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlobParams {
    /// Least area, pixels.
    pub min_area: f64,
    /// Greatest area, pixels.
    pub max_area: f64,
    /// Least share of the ellipse with the same moments that is filled; a full ellipse has 1, a rectangle 0.95, a ring less.
    pub min_fill: f64,
    /// Least ratio of the shorter to the longer half axis.
    pub min_ratio: f64,
    /// Deviation of the rim across itself, pixels: `1/√12` for that of the grid alone, more where the threshold is noisy.
    pub rim_deviation: f64,
    /// Which pixels touch.
    pub connectivity: Connectivity,
}

impl Default for BlobParams {
    fn default() -> Self {
        Self {
            min_area: 20.0,
            max_area: f64::INFINITY,
            min_fill: 0.8,
            min_ratio: 0.2,
            rim_deviation: 0.3,
            connectivity: Connectivity::Eight,
        }
    }
}

impl BlobParams {
    /// Checks the parameters.
    ///
    /// # Errors
    /// [`ConfigError::Parameter`] with the first that is out of its range.
    pub fn check(self) -> Result<Self, ConfigError> {
        let fails = |key, found: f64, expected| Err(ConfigError::parameter(key, found, expected));
        if self.min_area.is_nan() || self.min_area < 1.0 {
            return fails("min_area", self.min_area, "1 px or more");
        }
        if self.max_area.is_nan() || self.max_area < self.min_area {
            return fails("max_area", self.max_area, "min_area or more");
        }
        for (key, share) in [("min_fill", self.min_fill), ("min_ratio", self.min_ratio)] {
            if !(0.0..=1.0).contains(&share) {
                return fails(key, share, "0 to 1");
            }
        }
        if !(self.rim_deviation > 0.0 && self.rim_deviation.is_finite()) {
            return fails("rim_deviation", self.rim_deviation, "a positive number of pixels");
        }
        Ok(self)
    }
}

/// A blob.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Blob {
    /// The ellipse with its moments.
    pub ellipse: Ellipse,
    /// Number of pixels.
    pub area: f64,
    /// Covariance of the centre, square pixels.
    pub covariance: Matrix2<f64>,
}

impl Blob {
    /// The component as a blob, if it is one.
    ///
    /// Where the rim moves by `δ` across itself, the centre moves by `∮ (x − c) δ ds / A`. With `δ` of deviation `σ` and independent from
    /// pixel to pixel its covariance is `σ² ∮ (x − c)(x − c)ᵀ ds / A²`; on an ellipse the integral is nearly the
    /// perimeter times twice the spread of the area (exactly for a circle).
    pub fn of(component: &Component, params: &BlobParams) -> Option<Self> {
        let moments = &component.moments;
        let (area, ellipse) = (moments.mass(), moments.ellipse()?);
        let [long, short] = ellipse.half_axes;
        let wanted = area >= params.min_area
            && area <= params.max_area
            && area >= params.min_fill * ellipse.area()
            && short >= params.min_ratio * long;
        let scale = params.rim_deviation * params.rim_deviation * ellipse.perimeter() * 2.0 / (area * area);
        wanted.then(|| Self { ellipse, area, covariance: moments.spread() * scale })
    }
}

/// Finds blobs in masks.
#[derive(Clone, Debug, Default)]
pub struct BlobDetector {
    components: Components,
    blobs: Vec<Blob>,
}

impl BlobDetector {
    /// The blobs among the components of `mask`, in the order of their first pixels.
    pub fn detect(&mut self, mask: &Plane<u8>, params: &BlobParams) -> &[Blob] {
        self.components.compute(mask, params.connectivity);
        self.blobs.clear();
        self.blobs.extend(self.components.components().iter().filter_map(|c| Blob::of(c, params)));
        &self.blobs
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Point2, Vector2};
    use vt_core::frame::Roi;
    use vt_core::math;
    use vt_core::random::{Random, Stream};

    /// Full ellipses at random places, by thresholding their covered share of every pixel with noise.
    fn draw(random: &mut Random, half_axes: [f64; 2], noise: f64) -> (Plane<u8>, Point2<f64>) {
        let centre = Point2::new(40.0 + random.uniform(), 30.0 + random.uniform());
        let (s, c) = math::sin_cos(3.0 * random.uniform());
        let mut mask = Plane::default();
        for (k, m) in (0u32..).zip(mask.reshape(Roi { x: 0, y: 0, width: 80, height: 60 }).iter_mut()) {
            let d = Point2::new(f64::from(k % 80), f64::from(k / 80)) - centre;
            let (u, v) = ((c * d.x + s * d.y) / half_axes[0], (c * d.y - s * d.x) / half_axes[1]);
            // Distance to the rim, to the first order.
            let (r, slope) = (u.hypot_squared(v), Vector2::new(u / half_axes[0], v / half_axes[1]).norm());
            let depth = if slope > 0.0 { (1.0 - r) / (2.0 * slope) } else { 1.0 };
            *m = u8::from(depth + noise * random.normal() > 0.0);
        }
        (mask, centre)
    }

    trait Squares {
        fn hypot_squared(self, other: Self) -> Self;
    }

    impl Squares for f64 {
        fn hypot_squared(self, other: Self) -> Self {
            self * self + other * other
        }
    }

    #[test]
    fn blobs_are_as_certain_as_they_say() {
        let mut detector = BlobDetector::default();
        for (half_axes, noise) in [([9.0, 9.0], 0.0), ([14.0, 8.0], 0.0), ([16.0, 9.0], 0.2)] {
            let mut nees = 0.0;
            let trials = 600;
            for trial in 0..trials {
                let mut random = Random::new(11, Stream::Sim, 0, trial, 0);
                let (mask, centre) = draw(&mut random, half_axes, noise);
                // Grid and threshold; noise of depth flips pixels on both sides of the rim.
                let rim_deviation = (1.0 / 12.0 + noise * noise).sqrt();
                let params = BlobParams { rim_deviation, ..BlobParams::default() }.check().unwrap();
                let [blob] = detector.detect(&mask, &params) else { panic!("one blob") };
                let d = blob.ellipse.centre - centre;
                nees += (blob.covariance.try_inverse().unwrap() * d).dot(&d) / trials as f64;
                for (found, half) in blob.ellipse.half_axes.into_iter().zip(half_axes) {
                    assert!((found - half).abs() < 0.7, "{found} {half}");
                }
            }
            assert!((1.0..3.0).contains(&nees), "{half_axes:?} {noise} {nees}");
        }
    }

    #[test]
    fn other_shapes_are_left_out() {
        let mut mask = Plane::default();
        for (k, m) in (0u32..).zip(mask.reshape(Roi { x: 0, y: 0, width: 60, height: 40 }).iter_mut()) {
            let (x, y) = (f64::from(k % 60), f64::from(k / 60));
            let r = ((x - 15.0).powi(2) + (y - 20.0).powi(2)).sqrt();
            let ring = (7.0..10.0).contains(&r);
            let bar = (35.0..57.0).contains(&x) && (5.0..8.0).contains(&y);
            let speck = (40.0..43.0).contains(&x) && (20.0..23.0).contains(&y);
            let disc = (x - 50.0).powi(2) + (y - 28.0).powi(2) < 40.0;
            *m = u8::from(ring || bar || speck || disc);
        }
        let mut detector = BlobDetector::default();
        let found = detector.detect(&mask, &BlobParams::default());
        assert_eq!(found.len(), 1);
        assert!((found[0].ellipse.centre - Point2::new(50.0, 28.0)).norm() < 1e-9);
        let all = BlobParams { min_area: 1.0, min_fill: 0.0, min_ratio: 0.0, ..BlobParams::default() };
        assert_eq!(detector.detect(&mask, &all).len(), 4);
        let wrong = BlobParams { max_area: 3.0, ..BlobParams::default() };
        assert!(wrong.check().unwrap_err().to_string().contains("max_area"));
    }
}
