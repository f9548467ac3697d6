//! Extrema of the differences of Gaussians over place and scale, to a part of a pixel (Lowe 2004, §3 and §4).

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;
use vt_core::batch::vectorized;

use super::scale_space::{Octave, ScaleSpace};
use crate::plane::Plane;

/// Rows that are one piece of work.
const BAND: usize = 32;

/// Pixels along the border of an octave in which nothing is looked for: smoothing has made up what is beyond it.
const BORDER: usize = 5;

/// Most steps of the refinement from pixel to pixel.
const STEPS: usize = 5;

/// Farthest that an extremum may lie from its pixel. More than a half: from either side of a middle the other one looks nearer.
const FARTHEST: f64 = 0.6;

/// Pixels that are looked at together.
const BLOCK: usize = 32;

/// A keypoint without a direction.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Extremum {
    /// Index of the octave.
    pub octave: u32,
    /// Index of the level that is nearest in scale.
    pub level: u32,
    /// The pixel of the octave that is nearest.
    pub pixel: [u32; 2],
    /// Place in pixels of the octave.
    pub at: [f32; 2],
    /// Scale as an index of a level.
    pub scale: f32,
    /// Absolute value of the difference of Gaussians, grey levels.
    pub response: f32,
}

impl Extremum {
    /// Octave, level, row and column: two extrema never have the same.
    pub fn place(&self) -> (u32, u32, u32, u32) {
        (self.octave, self.level, self.pixel[1], self.pixel[0])
    }
}

/// What is an extremum.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Least absolute value after refinement, grey levels.
    pub response: f32,
    /// Largest ratio of the principal curvatures.
    pub edge: f32,
}

/// Buffers of a band of rows.
#[derive(Clone, Debug, Default)]
pub struct Band {
    /// Three rows of every difference in turn, then of every difference the largest and the smallest value around each pixel, and
    /// two rows more.
    rows: Vec<f32>,
    /// Blocks of a row with an extremum.
    hits: Vec<bool>,
    found: Vec<Extremum>,
}

/// Finds the extrema of all octaves, in the order of octaves and rows.
pub fn find(space: &ScaleSpace, limits: &Limits, bands: &mut Vec<Band>, out: &mut Vec<Extremum>) {
    out.clear();
    for (index, octave) in space.octaves().iter().enumerate() {
        let region = octave.levels[0].region();
        let (first, end) = (BORDER, (region.height as usize).saturating_sub(BORDER));
        let count = end.saturating_sub(first).div_ceil(BAND);
        if region.width as usize <= 2 * BORDER || count == 0 {
            continue;
        }
        bands.resize(bands.len().max(count), Band::default());
        bands[..count].par_iter_mut().enumerate().for_each(|(b, band)| {
            let start = first + b * BAND;
            band.search(octave, index as u32, start, (start + BAND).min(end), limits);
        });
        for band in &bands[..count] {
            out.extend(&band.found);
        }
    }
    // Neighbours may have led to the same place.
    out.sort_unstable_by_key(Extremum::place);
    out.dedup_by_key(|e| e.place());
}

impl Band {
    fn search(&mut self, octave: &Octave, index: u32, start: usize, end: usize, limits: &Limits) {
        let (levels, width) = (&octave.levels, octave.levels[0].region().width as usize);
        let count = levels.len() - 1;
        self.found.clear();
        // Whole blocks; what is beyond the row does not count.
        let stride = (width - 2 * BORDER).next_multiple_of(BLOCK) + 2 * BORDER;
        self.rows.resize((count * 5 + 2) * stride, 0.0);
        self.hits.resize(stride / BLOCK, false);
        let (ring, rest) = self.rows.split_at_mut(count * 3 * stride);
        let (around, columns) = rest.split_at_mut(count * 2 * stride);
        // A candidate moves by less than a pixel in value: half of the bound is what it must have before.
        let least = 0.5 * limits.response;
        for y in start - 1..=end {
            for (d, rows) in ring.chunks_exact_mut(3 * stride).enumerate() {
                let out = &mut rows[y % 3 * stride..][..width];
                difference(row(&levels[d], y), row(&levels[d + 1], y), out);
            }
            if y <= start {
                continue;
            }
            let middle = y - 1;
            for (rows, around) in ring.chunks_exact(3 * stride).zip(around.chunks_exact_mut(2 * stride)) {
                surround(rows, columns, around);
            }
            for s in 1..count - 1 {
                let centre = &ring[(3 * s + middle % 3) * stride..][..stride];
                let around = &around[2 * (s - 1) * stride..][..6 * stride];
                mark(centre, around, least, &mut self.hits);
                for block in self.hits.iter().enumerate().filter(|(_, hit)| **hit).map(|(k, _)| k * BLOCK) {
                    let block = BORDER + block..(BORDER + block + BLOCK).min(width - BORDER);
                    for x in block.filter(|&x| holds(centre, around, least, x)) {
                        self.found.extend(refine(octave, index, [x, middle, s], limits));
                    }
                }
            }
        }
    }
}

fn row(plane: &Plane<f32>, y: usize) -> &[f32] {
    let width = plane.region().width as usize;
    &plane.values()[y * width..][..width]
}

fn difference(a: &[f32], b: &[f32], out: &mut [f32]) {
    vectorized(
        #[inline(always)]
        || {
            let n = out.len();
            let (a, b) = (&a[..n], &b[..n]);
            for i in 0..n {
                out[i] = b[i] - a[i];
            }
        },
    );
}

#[inline(always)]
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[inline(always)]
fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Largest and smallest value of the 3 × 3 around every pixel but the outermost; `columns` holds those of columns of three between.
fn surround(rows: &[f32], columns: &mut [f32], around: &mut [f32]) {
    vectorized(
        #[inline(always)]
        || {
            let n = rows.len() / 3;
            let (a, b, c) = (&rows[..n], &rows[n..][..n], &rows[2 * n..][..n]);
            let (tops, bottoms) = columns.split_at_mut(n);
            let (tops, bottoms) = (&mut tops[..n], &mut bottoms[..n]);
            for i in 0..n {
                tops[i] = larger(larger(a[i], b[i]), c[i]);
                bottoms[i] = smaller(smaller(a[i], b[i]), c[i]);
            }
            let (high, low) = around.split_at_mut(n);
            let inner = n - 2;
            let (t0, t1, t2) = (&tops[..inner], &tops[1..][..inner], &tops[2..][..inner]);
            let (b0, b1, b2) = (&bottoms[..inner], &bottoms[1..][..inner], &bottoms[2..][..inner]);
            let (high, low) = (&mut high[1..][..inner], &mut low[1..][..inner]);
            for i in 0..inner {
                high[i] = larger(larger(t0[i], t1[i]), t2[i]);
                low[i] = smaller(smaller(b0[i], b1[i]), b2[i]);
            }
        },
    );
}

/// Whether a pixel of a row of a difference is an extremum. `around` holds the largest and the smallest values around each pixel of
/// the difference before, of this one and of the one after.
#[inline(always)]
fn holds(centre: &[f32], around: &[f32], least: f32, x: usize) -> bool {
    let (n, c) = (centre.len(), centre[x]);
    let high = (c > least) & (c >= around[x]) & (c >= around[2 * n + x]) & (c >= around[4 * n + x]);
    high | ((c < -least) & (c <= around[n + x]) & (c <= around[3 * n + x]) & (c <= around[5 * n + x]))
}

/// Marks the blocks with an extremum.
fn mark(centre: &[f32], around: &[f32], least: f32, hits: &mut [bool]) {
    let n = centre.len();
    vectorized(
        #[inline(always)]
        || {
            for (k, hit) in hits.iter_mut().enumerate() {
                let start = BORDER + k * BLOCK;
                let part = |row: usize| &around[row * n + start..][..BLOCK];
                let (c, h0, l0, h1) = (&centre[start..][..BLOCK], part(0), part(1), part(2));
                let (l1, h2, l2) = (part(3), part(4), part(5));
                let mut any = [0u32; BLOCK];
                for i in 0..BLOCK {
                    let high = larger(larger(h0[i], h1[i]), larger(h2[i], least));
                    let low = smaller(smaller(l0[i], l1[i]), smaller(l2[i], -least));
                    any[i] = u32::from((c[i] >= high) | (c[i] <= low));
                }
                *hit = any.iter().fold(0, |a, b| a | b) != 0;
            }
        },
    );
}

/// Newton's steps to the extremum of the quadratic through the neighbours. None where it leaves the octave, is too weak or lies
/// on an edge.
fn refine(octave: &Octave, index: u32, at: [usize; 3], limits: &Limits) -> Option<Extremum> {
    let region = octave.levels[0].region();
    let size = [region.width as usize, region.height as usize, octave.levels.len() - 1];
    let margin = [BORDER, BORDER, 1];
    let mut at = at;
    for _ in 0..STEPS {
        let quadratic = Quadratic::new(octave, at);
        let offset = quadratic.top()?;
        let moves = offset.map(|o| if o.abs() > FARTHEST { o.round() } else { 0.0 });
        if moves == Vector3::zeros() {
            return quadratic.extremum(index, at, offset, limits);
        }
        for k in 0..3 {
            let next = at[k] as f64 + moves[k];
            // A nearly flat quadratic has its top anywhere.
            let inside = margin[k] as f64 <= next && next < (size[k] - margin[k]) as f64;
            at[k] = inside.then_some(next as usize)?;
        }
    }
    None
}

/// The difference of Gaussians around a pixel: `value + gᵀd + ½ dᵀH d`, `d` in x, y and level.
struct Quadratic {
    value: f64,
    gradient: Vector3<f64>,
    hessian: Matrix3<f64>,
}

impl Quadratic {
    fn new(octave: &Octave, [x, y, s]: [usize; 3]) -> Self {
        let cube: [[[f64; 3]; 3]; 3] = core::array::from_fn(|k| {
            let (lower, upper) = (&octave.levels[s + k - 1], &octave.levels[s + k]);
            core::array::from_fn(|j| {
                let (lower, upper) =
                    (&row(lower, y + j - 1)[x - 1..][..3], &row(upper, y + j - 1)[x - 1..][..3]);
                core::array::from_fn(|i| f64::from(upper[i] - lower[i]))
            })
        });
        let value = cube[1][1][1];
        let v = |i: usize, j: usize, k: usize| cube[k][j][i];
        let second = |a: f64, b: f64| a + b - 2.0 * value;
        let mixed = |a: f64, b: f64, c: f64, d: f64| 0.25 * (a + b - c - d);
        let gradient =
            Vector3::new(v(2, 1, 1) - v(0, 1, 1), v(1, 2, 1) - v(1, 0, 1), v(1, 1, 2) - v(1, 1, 0)) * 0.5;
        let (xx, yy, ss) =
            (second(v(0, 1, 1), v(2, 1, 1)), second(v(1, 0, 1), v(1, 2, 1)), second(v(1, 1, 0), v(1, 1, 2)));
        let xy = mixed(v(2, 2, 1), v(0, 0, 1), v(0, 2, 1), v(2, 0, 1));
        let xs = mixed(v(2, 1, 2), v(0, 1, 0), v(0, 1, 2), v(2, 1, 0));
        let ys = mixed(v(1, 2, 2), v(1, 0, 0), v(1, 0, 2), v(1, 2, 0));
        Self { value, gradient, hessian: Matrix3::new(xx, xy, xs, xy, yy, ys, xs, ys, ss) }
    }

    /// Offset of the place without slope.
    fn top(&self) -> Option<Vector3<f64>> {
        Some(-(self.hessian.try_inverse()? * self.gradient))
    }

    fn extremum(
        &self,
        octave: u32,
        [x, y, s]: [usize; 3],
        offset: Vector3<f64>,
        limits: &Limits,
    ) -> Option<Extremum> {
        let response = (self.value + 0.5 * self.gradient.dot(&offset)).abs() as f32;
        let h = &self.hessian;
        let (trace, determinant) = (h.m11 + h.m22, h.m11 * h.m22 - h.m12 * h.m12);
        let edge = f64::from(limits.edge);
        let round = trace * trace * edge < (edge + 1.0) * (edge + 1.0) * determinant;
        (response >= limits.response && round).then(|| Extremum {
            octave,
            level: s as u32,
            pixel: [x as u32, y as u32],
            at: [(x as f64 + offset.x) as f32, (y as f64 + offset.y) as f32],
            scale: (s as f64 + offset.z) as f32,
            response,
        })
    }
}
