//! Gaussian scale space: octaves of ever smoother pictures, each octave at half the resolution of the one before.
//!
//! All octaves share the place of their first pixel, and every second pixel goes on to the next one. A pixel of an octave lies at
//! `origin + spacing · x` in the picture, so that no shift of a part of a pixel adds up.

use image::GrayImage;
use rayon::prelude::*;
use vt_core::batch::vectorized;
use vt_core::error::ConfigError;
use vt_core::frame::Roi;
use vt_core::math;

use crate::gaussian::{Gaussian, across, along};
use crate::plane::{Plane, area, reserve};

/// Rows that are one piece of work.
const BAND: usize = 32;

/// Pixels of a row that are smoothed together.
const BLOCK: usize = 64;

/// Columns that are smoothed together: as many rows of them as a kernel is high stay close by.
const TILE: usize = 4 * BLOCK;

/// Smallest side of an octave, pixels.
const LEAST_SIDE: u32 = 12;

/// Deviations of a kernel after which its weights are left out.
const REACH: f64 = 3.5;

/// Pictures at one resolution.
#[derive(Clone, Debug, Default)]
pub struct Octave {
    /// Grey levels, the smoother the later; the regions begin at zero.
    pub levels: Vec<Plane<f32>>,
    /// Distance of two pixels in the picture, pixels.
    pub spacing: f32,
}

/// How the first picture of the first octave is made.
#[derive(Clone, Debug)]
enum First {
    /// By smoothing.
    Same(Gaussian),
    /// At twice the resolution: weights for pixels of the picture, and for the middles between them.
    Doubled { at: Vec<f32>, between: Vec<f32> },
}

/// A scale space with buffers that are used again.
#[derive(Clone, Debug)]
pub struct ScaleSpace {
    first: First,
    /// Smoothing from each level to the next.
    steps: Vec<Gaussian>,
    most_octaves: usize,
    octaves: Vec<Octave>,
    used: usize,
    origin: (u32, u32),
    grey: Plane<f32>,
    /// Rows in work, by bands.
    rows: Vec<Vec<f32>>,
}

impl ScaleSpace {
    /// `layers + 3` levels an octave. Level `s` has the deviation `sigma · 2^(s / layers)` in pixels of its octave, if that of the
    /// picture is `input` in pixels of the picture.
    ///
    /// # Errors
    /// [`ConfigError`] when the picture is smoother than the first level, or a kernel is out of range.
    pub fn new(
        sigma: f64,
        input: f64,
        layers: usize,
        doubled: bool,
        most_octaves: usize,
    ) -> Result<Self, ConfigError> {
        // Of the first octave, in pixels of the picture.
        let start = if doubled { 0.5 * sigma } else { sigma };
        let missing = (start * start - input * input).max(0.0).sqrt();
        if missing < 0.4 {
            let expected = "smaller: the first level is smoother than the picture by at least 0.4 px";
            return Err(ConfigError::parameter("input_blur", input, expected));
        }
        let reach = |sigma: f64| (REACH * sigma).ceil() as u32;
        let first = if doubled {
            let row = |offset: f64| {
                let taps = (0..=reach(missing)).map(|k| f64::from(k) + offset);
                let weights: Vec<f64> =
                    taps.map(|d| math::exp(-0.5 * (d / missing) * (d / missing))).collect();
                let sum = 2.0 * weights.iter().sum::<f64>() - if offset == 0.0 { weights[0] } else { 0.0 };
                weights.iter().map(|w| (w / sum) as f32).collect()
            };
            First::Doubled { at: row(0.0), between: row(0.5) }
        } else {
            First::Same(Gaussian::with_reach(missing, reach(missing))?)
        };
        let ratio = math::pow(2.0, 1.0 / layers as f64);
        let mut before = sigma;
        let step = |_| {
            let next = before * ratio;
            let more = (next * next - before * before).sqrt();
            before = next;
            Gaussian::with_reach(more, reach(more))
        };
        let steps = (0..layers + 2).map(step).collect::<Result<_, _>>()?;
        let (octaves, grey, rows) = (vec![], Plane::default(), vec![]);
        Ok(Self { first, steps, most_octaves, octaves, used: 0, origin: (0, 0), grey, rows })
    }

    /// Octaves of the last picture, the finest first.
    pub fn octaves(&self) -> &[Octave] {
        &self.octaves[..self.used]
    }

    /// Place in the picture of a place in an octave, pixels.
    pub fn in_picture(&self, octave: usize, at: [f32; 2]) -> [f64; 2] {
        let spacing = f64::from(self.octaves[octave].spacing);
        [
            f64::from(self.origin.0) + spacing * f64::from(at[0]),
            f64::from(self.origin.1) + spacing * f64::from(at[1]),
        ]
    }

    /// Computes all octaves of a part of the picture; beyond its border the outermost pixels go on.
    pub fn compute(&mut self, image: &GrayImage, region: Roi) {
        self.origin = (region.x, region.y);
        self.used = 0;
        let doubled = matches!(self.first, First::Doubled { .. });
        let scale = if doubled { 2 } else { 1 };
        let mut size = (region.width * scale, region.height * scale);
        let mut spacing = 1.0 / scale as f32;
        if region.width == 0 {
            return;
        }
        reserve(&mut self.rows, (size.1 as usize).div_ceil(BAND));
        self.rows.resize((size.1 as usize).div_ceil(BAND).max(self.rows.len()), vec![]);
        copy(image, region, &mut self.grey);
        while size.0.min(size.1) >= LEAST_SIDE && self.used < self.most_octaves {
            if self.used == self.octaves.len() {
                let levels = vec![Plane::default(); self.steps.len() + 1];
                self.octaves.push(Octave { levels, spacing });
            }
            let (before, octave) = self.octaves.split_at_mut(self.used);
            let octave = &mut octave[0];
            octave.spacing = spacing;
            let (base, mut rest) = octave.levels.split_at_mut(1);
            let room = Roi { x: 0, y: 0, width: size.0, height: size.1 };
            match (before.last(), &self.first) {
                // The level with twice the deviation of the first one.
                (Some(finer), _) => halve(&finer.levels[self.steps.len() - 2], room, &mut base[0]),
                (None, First::Same(kernel)) => smooth(&self.grey, kernel, &mut base[0], &mut self.rows),
                (None, First::Doubled { at, between }) => {
                    double(&self.grey, at, between, &mut base[0], &mut self.rows);
                }
            }
            let mut source = &base[0];
            for kernel in &self.steps {
                let (target, more) = rest.split_at_mut(1);
                smooth(source, kernel, &mut target[0], &mut self.rows);
                source = &target[0];
                rest = more;
            }
            self.used += 1;
            size = (size.0.div_ceil(2), size.1.div_ceil(2));
            spacing *= 2.0;
        }
    }
}

/// The pixels of a region as numbers.
fn copy(image: &GrayImage, region: Roi, out: &mut Plane<f32>) {
    out.reserve(area(image.dimensions()));
    let width = region.width as usize;
    let target = out.reshape(Roi { x: 0, y: 0, ..region });
    for (y, row) in (region.y as usize..).zip(target.chunks_exact_mut(width)) {
        let source = &image.as_raw()[y * image.width() as usize + region.x as usize..][..width];
        vectorized(
            #[inline(always)]
            || row.iter_mut().zip(source).for_each(|(to, &from)| *to = f32::from(from)),
        );
    }
}

/// Every second pixel.
fn halve(source: &Plane<f32>, room: Roi, out: &mut Plane<f32>) {
    let (from, to) = (source.region().width as usize, room.width as usize);
    let rows = source.values().chunks_exact(from).step_by(2);
    for (row, target) in rows.zip(out.reshape(room).chunks_exact_mut(to)) {
        row.iter().step_by(2).zip(target).for_each(|(&from, to)| *to = from);
    }
}

/// The row `y` of a plane, the first or last one beyond its border.
fn row_at(plane: &Plane<f32>, y: i64) -> &[f32] {
    let region = plane.region();
    let y = y.clamp(0, i64::from(region.height) - 1) as usize;
    &plane.values()[y * region.width as usize..][..region.width as usize]
}

/// Continues a row on both sides by its outermost values.
fn extend(padded: &mut [f32], reach: usize) {
    let end = padded.len() - reach - 1;
    let (first, last) = (padded[reach], padded[end]);
    padded[..reach].fill(first);
    padded[end + 1..].fill(last);
}

/// Smoothing, columns first: then each row of the result depends on the source alone, and rows can be shared out.
fn smooth(source: &Plane<f32>, kernel: &Gaussian, out: &mut Plane<f32>, rows: &mut [Vec<f32>]) {
    let (region, reach, weights) = (source.region(), kernel.reach() as usize, kernel.weights());
    let width = region.width as usize;
    let bands = out.reshape(region).par_chunks_mut(width * BAND).zip(rows).enumerate();
    bands.for_each(|(band, (target, buffer))| {
        let padded = width + 2 * reach;
        buffer.resize(padded * BAND, 0.0);
        let count = target.len() / width;
        let rows = &mut buffer[..count * padded];
        if width < BLOCK {
            for (y, row) in (band * BAND..).zip(rows.chunks_exact_mut(padded)) {
                across(|k| row_at(source, y as i64 + k), weights, &mut row[reach..][..width]);
            }
        } else {
            columns(source, weights, band * BAND, rows);
        }
        for (row, target) in rows.chunks_exact_mut(padded).zip(target.chunks_exact_mut(width)) {
            extend(row, reach);
            if width < BLOCK {
                along(row, weights, target);
            } else {
                row_in_blocks(row, weights, target);
            }
        }
    });
}

/// Where a block begins so that it ends within a row: the last one goes over some pixels again.
fn starts(width: usize) -> impl Iterator<Item = usize> {
    (0..width).step_by(BLOCK).map(move |start| start.min(width - BLOCK))
}

/// Smooths along columns, from the row `first` on. Block by block of columns, so that what is read again is close by.
fn columns(source: &Plane<f32>, weights: &[f32], first: usize, rows: &mut [f32]) {
    let (width, height) = (source.region().width as usize, source.region().height as usize);
    let (values, reach) = (source.values(), weights.len() - 1);
    let padded = width + 2 * reach;
    vectorized(
        #[inline(always)]
        || {
            for tile in (0..width).step_by(TILE) {
                for (y, row) in (first..).zip(rows.chunks_exact_mut(padded)) {
                    for start in starts(width).skip(tile / BLOCK).take(TILE / BLOCK) {
                        let block = |y: usize| &values[y * width + start..][..BLOCK];
                        let pair = |k: usize| (block(y.saturating_sub(k)), block((y + k).min(height - 1)));
                        weighted(block(y), pair, weights, &mut row[reach + start..][..BLOCK]);
                    }
                }
            }
        },
    );
}

/// Smooths along a row, which has its continuation on both sides.
fn row_in_blocks(padded: &[f32], weights: &[f32], out: &mut [f32]) {
    let (width, reach) = (out.len(), weights.len() - 1);
    vectorized(
        #[inline(always)]
        || {
            for start in starts(width) {
                let block = |offset: usize| &padded[start + offset..][..BLOCK];
                let pair = |k: usize| (block(reach - k), block(reach + k));
                weighted(block(reach), pair, weights, &mut out[start..][..BLOCK]);
            }
        },
    );
}

/// `centre · w_0 + Σ (a_k + b_k) w_k` of a block.
#[inline(always)]
fn weighted<'a>(
    centre: &[f32],
    pair: impl Fn(usize) -> (&'a [f32], &'a [f32]),
    weights: &[f32],
    out: &mut [f32],
) {
    let mut sums = [0.0f32; BLOCK];
    for i in 0..BLOCK {
        sums[i] = centre[i] * weights[0];
    }
    // Four at a time, since sums come from memory and go there each time.
    let (fours, rest) = weights[1..].as_chunks::<4>();
    for (k, w) in fours.iter().enumerate() {
        let [(a0, b0), (a1, b1), (a2, b2), (a3, b3)] =
            [pair(4 * k + 1), pair(4 * k + 2), pair(4 * k + 3), pair(4 * k + 4)];
        for i in 0..BLOCK {
            let near = (a0[i] + b0[i]) * w[0] + (a1[i] + b1[i]) * w[1];
            sums[i] += near + ((a2[i] + b2[i]) * w[2] + (a3[i] + b3[i]) * w[3]);
        }
    }
    let (twos, rest) = rest.as_chunks::<2>();
    for w in twos {
        let k = 4 * fours.len() + 1;
        let [(a0, b0), (a1, b1)] = [pair(k), pair(k + 1)];
        for i in 0..BLOCK {
            sums[i] += (a0[i] + b0[i]) * w[0] + (a1[i] + b1[i]) * w[1];
        }
    }
    for &w in rest {
        let (a, b) = pair(weights.len() - 1);
        for i in 0..BLOCK {
            sums[i] += (a[i] + b[i]) * w;
        }
    }
    // As a whole: a copy of known length is no call.
    if let Some(out) = out.first_chunk_mut() {
        *out = sums;
    }
}

/// Smoothing at twice the resolution: pixels with even coordinates lie on those of the source, the others in the middle.
fn double(source: &Plane<f32>, at: &[f32], between: &[f32], out: &mut Plane<f32>, rows: &mut [Vec<f32>]) {
    let region = source.region();
    let (width, reach) = (region.width as usize, between.len());
    let room = Roi { x: 0, y: 0, width: 2 * region.width, height: 2 * region.height };
    let bands = out.reshape(room).par_chunks_mut(2 * width * BAND).zip(rows).enumerate();
    bands.for_each(|(band, (target, buffer))| {
        buffer.resize(3 * width + 2 * reach, 0.0);
        let (padded, halves) = buffer.split_at_mut(width + 2 * reach);
        let (even, odd) = halves.split_at_mut(width);
        for (v, target) in (band * BAND..).zip(target.chunks_exact_mut(2 * width)) {
            let (y, middle) = (v as i64 / 2, &mut padded[reach..][..width]);
            if v % 2 == 0 {
                across(|k| row_at(source, y + k), at, middle);
            } else {
                let pair = |k: usize| (row_at(source, y - k as i64), row_at(source, y + 1 + k as i64));
                sum_pairs(pair, between, middle);
            }
            extend(padded, reach);
            along(&padded[reach + 1 - at.len()..][..width + 2 * (at.len() - 1)], at, even);
            sum_pairs(|k| (&padded[reach - k..][..width], &padded[reach + 1 + k..][..width]), between, odd);
            vectorized(
                #[inline(always)]
                || {
                    for (pair, (&e, &o)) in target.chunks_exact_mut(2).zip(even.iter().zip(odd.iter())) {
                        (pair[0], pair[1]) = (e, o);
                    }
                },
            );
        }
    });
}

/// `Σ (a_k + b_k) w_k`
fn sum_pairs<'a>(pair: impl Fn(usize) -> (&'a [f32], &'a [f32]), weights: &[f32], out: &mut [f32]) {
    vectorized(
        #[inline(always)]
        || {
            out.fill(0.0);
            for (k, &w) in weights.iter().enumerate() {
                let (a, b) = pair(k);
                out.iter_mut().zip(a.iter().zip(b)).for_each(|(o, (a, b))| *o += (a + b) * w);
            }
        },
    );
}
