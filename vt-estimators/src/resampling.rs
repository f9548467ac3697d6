//! Resampling of weighted particles.

use vt_core::random::Random;

/// How particles are drawn again in proportion to their weights.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Resampling {
    /// Systematic with the fixed offset ½ (Kitagawa 1996): no randomness at all; the paper's "deterministic".
    #[default]
    Deterministic,
    /// Systematic with one random offset.
    Systematic,
}

impl Resampling {
    /// Fills `out` with the indices of the chosen particles, in ascending order; `weights` sum to 1.
    pub fn draw(self, weights: &[f64], random: &mut Random, out: &mut Vec<usize>) {
        let n = weights.len();
        let offset = match self {
            Self::Deterministic => 0.5,
            Self::Systematic => random.uniform(),
        };
        out.clear();
        let mut index = 0;
        let mut sum = weights.first().copied().unwrap_or(0.0);
        for k in 0..n {
            let u = (k as f64 + offset) / n as f64;
            while sum < u && index + 1 < n {
                index += 1;
                sum += weights[index];
            }
            out.push(index);
        }
    }
}

/// Effective number of particles `1 / Σ w²` of normalised weights (Kong, Liu and Wong 1994).
pub fn effective_number(weights: &[f64]) -> f64 {
    1.0 / weights.iter().map(|w| w * w).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use vt_core::random::Stream;

    proptest! {
        #![proptest_config(ProptestConfig { cases: 100, rng_seed: proptest::test_runner::RngSeed::Fixed(2), ..Default::default() })]

        /// A particle of weight `w` is drawn `⌊nw⌋` or `⌈nw⌉` times.
        #[test]
        fn systematic_counts_are_the_integers_next_to_their_mean(raw in prop::collection::vec(0.0..1.0f64, 1..60), seed: u64) {
            let total: f64 = raw.iter().sum();
            prop_assume!(total > 1e-3);
            let weights: Vec<f64> = raw.iter().map(|w| w / total).collect();
            let n = weights.len();
            for kind in [Resampling::Deterministic, Resampling::Systematic] {
                let mut drawn = vec![];
                kind.draw(&weights, &mut Random::new(seed, Stream::Resample, 0, 0, 0), &mut drawn);
                prop_assert_eq!(drawn.len(), n);
                for (k, w) in weights.iter().enumerate() {
                    let count = drawn.iter().filter(|&&d| d == k).count() as f64;
                    prop_assert!((count - w * n as f64).abs() < 1.0 + 1e-9, "{count} of {}", w * n as f64);
                }
            }
        }
    }

    #[test]
    fn effective_number_is_n_for_equal_and_one_for_single_weights() {
        assert!((effective_number(&[0.25; 4]) - 4.0).abs() < 1e-12);
        assert_eq!(effective_number(&[0.0, 1.0, 0.0]), 1.0);
    }
}
