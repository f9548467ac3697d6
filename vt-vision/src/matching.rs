//! Pairs of descriptors that belong together: exact nearest neighbours with the tests that make them trustworthy.
//!
//! All dot products are computed, in numbers of 32 bits: those of bytes are integers below 2²⁴, so that no sum is rounded and its
//! order does not matter.

use rayon::prelude::*;
use vt_core::batch::vectorized;
use vt_core::error::ConfigError;

use crate::sift::{Descriptor, SIZE};

/// Descriptors of the second set that are compared at once.
const LANES: usize = 32;

/// Descriptors of the first set that are compared at once.
const ROWS: usize = 4;

/// Fewest descriptors of the first set that are one piece of work.
const PIECE: usize = 64;

/// Most pieces of work, each of which keeps eight bytes for every descriptor of the second set.
const MOST_PIECES: usize = 64;

/// When two descriptors are a pair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MatchParams {
    /// The nearest of the second set must be nearer than this part of the distance of the second nearest; 1 allows all but ties.
    pub ratio: f64,
    /// Whether the one of the first set must be the nearest of its nearest, too.
    pub mutual: bool,
}

impl Default for MatchParams {
    fn default() -> Self {
        Self { ratio: 0.8, mutual: true }
    }
}

impl MatchParams {
    /// Checks the parameters.
    ///
    /// # Errors
    /// [`ConfigError::Parameter`] unless `0 < ratio ≤ 1`.
    pub fn check(self) -> Result<Self, ConfigError> {
        if self.ratio > 0.0 && self.ratio <= 1.0 {
            return Ok(self);
        }
        Err(ConfigError::parameter("ratio", self.ratio, "above 0 and at most 1"))
    }
}

/// A pair of descriptors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Match {
    /// Index in the first set.
    pub first: usize,
    /// Index in the second set.
    pub second: usize,
    /// Squared distance of both.
    pub squared_distance: u32,
    /// Distance as a part of that of the second nearest: the smaller, the more certain.
    pub ratio: f64,
}

/// The two nearest of the second set.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Nearest {
    index: u32,
    distance: i32,
    second: i32,
}

/// Matching with buffers that are used again.
#[derive(Clone, Debug, Default)]
pub struct Matcher {
    /// Second set, [`LANES`] descriptors interleaved value by value.
    columns: Vec<[[f32; LANES]; SIZE]>,
    /// Squared lengths of the second set; those of places without a descriptor are larger than any distance.
    lengths: Vec<[i32; LANES]>,
    nearest: Vec<Nearest>,
    pieces: Vec<Piece>,
    matches: Vec<Match>,
}

/// The nearest of a piece of the first set to each of the second.
#[derive(Clone, Debug, Default)]
struct Piece {
    /// Distances and indices.
    best: Vec<([i32; LANES], [u32; LANES])>,
}

/// Larger than any squared distance, with room for a length more.
const FAR: i32 = 1 << 29;

impl Matcher {
    /// Pairs in the order of the first set. Among equally near ones the first counts; there is no pair where the second set has no
    /// second descriptor to compare with.
    pub fn compute(&mut self, first: &[Descriptor], second: &[Descriptor], params: &MatchParams) -> &[Match] {
        self.matches.clear();
        if second.len() < 2 {
            return &self.matches;
        }
        self.interleave(second);
        self.nearest.resize(first.len(), Nearest { index: 0, distance: FAR, second: FAR });
        // No result depends on how the work is shared out.
        let piece = PIECE.max(first.len().div_ceil(MOST_PIECES).next_multiple_of(ROWS));
        let count = first.len().div_ceil(piece);
        self.pieces.resize(count.max(self.pieces.len()), Piece::default());
        let (columns, lengths) = (&self.columns, &self.lengths);
        let work = first.par_chunks(piece).zip(self.nearest.par_chunks_mut(piece)).zip(&mut self.pieces);
        work.enumerate().for_each(|(k, ((first, nearest), best))| {
            best.compare(first, (k * piece) as u32, columns, lengths, nearest);
        });
        let limit = params.ratio * params.ratio;
        for (index, near) in (0u32..).zip(&self.nearest) {
            let distinct = f64::from(near.distance) < limit * f64::from(near.second);
            if distinct && (!params.mutual || nearest_of_first(&self.pieces[..count], near.index) == index) {
                self.matches.push(Match {
                    first: index as usize,
                    second: near.index as usize,
                    squared_distance: near.distance as u32,
                    ratio: (f64::from(near.distance) / f64::from(near.second)).sqrt(),
                });
            }
        }
        &self.matches
    }

    fn interleave(&mut self, second: &[Descriptor]) {
        let count = second.len().div_ceil(LANES);
        self.columns.resize(count, [[0.0; LANES]; SIZE]);
        self.lengths.clear();
        self.lengths.resize(count, [FAR; LANES]);
        for (j, descriptor) in second.iter().enumerate() {
            let (block, lane) = (j / LANES, j % LANES);
            for (row, &value) in self.columns[block].iter_mut().zip(&descriptor.0) {
                row[lane] = f32::from(value);
            }
            self.lengths[block][lane] = squared_length(descriptor);
        }
    }
}

/// Index in the first set of the descriptor that is nearest to one of the second.
fn nearest_of_first(pieces: &[Piece], index: u32) -> u32 {
    let (block, lane) = (index as usize / LANES, index as usize % LANES);
    let of = |p: &Piece| (p.best[block].0[lane], p.best[block].1[lane]);
    pieces.iter().map(of).min().map_or(u32::MAX, |(_, first)| first)
}

fn squared_length(descriptor: &Descriptor) -> i32 {
    descriptor.0.iter().map(|&v| i32::from(v) * i32::from(v)).sum()
}

impl Piece {
    /// Compares some of the first set, the one of index `from` and those after it, with all of the second.
    fn compare(
        &mut self,
        first: &[Descriptor],
        from: u32,
        columns: &[[[f32; LANES]; SIZE]],
        lengths: &[[i32; LANES]],
        nearest: &mut [Nearest],
    ) {
        self.best.clear();
        self.best.resize(columns.len(), ([FAR; LANES], [0; LANES]));
        let mut rows = [[0.0f32; ROWS]; SIZE];
        for (k, (first, nearest)) in first.chunks(ROWS).zip(nearest.chunks_mut(ROWS)).enumerate() {
            for (r, descriptor) in first.iter().enumerate() {
                rows.iter_mut().zip(&descriptor.0).for_each(|(row, &v)| row[r] = f32::from(v));
            }
            let mut own = [0; ROWS];
            own.iter_mut().zip(first).for_each(|(length, d)| *length = squared_length(d));
            let mut two = [[[FAR; LANES]; 2]; ROWS];
            let mut which = [[0u32; LANES]; ROWS];
            for (block, ((columns, lengths), best)) in
                columns.iter().zip(lengths).zip(&mut self.best).enumerate()
            {
                let mut dots = [[0.0f32; LANES]; ROWS];
                vectorized(
                    #[inline(always)]
                    || {
                        products(&rows, columns, &mut dots);
                        for r in 0..first.len() {
                            let index = from + (k * ROWS + r) as u32;
                            let [near, next] = &mut two[r];
                            for l in 0..LANES {
                                // At least zero, and without the own length, which all of a row have in common, no less so.
                                let d = own[r] + lengths[l] - 2 * dots[r][l] as i32;
                                let nearer = d < near[l];
                                next[l] = if nearer { near[l] } else { next[l].min(d) };
                                which[r][l] = if nearer { block as u32 } else { which[r][l] };
                                near[l] = near[l].min(d);
                                best.1[l] = if d < best.0[l] { index } else { best.1[l] };
                                best.0[l] = best.0[l].min(d);
                            }
                        }
                    },
                );
            }
            for (r, nearest) in nearest.iter_mut().enumerate() {
                *nearest = merge(&two[r], &which[r]);
            }
        }
    }
}

/// Dot products of some descriptors with a block of others.
#[inline(always)]
fn products(rows: &[[f32; ROWS]; SIZE], columns: &[[f32; LANES]; SIZE], dots: &mut [[f32; LANES]; ROWS]) {
    let [mut a, mut b, mut c, mut d] = [[0.0f32; LANES]; 4];
    for (row, column) in rows.iter().zip(columns) {
        for l in 0..LANES {
            a[l] += row[0] * column[l];
            b[l] += row[1] * column[l];
            c[l] += row[2] * column[l];
            d[l] += row[3] * column[l];
        }
    }
    *dots = [a, b, c, d];
}

/// The two nearest of all lanes; the first in order among equals.
fn merge([near, next]: &[[i32; LANES]; 2], which: &[u32; LANES]) -> Nearest {
    let mut lanes: [(i32, u32); LANES] =
        core::array::from_fn(|l| (near[l], which[l] * LANES as u32 + l as u32));
    lanes.sort_unstable();
    let (distance, index) = lanes[0];
    let other = next[index as usize % LANES];
    Nearest { index, distance, second: lanes[1].0.min(other) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use vt_core::random::{Random, Stream};

    /// Descriptors that often lie equally far apart.
    fn some(seed: u64, count: usize, levels: usize) -> Vec<Descriptor> {
        let mut random = Random::new(seed, Stream::Sim, 0, 0, 0);
        let value = |r: &mut Random| (r.index(levels) * 255 / (levels - 1).max(1)) as u8;
        (0..count).map(|_| Descriptor(core::array::from_fn(|_| value(&mut random)))).collect()
    }

    fn squared(a: &Descriptor, b: &Descriptor) -> u32 {
        a.0.iter().zip(&b.0).map(|(a, b)| u32::from(a.abs_diff(*b)).pow(2)).sum()
    }

    fn brute_force(first: &[Descriptor], second: &[Descriptor], params: &MatchParams) -> Vec<Match> {
        let mut found = vec![];
        for (i, a) in first.iter().enumerate() {
            let mut all: Vec<(u32, usize)> = second.iter().map(|b| squared(a, b)).zip(0..).collect();
            all.sort_unstable();
            let [(near, j), (next, _), ..] = all[..] else { continue };
            let back = first.iter().map(|a| squared(a, &second[j])).zip(0..).min().map(|(_, i)| i);
            if f64::from(near) < params.ratio * params.ratio * f64::from(next)
                && (!params.mutual || back == Some(i))
            {
                let ratio = (f64::from(near) / f64::from(next)).sqrt();
                found.push(Match { first: i, second: j, squared_distance: near, ratio });
            }
        }
        found
    }

    proptest! {
        #[test]
        fn matches_are_those_of_brute_force(
            seed in any::<u64>(), m in 0usize..140, n in 0usize..80, levels in 1usize..257, ratio in 0.9..1.0f64, mutual in any::<bool>(),
        ) {
            let (first, second) = (some(seed, m, levels), some(seed ^ 1, n, levels));
            let params = MatchParams { ratio, mutual }.check().unwrap();
            let mut matcher = Matcher::default();
            // Buffers that another size has left do no harm.
            matcher.compute(&second, &first, &params);
            let found = matcher.compute(&first, &second, &params);
            prop_assert_eq!(found, &brute_force(&first, &second, &params)[..]);
        }
    }

    #[test]
    fn many_descriptors_are_shared_out_in_few_pieces() {
        let (first, second) = (some(3, PIECE * MOST_PIECES + 131, 4), some(4, 5, 4));
        let params = MatchParams { ratio: 1.0, mutual: true };
        let mut matcher = Matcher::default();
        assert_eq!(matcher.compute(&first, &second, &params), &brute_force(&first, &second, &params)[..]);
        assert!(matcher.pieces.len() <= MOST_PIECES);
    }

    #[test]
    fn extremes_are_not_rounded() {
        let [black, white] = [0, 255].map(|v| Descriptor([v; SIZE]));
        let params = MatchParams { ratio: 1.0, mutual: true };
        let mut matcher = Matcher::default();
        let found = matcher.compute(&[white], &[black, white], &params)[0];
        assert_eq!((found.second, found.squared_distance, found.ratio), (1, 0, 0.0));
        assert_eq!(matcher.nearest[0].second, 128 * 255 * 255);
    }

    #[test]
    fn threads_do_not_change_a_match() {
        let (first, second) = (some(5, 300, 3), some(6, 200, 3));
        let params = MatchParams { ratio: 1.0, mutual: true };
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| Matcher::default().compute(&first, &second, &params).to_vec())
        };
        assert_eq!(run(1), run(3));
    }

    #[test]
    fn a_ratio_out_of_range_is_refused() {
        for ratio in [0.0, -1.0, 1.1, f64::NAN] {
            assert!(MatchParams { ratio, mutual: false }.check().is_err());
        }
    }
}
