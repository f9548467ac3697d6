//! Resampling of weighted particles.
//!
//! Every scheme draws particle `i` on average `n wᵢ` times. What differs is the variance of these numbers (R. Douc,
//! O. Cappé, E. Moulines, "Comparison of resampling schemes for particle filtering", 2005):
//!
//! | scheme | copies of `i` | random numbers |
//! |---|---|---|
//! | [`Resampling::Multinomial`] | binomial | `n + 1` |
//! | [`Resampling::Residual`] | at least `⌊n wᵢ⌋`, the rest multinomial | one more than the rest |
//! | [`Resampling::Stratified`] | one draw in each `n`-th of the sum of weights | `n` |
//! | [`Resampling::Systematic`] | `⌊n wᵢ⌋` or `⌈n wᵢ⌉` | 1 |
//! | [`Resampling::Deterministic`] | as systematic; on average over offsets only | none |

use vt_core::math;
use vt_core::random::Random;

/// How particles are drawn again in proportion to their weights.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Resampling {
    /// Independent draws (Gordon, Salmond and Smith 1993).
    Multinomial,
    /// One draw in each stratum of equal weight (Kitagawa 1996).
    Stratified,
    /// One random offset for all strata (Carpenter, Clifford and Fearnhead 1999).
    Systematic,
    /// The integer parts of `n w` for certain, multinomial draws of what is left (Liu and Chen 1998).
    Residual,
    /// Systematic with the fixed offset ½ (Kitagawa 1996): no randomness at all; the paper's "deterministic".
    #[default]
    Deterministic,
}

impl Resampling {
    /// Fills `out` with the indices of `count` particles, in ascending order; `weights` sum to 1. Particles without weight
    /// are never drawn.
    pub fn draw(self, weights: &[f64], count: usize, random: &mut Random, out: &mut Vec<usize>) {
        out.clear();
        let n = count as f64;
        match self {
            Self::Deterministic => comb(weights, count, 0.5, out),
            Self::Systematic => comb(weights, count, random.uniform(), out),
            Self::Stratified => {
                pick(weights.iter().copied(), (0..count).map(|k| (k as f64 + random.uniform()) / n), out);
            }
            Self::Multinomial => pick(weights.iter().copied(), sorted_uniforms(count, random), out),
            Self::Residual => {
                for (index, w) in weights.iter().enumerate() {
                    out.extend(core::iter::repeat_n(index, (w * n) as usize));
                }
                let rest = count.saturating_sub(out.len());
                let fractions = weights.iter().map(|w| w * n - (w * n).floor());
                let total: f64 = fractions.clone().sum();
                pick(fractions.map(|f| f / total), sorted_uniforms(rest, random), out);
                out.truncate(count);
                out.sort_unstable();
            }
        }
    }
}

/// Appends the indices in whose shares of the sum of weights the points `(k + offset) / count` lie.
fn comb(weights: &[f64], count: usize, offset: f64, out: &mut Vec<usize>) {
    let (mut sum, mut last) = (0.0, 0);
    for (index, w) in weights.iter().enumerate() {
        sum += w;
        // Number of points below the sum.
        let end = ((sum * count as f64 + (1.0 - offset)) as usize).min(count);
        if end > out.len() {
            out.resize(end, index);
        }
        if *w > 0.0 {
            last = index;
        }
    }
    // What rounding of the sum leaves over.
    out.resize(count, last);
}

/// Appends, for each of the ascending `points` in `[0, 1]`, the index in whose share of the sum of weights it lies.
fn pick(weights: impl Iterator<Item = f64>, mut points: impl Iterator<Item = f64>, out: &mut Vec<usize>) {
    let mut point = points.next();
    let (mut sum, mut last) = (0.0, 0);
    for (index, w) in weights.enumerate().filter(|(_, w)| *w > 0.0) {
        sum += w;
        last = index;
        while let Some(u) = point.filter(|u| *u < sum) {
            let _ = u;
            out.push(index);
            point = points.next();
        }
    }
    // What rounding of the sum leaves over.
    out.extend(point.into_iter().chain(points).map(|_| last));
}

/// `count` independent uniform numbers in ascending order, by exponential spacings; the generator moves on.
fn sorted_uniforms(count: usize, random: &mut Random) -> impl Iterator<Item = f64> + use<> {
    let spacing = |r: &mut Random| -math::ln(1.0 - r.uniform());
    let mut again = random.clone();
    let total: f64 = (0..=count).map(|_| spacing(random)).sum();
    (0..count).scan(0.0, move |sum, _| {
        *sum += spacing(&mut again);
        Some(*sum / total)
    })
}

/// Effective number of particles `1 / Σ w²` of normalised weights (Kong, Liu and Wong 1994).
pub fn effective_number(weights: &[f64]) -> f64 {
    1.0 / weights.iter().map(|w| w * w).sum::<f64>()
}

/// Number of particles with which, at the normal quantile `z` of the confidence, the Kullback–Leibler distance between a
/// discrete distribution over `bins` occupied bins and its estimate stays below `epsilon` (D. Fox, "Adapting the sample
/// size in particle filters through KLD-sampling", 2003):
///
/// ```text
/// n = (k − 1) / 2ε · (1 − 2 / (9 (k − 1)) + √(2 / (9 (k − 1))) z)³
/// ```
///
/// 1 for fewer than two bins.
///
/// ```
/// let z = vt_core::math::normal_quantile(0.99);
/// assert_eq!(vt_estimators::resampling::kld_number(20, 0.05, z).round(), 362.0);
/// ```
pub fn kld_number(bins: usize, epsilon: f64, z: f64) -> f64 {
    if bins < 2 {
        return 1.0;
    }
    let k = bins as f64 - 1.0;
    let share = 2.0 / (9.0 * k);
    let root = 1.0 - share + share.sqrt() * z;
    k / (2.0 * epsilon) * root * root * root
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use vt_core::random::Stream;

    const ALL: [Resampling; 5] = [
        Resampling::Multinomial,
        Resampling::Stratified,
        Resampling::Systematic,
        Resampling::Residual,
        Resampling::Deterministic,
    ];

    fn normalized(raw: &[f64]) -> Vec<f64> {
        let total: f64 = raw.iter().sum();
        raw.iter().map(|w| w / total).collect()
    }

    fn copies(kind: Resampling, weights: &[f64], count: usize, case: u64) -> Vec<f64> {
        let mut drawn = vec![];
        kind.draw(weights, count, &mut Random::new(case, Stream::Resample, 0, 0, 0), &mut drawn);
        assert!(drawn.is_sorted() && drawn.len() == count);
        let mut copies = vec![0.0; weights.len()];
        drawn.iter().for_each(|&d| copies[d] += 1.0);
        copies
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 100, rng_seed: proptest::test_runner::RngSeed::Fixed(2), ..Default::default() })]

        /// Systematic schemes draw a particle of weight `w` `⌊nw⌋` or `⌈nw⌉` times, residual at least `⌊nw⌋` times,
        /// stratified by less than two off; particles without weight are never drawn.
        #[test]
        fn copies_keep_to_the_bounds_of_their_scheme(raw in prop::collection::vec(prop_oneof![Just(0.0), 0.0..1.0f64], 1..60), count in 1..90_usize, seed: u64) {
            prop_assume!(raw.iter().sum::<f64>() > 1e-3);
            let weights = normalized(&raw);
            for kind in ALL {
                for (found, w) in copies(kind, &weights, count, seed).iter().zip(&weights) {
                    let mean = w * count as f64;
                    let fits = match kind {
                        Resampling::Systematic | Resampling::Deterministic => (found - mean).abs() < 1.0 + 1e-9,
                        Resampling::Stratified => (found - mean).abs() < 2.0 + 1e-9,
                        Resampling::Residual => *found >= (mean - 1e-9).floor(),
                        Resampling::Multinomial => true,
                    };
                    prop_assert!(fits && (*w > 0.0 || *found == 0.0), "{kind:?}: {found} copies, mean {mean}");
                }
            }
        }

        #[test]
        fn deterministic_is_systematic_at_one_half(raw in prop::collection::vec(0.01..1.0f64, 1..40), count in 1..60_usize) {
            let weights = normalized(&raw);
            let mut at_half = vec![];
            pick(weights.iter().copied(), (0..count).map(|k| (k as f64 + 0.5) / count as f64), &mut at_half);
            let mut drawn = vec![];
            Resampling::Deterministic.draw(&weights, count, &mut Random::new(1, Stream::Resample, 0, 0, 0), &mut drawn);
            prop_assert_eq!(drawn, at_half);
        }

        /// The bounds of Fox: more bins, less error or more confidence need more particles.
        #[test]
        fn the_kld_number_grows_with_bins_and_confidence(bins in 2..2000_usize, epsilon in 0.005..0.5f64, z in 0.5..4.0f64) {
            let n = kld_number(bins, epsilon, z);
            prop_assert!(n > 0.0 && kld_number(bins + 1, epsilon, z) > n);
            prop_assert!(kld_number(bins, epsilon, z + 0.1) > n && kld_number(bins, epsilon * 0.9, z) > n);
            // It is the quantile of χ² with k - 1 degrees over 2ε (Wilson and Hilferty 1931).
            let exact = math::chi_square_quantile(math::normal_cdf(z), bins as f64 - 1.0) / (2.0 * epsilon);
            prop_assert!((n / exact - 1.0).abs() < if bins > 30 { 0.01 } else { 0.1 }, "{n} {exact}");
        }
    }

    /// Means of the copies over 20,000 draws within 4.5 standard errors of `n w`, and no variance above that of
    /// multinomial draws, `n w (1 − w)`.
    #[test]
    fn every_random_scheme_is_unbiased() {
        let weights = normalized(&[0.3, 0.01, 2.0, 0.7, 1.3, 0.0, 0.9, 0.05, 1.1, 0.4]);
        let runs = 20_000_u32;
        for count in [10, 17] {
            for kind in &ALL[..4] {
                let (mut sums, mut squares) = ([0.0; 10], [0.0; 10]);
                for case in 0..runs {
                    for (k, c) in copies(*kind, &weights, count, case.into()).iter().enumerate() {
                        sums[k] += c;
                        squares[k] += c * c;
                    }
                }
                for (k, w) in weights.iter().enumerate() {
                    let (n, m) = (count as f64, f64::from(runs));
                    let (mean, expected) = (sums[k] / m, n * w);
                    let variance = squares[k] / m - mean * mean;
                    let multinomial = n * w * (1.0 - w);
                    let error = (multinomial / m).sqrt();
                    assert!(
                        (mean - expected).abs() <= 4.5 * error,
                        "{kind:?}, {k}: {mean}, expected {expected}"
                    );
                    // A variance is known to about √(2/m), a little more for rare copies.
                    assert!(
                        variance <= multinomial * 1.06 + 1e-3,
                        "{kind:?}, {k}: {variance} above {multinomial}"
                    );
                    if *kind == Resampling::Multinomial {
                        assert!(variance >= multinomial * 0.94 - 1e-3, "{k}: {variance} of {multinomial}");
                    }
                }
            }
        }
    }

    #[test]
    fn effective_number_is_n_for_equal_and_one_for_single_weights() {
        assert!((effective_number(&[0.25; 4]) - 4.0).abs() < 1e-12);
        assert_eq!(effective_number(&[0.0, 1.0, 0.0]), 1.0);
    }

    #[test]
    fn few_bins_need_one_particle() {
        assert_eq!((kld_number(0, 0.05, 2.3), kld_number(1, 0.05, 2.3)), (1.0, 1.0));
    }
}
