//! Mass, centre and spread of weighted pixels.

use nalgebra::{Matrix2, Point2, SymmetricEigen, Vector2};
use vt_core::frame::Roi;
use vt_core::math;

use crate::plane::{Plane, intersection};

/// Variance of a coordinate that is only known to a pixel.
const PIXEL: f64 = 1.0 / 12.0;

/// Moments up to the second order, in pixels of the full picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moments {
    /// What all places are relative to: near the pixels, sums of squares do not cancel.
    origin: [f64; 2],
    mass: f64,
    squares: f64,
    first: [f64; 2],
    second: [f64; 3],
}

/// An ellipse in the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ellipse {
    /// Centre.
    pub centre: Point2<f64>,
    /// Half axes, the longer first, pixels.
    pub half_axes: [f64; 2],
    /// Angle from the x axis to the longer half axis, towards y, in (−π/2, π/2].
    pub angle: f64,
}

impl Ellipse {
    /// Area, square pixels.
    pub fn area(&self) -> f64 {
        core::f64::consts::PI * self.half_axes[0] * self.half_axes[1]
    }

    /// Length of the rim, pixels (Ramanujan's approximation).
    pub fn perimeter(&self) -> f64 {
        let [a, b] = self.half_axes;
        core::f64::consts::PI * (3.0 * (a + b) - ((3.0 * a + b) * (a + 3.0 * b)).sqrt())
    }
}

impl Moments {
    /// Moments of the bytes of a region, which are weights.
    pub fn of_plane(plane: &Plane<u8>, region: Roi) -> Self {
        let part = intersection(plane.region(), region);
        let (mut mass, mut squares, mut x1, mut x2, mut xy) = (0u64, 0u64, 0u64, 0u64, 0u64);
        let (mut y1, mut y2) = (0u64, 0u64);
        for (v, y) in (0u64..).zip(part.y..part.y + part.height) {
            let (mut w0, mut w1, mut w2) = (0u64, 0u64, 0u64);
            for (u, &w) in (0u64..).zip(plane.row(y, part)) {
                let w = u64::from(w);
                w0 += w;
                w1 += u * w;
                w2 += u * u * w;
                squares += w * w;
            }
            mass += w0;
            x1 += w1;
            x2 += w2;
            y1 += v * w0;
            y2 += v * v * w0;
            xy += v * w1;
        }
        Self {
            origin: [f64::from(part.x), f64::from(part.y)],
            mass: mass as f64,
            squares: squares as f64,
            first: [x1, y1].map(|s| s as f64),
            second: [x2, xy, y2].map(|s| s as f64),
        }
    }

    /// Adds a pixel.
    #[inline]
    pub fn add(&mut self, [x, y]: [f64; 2], weight: f64) {
        if self.mass == 0.0 {
            *self = Self { origin: [x, y], ..Self::default() };
        }
        let (x, y) = (x - self.origin[0], y - self.origin[1]);
        self.mass += weight;
        self.squares += weight * weight;
        self.first = [self.first[0] + weight * x, self.first[1] + weight * y];
        let [xx, xy, yy] = self.second;
        self.second = [xx + weight * x * x, xy + weight * x * y, yy + weight * y * y];
    }

    /// Sum of the weights.
    pub fn mass(&self) -> f64 {
        self.mass
    }

    /// Mass centre; none without mass: nothing seen is no measurement.
    pub fn centroid(&self) -> Option<Point2<f64>> {
        let [x, y] = self.first.map(|s| s / self.mass);
        (self.mass > 0.0).then(|| Point2::new(self.origin[0] + x, self.origin[1] + y))
    }

    /// Covariance of the places of the pixels around their centre, square pixels, with that of a place within its pixel.
    pub fn spread(&self) -> Matrix2<f64> {
        if self.mass <= 0.0 {
            return Matrix2::identity() * PIXEL;
        }
        let mean = Vector2::from(self.first) / self.mass;
        let [xx, xy, yy] = self.second.map(|s| s / self.mass);
        let central = Matrix2::new(xx, xy, xy, yy) - mean * mean.transpose();
        let floor = Matrix2::identity() * PIXEL;
        Matrix2::new(central.m11.max(0.0), central.m12, central.m12, central.m22.max(0.0)) + floor
    }

    /// Number of independent pixels, `(Σ w)² / Σ w²`.
    pub fn effective_count(&self) -> f64 {
        if self.squares > 0.0 { self.mass * self.mass / self.squares } else { 0.0 }
    }

    /// Covariance of the mass centre when pixels are drawn from a distribution with this spread, patches of `patch` square pixels
    /// all at once: spread over the number of patches less one, as the mean is estimated too. One patch or two have the spread
    /// itself. None without mass.
    pub fn centroid_covariance(&self, patch: f64) -> Option<Matrix2<f64>> {
        let patches = (self.effective_count() / patch).max(2.0);
        (self.mass > 0.0).then(|| self.spread() / (patches - 1.0))
    }

    /// The ellipse with constant density that has these moments: its half axes are twice the deviations along them. None without
    /// mass.
    pub fn ellipse(&self) -> Option<Ellipse> {
        let centre = self.centroid()?;
        let SymmetricEigen { eigenvalues, eigenvectors } = SymmetricEigen::new(self.spread());
        let long = eigenvalues.imax();
        let axis = eigenvectors.column(long);
        let sign = if axis.x < 0.0 || axis.x == 0.0 && axis.y < 0.0 { -1.0 } else { 1.0 };
        let half_axes = [eigenvalues[long], eigenvalues[1 - long]].map(|v| 2.0 * v.max(0.0).sqrt());
        Some(Ellipse { centre, half_axes, angle: math::atan2(sign * axis.y, sign * axis.x) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use vt_core::random::{Random, Stream};

    proptest! {
        #[test]
        fn moments_are_the_sums(
            (width, height) in (1u32..9, 1u32..9), values in prop::collection::vec(any::<u8>(), 64),
        ) {
            let region = Roi { x: 700, y: 2000, width, height };
            let mut plane = Plane::default();
            plane.reshape(region).copy_from_slice(&values[..(width * height) as usize]);
            let found = Moments::of_plane(&plane, region);
            let mut one_by_one = Moments::default();
            let (mut mass, mut mean) = (0.0, Vector2::zeros());
            let pixels = || (0..width * height).map(|k| {
                let at = Vector2::new(f64::from(700 + k % width), f64::from(2000 + k / width));
                (at, f64::from(values[k as usize]))
            });
            for (at, w) in pixels() {
                one_by_one.add([at.x, at.y], w);
                mass += w;
                mean += at * w;
            }
            prop_assume!(mass > 0.0);
            mean /= mass;
            let spread = pixels().map(|(at, w)| (at - mean) * (at - mean).transpose() * w).sum::<Matrix2<f64>>() / mass;
            for m in [found, one_by_one] {
                prop_assert_eq!(m.mass(), mass);
                prop_assert!((m.centroid().unwrap().coords - mean).amax() < 1e-9);
                prop_assert!((m.spread() - spread - Matrix2::identity() / 12.0).amax() < 1e-9);
                let squares: f64 = pixels().map(|(_, w)| w * w).sum();
                prop_assert!((m.effective_count() - mass * mass / squares).abs() < 1e-9);
            }
        }

        #[test]
        fn a_drawn_ellipse_is_found_again(
            (x, y) in (40.0..60.0f64, 40.0..60.0f64), (long, ratio) in (10.0..30.0f64, 0.3..0.9f64), angle in -1.5..1.5f64,
        ) {
            let (s, c) = math::sin_cos(angle);
            let mut plane = Plane::default();
            // The weight of a pixel is the share of it that is covered, in 64ths.
            for (k, m) in (0u32..).zip(plane.reshape(Roi { x: 0, y: 0, width: 100, height: 100 }).iter_mut()) {
                let covered = (0..64u32).filter(|part| {
                    let [dx, dy] = [part % 8, part / 8].map(|i| (f64::from(i) - 3.5) / 8.0);
                    let d = Vector2::new(f64::from(k % 100) + dx - x, f64::from(k / 100) + dy - y);
                    let (u, v) = (c * d.x + s * d.y, c * d.y - s * d.x);
                    (u / long).powi(2) + (v / (long * ratio)).powi(2) <= 1.0
                });
                *m = covered.count() as u8;
            }
            let found = Moments::of_plane(&plane, plane.region()).ellipse().unwrap();
            prop_assert!((found.centre - Point2::new(x, y)).norm() < 0.05, "{:?}", found);
            // Shares of pixels smear the ellipse by one pixel, and each is only known to its pixel.
            let [a, b] = [long, long * ratio].map(|half| (half * half + 8.0 * PIXEL).sqrt());
            prop_assert!((found.half_axes[0] - a).abs() < 0.05 && (found.half_axes[1] - b).abs() < 0.05, "{:?}", found);
            let off = math::sin(found.angle - angle).abs();
            prop_assert!(off < 0.05 / (long * (1.0 - ratio)), "{:?} {}", found, angle);
        }
    }

    #[test]
    fn the_centre_of_drawn_pixels_is_as_uncertain_as_it_says() {
        // Patches of two by two pixels drawn from a Gaussian.
        let truth = Vector2::new(100.0, 80.0);
        let root = Matrix2::new(9.0, 0.0, 3.0, 4.0);
        let mut nees = 0.0;
        for trial in 0..2000 {
            let mut random = Random::new(3, Stream::Sim, 0, trial, 0);
            let mut moments = Moments::default();
            for _ in 0..300 {
                let corner = truth + root * Vector2::new(random.normal(), random.normal());
                let corner = corner.map(|c| (c - 0.5).round());
                for (dx, dy) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
                    moments.add([corner.x + dx, corner.y + dy], 1.0);
                }
            }
            let d = moments.centroid().unwrap().coords - truth;
            let information = moments.centroid_covariance(4.0).unwrap().try_inverse().unwrap();
            nees += (d.transpose() * information * d).x / 2000.0;
        }
        // Two degrees of freedom; the mean of 2000 has a deviation of 0.045.
        assert!((nees - 2.0).abs() < 0.14, "{nees}");
        assert_eq!(Moments::default().centroid_covariance(1.0), None);
        assert_eq!(Moments::default().ellipse(), None);
    }
}
