//! Grey levels around a target: smoothed, halved again and again, and known between pixels.

use image::GrayImage;
use nalgebra::{Matrix3, Point2};
use vt_core::frame::Roi;

use crate::gaussian::{Blur, Gaussian};
use crate::plane::{Plane, area};

/// The smoothed picture and its halves, pixel centres as in [`crate::pyramid`], inside of a region.
#[derive(Clone, Debug, Default)]
pub(super) struct Planes {
    blur: Blur,
    levels: Vec<Plane<f32>>,
}

impl Planes {
    /// Computes `count` levels inside `region`.
    pub fn compute(&mut self, picture: &GrayImage, region: Roi, kernel: &Gaussian, count: usize) {
        if self.levels.len() != count {
            self.levels.resize_with(count, Plane::default);
        }
        let Some((first, _)) = self.levels.split_first_mut() else { return };
        // Begins at a pixel of the coarsest level.
        let block = (1u32 << (count - 1)) - 1;
        let (x, y) = (region.x & !block, region.y & !block);
        let whole = Roi { x, y, width: region.width + region.x - x, height: region.height + region.y - y };
        self.blur.compute(picture, Some(whole), kernel, first);
        for level in 1..count {
            let (finer, coarser) = self.levels.split_at_mut(level);
            let (source, target) = (&finer[level - 1], &mut coarser[0]);
            target.reserve(area(picture.dimensions()) >> (2 * level));
            halve(source, target);
        }
    }

    /// The level with this number.
    pub fn level(&self, level: usize) -> Option<View<'_>> {
        let plane = self.levels.get(level)?;
        let r = plane.region();
        let origin = [f64::from(r.x), f64::from(r.y)];
        let last = [f64::from(r.width) - 1.0, f64::from(r.height) - 1.0];
        Some(View { values: plane.values(), stride: r.width as usize, origin, last })
    }
}

/// Means of blocks of 2 × 2 pixels; an odd last row or column is left out.
fn halve(source: &Plane<f32>, target: &mut Plane<f32>) {
    let r = source.region();
    let half = Roi { x: r.x / 2, y: r.y / 2, width: r.width / 2, height: r.height / 2 };
    let (from, to) = (r.width as usize, half.width as usize);
    let values = target.reshape(half);
    if to == 0 {
        return;
    }
    vt_core::batch::vectorized(
        #[inline(always)]
        || {
            let rows = source.values().chunks_exact(2 * from);
            for (out, pair) in values.chunks_exact_mut(to).zip(rows) {
                let (above, below) = (&pair[..2 * to], &pair[from..][..2 * to]);
                for k in 0..to {
                    let sum = (above[2 * k] + above[2 * k + 1]) + (below[2 * k] + below[2 * k + 1]);
                    out[k] = 0.25 * sum;
                }
            }
        },
    );
}

/// One level, by coordinates of that level.
#[derive(Clone, Copy, Debug)]
pub(super) struct View<'a> {
    values: &'a [f32],
    stride: usize,
    origin: [f64; 2],
    last: [f64; 2],
}

impl View<'_> {
    /// Grey level of the bilinear interpolation and its slopes along x and y; `None` outside of the pixel centres.
    #[inline(always)]
    pub fn interpolate(&self, x: f64, y: f64) -> Option<[f64; 3]> {
        let (x, y) = (x - self.origin[0], y - self.origin[1]);
        if !(x >= 0.0 && y >= 0.0 && x < self.last[0] && y < self.last[1]) {
            return None;
        }
        let (i, j) = (x as usize, y as usize);
        let (u, v) = (x - i as f64, y - j as f64);
        let start = j * self.stride + i;
        let above = self.values.get(start..start + 2)?;
        let below = self.values.get(start + self.stride..start + self.stride + 2)?;
        let (a, b) = (f64::from(above[0]), f64::from(above[1]));
        let (c, d) = (f64::from(below[0]), f64::from(below[1]));
        let (upper, lower) = (b - a, d - c);
        let (left, middle) = (a + u * upper, c + u * lower);
        Some([left + v * (middle - left), upper + v * (lower - upper), middle - left])
    }

    /// Grey level and slopes over one pixel, half a pixel to both sides; `None` outside of the pixel centres.
    pub fn differentiate(&self, x: f64, y: f64) -> Option<[f64; 3]> {
        let at = |dx: f64, dy: f64| Some(self.interpolate(x + dx, y + dy)?[0]);
        Some([at(0.0, 0.0)?, at(0.5, 0.0)? - at(-0.5, 0.0)?, at(0.0, 0.5)? - at(0.0, -0.5)?])
    }
}

/// Coordinates of level `l` from those of the full picture.
pub(super) fn level_from_picture(l: u32) -> Matrix3<f64> {
    let s = 1.0 / f64::from(1u32 << l);
    let b = 0.5 * s - 0.5;
    Matrix3::new(s, 0.0, b, 0.0, s, b, 0.0, 0.0, 1.0)
}

/// Image of a point; `None` where it has none.
pub(super) fn map(m: &Matrix3<f64>, p: &Point2<f64>) -> Option<Point2<f64>> {
    let h = m * p.to_homogeneous();
    (h.z > 0.0).then(|| Point2::new(h.x / h.z, h.y / h.z))
}

/// Pixels at most `margin` from the rectangle about some points, inside of a picture; `None` without any.
pub(super) fn region_about(points: &[Point2<f64>], margin: f64, size: (u32, u32)) -> Option<Roi> {
    let bound = |k: usize, far: f64, pick: fn(f64, f64) -> f64| points.iter().map(|p| p[k]).fold(far, pick);
    let range = |k: usize, n: u32| {
        let low = (bound(k, f64::INFINITY, f64::min) - margin).floor().max(0.0);
        let high = (bound(k, f64::NEG_INFINITY, f64::max) + margin).ceil().min(f64::from(n) - 1.0);
        (low <= high).then_some((low as u32, (high - low) as u32 + 1))
    };
    let ((x, width), (y, height)) = (range(0, size.0)?, range(1, size.1)?);
    Some(Roi { x, y, width, height })
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Luma;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn ramps_are_the_same_on_all_levels((x, y) in (20.0..40.0f64, 20.0..30.0f64), (rx, ry) in (0u32..9, 0u32..9)) {
            let ramp = GrayImage::from_fn(70, 50, |x, y| Luma([(2 * x + y) as u8]));
            let mut planes = Planes::default();
            let region = Roi { x: rx, y: ry, width: 60, height: 41 };
            planes.compute(&ramp, region, &Gaussian::new(0.8).unwrap(), 3);
            for level in 0..3 {
                let p = map(&level_from_picture(level), &Point2::new(x, y)).unwrap();
                prop_assert!((crate::pyramid::to_level(x, level) - p.x).abs() < 1e-12);
                let scale = f64::from(1 << level);
                for found in [planes.level(level as usize).unwrap().interpolate(p.x, p.y), planes.level(level as usize).unwrap().differentiate(p.x, p.y)] {
                    let [value, dx, dy] = found.unwrap();
                    prop_assert!((value - (2.0 * x + y)).abs() < 1e-3, "{} {}", value, 2.0 * x + y);
                    prop_assert!((dx - 2.0 * scale).abs() < 1e-3 && (dy - scale).abs() < 1e-3);
                }
            }
            prop_assert!(planes.level(3).is_none());
        }

        #[test]
        fn slopes_are_those_of_the_interpolation((x, y) in (1.0..18.0f64, 1.0..14.0f64), seed in 0u32..100) {
            let picture = GrayImage::from_fn(20, 16, |x, y| Luma([((x * 97 + y * 61 + x * y * seed) % 256) as u8]));
            let mut planes = Planes::default();
            planes.compute(&picture, Roi { x: 0, y: 0, width: 20, height: 16 }, &Gaussian::new(0.5).unwrap(), 1);
            let view = planes.level(0).unwrap();
            let h = 1e-5;
            prop_assume!([x, y].iter().all(|v| v.fract() > 2.0 * h && v.fract() < 1.0 - 2.0 * h));
            let at = |x, y| view.interpolate(x, y).unwrap()[0];
            let [_, dx, dy] = view.interpolate(x, y).unwrap();
            prop_assert!(((at(x + h, y) - at(x - h, y)) / (2.0 * h) - dx).abs() < 1e-5);
            prop_assert!(((at(x, y + h) - at(x, y - h)) / (2.0 * h) - dy).abs() < 1e-5);
        }
    }

    #[test]
    fn regions_keep_to_the_picture() {
        let about = |x: f64, y: f64| region_about(&[Point2::new(x, y)], 3.0, (20, 10));
        assert_eq!(about(10.0, 5.0), Some(Roi { x: 7, y: 2, width: 7, height: 7 }));
        assert_eq!(about(-1.0, 9.0), Some(Roi { x: 0, y: 6, width: 3, height: 4 }));
        assert_eq!((about(-9.0, 5.0), about(5.0, 90.0), about(f64::NAN, 5.0)), (None, None, None));
        let planes = Planes::default();
        assert!(planes.level(0).is_none());
    }
}
