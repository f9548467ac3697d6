//! Random numbers that depend on what they are for, not on when they are drawn.
//!
//! A shared generator gives other numbers when threads race or when one more target appears. Here every use has an
//! address (seed, stream, target, frame, particle), and the n-th draw at an address is a fixed function of the
//! address and n: same seed, same bytes, whatever the order and the number of threads.
//!
//! The function is Philox 4×32 with ten rounds (J. Salmon, M. Moraes, R. Dror, D. Shaw, "Parallel random numbers: as
//! easy as 1, 2, 3", 2011), a counter-based generator that passes the usual test batteries. Seed, stream and target
//! are mixed into its key; frame, particle and draw are its counter.
//!
//! ```
//! use vt_core::random::{Source, Stream};
//! let source = Source::new(7, Stream::Predict, 0);
//! let mut a = source.at(12, 3); // frame 12, particle 3
//! let (x, y) = (a.normal(), a.normal());
//! let mut again = source.at(12, 3);
//! assert_eq!((x, y), (again.normal(), again.normal()));
//! ```

use crate::batch::{LANES, Row, vectorized};
use crate::math;

/// What random numbers are for; different uses never share numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Stream {
    /// Process noise of predictions.
    Predict = 0,
    /// Resampling of particles.
    Resample = 1,
    /// Re-initialisation of lost targets.
    Reinit = 2,
    /// Simulated scenes and sensors.
    Sim = 3,
    /// Moves of particles within a correction.
    Move = 4,
    /// Roughening of particles.
    Roughen = 5,
}

/// All random numbers of one use by one target.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Source {
    key: [u32; 2],
}

impl Source {
    /// The numbers for the use `stream` of the target with this index, in a run with this seed.
    pub fn new(seed: u64, stream: Stream, target: u64) -> Self {
        // A block of the same function under the seed: distinct uses get unrelated keys.
        let [t0, t1] = halves(target);
        let [a, b, ..] = philox([t0, t1, stream as u32, u32::from_be_bytes(*b"key!")], halves(seed));
        Self { key: [a, b] }
    }

    /// The numbers of one particle (0 where there are no particles) in one frame, from the first draw on.
    pub fn at(&self, frame: u64, particle: u32) -> Random {
        Random { key: self.key, frame, particle, draw: 0, block: [0; 2] }
    }

    /// Standard normal numbers of [`LANES`] particles from the particle `first` on: the lanes of row `r` hold number `r` of
    /// each. A fixed function of the address, several times faster than [`Random::normal`], and other numbers.
    ///
    /// By the transformation of Box and Muller (1958) from 32 bits each for radius and angle: distinct magnitudes up to
    /// 6.7, each to about one part in 10⁸.
    pub fn normal_rows(&self, frame: u64, first: u32, rows: &mut [Row]) {
        // Under another key than the numbers of `at`.
        let key = [self.key[0] ^ 0x524F_5753, self.key[1]];
        for (block, rows) in rows.chunks_mut(4).enumerate() {
            let mut bits = [[0; LANES]; 4];
            vectorized(
                #[inline(always)]
                || {
                    for (k, particle) in (0..LANES).zip(first..) {
                        let counter = [block as u32, particle, frame as u32, (frame >> 32) as u32];
                        let [a, b, c, d] = philox(counter, key);
                        [bits[0][k], bits[1][k], bits[2][k], bits[3][k]] = [a, b, c, d];
                    }
                    for (rows, bits) in rows.chunks_mut(2).zip(bits.chunks(2)) {
                        let mut pair = [[0.0; LANES]; 2];
                        for k in 0..LANES {
                            [pair[0][k], pair[1][k]] = math::normal_pair(bits[0][k], bits[1][k]);
                        }
                        rows.copy_from_slice(&pair[..rows.len()]);
                    }
                },
            );
        }
    }
}

/// A sequence of random numbers at one address.
#[derive(Clone, Debug)]
pub struct Random {
    key: [u32; 2],
    frame: u64,
    particle: u32,
    /// Number of draws made; two draws share a block of the generator.
    draw: u64,
    block: [u64; 2],
}

impl Random {
    /// The sequence at this address; [`Source`] saves work where many particles share seed, stream and target.
    pub fn new(seed: u64, stream: Stream, target: u64, frame: u64, particle: u32) -> Self {
        Source::new(seed, stream, target).at(frame, particle)
    }

    /// 64 random bits. An address has 2³³ draws; then they repeat.
    #[inline]
    pub fn next_u64(&mut self) -> u64 {
        if self.draw.is_multiple_of(2) {
            let [f0, f1] = halves(self.frame);
            let [a, b, c, d] = philox([(self.draw >> 1) as u32, self.particle, f0, f1], self.key);
            self.block = [u64::from(a) | u64::from(b) << 32, u64::from(c) | u64::from(d) << 32];
        }
        let bits = self.block[(self.draw & 1) as usize];
        self.draw += 1;
        bits
    }

    /// Number of draws made so far.
    pub fn draws(&self) -> u64 {
        self.draw
    }

    /// A uniform number in `[0, 1)`, a multiple of 2⁻⁵³. One draw.
    #[inline]
    pub fn uniform(&mut self) -> f64 {
        (self.next_u64() >> 11) as f64 * (1.0 / (1_u64 << 53) as f64)
    }

    /// A standard normal number, by inversion: one draw each, so that the n-th number never depends on rejections.
    #[inline]
    pub fn normal(&mut self) -> f64 {
        // The middle of the cell, so that 0 and 1 cannot occur; 52 bits, so that the middle is a number.
        math::normal_quantile(((self.next_u64() >> 12) as f64 + 0.5) * (1.0 / (1_u64 << 52) as f64))
    }

    /// Fills `out` with standard normal numbers.
    pub fn normals(&mut self, out: &mut [f64]) {
        for x in out {
            *x = self.normal();
        }
    }

    /// A uniform index below `n`, without bias beyond 2⁻⁶⁴·n; 0 for `n = 0`. One draw.
    #[inline]
    pub fn index(&mut self, n: usize) -> usize {
        ((u128::from(self.next_u64()) * n as u128) >> 64) as usize
    }
}

/// Low and high half.
#[inline(always)]
fn halves(x: u64) -> [u32; 2] {
    [x as u32, (x >> 32) as u32]
}

/// One block of Philox 4×32-10.
#[inline(always)]
fn philox(mut counter: [u32; 4], mut key: [u32; 2]) -> [u32; 4] {
    for _ in 0..10 {
        let [lo0, hi0] = halves(0xD251_1F53 * u64::from(counter[0]));
        let [lo1, hi1] = halves(0xCD9E_8D57 * u64::from(counter[2]));
        counter = [hi1 ^ counter[1] ^ key[0], lo1, hi0 ^ counter[3] ^ key[1], lo0];
        // Weyl sequences of the golden ratio and √3 - 1.
        key = [key[0].wrapping_add(0x9E37_79B9), key[1].wrapping_add(0xBB67_AE85)];
    }
    counter
}

/// Points that fill the unit cube evenly, each next to none before it: an additive recurrence with the powers of the
/// root of `x^(n+1) = x + 1`, in one dimension the golden ratio (M. Roberts, "The unreasonable effectiveness of
/// quasirandom sequences", 2018).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LowDiscrepancy {
    step: f64,
}

impl LowDiscrepancy {
    /// The sequence in `n` dimensions.
    pub fn new(n: usize) -> Self {
        // A contraction by at least ½ a step.
        let root = (0..60).fold(1.5, |x, _| crate::math::pow(1.0 + x, 1.0 / (n as f64 + 1.0)));
        Self { step: 1.0 / root }
    }

    /// Coordinate `d` of point `k`, in (0, 1); point 0 is the centre.
    pub fn at(&self, k: u32, d: usize) -> f64 {
        (0.5 + f64::from(k) * crate::math::pow(self.step, d as f64 + 1.0)).fract().max(f64::EPSILON)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn published_answers_of_random123() {
        // kat_vectors of the Random123 distribution, lines philox4x32 10.
        for (counter, key, answer) in [
            ([0; 4], [0; 2], [0x6627e8d5, 0xe169c58d, 0xbc57ac4c, 0x9b00dbd8]),
            ([u32::MAX; 4], [u32::MAX; 2], [0x408f276d, 0x41c83b0e, 0xa20bc7c6, 0x6d5451fd]),
            (
                [0x243f6a88, 0x85a308d3, 0x13198a2e, 0x03707344],
                [0xa4093822, 0x299f31d0],
                [0xd16cfe09, 0x94fdcceb, 0x5001e420, 0x24126ea1],
            ),
        ] {
            assert_eq!(philox(counter, key), answer);
        }
    }

    #[test]
    fn moments_are_those_of_the_distributions() {
        const N: usize = 400_000;
        let (mut u, mut n) = ([0.0; 4], [0.0; 4]);
        let mut tail = 0;
        for particle in 0..N / 100 {
            let mut random = Random::new(1, Stream::Sim, 0, 5, particle as u32);
            for _ in 0..100 {
                let (x, z) = (random.uniform(), random.normal());
                assert!((0.0..1.0).contains(&x));
                tail += usize::from(z.abs() > 3.0);
                for (k, (a, b)) in u.iter_mut().zip(&mut n).enumerate() {
                    *a += (0..k).fold(x, |p, _| p * x) / N as f64;
                    *b += (0..k).fold(z, |p, _| p * z) / N as f64;
                }
            }
        }
        // Bounds of five standard errors.
        let sd = 5.0 / (N as f64).sqrt();
        for (k, m) in u.iter().enumerate() {
            assert!((m - 1.0 / (k as f64 + 2.0)).abs() < sd * 0.3, "uniform moment {}: {m}", k + 1);
        }
        for (k, (m, (mean, variance))) in
            n.iter().zip([(0.0, 1.0), (1.0, 2.0), (0.0, 15.0), (3.0, 96.0_f64)]).enumerate()
        {
            assert!((m - mean).abs() < sd * f64::sqrt(variance), "normal moment {}: {m}", k + 1);
        }
        assert!((tail as f64 - 0.0026998 * N as f64).abs() < 5.0 * (0.0027 * N as f64).sqrt(), "{tail}");
    }

    /// Moments, tails, independence of rows and lanes; the formula itself is tested beside it.
    #[test]
    fn rows_are_standard_normal_and_independent() {
        const FRAMES: u64 = 2000;
        let source = Source::new(9, Stream::Predict, 4);
        let count = (FRAMES as usize * LANES * 7) as f64;
        let (mut sums, mut tails) = ([0.0; 4], [0_u32; 3]);
        let mut products = [[0.0; 7]; 7];
        let mut neighbours = 0.0;
        for frame in 0..FRAMES {
            let mut rows = [[0.0; LANES]; 7];
            source.normal_rows(frame, 64, &mut rows);
            for x in rows.iter().flatten() {
                for (k, sum) in sums.iter_mut().enumerate() {
                    *sum += (0..k).fold(*x, |p, _| p * x) / count;
                }
                for (tail, bound) in tails.iter_mut().zip([1.0, 2.0, 3.0]) {
                    *tail += u32::from(x.abs() > bound);
                }
            }
            for (a, products) in rows.iter().zip(&mut products) {
                rows.iter().zip(products).for_each(|(b, sum)| *sum += crate::batch::dot(a, b));
                neighbours += a.windows(2).map(|w| w[0] * w[1]).sum::<f64>();
            }
        }
        // Five standard errors each.
        let error = 5.0 / count.sqrt();
        for (sum, (mean, variance)) in sums.iter().zip([(0.0, 1.0), (1.0, 2.0), (0.0, 15.0), (3.0, 96.0_f64)])
        {
            assert!((sum - mean).abs() < error * variance.sqrt(), "{sums:?}");
        }
        for (tail, bound) in tails.iter().zip([1.0, 2.0, 3.0]) {
            let p = 2.0 * math::normal_cdf(-bound);
            assert!((f64::from(*tail) / count - p).abs() < error * p.sqrt(), "{tail} beyond {bound}");
        }
        let n = FRAMES as f64 * LANES as f64;
        for (r, row) in products.iter().enumerate() {
            for (c, sum) in row.iter().enumerate().filter(|(c, _)| *c != r) {
                assert!(sum.abs() < 5.0 * n.sqrt(), "rows {r} and {c}: {}", sum / n);
            }
        }
        assert!(neighbours.abs() < 5.0 * count.sqrt(), "{neighbours}");
    }

    #[test]
    fn rows_depend_on_the_address_alone() {
        let source = Source::new(1, Stream::Predict, 0);
        let rows = |first, count| {
            let mut rows = vec![[0.0; LANES]; count];
            source.normal_rows(3, first, &mut rows);
            rows
        };
        let (at, shifted, few) = (rows(0, 6), rows(10, 6), rows(0, 3));
        for r in 0..6 {
            assert_eq!(at[r][10..], shifted[r][..LANES - 10]);
        }
        assert_eq!(at[..3], few[..]);
    }

    #[test]
    fn numbers_do_not_depend_on_the_order_of_creation() {
        let source = Source::new(42, Stream::Predict, 3);
        let forward: Vec<u64> = (0..50).map(|p| source.at(9, p).next_u64()).collect();
        let mut backward: Vec<u64> =
            (0..50).rev().map(|p| Random::new(42, Stream::Predict, 3, 9, p).next_u64()).collect();
        backward.reverse();
        assert_eq!(forward, backward);
        let mut a = source.at(9, 0);
        let mut b = source.at(9, 1);
        let mixed: Vec<u64> = (0..10).flat_map(|_| [a.next_u64(), b.next_u64()]).collect();
        let mut again = source.at(9, 1);
        assert!(mixed.iter().skip(1).step_by(2).all(|&x| x == again.next_u64()));
        assert_eq!(again.draws(), 10);
    }

    #[test]
    fn every_part_of_the_address_matters_and_nothing_correlates() {
        let base = (1_u64, Stream::Predict, 1_u64, 1_u64, 1_u32);
        let others = [
            (2, base.1, base.2, base.3, base.4),
            (1 << 40, base.1, base.2, base.3, base.4),
            (base.0, Stream::Resample, base.2, base.3, base.4),
            (base.0, base.1, 2, base.3, base.4),
            (base.0, base.1, 1 | 1 << 40, base.3, base.4),
            (base.0, base.1, base.2, 2, base.4),
            (base.0, base.1, base.2, 1 | 1 << 40, base.4),
            (base.0, base.1, base.2, base.3, 2),
        ];
        let series = |a: (u64, Stream, u64, u64, u32)| {
            let mut random = Random::new(a.0, a.1, a.2, a.3, a.4);
            (0..10_000).map(|_| random.normal()).collect::<Vec<f64>>()
        };
        let reference = series(base);
        for other in others {
            let correlation: f64 =
                series(other).iter().zip(&reference).map(|(x, y)| x * y).sum::<f64>() / 1e4;
            assert!(correlation.abs() < 0.05, "{other:?}: {correlation}");
        }
        // Neighbouring draws.
        let lag: f64 = reference.windows(2).map(|w| w[0] * w[1]).sum::<f64>() / 1e4;
        assert!(lag.abs() < 0.05, "{lag}");
    }

    #[test]
    fn indices_are_uniform() {
        let mut random = Random::new(3, Stream::Resample, 0, 0, 0);
        let mut counts = [0_i32; 7];
        for _ in 0..70_000 {
            counts[random.index(7)] += 1;
        }
        assert!(counts.iter().all(|c| (c - 10_000).abs() < 500), "{counts:?}");
        assert_eq!(random.index(0), 0);
    }

    /// Points fill the half volume at the centre and a quarter along every axis to within one standard deviation of
    /// chance, √(n p (1 − p)): 31.6 and 13.7.
    #[test]
    fn low_discrepancy_points_fill_the_cube_evenly() {
        for dims in [1, 2, 3, 6, 12] {
            let sequence = LowDiscrepancy::new(dims);
            assert!((0..dims).all(|d| sequence.at(0, d) == 0.5));
            let side = crate::math::pow(0.5, 1.0 / dims as f64);
            let inside = |k: u32| (0..dims).all(|d| (sequence.at(k, d) - 0.5).abs() < 0.5 * side);
            let count = (0..4000).filter(|&k| inside(k)).count() as f64;
            assert!((count - 2000.0).abs() < 32.0, "{dims} dimensions: {count} of 4000 in half the volume");
            for d in 0..dims {
                let low = (0..1000).filter(|&k| sequence.at(k, d) < 0.25).count();
                assert!(low.abs_diff(250) <= 13, "coordinate {d} of {dims}: {low} of 1000 in a quarter");
            }
        }
    }
}
