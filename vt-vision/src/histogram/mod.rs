//! Colour histograms: which bin a pixel is in, weighted counts of regions, similarity, back-projection.
//!
//! The pixels' bins are evidence ([`ColorBinsProcessing`]), made once a frame, so that a histogram of a region costs one
//! look-up a pixel, however many hypotheses ask. Layout after Pérez, Hue, Vermaak and Gangnet ("Color-based probabilistic
//! tracking", 2002): hue and saturation for pixels that have a colour, value for those too dark or too pale to have one.

mod back_projection;
mod bins;

pub use back_projection::{back_project, likelihood_ratio_table, scaled_table};
pub use bins::{Achromatic, Binning, BinningParams, ColorBins, ColorBinsProcessing};

use nalgebra::{Point2, Vector2};
use vt_core::frame::Roi;

use crate::plane::{Plane, intersection};

/// Weight of pixels in the bins of a [`Binning`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Histogram {
    weights: Vec<f32>,
    /// Partial counts of pixels that follow each other, lest one waits for the other.
    lanes: Vec<[u32; 4]>,
}

impl Histogram {
    /// An empty histogram of so many bins.
    pub fn new(bins: usize) -> Self {
        Self { weights: vec![0.0; bins], lanes: vec![] }
    }

    /// Weights of the bins.
    pub fn weights(&self) -> &[f32] {
        &self.weights
    }

    /// Weights of the bins, to be changed.
    pub fn weights_mut(&mut self) -> &mut [f32] {
        &mut self.weights
    }

    /// Sum of the weights.
    pub fn total(&self) -> f32 {
        self.weights.iter().sum()
    }

    /// Forgets all pixels.
    pub fn clear(&mut self) {
        self.weights.fill(0.0);
    }

    /// Adds the pixels of a region, each with weight one. Pixels without a bin and outside of the plane do not count.
    pub fn add_region(&mut self, bins: &Plane<u16>, region: Roi) {
        self.lanes.clear();
        self.lanes.resize(self.weights.len(), [0; 4]);
        let region = intersection(bins.region(), region);
        let lanes = &mut self.lanes[..];
        let mut count = |bin: u16, lane: usize| {
            if let Some(counts) = lanes.get_mut(usize::from(bin)) {
                counts[lane] += 1;
            }
        };
        for y in region.y..region.y + region.height {
            let mut fours = bins.row(y, region).chunks_exact(4);
            for four in &mut fours {
                for lane in 0..4 {
                    count(four[lane], lane);
                }
            }
            fours.remainder().iter().for_each(|&bin| count(bin, 0));
        }
        for (weight, counts) in self.weights.iter_mut().zip(&self.lanes) {
            *weight += counts.iter().sum::<u32>() as f32;
        }
    }

    /// Adds the pixels of an upright ellipse with Epanechnikov's weights `1 − r²`, `r` being 1 on its rim: pixels near the
    /// rim, which are the least certain to belong, weigh least. `half_axes` are in pixels. Nothing is added where they
    /// are not positive.
    pub fn add_ellipse(&mut self, bins: &Plane<u16>, centre: Point2<f64>, half_axes: Vector2<f64>) {
        if !(half_axes.x > 0.0 && half_axes.y > 0.0) {
            return;
        }
        let plane = bins.region();
        let span = |c: f64, half: f64, start: u32, count: u32| {
            let last = f64::from(start) + f64::from(count) - 1.0;
            let (from, to) = ((c - half).ceil().max(f64::from(start)), (c + half).floor().min(last));
            if from <= to { from as u32..to as u32 + 1 } else { 0..0 }
        };
        for y in span(centre.y, half_axes.y, plane.y, plane.height) {
            let v = (f64::from(y) - centre.y) / half_axes.y;
            let half_width = half_axes.x * (1.0 - v * v).max(0.0).sqrt();
            let columns = span(centre.x, half_width, plane.x, plane.width);
            let row = Roi { x: columns.start, y, width: columns.end - columns.start, height: 1 };
            for (x, &bin) in columns.zip(bins.row(y, row)) {
                let u = (f64::from(x) - centre.x) / half_axes.x;
                if let Some(weight) = self.weights.get_mut(usize::from(bin)) {
                    *weight += (1.0 - u * u - v * v) as f32;
                }
            }
        }
    }

    /// Scales the weights to a sum of one; an empty histogram stays empty.
    pub fn normalize(&mut self) {
        let total = self.total();
        if total > 0.0 {
            self.weights.iter_mut().for_each(|w| *w /= total);
        }
    }

    /// Scales every bin by `min b / b` of the background's normalised weights, so that colours which the surroundings share
    /// count less (Comaniciu, Ramesh and Meer, "Kernel-based object tracking", 2003), and normalises. Bins that the
    /// background lacks keep their weight.
    pub fn weigh_against(&mut self, background: &Self) {
        let least = background.weights.iter().filter(|&&b| b > 0.0).fold(f32::INFINITY, |a, &b| a.min(b));
        for (weight, &b) in self.weights.iter_mut().zip(&background.weights) {
            if b > 0.0 {
                *weight *= least / b;
            }
        }
        self.normalize();
    }

    /// Bhattacharyya coefficient with another histogram of the same bins, both scaled to a sum of one; see
    /// [`bhattacharyya`].
    pub fn similarity(&self, other: &Self) -> f64 {
        let scale = f64::from(self.total()) * f64::from(other.total());
        if scale > 0.0 { bhattacharyya(&self.weights, &other.weights) / scale.sqrt() } else { 0.0 }
    }
}

/// Bhattacharyya coefficient `Σ √(p_k q_k)` of normalised weights: 1 for equal ones, 0 without common bins or when one is
/// empty. The distance in the colour likelihood `exp(−λ D²)` is `D² = 1 − Σ √(p_k q_k)`.
pub fn bhattacharyya(p: &[f32], q: &[f32]) -> f64 {
    p.iter().zip(q).map(|(&p, &q)| f64::from((p * q).sqrt())).sum()
}

/// A region cut into `columns` × `rows` parts of nearly equal size, by rows: histograms of parts know where in the target a
/// colour is.
pub fn parts(region: Roi, columns: u32, rows: u32) -> impl Iterator<Item = Roi> {
    let cut = |start: u32, length: u32, k: u32, n: u32| {
        let at = |k: u32| (u64::from(length) * u64::from(k) / u64::from(n)) as u32;
        (start + at(k), at(k + 1) - at(k))
    };
    (0..rows).flat_map(move |j| {
        let (y, height) = cut(region.y, region.height, j, rows);
        (0..columns).map(move |i| {
            let (x, width) = cut(region.x, region.width, i, columns);
            Roi { x, y, width, height }
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn plane(width: u32, height: u32, values: &[u16]) -> Plane<u16> {
        let mut plane = Plane::default();
        plane
            .reshape(Roi { x: 3, y: 2, width, height })
            .copy_from_slice(&values[..(width * height) as usize]);
        plane
    }

    fn histogram(weights: &[f32]) -> Histogram {
        Histogram { weights: weights.to_vec(), lanes: vec![] }
    }

    proptest! {
        #[test]
        fn regions_and_ellipses_count_as_pixel_by_pixel(
            (width, height) in (1u32..20, 1u32..12),
            values in prop::collection::vec(0u16..9, 240),
            (x, y, w, h) in (0u32..20, 0u32..12, 0u32..20, 0u32..14),
            (cx, cy) in (-5.0..30.0, -5.0..20.0f64), (a, b) in (-1.0..15.0, 0.0..12.0f64),
        ) {
            let plane = plane(width, height, &values);
            let (mut counts, mut kernel) = (Histogram::new(8), Histogram::new(8));
            let (mut box_truth, mut kernel_truth) = ([0.0f64; 8], [0.0f64; 8]);
            counts.add_region(&plane, Roi { x, y, width: w, height: h });
            kernel.add_ellipse(&plane, Point2::new(cx, cy), Vector2::new(a, b));
            for v in 0..40 {
                for u in 0..40 {
                    let Some(bin) = plane.get(u, v).filter(|&bin| bin < 8) else { continue };
                    if u >= x && u < x + w && v >= y && v < y + h {
                        box_truth[usize::from(bin)] += 1.0;
                    }
                    if a > 0.0 && b > 0.0 {
                        let r2 = ((f64::from(u) - cx) / a).powi(2) + ((f64::from(v) - cy) / b).powi(2);
                        kernel_truth[usize::from(bin)] += (1.0 - r2).max(0.0);
                    }
                }
            }
            for k in 0..8 {
                prop_assert_eq!(f64::from(counts.weights()[k]), box_truth[k]);
                prop_assert!((f64::from(kernel.weights()[k]) - kernel_truth[k]).abs() < 1e-4);
            }
        }

        #[test]
        fn parts_cover_the_region_once(
            (x, y, width, height) in (0u32..9, 0u32..9, 0u32..9, 0u32..9), (columns, rows) in (1u32..5, 1u32..5),
        ) {
            let mut seen = [[0; 20]; 20];
            for part in parts(Roi { x, y, width, height }, columns, rows) {
                for v in part.y..part.y + part.height {
                    for u in part.x..part.x + part.width {
                        seen[v as usize][u as usize] += 1;
                    }
                }
            }
            for (v, row) in seen.iter().enumerate() {
                for (u, &n) in row.iter().enumerate() {
                    let (u, v) = (u as u32, v as u32);
                    let inside = u >= x && u < x + width && v >= y && v < y + height;
                    prop_assert_eq!(n, i32::from(inside));
                }
            }
        }

        #[test]
        fn similarity_is_one_for_proportional_weights_and_smaller_otherwise(
            p in prop::collection::vec(0.0f32..5.0, 6), q in prop::collection::vec(0.0f32..5.0, 6), c in 0.1f32..9.0,
        ) {
            prop_assume!(p.iter().sum::<f32>() > 0.1 && q.iter().sum::<f32>() > 0.1);
            let (a, b) = (histogram(&p), histogram(&q));
            let scaled = histogram(&p.iter().map(|w| w * c).collect::<Vec<_>>());
            prop_assert!((a.similarity(&scaled) - 1.0).abs() < 1e-5);
            prop_assert!(a.similarity(&b) <= 1.0 + 1e-5);
            prop_assert_eq!(a.similarity(&b), b.similarity(&a));
            prop_assert_eq!(a.similarity(&Histogram::new(6)), 0.0);
        }
    }

    #[test]
    fn what_the_background_has_too_counts_less() {
        let mut target = histogram(&[2.0, 2.0, 2.0, 0.0]);
        target.weigh_against(&histogram(&[0.8, 0.2, 0.0, 0.0]));
        let expected = [0.25, 1.0, 1.0, 0.0].map(|w: f32| w / 2.25);
        assert!(target.weights().iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{target:?}");
        let mut empty = Histogram::new(2);
        empty.normalize();
        assert_eq!(empty.weights(), [0.0, 0.0]);
    }
}
