//! The likelihood of a warped contour.

use core::marker::PhantomData;

use nalgebra::{DefaultAllocator, Point2};
use vt_core::agent::Warp;
use vt_core::batch::{LANES, vectorized, with_rows};
use vt_core::manifold::{Alloc, Manifold, Tangent};
use vt_core::math;
use vt_core::measurement::{Level, Linearized, Measurement, NormalEquations, Quality};
use vt_models::contour::Contour;

use super::lines::{Aim, EdgeLines};
use super::params::ContourParams;
use super::places::{Normals, Place, places, with_normals};
use crate::edge::Hypotheses;

/// `√(2π)`.
const SQRT_TAU: f64 = 2.506_628_274_631_000_7;

/// The product of ratios whose logarithm is taken in one go must not overflow.
const LARGE: f64 = 1e200;

/// The edges of a frame and the contour that is warped among them.
pub struct ContourLikelihood<P, W: Warp<P>>
where
    P: Manifold,
    DefaultAllocator: Alloc<P::D>,
{
    pub(super) warp: W,
    pub(super) contour: Contour<W::Body>,
    pub(super) lines: EdgeLines,
    hypotheses: Hypotheses,
    range: f64,
    /// `1 / σ²`.
    information: f64,
    /// `1 / (√(2π) σ q λ)`.
    beta: f64,
    log_beta: f64,
    /// `1 / τ`.
    weight: f64,
    pose: PhantomData<fn() -> P>,
}

/// An edge on a normal.
#[derive(Clone, Copy, Default)]
pub(super) struct Hit {
    pub residual: f64,
    pub at: Point2<f64>,
    /// Probability that it is the contour's, times what the normal says against clutter.
    pub strength: f64,
}

/// Most edges on a normal: those within reach, at the least distance of two.
const MOST_HITS: usize = 64;

impl<P: Manifold, W: Warp<P>> ContourLikelihood<P, W>
where
    DefaultAllocator: Alloc<P::D>,
{
    pub(super) fn new(params: &ContourParams, warp: W, contour: Contour<W::Body>) -> Self {
        let alpha = params.miss_probability * params.clutter_density;
        let temperature = params.temperature.unwrap_or(contour.points().len() as f64 / 8.0);
        let beta = 1.0 / (SQRT_TAU * params.sigma * alpha);
        Self {
            warp,
            contour,
            lines: EdgeLines::default(),
            hypotheses: params.hypotheses,
            range: params.range,
            information: 1.0 / (params.sigma * params.sigma),
            beta,
            log_beta: math::ln(beta),
            weight: 1.0 / temperature,
            pose: PhantomData,
        }
    }

    /// `P(normal | p)` against clutter at its temperature of one, as a factor and a logarithm.
    #[inline]
    fn ratio(&self, place: &Place) -> (f64, f64) {
        match self.hypotheses {
            Hypotheses::Multiple => {
                let scale = -0.5 * self.information;
                let mut sum = 0.0;
                self.lines
                    .each(place.y, place.normal, self.range, |r, _| sum += math::exp_fast(r * r * scale));
                (1.0 + self.beta * sum, 0.0)
            }
            Hypotheses::Single => {
                let mut least = f64::INFINITY;
                self.lines.each(place.y, place.normal, self.range, |r, _| least = least.min(r * r));
                (1.0, self.nearest(least))
            }
        }
    }

    /// The sum over all normals, a batch of them at a time: aims in lanes, then hits one by one, then their probabilities
    /// in lanes again. Every number is that of [`Self::ratio`].
    fn log_likelihood(&self, pose: &P, hits: &mut [f64]) -> f64 {
        let posed = self.warp.at(pose);
        with_normals::<P, W, _>(&posed, &self.contour, |all| {
            vectorized(
                #[inline(always)]
                || {
                    let (mut product, mut sum) = (1.0, 0.0);
                    for first in (0..all.x.len()).step_by(LANES) {
                        self.batch(all, first, hits, &mut product, &mut sum);
                    }
                    self.weight * (sum + math::ln(product))
                },
            )
        })
    }

    #[inline(always)]
    fn batch(&self, all: &Normals<'_>, first: usize, hits: &mut [f64], product: &mut f64, sum: &mut f64) {
        let n = (all.x.len() - first).min(LANES);
        let part = |v: &'_ [f64]| -> [f64; LANES] {
            let mut out = [f64::NAN; LANES];
            out[..n].copy_from_slice(&v[first..first + n]);
            out
        };
        let (x, y, nx, ny) = (part(all.x), part(all.y), part(all.nx), part(all.ny));
        let mut aims = [Aim::default(); LANES];
        for k in 0..LANES {
            aims[k] = self.lines.aim(x[k], y[k], nx[k], ny[k], self.range);
        }
        let single = self.hypotheses == Hypotheses::Single;
        let (mut ends, mut count) = ([0; LANES], 0);
        for k in 0..n {
            let at = [x[k], y[k], nx[k], ny[k]];
            let start = count;
            self.lines.hits(&aims[k], at, self.range, |r, _| {
                if let Some(hit) = hits.get_mut(count) {
                    *hit = r * r;
                    count += 1;
                }
            });
            if single {
                let least = hits[start..count].iter().fold(f64::INFINITY, |a, &b| a.min(b));
                *sum += self.nearest(least);
            }
            ends[k] = count;
        }
        if single {
            return;
        }
        let scale = -0.5 * self.information;
        // Whole lanes; what is behind the last hit is not used.
        let whole = count.next_multiple_of(8).min(hits.len());
        hits[..whole].iter_mut().for_each(|hit| *hit = math::exp_fast(*hit * scale));
        let mut start = 0;
        for end in &ends[..n] {
            let strengths = hits[start..*end].iter().fold(0.0, |a, b| a + b);
            start = *end;
            *product *= 1.0 + self.beta * strengths;
            if *product > LARGE {
                *sum += math::ln(*product);
                *product = 1.0;
            }
        }
    }

    /// Logarithm against clutter of a normal whose nearest edge has this squared distance.
    #[inline(always)]
    fn nearest(&self, squared: f64) -> f64 {
        (self.log_beta - 0.5 * self.information * squared).max(0.0)
    }

    /// Calls `f` with every contour point, the edges on its normal with the probabilities that they are the contour's, and
    /// the logarithm of the normal against clutter.
    pub(super) fn each(&self, posed: &W::Posed<'_>, mut f: impl FnMut(Place, &[Hit], f64)) {
        let mut hits = [Hit::default(); MOST_HITS];
        places::<P, W>(posed, &self.contour, |place| {
            let mut count = 0;
            self.lines.each(place.y, place.normal, self.range, |residual, at| {
                if let Some(hit) = hits.get_mut(count) {
                    *hit = Hit { residual, at, strength: 0.0 };
                    count += 1;
                }
            });
            let hits = &mut hits[..count];
            let (factor, logarithm) = self.ratio(&place);
            match self.hypotheses {
                Hypotheses::Multiple => {
                    for hit in hits.iter_mut() {
                        let exponent = -0.5 * self.information * hit.residual * hit.residual;
                        hit.strength = self.beta * math::exp_fast(exponent) / factor;
                    }
                    f(place, hits, math::ln(factor));
                }
                Hypotheses::Single => {
                    let nearest =
                        hits.iter_mut().min_by(|a, b| a.residual.abs().total_cmp(&b.residual.abs()));
                    if let Some(hit) = nearest {
                        hit.strength = if logarithm > 0.0 { 1.0 } else { 0.0 };
                    }
                    f(place, hits, logarithm);
                }
            }
        });
    }

    /// Calls `f(residual, Jacobian, probability)` for every edge that may be the contour's; returns the cost, with τ.
    ///
    /// A normal turns with the pose, `∂n = −t ω`, so that `r = n · (m − y)` has the derivative `−n · ∂y − (t · (m − y)) ω`.
    fn rows(&self, at: &P, mut f: impl FnMut(f64, &Tangent<P>, f64)) -> f64 {
        let posed = self.warp.at(at);
        let mut sum = 0.0;
        self.each(&posed, |place, hits, logarithm| {
            sum += logarithm;
            if hits.iter().all(|h| h.strength == 0.0) {
                return;
            }
            let Some((own, turn)) = place.derivatives::<P, W>(&posed, &self.contour) else { return };
            let tangent = place.tangent();
            for hit in hits.iter().filter(|h| h.strength > 0.0) {
                let sideways = tangent.dot(&(hit.at - place.y));
                f(hit.residual, &(&own + &turn * sideways), hit.strength);
            }
        });
        -self.weight * sum
    }
}

impl<P: Manifold, W: Warp<P>> Measurement<P> for ContourLikelihood<P, W>
where
    DefaultAllocator: Alloc<P::D>,
{
    fn log_likelihoods(&self, poses: &[P], out: &mut [f64]) {
        with_rows(MOST_HITS, |rows| {
            let hits = rows.as_flattened_mut();
            for (pose, l) in poses.iter().zip(out) {
                *l = self.log_likelihood(pose, hits);
            }
        });
    }

    /// One row for every edge on every normal, weighted by the probability that it is the contour's.
    fn residuals(&self, at: &P, out: &mut Linearized<P>) {
        out.clear();
        let variance = 1.0 / (self.information * self.weight);
        self.rows(at, |r, j, probability| out.push(r, j.clone(), variance, probability));
    }

    fn normal_equations(&self, at: &P, out: &mut NormalEquations<P>) {
        out.clear();
        let information = self.information * self.weight;
        let cost = self.rows(at, |r, j, probability| out.add(r, j, information * probability));
        out.cost = cost;
    }

    fn quality(&self, at: &P) -> Quality {
        let mut q = Quality::default();
        let (mut squares, mut log_ratio) = (0.0, 0.0);
        self.each(&self.warp.at(at), |_, hits, logarithm| {
            q.expected += 1;
            log_ratio += logarithm;
            let (probability, square) = hits
                .iter()
                .fold((0.0, 0.0), |(p, s), h| (p + h.strength, s + h.strength * h.residual * h.residual));
            if probability > 0.5 {
                q.inliers += 1;
                squares += square / probability * self.information;
            }
        });
        let expected = (q.expected as f64).max(1.0);
        q.inlier_ratio = q.inliers as f64 / expected;
        q.log_ratio = log_ratio / expected;
        q.normalized_rms = (squares / (q.inliers as f64).max(1.0)).sqrt();
        q
    }

    fn level(&self) -> Level {
        Level::Pixel
    }
}
