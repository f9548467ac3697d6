//! Histograms of hypotheses against those of the reference.

use core::cell::RefCell;
use std::sync::Arc;

use nalgebra::{DefaultAllocator, Dim, Matrix3, OVector, U1, Vector2};
use vt_core::batch::{LANES, vectorized, with_rows};
use vt_core::lie::PlanarMotion;
use vt_core::manifold::{Alloc, Tangent};
use vt_core::measurement::{Level, Linearized, Measurement, NormalEquations, Quality};
use vt_models::warp::PlanarWarp;

use super::kernel::{KernelPart, Lattice, OUTSIDE, UNIT};
use super::params::ColorParams;
use crate::histogram::ColorBins;

/// Classes beside the bins: pixels without a bin, and outside of the picture.
const EXTRA: usize = 2;

/// Partial sums of a class: pixels that follow each other go to different ones, lest one waits for the other.
const PARTIAL: usize = 4;

/// A hypothesis may have so many times the pixels of the prediction.
const EXCESS: f64 = 64.0;

/// `D²` of clutter when nothing is known of the background.
const UNKNOWN: f64 = 0.5;

/// A similarity above this supports a part.
const SIMILAR: f64 = 0.8;

/// The colours of a frame and those of the reference.
pub struct ColorLikelihood<P> {
    pub(super) warp: PlanarWarp<P>,
    pub(super) bins: Arc<ColorBins>,
    params: ColorParams,
    pub(super) parts: Vec<KernelPart>,
    lattice: Lattice,
    pub(super) classes: usize,
    /// `√q*` of one part after the other; empty without a reference.
    pub(super) reference: Vec<f64>,
    /// Weight of each class.
    weights: Vec<f64>,
    /// `D²` of the surroundings of the reference.
    clutter: f64,
}

thread_local! {
    /// Weights of the pixels of each class.
    static COUNTS: RefCell<Vec<[u64; PARTIAL]>> = const { RefCell::new(vec![]) };
}

/// Lends `n` numbers.
fn with_numbers<R>(n: usize, f: impl FnOnce(&mut [f64]) -> R) -> R {
    with_rows(n.div_ceil(LANES), |rows| f(&mut rows.as_flattened_mut()[..n]))
}

/// `Σ √(p q)` for the roots of `p`.
fn bhattacharyya(roots: &[f64], q: &[f64]) -> f64 {
    vectorized(
        #[inline(always)]
        || {
            // Eight sums, since each addition waits for the one before.
            let mut sums = [0.0; 8];
            let (whole, rest) = roots.as_chunks::<8>();
            let (others, q) = q.as_chunks::<8>();
            for (roots, q) in whole.iter().zip(others) {
                for k in 0..8 {
                    sums[k] += roots[k] * q[k].sqrt();
                }
            }
            for (sum, (root, q)) in sums.iter_mut().zip(rest.iter().zip(q)) {
                *sum += root * q.sqrt();
            }
            let [a, b, c, d, e, f, g, h] = sums;
            ((a + e) + (c + g)) + ((b + f) + (d + h))
        },
    )
}

impl<P: PlanarMotion> ColorLikelihood<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    pub(super) fn new(params: &ColorParams, bins: u16, warp: PlanarWarp<P>, [w, h]: [f64; 2]) -> Self {
        Self {
            warp,
            bins: Arc::default(),
            params: *params,
            parts: KernelPart::grid(w, h, params.columns, params.rows),
            lattice: Lattice::ALL,
            classes: usize::from(bins) + EXTRA,
            reference: vec![],
            weights: vec![],
            clutter: UNKNOWN,
        }
    }

    /// The object's parts.
    pub fn parts(&self) -> &[KernelPart] {
        &self.parts
    }

    /// True when there is a reference.
    pub(super) fn has_reference(&self) -> bool {
        !self.reference.is_empty()
    }

    /// Forgets the reference.
    pub(super) fn forget(&mut self) {
        self.reference.clear();
    }

    /// Looks at so many pixels that about the wanted number is under each part at this pose.
    pub(super) fn choose_lattice(&mut self, pose: &P) {
        let m = pose.matrix();
        let strides = self.parts.iter().map(|part| part.stride(&m, self.params.samples));
        let stride = strides.max().unwrap_or(1);
        self.lattice = Lattice { stride, most: (EXCESS * self.params.samples as f64).min(Lattice::ALL.most) };
    }

    /// Takes the colours at `pose` as the reference; `false` where half of a part or more is not in the picture.
    pub(super) fn learn(&mut self, pose: &P) -> bool {
        let (m, classes) = (pose.matrix(), self.classes);
        self.lattice = Lattice::ALL;
        let ring = self.ring(&m);
        // Comaniciu's least bin, but not that of a single pixel.
        let least = ring.iter().filter(|b| **b > 0.0).fold(f64::INFINITY, |a, &b| a.min(b));
        let least = least.max(1.0 / classes as f64);
        self.weights.clear();
        self.weights.extend(ring.iter().map(|b| (least / b).min(1.0)));
        let (mut reference, mut seen) = (vec![], true);
        for part in &self.parts {
            self.with_histogram(part, &m, |q, total| {
                reference.extend(q.iter().map(|q| q.sqrt()));
                seen &= total > 0.0 && q[classes - 1] < 0.5;
            });
        }
        if !seen {
            return false;
        }
        let background: Vec<f64> = ring.iter().zip(&self.weights).map(|(b, w)| b * w).collect();
        let total: f64 = background.iter().sum();
        self.clutter = UNKNOWN;
        if total > 0.0 {
            let similarity =
                reference.chunks(classes).map(|roots| bhattacharyya(roots, &background)).sum::<f64>();
            self.clutter = (1.0 - similarity / (total.sqrt() * self.parts.len() as f64)).max(0.05);
        }
        self.reference = reference;
        true
    }

    /// Shares of the classes in the ring around the object; zeros where there is none.
    fn ring(&self, image_from_object: &Matrix3<f64>) -> Vec<f64> {
        let mut ring = vec![0.0; self.classes];
        let Some(factor) = self.params.background else { return ring };
        let (first, last) = (self.parts[0], self.parts[self.parts.len() - 1]);
        let (low, high) = (first.centre - first.half_axes, last.centre + last.half_axes);
        let around =
            KernelPart { centre: nalgebra::center(&low, &high), half_axes: (high - low) * (0.5 * factor) };
        around.visit(&self.bins.bins, image_from_object, Lattice::ALL, |pixel| {
            let [u, v] = pixel.place;
            if (u * u + v * v) * factor * factor > 1.0 && pixel.bin != OUTSIDE {
                ring[self.class(pixel.bin)] += 1.0;
            }
        });
        let total = ring.iter().sum::<f64>().max(1.0);
        ring.iter_mut().for_each(|b| *b /= total);
        ring
    }

    /// Class of a bin.
    #[inline(always)]
    fn class(&self, bin: u16) -> usize {
        if bin == OUTSIDE { self.classes - 1 } else { usize::from(bin).min(self.classes - EXTRA) }
    }

    /// Calls `f` with the normalised histogram of a part, classes weighted and with the floor, and with the weight of all
    /// pixels: zeros where there are none.
    pub(super) fn with_histogram<R>(
        &self,
        part: &KernelPart,
        image_from_object: &Matrix3<f64>,
        f: impl FnOnce(&[f64], f64) -> R,
    ) -> R {
        with_numbers(self.classes, |q| {
            let (whole, total) = COUNTS.with_borrow_mut(|counts| {
                counts.clear();
                counts.resize(self.classes, [0; PARTIAL]);
                vectorized(
                    #[inline(always)]
                    || self.sum(part, image_from_object, counts, q),
                )
            });
            let seen = whole && total > 0.0;
            if !seen {
                q.fill(0.0);
                return f(q, 0.0);
            }
            let floor = self.params.floor;
            let scale = 1.0 / (1.0 + floor * self.classes as f64);
            let reciprocal = 1.0 / total;
            q.iter_mut().for_each(|q| *q = (*q * reciprocal + floor) * scale);
            f(q, total)
        })
    }

    /// Weighted sums of all classes from counts that are zero, whether all pixels of the part were looked at, and the sum of all.
    #[inline(always)]
    fn sum(
        &self,
        part: &KernelPart,
        image_from_object: &Matrix3<f64>,
        counts: &mut [[u64; PARTIAL]],
        sums: &mut [f64],
    ) -> (bool, f64) {
        let stride = self.lattice.stride as usize;
        let outside = self.classes - 1;
        let mut weights = [0; LANES];
        let whole = part.visit_rows(
            &self.bins.bins,
            image_from_object,
            self.lattice,
            #[inline(always)]
            |row, bins| {
                for from in (0..row.count).step_by(LANES) {
                    let n = (row.count - from).min(LANES);
                    row.weights(from, n, &mut weights);
                    let weights = &weights[..n];
                    if bins.is_empty() {
                        counts[outside][0] += weights.iter().sum::<u64>();
                        continue;
                    }
                    let bins = &bins[from * stride..];
                    if stride == 1 {
                        let (bins, rest) = bins[..n].as_chunks::<PARTIAL>();
                        let (weights, others) = weights.as_chunks::<PARTIAL>();
                        for (bins, weights) in bins.iter().zip(weights) {
                            for turn in 0..PARTIAL {
                                counts[usize::from(bins[turn])][turn] += weights[turn];
                            }
                        }
                        for (turn, (bin, weight)) in rest.iter().zip(others).enumerate() {
                            counts[usize::from(*bin)][turn] += weight;
                        }
                    } else {
                        for (k, (bin, weight)) in bins.iter().step_by(stride).zip(weights).enumerate() {
                            counts[usize::from(*bin)][k % PARTIAL] += *weight;
                        }
                    }
                }
            },
        );
        // Totals of every fourth class, since each addition waits for the one before.
        let mut totals = [0.0; 4];
        for (k, ((sum, weight), [a, b, c, d])) in sums.iter_mut().zip(&self.weights).zip(counts).enumerate() {
            *sum = (*a + *b + *c + *d) as f64 * (UNIT * weight);
            totals[k % 4] += *sum;
        }
        let total = (totals[0] + totals[1]) + (totals[2] + totals[3]);
        (whole, total)
    }

    /// Calls `f` with the Bhattacharyya coefficient of each part with its reference.
    fn similarities(&self, pose: &P, mut f: impl FnMut(f64)) {
        let m = pose.matrix();
        for (part, roots) in self.parts.iter().zip(self.reference.chunks(self.classes)) {
            f(self.with_histogram(part, &m, |q, _| bhattacharyya(roots, q)));
        }
    }

    /// Calls `f(√q* − √q, Jacobian of √q)` for every bin that has one; returns the sum of the parts' `D²`.
    fn rows(&self, at: &P, mut f: impl FnMut(f64, Tangent<P>)) -> f64 {
        let m = at.matrix();
        let mut distance = 0.0;
        for (part, roots) in self.parts.iter().zip(self.reference.chunks(self.classes)) {
            self.with_histogram(part, &m, |q, total| {
                distance += 1.0 - bhattacharyya(roots, q);
                if total > 0.0 {
                    self.part_rows(part, at, q, total, roots, &mut f);
                }
            });
        }
        distance
    }

    /// The rows of one part, whose histogram is `q`.
    fn part_rows(
        &self,
        part: &KernelPart,
        at: &P,
        q: &[f64],
        total: f64,
        roots: &[f64],
        f: &mut impl FnMut(f64, Tangent<P>),
    ) {
        let (n, floor) = (at.dim(), self.params.floor);
        let (size, scale) = (n.value(), 1.0 + floor * self.classes as f64);
        let [a, b] = part.half_axes.into();
        with_numbers(self.classes * size, |slopes| {
            slopes.fill(0.0);
            let mut whole = Tangent::<P>::zeros_generic(n, U1);
            part.visit(&self.bins.bins, &at.matrix(), self.lattice, |pixel| {
                let [u, v] = pixel.place;
                let x = part.centre + Vector2::new(u * a, v * b);
                let class = self.class(pixel.bin);
                // A pixel that stays in the picture moves in the object against the generators.
                let slope =
                    P::generators(&x).tr_mul(&Vector2::new(2.0 * u / a, 2.0 * v / b)) * self.weights[class];
                slopes[class * size..][..size].iter_mut().zip(&slope).for_each(|(s, d)| *s += d);
                whole += slope;
            });
            for (k, (q, root)) in
                q.iter().map(|q| (q, q.sqrt())).enumerate().filter(|(_, (_, root))| *root > 0.0)
            {
                // ∂√q = ∂q / 2√q, q = (Q_k / Σ Q + floor) / scale
                let share = q * scale - floor;
                let factor = 1.0 / (2.0 * root * total * scale);
                let own = OVector::<f64, P::D>::from_fn_generic(n, U1, |i, _| slopes[k * size + i]);
                let mut j = ((own - &whole * share) * factor).transpose();
                self.warp.lock(&mut j);
                f(roots[k] - root, j.transpose());
            }
        });
    }
}

impl<P: PlanarMotion> Measurement<P> for ColorLikelihood<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    fn log_likelihoods(&self, poses: &[P], out: &mut [f64]) {
        for (pose, l) in poses.iter().zip(out) {
            let mut sum = 0.0;
            self.similarities(pose, |similarity| sum += 1.0 - similarity);
            *l = -self.params.lambda * sum;
        }
    }

    /// `√q* − √q` of every bin of every part.
    fn residuals(&self, at: &P, out: &mut Linearized<P>) {
        out.clear();
        let variance = 1.0 / self.params.lambda;
        self.rows(at, |r, j| out.push(r, j, variance, 1.0));
    }

    fn normal_equations(&self, at: &P, out: &mut NormalEquations<P>) {
        out.clear();
        let distance = self.rows(at, |r, j| out.add(r, &j, self.params.lambda));
        out.cost = self.params.lambda * distance;
    }

    /// Rows are parts; clutter is what surrounded the reference.
    fn quality(&self, at: &P) -> Quality {
        let mut q = Quality { expected: self.parts.len(), ..Quality::default() };
        let (mut similar, mut inlying) = (0.0, 0.0);
        self.similarities(at, |similarity| {
            similar += similarity;
            if similarity > SIMILAR {
                q.inliers += 1;
                inlying += 1.0 - similarity;
            }
        });
        let mean = similar / self.parts.len() as f64;
        q.inlier_ratio = mean.clamp(0.0, 1.0);
        q.log_ratio = self.params.lambda * (self.clutter - (1.0 - mean));
        let bins = (q.inliers * self.classes) as f64;
        q.normalized_rms = (2.0 * self.params.lambda * inlying.max(0.0) / bins.max(1.0)).sqrt();
        q
    }

    fn level(&self) -> Level {
        Level::Pixel
    }
}
