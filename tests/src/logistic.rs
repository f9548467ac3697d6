//! Logistic regression and the receiver operating characteristic, for loss detection.

use nalgebra::{SMatrix, SVector};
use vt_core::math;

/// Weights `w` of `p = 1 / (1 + exp(−w·x))` that fit the examples best, by Newton's method (iteratively reweighted
/// least squares) with a ridge of `ridge` on all weights but the first, in units of the signs' own deviations. The
/// first sign must be 1 everywhere. `None` when the equations cannot be solved.
pub fn fit<const N: usize>(examples: &[(SVector<f64, N>, bool)], ridge: f64) -> Option<SVector<f64, N>> {
    let n = examples.len() as f64;
    let mean = examples.iter().map(|(x, _)| x).sum::<SVector<f64, N>>() / n;
    let squares =
        examples.iter().map(|(x, _)| (x - mean).component_mul(&(x - mean))).sum::<SVector<f64, N>>();
    let variance = squares / n;
    let mut w = SVector::<f64, N>::zeros();
    for _ in 0..100 {
        let mut gradient = SVector::<f64, N>::zeros();
        let mut hessian = SMatrix::<f64, N, N>::zeros();
        for (x, lost) in examples {
            let p = math::logistic(w.dot(x));
            gradient += x * (f64::from(*lost) - p);
            hessian += x * x.transpose() * (p * (1.0 - p));
        }
        for k in 1..N {
            gradient[k] -= ridge * variance[k] * w[k];
            hessian[(k, k)] += ridge * variance[k];
        }
        let step = hessian.cholesky()?.solve(&gradient);
        w += step;
        if step.component_mul(&variance.map(f64::sqrt)).amax().max(step[0].abs()) < 1e-9 {
            return Some(w);
        }
    }
    None
}

/// Corners of the curve of false against true positive rates, from (0, 0) to (1, 1), when everything above a falling
/// threshold counts as positive. Of `(score, positive)` pairs; empty when one kind is missing.
pub fn roc(scores: &[(f64, bool)]) -> Vec<[f64; 2]> {
    let mut sorted = scores.to_vec();
    sorted.sort_unstable_by(|a, b| b.0.total_cmp(&a.0));
    let positives = sorted.iter().filter(|s| s.1).count() as f64;
    let negatives = sorted.len() as f64 - positives;
    if positives == 0.0 || negatives == 0.0 {
        return vec![];
    }
    let mut at = [0.0, 0.0];
    let mut corners = vec![at];
    for equal in sorted.chunk_by(|a, b| a.0 == b.0) {
        for (_, positive) in equal {
            at[usize::from(*positive)] += 1.0;
        }
        corners.push([at[0] / negatives, at[1] / positives]);
    }
    corners
}

/// Area under such a curve: the probability that a positive scores above a negative, ties counted half.
pub fn area(roc: &[[f64; 2]]) -> f64 {
    roc.windows(2).map(|w| (w[1][0] - w[0][0]) * (w[1][1] + w[0][1]) / 2.0).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use vt_core::random::{Random, Stream};

    #[test]
    fn weights_that_made_the_examples_are_found_again() {
        let truth = SVector::from([-1.0, 2.0, -0.5]);
        let mut random = Random::new(0, Stream::Sim, 0, 0, 0);
        let examples: Vec<_> = (0..20_000)
            .map(|_| {
                let x = SVector::from([1.0, random.normal(), 3.0 * random.normal()]);
                (x, random.uniform() < math::logistic(truth.dot(&x)))
            })
            .collect();
        let found = fit(&examples, 1.0).unwrap();
        assert!((found - truth).amax() < 0.1, "{found}");
        assert!(fit::<3>(&[], 1.0).is_none());
    }

    #[test]
    fn the_area_is_the_share_of_pairs_in_order() {
        let mut random = Random::new(1, Stream::Sim, 0, 0, 0);
        let scores: Vec<(f64, bool)> =
            (0..60).map(|k| (((random.normal() + f64::from(k % 2)) * 4.0).round(), k % 2 == 1)).collect();
        let mut pairs = 0.0;
        for (a, _) in scores.iter().filter(|s| s.1) {
            for (b, _) in scores.iter().filter(|s| !s.1) {
                pairs += if a > b { 1.0 } else { 0.5 * f64::from(u8::from(a == b)) };
            }
        }
        assert!((area(&roc(&scores)) - pairs / 900.0).abs() < 1e-12);
        assert!(roc(&[(1.0, true)]).is_empty());
    }
}
