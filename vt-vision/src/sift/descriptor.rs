//! Descriptor of a keypoint: histograms of gradient directions in 4 × 4 cells (Lowe 2004, §6; R. Arandjelović and A. Zisserman,
//! "Three things everyone should know to improve object retrieval", 2012, for its root).
//!
//! Instead of visiting the pixels under the cells, of which there are more the larger the keypoint, a turned grid of 25 × 25 places
//! is read from the level: 0.6 deviations apart, less than what the level can resolve. Weights of cells then are the same for all
//! keypoints, and pooling is two products with them.

use vt_core::batch::vectorized;
use vt_core::math;

use super::polar::polar;
use crate::gaussian::Smoothed;
use crate::plane::Plane;

/// Values of a descriptor: eight directions in each of 4 × 4 cells. Its length is about 512.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Descriptor(pub [u8; SIZE]);

/// Number of values.
pub const SIZE: usize = 128;

/// Cells along a side.
const CELLS: usize = 4;

/// Directions of a cell.
const BINS: usize = 8;

/// Side of a cell in deviations of the keypoint.
const CELL: f64 = 3.0;

/// Places along a side of a cell.
const PLACES: usize = 5;

/// Places along a side of the grid: half a cell more on either side, since cells overlap.
const SIDE: usize = PLACES * (CELLS + 1);

/// Places with a further one on either side, for gradients.
const READ: usize = SIDE + 2;

/// Length of a row in memory.
const LANES: usize = 32;

/// Largest share of a direction in the whole, so that a lamp or an edge does not make up all of it.
const MOST: f32 = 0.2;

/// Length of a descriptor.
const LENGTH: f32 = 512.0;

type Lanes = [f32; LANES];

impl Default for Descriptor {
    fn default() -> Self {
        Self([0; SIZE])
    }
}

/// Weights of the places of a row for each cell: linear between the centres of cells, times a Gaussian of half the width of all.
#[derive(Clone, Debug)]
pub struct Pooling {
    weights: [Lanes; CELLS],
}

impl Default for Pooling {
    fn default() -> Self {
        let mut weights = [[0.0; LANES]; CELLS];
        for (cell, row) in weights.iter_mut().enumerate() {
            for (k, weight) in row[..SIDE].iter_mut().enumerate() {
                let place = (k as f64 - (SIDE / 2) as f64) / PLACES as f64;
                let centre = cell as f64 - 0.5 * (CELLS - 1) as f64;
                let gaussian =
                    math::exp(-0.5 * (place / (0.5 * CELLS as f64)) * (place / (0.5 * CELLS as f64)));
                *weight = ((1.0 - (place - centre).abs()).max(0.0) * gaussian) as f32;
            }
        }
        Self { weights }
    }
}

impl Pooling {
    /// The descriptor at a place of a level, for a keypoint of deviation `sigma` in pixels of the octave that points to `angle`.
    pub fn describe(
        &self,
        level: &Plane<f32>,
        at: [f32; 2],
        sigma: f64,
        angle: f32,
        root: bool,
    ) -> Descriptor {
        let mut patch = [[0.0; LANES]; READ];
        read(level, at, CELL / PLACES as f64 * sigma, angle, &mut patch);
        let mut cells = [[[0.0; LANES]; BINS]; CELLS];
        vectorized(
            #[inline(always)]
            || self.pool_rows(&patch, &mut cells),
        );
        let mut values = [0.0; SIZE];
        vectorized(
            #[inline(always)]
            || self.pool_columns(&cells, &mut values),
        );
        finish(&mut values, root)
    }

    /// Directions of all places, summed over the rows of each cell.
    #[inline(always)]
    fn pool_rows(&self, patch: &[Lanes; READ], cells: &mut [[Lanes; BINS]; CELLS]) {
        for y in 0..SIDE {
            let (above, here, below) = (&patch[y], &patch[y + 1], &patch[y + 2]);
            let (mut lengths, mut eighths) = ([0.0; LANES], [0.0; LANES]);
            for i in 0..SIDE {
                (lengths[i], eighths[i]) = polar(here[i + 2] - here[i], below[i + 1] - above[i + 1]);
            }
            for b in 0..BINS {
                let mut channel = [0.0; LANES];
                for i in 0..LANES {
                    let off = (eighths[i] - b as f32).abs();
                    // Around the turn.
                    let off = if off > 4.0 { 8.0 - off } else { off };
                    let share = if off < 1.0 { 1.0 - off } else { 0.0 };
                    channel[i] = lengths[i] * share;
                }
                for cell in 0..CELLS {
                    let (weight, sums) = (self.weights[cell][y], &mut cells[cell][b]);
                    if weight > 0.0 {
                        for i in 0..LANES {
                            sums[i] += channel[i] * weight;
                        }
                    }
                }
            }
        }
    }

    /// Sums over the columns of each cell.
    #[inline(always)]
    fn pool_columns(&self, cells: &[[Lanes; BINS]; CELLS], values: &mut [f32; SIZE]) {
        for y in 0..CELLS {
            for x in 0..CELLS {
                let weights = &self.weights[x];
                for b in 0..BINS {
                    let row = &cells[y][b];
                    let mut s = [0.0f32; 8];
                    for l in 0..8 {
                        s[l] = (row[l] * weights[l] + row[l + 8] * weights[l + 8])
                            + (row[l + 16] * weights[l + 16] + row[l + 24] * weights[l + 24]);
                    }
                    let even = (s[0] + s[4]) + (s[2] + s[6]);
                    values[(y * CELLS + x) * BINS + b] = even + ((s[1] + s[5]) + (s[3] + s[7]));
                }
            }
        }
    }
}

/// Reads a turned grid around a place, linearly between pixels; beyond the border the outermost pixels go on.
fn read(level: &Plane<f32>, at: [f32; 2], spacing: f64, angle: f32, patch: &mut [Lanes; READ]) {
    let region = level.region();
    let (width, height) = (region.width as usize, region.height as usize);
    let (sin, cos) = math::sin_cos(f64::from(angle));
    let (dx, dy) = ((cos * spacing) as f32, (sin * spacing) as f32);
    let (right, bottom) = ((width - 1) as f32, (height - 1) as f32);
    let (last_x, last_y) = ((width - 2) as f32, (height - 2) as f32);
    let values = level.values();
    let (mut places, mut parts) = ([[0u32; LANES]; READ], [[[0.0f32; LANES]; 2]; READ]);
    vectorized(
        #[inline(always)]
        || {
            for (j, (places, parts)) in places.iter_mut().zip(&mut parts).enumerate() {
                let v = j as f32 - (READ / 2) as f32;
                let (x0, y0) = (at[0] - v * dy, at[1] + v * dx);
                for i in 0..LANES {
                    let u = i as f32 - (READ / 2) as f32;
                    let x = clamp(x0 + u * dx, right);
                    let y = clamp(y0 + u * dy, bottom);
                    // Down to the corner of four pixels that exist.
                    let (left, top) = (down(clamp(x, last_x)), down(clamp(y, last_y)));
                    (parts[0][i], parts[1][i]) = (x - left.1, y - top.1);
                    places[i] = top.0 * width as u32 + left.0;
                }
            }
        },
    );
    // All reading by itself: a vector must not wait for single values that were written just before.
    let mut corners = [[[0.0f32; LANES]; 4]; READ];
    for (places, corners) in places.iter().zip(&mut corners) {
        for i in 0..READ {
            let four = &values[places[i] as usize..][..width + 2];
            (corners[0][i], corners[1][i]) = (four[0], four[1]);
            (corners[2][i], corners[3][i]) = (four[width], four[width + 1]);
        }
    }
    vectorized(
        #[inline(always)]
        || {
            for ((corners, parts), out) in corners.iter().zip(&parts).zip(patch) {
                for i in 0..LANES {
                    let above = corners[0][i] + (corners[1][i] - corners[0][i]) * parts[0][i];
                    let below = corners[2][i] + (corners[3][i] - corners[2][i]) * parts[0][i];
                    out[i] = above + (below - above) * parts[1][i];
                }
            }
        },
    );
}

/// The next lower integer, or an integer itself or the one below it, as both kinds of number. Unlike a conversion, adding a large
/// number is a vector instruction.
#[inline(always)]
fn down(x: f32) -> (u32, f32) {
    const LARGE: f32 = 12_582_912.0;
    let sum = (x - 0.5) + LARGE;
    (sum.to_bits().wrapping_sub(LARGE.to_bits()), sum - LARGE)
}

#[inline(always)]
fn clamp(x: f32, most: f32) -> f32 {
    let x = if x > 0.0 { x } else { 0.0 };
    if x < most { x } else { most }
}

/// Brings a histogram to its length, cuts what stands out, and rounds.
fn finish(values: &mut [f32; SIZE], root: bool) -> Descriptor {
    let mut bytes = Descriptor::default();
    vectorized(
        #[inline(always)]
        || {
            let most = MOST * squares(values).sqrt();
            for v in values.iter_mut() {
                *v = if *v < most { *v } else { most };
            }
            if root {
                let scale = LENGTH * LENGTH / (total(values) + f32::MIN_POSITIVE);
                for v in values.iter_mut() {
                    *v = (*v * scale).sqrt();
                }
            } else {
                let scale = LENGTH / (squares(values) + f32::MIN_POSITIVE).sqrt();
                for v in values.iter_mut() {
                    *v *= scale;
                }
            }
            for k in 0..SIZE {
                bytes.0[k] = u8::of(if values[k] < 255.0 { values[k] } else { 255.0 });
            }
        },
    );
    bytes
}

/// `Σ v_k` in an order that does not depend on the machine.
#[inline(always)]
fn total(values: &[f32; SIZE]) -> f32 {
    let mut s = [0.0f32; 8];
    for eight in values.as_chunks::<8>().0 {
        for l in 0..8 {
            s[l] += eight[l];
        }
    }
    ((s[0] + s[4]) + (s[2] + s[6])) + ((s[1] + s[5]) + (s[3] + s[7]))
}

/// `Σ v_k²` in the same order.
#[inline(always)]
fn squares(values: &[f32; SIZE]) -> f32 {
    let mut squares = [0.0f32; SIZE];
    for k in 0..SIZE {
        squares[k] = values[k] * values[k];
    }
    total(&squares)
}
