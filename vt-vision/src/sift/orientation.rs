//! Directions of a keypoint: peaks of the histogram of gradient directions around it (Lowe 2004, §5).

use vt_core::batch::vectorized;
use vt_core::math;

use super::polar::polar;
use crate::gaussian::Smoothed;
use crate::plane::Plane;

/// Bins of a turn.
const BINS: usize = 36;

/// Most directions of one keypoint.
pub const MOST: usize = 4;

/// Deviation of the weights in deviations of the keypoint.
const SPREAD: f64 = 1.5;

/// Deviations of the weights after which pixels are left out.
const REACH: f64 = 3.0;

/// Share of the highest peak that another one must have.
const SHARE: f32 = 0.8;

/// Longest half of a window, pixels.
const LONGEST: usize = 31;

/// Pixels of a row of a window, in whole blocks.
const LANES: usize = 64;

/// Pixels that are taken together.
const BLOCK: usize = 32;

/// Directions in radians from x towards y, the most certain first.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Directions {
    /// Number of them.
    pub count: usize,
    /// The first `count` are directions.
    pub radians: [f32; MOST],
}

/// Directions at a pixel of a level, for a keypoint of deviation `sigma` in pixels of the octave.
pub fn directions(level: &Plane<f32>, [x, y]: [u32; 2], sigma: f64) -> Directions {
    let spread = SPREAD * sigma;
    let reach = ((REACH * spread + 0.5) as usize).min(LONGEST);
    let mut weights = [0.0f32; LONGEST + 1];
    for (k, w) in weights[..=reach].iter_mut().enumerate() {
        *w = math::exp_fast(-0.5 * (k as f64 / spread) * (k as f64 / spread)) as f32;
    }
    let region = level.region();
    let (width, height) = (region.width as usize, region.height as usize);
    let (x, y) = (x as usize, y as usize);
    // The outermost pixels have no gradient.
    let (left, right) = (x.saturating_sub(reach).max(1), (x + reach + 1).min(width - 1));
    let rows = y.saturating_sub(reach).max(1)..(y + reach + 1).min(height - 1);
    let mut histogram = [0.0f32; BINS + 1];
    let n = right.saturating_sub(left);
    // Three rows in turn, with a pixel more on either side; whole blocks, of which the rest has no weight.
    let mut ring = [[0.0f32; LANES + 2]; 3];
    let mut across = [0.0f32; LANES];
    across[..n].iter_mut().zip(left..).for_each(|(w, u)| *w = weights[u.abs_diff(x)]);
    let (mut lengths, mut bins) = ([0.0f32; LANES], [0u8; LANES]);
    for v in rows.start - 1..rows.end + 1 {
        ring[v % 3][..n + 2].copy_from_slice(&level.values()[v * width + left - 1..][..n + 2]);
        if v <= rows.start {
            continue;
        }
        let of_row = weights[(v - 1).abs_diff(y)];
        let (above, here, below) = (&ring[(v - 2) % 3], &ring[(v - 1) % 3], &ring[v % 3]);
        vectorized(
            #[inline(always)]
            || {
                for block in 0..n.div_ceil(BLOCK) {
                    let start = block * BLOCK;
                    let (before, after) = (&here[start..][..BLOCK], &here[start + 2..][..BLOCK]);
                    let (above, below) = (&above[start + 1..][..BLOCK], &below[start + 1..][..BLOCK]);
                    let (lengths, bins) = (&mut lengths[start..][..BLOCK], &mut bins[start..][..BLOCK]);
                    let across = &across[start..][..BLOCK];
                    for i in 0..BLOCK {
                        let (length, eighths) = polar(after[i] - before[i], below[i] - above[i]);
                        lengths[i] = length * (of_row * across[i]);
                        bins[i] = u8::of(eighths * (BINS as f32 / 8.0));
                    }
                }
            },
        );
        for (length, &bin) in lengths[..n].iter().zip(&bins[..n]) {
            histogram[(bin as usize).min(BINS)] += length;
        }
    }
    histogram[0] += histogram[BINS];
    peaks(&core::array::from_fn(|k| histogram[k]))
}

/// Peaks of a histogram after smoothing, to a part of a bin by a parabola.
fn peaks(raw: &[f32; BINS]) -> Directions {
    let smooth: [f32; BINS] = core::array::from_fn(|k| {
        let at = |d: usize| raw[(k + d) % BINS];
        (at(BINS - 2) + at(2)) * (1.0 / 16.0) + (at(BINS - 1) + at(1)) * (4.0 / 16.0) + at(0) * (6.0 / 16.0)
    });
    let most = smooth.iter().copied().fold(0.0, f32::max);
    let mut found = [(0.0f32, 0.0f32); BINS];
    let mut count = 0;
    for k in 0..BINS {
        let (before, here, after) = (smooth[(k + BINS - 1) % BINS], smooth[k], smooth[(k + 1) % BINS]);
        // What is symmetric has equal neighbours.
        if here > before && here >= after && here >= SHARE * most {
            let bin = k as f32 + 0.5 * (before - after) / (before - 2.0 * here + after);
            found[count] = (here, bin * (core::f32::consts::TAU / BINS as f32));
            count += 1;
        }
    }
    found[..count].sort_by(|a, b| b.0.total_cmp(&a.0));
    let count = count.min(MOST);
    Directions { count, radians: core::array::from_fn(|k| if k < count { found[k].1 } else { 0.0 }) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vt_core::frame::Roi;

    #[test]
    fn a_ramp_has_its_own_direction() {
        for k in 0..72 {
            let angle = f64::from(k) * core::f64::consts::TAU / 72.0 + 0.01;
            let (s, c) = math::sin_cos(angle);
            let mut level = Plane::<f32>::default();
            let values = level.reshape(Roi { x: 0, y: 0, width: 40, height: 30 });
            for (i, value) in values.iter_mut().enumerate() {
                *value = ((i % 40) as f64 * c + (i / 40) as f64 * s) as f32;
            }
            for at in [[20, 15], [1, 1], [39, 29]] {
                let found = directions(&level, at, 2.0);
                assert_eq!(found.count, 1);
                // All fall into one bin of 10 degrees.
                assert!(
                    math::wrap_angle(f64::from(found.radians[0]) - angle).abs() < 0.09,
                    "{found:?} {angle}"
                );
            }
        }
    }

    #[test]
    fn no_gradient_has_no_direction() {
        let mut level = Plane::<f32>::default();
        level.reshape(Roi { x: 0, y: 0, width: 40, height: 30 });
        assert_eq!(directions(&level, [20, 15], 2.0).count, 0);
    }
}
