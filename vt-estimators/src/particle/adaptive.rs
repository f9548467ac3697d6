//! Number of particles by what they have to represent.

use nalgebra::DefaultAllocator;
use vt_core::manifold::{Alloc, Manifold};
use vt_core::math;

use crate::resampling::kld_number;

/// KLD-sampling (D. Fox, "Adapting the sample size in particle filters through KLD-sampling", 2003): as many particles as
/// keep the Kullback–Leibler distance between the belief, as a histogram, and its estimate below a bound. In every
/// prediction the particles that resampling chooses are counted by the bins in which they lie, and as many as
/// [`kld_number`] says are drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct Adaptive {
    /// Width of a bin in each coordinate of the pose's tangent space.
    pub widths: Vec<f64>,
    /// Bound `ε` of the distance, in nats.
    pub epsilon: f64,
    /// Probability with which it holds.
    pub confidence: f64,
    /// Fewest particles.
    pub least: usize,
    /// Most particles.
    pub most: usize,
}

impl Adaptive {
    /// Number of particles for those of `poses` that were `chosen` (ascending).
    pub(super) fn count<P: Manifold>(&self, poses: &[P], chosen: &[usize], keys: &mut Vec<u64>) -> usize
    where
        DefaultAllocator: Alloc<P::D>,
    {
        let bins = self.bins(poses, chosen, keys);
        let enough = kld_number(bins, self.epsilon, math::normal_quantile(self.confidence));
        let least = self.least.max(1);
        (enough.ceil() as usize).clamp(least, self.most.max(least))
    }

    /// Number of bins that hold at least one of the chosen poses, in the tangent space at the first of them,
    /// which lies in the middle of its bin.
    pub(super) fn bins<P: Manifold>(&self, poses: &[P], chosen: &[usize], keys: &mut Vec<u64>) -> usize
    where
        DefaultAllocator: Alloc<P::D>,
    {
        keys.clear();
        let Some(at) = chosen.first().and_then(|&k| poses.get(k)) else { return 0 };
        let mut last = usize::MAX;
        for &k in chosen {
            if k != last {
                let offset = at.local(&poses[k]);
                // Distinct bins have distinct keys but for a chance of some 2⁻⁶⁴ a pair.
                let key = offset.iter().zip(&self.widths).fold(0_u64, |key, (x, width)| {
                    let bin = (x / width).round() as i64;
                    mix(key ^ bin as u64)
                });
                keys.push(key);
                last = k;
            }
        }
        keys.sort_unstable();
        keys.dedup();
        keys.len()
    }
}

/// A bijection that spreads its argument over all bits (finaliser of SplitMix64).
fn mix(x: u64) -> u64 {
    let x = x.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    x ^ (x >> 31)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use nalgebra::Vector2;
    use proptest::prelude::*;
    use vt_core::lie::Vector;

    proptest! {
        #![proptest_config(ProptestConfig { cases: 100, rng_seed: proptest::test_runner::RngSeed::Fixed(4), ..Default::default() })]

        #[test]
        fn bins_are_counted_once(points in prop::collection::vec((-3.0..3.0f64, -30.0..30.0f64), 1..200)) {
            let poses: Vec<_> = points.iter().map(|(x, y)| Vector(Vector2::new(*x, *y))).collect();
            let adaptive = Adaptive { widths: vec![0.5, 4.0], epsilon: 0.05, confidence: 0.99, least: 1, most: 1_000_000 };
            // Twice each: copies do not count again.
            let chosen: Vec<usize> = (0..poses.len()).flat_map(|k| [k, k]).collect();
            let exact: BTreeSet<_> = points
                .iter()
                .map(|(x, y)| (((x - points[0].0) / 0.5).round() as i64, ((y - points[0].1) / 4.0).round() as i64))
                .collect();
            let mut keys = vec![];
            prop_assert_eq!(adaptive.bins(&poses, &chosen, &mut keys), exact.len());
            let number = kld_number(exact.len(), 0.05, math::normal_quantile(0.99)).ceil() as usize;
            prop_assert_eq!(adaptive.count(&poses, &chosen, &mut keys), number);
            let bounded = Adaptive { least: 50, most: 70, ..adaptive };
            prop_assert_eq!(bounded.count(&poses, &chosen, &mut keys), number.clamp(50, 70));
        }
    }
}
