//! What weighted poses say: mean, covariance, mode.

use nalgebra::{DefaultAllocator, U1};
use vt_core::batch::{LANES, Row, dot, total, vectorized, with_rows};
use vt_core::belief::Gaussian;
use vt_core::dynamics::semidefinite_root;
use vt_core::manifold::{Alloc, Manifold, Square, Tangent};
use vt_core::math;

/// Poses that are summed one after the other; beyond, halves are summed apart, always the same ones.
const LEAF: usize = 4 * LANES;

/// Weight, weighted sum and (lower triangle of) weighted sum of squares of tangent vectors.
struct Moments<P: Manifold>
where
    DefaultAllocator: Alloc<P::D>,
{
    weight: f64,
    first: Tangent<P>,
    second: Square<P>,
}

/// Moments of the poses in the tangent space at `at`.
fn moments<P: Manifold>(at: &P, poses: &[P], weights: &[f64]) -> Moments<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    if poses.len() > LEAF {
        let half = (poses.len() / 2).next_multiple_of(LEAF);
        let ((p, q), (v, w)) = (poses.split_at(half), weights.split_at(half));
        let (mut a, b) = rayon::join(|| moments(at, p, v), || moments(at, q, w));
        a.weight += b.weight;
        a.first += b.first;
        a.second += b.second;
        return a;
    }
    let n = at.dim();
    let mut sum: Moments<P> =
        Moments { weight: 0.0, first: at.zero(), second: Square::<P>::zeros_generic(n, n) };
    with_rows(sum.first.len(), |rows| {
        for (poses, weights) in poses.chunks(LANES).zip(weights.chunks(LANES)) {
            at.local_each(poses, rows);
            let mut w = [0.0; LANES];
            w[..weights.len()].copy_from_slice(weights);
            vectorized(
                #[inline(always)]
                || add(&w, rows, &mut sum),
            );
        }
    });
    sum
}

#[inline(always)]
fn add<P: Manifold>(w: &Row, rows: &[Row], sum: &mut Moments<P>)
where
    DefaultAllocator: Alloc<P::D>,
{
    sum.weight += total(w);
    for (r, row) in rows.iter().enumerate() {
        let mut weighted = *w;
        weighted.iter_mut().zip(row).for_each(|(w, d)| *w *= d);
        sum.first[r] += total(&weighted);
        for (c, other) in rows.iter().take(r + 1).enumerate() {
            sum.second[(r, c)] += dot(&weighted, other);
        }
    }
}

/// Part of the deviations up to which the mean is exact; chance leaves `1 / √N`.
const EXACT: f64 = 1e-6;

/// Manifold mean and covariance of the poses, at least one of them with a weight.
///
/// Karcher's iteration. A step leaves an error that is smaller than the step at least as the step is smaller than the
/// deviations (or the step before); it ends where that is negligible. The covariance is that about the mean, in a chart
/// that is the last step away: with a relative error of about that step in radians.
pub(super) fn gaussian<P: Manifold>(poses: &[P], weights: &[f64]) -> Gaussian<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    let mut mean = P::centre(poses, weights).unwrap_or_else(|| poses[0].clone());
    let mut last = f64::INFINITY;
    for round in 1.. {
        let sum = moments(&mean, poses, weights);
        let step = sum.first / sum.weight;
        let mut covariance = sum.second / sum.weight;
        covariance.ger(-1.0, &step, &step, 1.0);
        covariance.fill_upper_triangle_with_lower_triangle();
        let (length, spread) = (step.norm(), covariance.trace().max(0.0).sqrt());
        mean = mean.retract(&step);
        let remaining = length * (length / last.min(spread)).min(1.0);
        if remaining <= EXACT * spread || length < 1e-14 || !length.is_finite() || round == 50 {
            return Gaussian { mean, covariance };
        }
        last = length;
    }
    Gaussian { covariance: Square::<P>::zeros_generic(mean.dim(), mean.dim()), mean }
}

/// Particles that are tried as starts.
const STARTS: usize = 16;

/// Mode of the Gaussian kernel density of the poses: mean shift (D. Comaniciu, P. Meer, 2002) from the mean and
/// from particles out of all parts of the weight, the best of them to the end.
pub(super) fn mode<P: Manifold>(poses: &[P], weights: &[f64], belief: &Gaussian<P>) -> P
where
    DefaultAllocator: Alloc<P::D>,
{
    let d = belief.mean.zero().len() as f64;
    let effective = crate::resampling::effective_number(weights);
    // Silverman's bandwidth in units of the deviations, for d dimensions.
    let width = math::pow(4.0 / ((d + 2.0) * effective), 1.0 / (d + 4.0));
    let root = semidefinite_root(&belief.covariance) * width;
    let kernel = |at: &P, pose: &P| -> (Tangent<P>, f64) {
        let step = at.local(pose);
        // Forward substitution; coordinates without variance do not count.
        let mut white = step.clone();
        for r in 0..white.len() {
            let known: f64 = (0..r).map(|c| root[(r, c)] * white[c]).sum();
            white[r] = if root[(r, r)] > 0.0 { (step[r] - known) / root[(r, r)] } else { 0.0 };
        }
        let density = math::exp_fast(-0.5 * white.norm_squared());
        (step, density)
    };
    let density = |at: &P| -> f64 { poses.iter().zip(weights).map(|(p, w)| w * kernel(at, p).1).sum() };
    // A pose of each share of the weight, so that starts lie in all modes.
    let mut starts = vec![belief.mean.clone()];
    let mut sum = 0.0;
    for (pose, w) in poses.iter().zip(weights) {
        sum += w * STARTS as f64;
        if sum > starts.len() as f64 - 0.5 {
            starts.push(pose.clone());
        }
    }
    let shift = |start: &P, rounds: usize| {
        let mut at = start.clone();
        for _ in 0..rounds {
            let mut step = Tangent::<P>::zeros_generic(at.dim(), U1);
            let mut total = 0.0;
            for (pose, w) in poses.iter().zip(weights) {
                let (d, k) = kernel(&at, pose);
                step.axpy(w * k, &d, 1.0);
                total += w * k;
            }
            if total <= 0.0 {
                return at;
            }
            step /= total;
            at = at.retract(&step);
            if step.norm() < 1e-9 * root.norm() {
                break;
            }
        }
        at
    };
    let rough = starts.iter().map(|s| shift(s, 3)).map(|at| (density(&at), at));
    let best = rough.reduce(|a, b| if b.0 > a.0 { b } else { a });
    let best = best.map_or_else(|| belief.mean.clone(), |(_, at)| at);
    shift(&best, 100)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector6;
    use vt_core::lie::{LieGroup, SE2, SE3};
    use vt_core::random::{Random, Stream};

    /// Mean and covariance against Karcher's iteration to the end and the sum of squares about it.
    fn check<P: Manifold>(at: &P, scale: f64, random: &mut Random)
    where
        DefaultAllocator: Alloc<P::D>,
    {
        for n in [1, 2, 63, 200, 1000] {
            let mut offset = || at.zero().map(|_: f64| scale * random.normal());
            let poses: Vec<P> = (0..n).map(|_| at.retract(&offset())).collect();
            let weights: Vec<f64> = (0..n).map(|_| 0.1 + random.uniform()).collect();
            let found = gaussian(&poses, &weights);
            let mean = P::mean(&poses, &weights).expect("points");
            let total: f64 = weights.iter().sum();
            let mut covariance = found.covariance.clone() * 0.0;
            for (pose, w) in poses.iter().zip(&weights) {
                let d = mean.local(pose);
                covariance.ger(w / total, &d, &d, 1.0);
            }
            assert!(mean.local(&found.mean).norm() <= 1e-5 * scale, "{n} at {scale}");
            assert!((covariance - &found.covariance).amax() <= 1e-3 * scale * scale, "{n} at {scale}");
        }
    }

    #[test]
    fn mean_and_covariance_are_those_of_the_definition() {
        let random = &mut Random::new(8, Stream::Sim, 0, 0, 0);
        for scale in [1e-6, 0.01, 0.1, 0.4] {
            check(&SE3::exp(&Vector6::new(1.0, -2.0, 0.5, 2.0, -0.5, 0.3)), scale, random);
            check(&SE2::new(1.0, -2.0, 3.1), scale, random);
            check(&vt_core::lie::Vector(Vector6::repeat(2.0)), scale, random);
        }
    }
}
