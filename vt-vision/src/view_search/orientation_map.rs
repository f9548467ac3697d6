//! Orientations of image edges, spread over a small neighbourhood and answered from tables (LINE-MOD: Hinterstoisser
//! and others, "Gradient response maps for real-time detection of textureless objects", 2012).
//!
//! Other than there, orientations are those of thinned edges, not of all strong gradients, so that the threshold can be
//! low and the weak contours of real pictures count.

use image::{GrayImage, Luma};
use nalgebra::Vector2;
use vt_core::math;

use crate::edge_map::EdgeMap;
use crate::noise::noise_deviation;

/// Orientations of a line that are told apart in [`EdgeBits`].
pub const FINE: usize = 16;

/// Orientations that are told apart in the search.
pub const BINS: usize = 8;

/// Side of the neighbourhood over which an orientation is spread, and distance of the places that are looked at.
pub const SPREAD: usize = 4;

/// Largest answer, to an edge of the right orientation where there are few of it.
pub const FULL: u8 = 6;

/// Plane of the answers to no edge at all.
pub const EMPTY: usize = BINS;

/// Largest answer to no edge, where there are many.
pub const FULL_EMPTY: u8 = 2;

/// One unit of an answer, nats.
const UNIT: f64 = 0.8;

/// Probability that a visible contour point gives no edge of its orientation.
const MISS: f64 = 0.15;

/// Half the side of the window in which edges are counted, pixels.
const WINDOW: usize = 48;

/// Positions that are summed together.
pub const BLOCK: usize = 64;

/// The bin, of `bins`, of a line's normal with this angle.
pub fn bin(angle: f64, bins: usize) -> usize {
    let turn = (angle / core::f64::consts::PI).rem_euclid(1.0);
    ((turn * bins as f64) as usize).min(bins - 1)
}

/// The bin, of [`FINE`], of a line with this normal.
#[inline]
pub fn fine_bin(normal: &Vector2<f64>) -> usize {
    // Tangents of the borders between bins in the first half quadrant.
    const BORDERS: [f64; 3] = [0.198_912_367_379_658, 0.414_213_562_373_095, 0.668_178_637_919_298_9];
    let (x, y) = (normal.x.abs(), normal.y.abs());
    let past = |a: f64, b: f64| BORDERS.iter().filter(|&&t| a > t * b).count();
    let k = if y <= x { past(y, x) } else { FINE / 2 - 1 - past(x, y) };
    if normal.x * normal.y < 0.0 { FINE - 1 - k } else { k }
}

/// Share of edge pixels above which a picture is full of them.
const CROWDED: f64 = 0.2;

/// One bit for every orientation of an edge at each pixel of a picture; a pixel without an edge has none.
#[derive(Clone, Debug, Default)]
pub struct EdgeBits {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Bits by rows.
    pub bits: Vec<u16>,
    edges: EdgeMap,
}

impl EdgeBits {
    /// Finds the edges of at least `min_contrast` grey levels; where the picture is full of edges, the strongest ones
    /// only.
    pub fn compute(&mut self, image: &GrayImage, min_contrast: f64) {
        let most = (CROWDED * f64::from(image.width() * image.height())) as usize;
        let mut contrast = min_contrast;
        for _ in 0..12 {
            self.edges.compute(image, None, contrast);
            if self.edges.count() <= most {
                break;
            }
            contrast *= 1.3;
        }
        (self.width, self.height) = (image.width() as usize, image.height() as usize);
        self.bits.clear();
        self.bits.resize(self.width * self.height, 0);
        for (x, y, turn) in self.edges.orientations() {
            // An orientation near the border of a bin belongs to both.
            let near = |d: f64| 1 << bin((turn + d) * core::f64::consts::PI, FINE);
            self.bits[y * self.width + x] = near(0.0) | near(0.02) | near(-0.02);
        }
    }
}

/// The picture blurred by the binomial mask of 3 × 3, and the contrast that edges in it must have to stand out from the
/// noise of `image`; weak edges are found where the noise hides them in single pixels.
pub fn blurred(image: &GrayImage, min_contrast: f64) -> (GrayImage, f64) {
    let (w, h) = (image.width() as usize, image.height() as usize);
    let pixels = image.as_raw();
    let mut rows = vec![0_u16; w * h];
    for (row, out) in pixels.chunks_exact(w.max(1)).zip(rows.chunks_exact_mut(w.max(1))) {
        for x in 0..w {
            let (left, right) = (row[x.saturating_sub(1)], row[(x + 1).min(w - 1)]);
            out[x] = u16::from(left) + 2 * u16::from(row[x]) + u16::from(right);
        }
    }
    let mut out = GrayImage::new(image.width(), image.height());
    for (y, line) in out.chunks_exact_mut(w.max(1)).enumerate() {
        let [above, here, below] = [y.saturating_sub(1), y, (y + 1).min(h - 1)].map(|r| &rows[r * w..][..w]);
        for x in 0..w {
            line[x] = ((above[x] + 2 * here[x] + below[x] + 8) / 16) as u8;
        }
    }
    let noise = noise_deviation(image, &mut vec![]);
    (out, min_contrast.max(NOISE_FACTOR * noise))
}

/// Contrast that stands out from noise of one grey level after blurring: four deviations of Sobel's answer, 0.41.
const NOISE_FACTOR: f64 = 4.0 * 0.41;

/// Answers to all orientations at all places, ordered so that those [`SPREAD`] pixels apart are neighbours in memory.
#[derive(Clone, Debug, Default)]
pub struct OrientationMap {
    columns: usize,
    rows: usize,
    /// Cells of the border on each side, in which no edge answers.
    border: usize,
    stride: usize,
    plane: usize,
    answers: Vec<u8>,
    narrow: Vec<u8>,
    wide: Vec<u8>,
    spread: Vec<u8>,
    counts: Vec<u32>,
}

/// Answers to an edge that is there by chance with probability `k / 255`: how much more probable it is where the contour
/// is, against the probability of none.
fn answers() -> [u8; 256] {
    core::array::from_fn(|k| {
        let chance = (k as f64 / 255.0).max(0.01);
        let found = math::ln((1.0 - MISS) / chance + MISS);
        ((found - math::ln(MISS)) / UNIT).round().clamp(1.0, f64::from(FULL)) as u8
    })
}

/// Answers to no edge at all where one is by chance with probability `k / 255`, in the same units.
fn empty_answers() -> [u8; 256] {
    core::array::from_fn(|k| {
        let none = math::ln(1.0 - (k as f64 / 255.0).min(0.95));
        (-none / UNIT).round().min(f64::from(FULL_EMPTY)) as u8
    })
}

/// Fine orientations as coarse ones.
fn coarse(fine: u16) -> u8 {
    (0..BINS).fold(0, |set, k| set | u8::from(fine >> (2 * k) & 3 != 0) << k)
}

impl OrientationMap {
    /// Spreads the orientations and looks up all answers; `reach` is how many pixels a template extends from its
    /// centre.
    pub fn compute(&mut self, edges: &EdgeBits, reach: usize) {
        let (w, h) = (edges.width, edges.height);
        (self.columns, self.rows) = (w.div_ceil(SPREAD), h.div_ceil(SPREAD));
        self.border = reach.div_ceil(SPREAD) + 1;
        self.stride = self.columns + 2 * self.border;
        self.plane = self.stride * (self.rows + 2 * self.border) + BLOCK;
        // The union over −1, 0, 1, 2 pixels, along rows and then along columns.
        let union =
            |from: &[u8], to: &mut Vec<u8>, step: usize, length: usize, place: &dyn Fn(usize) -> usize| {
                to.clear();
                to.extend((0..from.len()).map(|k| {
                    let at = place(k);
                    let first = at.saturating_sub(SPREAD / 2 - 1);
                    let last = (at + SPREAD / 2).min(length - 1);
                    (first..=last).fold(0, |set, p| set | from[k + p * step - at * step])
                }));
            };
        if w == 0 || h == 0 {
            self.wide.clear();
            self.spread.clear();
        } else {
            self.narrow.clear();
            self.narrow.extend(edges.bits.iter().map(|&b| coarse(b)));
            union(&self.narrow, &mut self.wide, 1, w, &|k| k % w);
            union(&self.wide, &mut self.spread, w, h, &|k| k / w);
        }
        let table = answers();
        self.answers.clear();
        self.answers.resize((BINS + 1) * SPREAD * SPREAD * self.plane, 0);
        for o in 0..BINS {
            let own = 1_u8 << o;
            let beside = 1 << ((o + 1) % BINS) | 1 << ((o + BINS - 1) % BINS);
            self.count(own, w, h);
            self.answer(o, w, h, |set, chance| match () {
                () if set & own != 0 => table[chance],
                () if set & beside != 0 => table[chance] / 2,
                () => 0,
            });
        }
        let table = empty_answers();
        self.count(u8::MAX, w, h);
        self.answer(EMPTY, w, h, |set, chance| if set == 0 { table[chance] } else { 0 });
    }

    /// Fills a plane with `answer(orientations here, 255 × share of counted pixels around)`.
    fn answer(&mut self, plane: usize, w: usize, h: usize, answer: impl Fn(u8, usize) -> u8) {
        for y in 0..h {
            let (top, bottom) = (y.saturating_sub(WINDOW), (y + WINDOW + 1).min(h));
            for x in 0..w {
                let (left, right) = (x.saturating_sub(WINDOW), (x + WINDOW + 1).min(w));
                let at = |row: usize, column: usize| self.counts[row * (w + 1) + column];
                let count = at(bottom, right) + at(top, left) - at(top, right) - at(bottom, left);
                let area = ((bottom - top) * (right - left)) as u32;
                let value = answer(self.spread[y * w + x], (count * 255 / area) as usize);
                if value != 0 {
                    let (start, place) = self.place(plane, x as i32, y as i32);
                    self.answers[start + place] = value;
                }
            }
        }
    }

    /// Sums of the pixels with one of these orientations over all rectangles from the corner.
    fn count(&mut self, own: u8, w: usize, h: usize) {
        self.counts.clear();
        self.counts.resize((w + 1) * (h + 1), 0);
        for y in 0..h {
            let mut row = 0;
            for x in 0..w {
                row += u32::from(self.spread[y * w + x] & own != 0);
                self.counts[(y + 1) * (w + 1) + x + 1] = self.counts[y * (w + 1) + x + 1] + row;
            }
        }
    }

    /// Start of the plane and place in it of an orientation at a pixel, at most the border outside the picture.
    #[inline]
    fn place(&self, bin: usize, x: i32, y: i32) -> (usize, usize) {
        let border = (self.border * SPREAD) as i32;
        let (x, y) = ((x + border) as usize, (y + border) as usize);
        let phase = (y % SPREAD) * SPREAD + x % SPREAD;
        ((bin * SPREAD * SPREAD + phase) * self.plane, (y / SPREAD) * self.stride + x / SPREAD)
    }

    /// Where the answers to a template's point, `(dx, dy)` pixels from its centre, start when the centre moves over all
    /// positions in order.
    pub fn start(&self, bin: usize, dx: i32, dy: i32) -> usize {
        let (start, place) = self.place(bin, dx, dy);
        start + place
    }

    /// Number of positions in order, a row with those right of the picture, which count for nothing.
    pub fn positions(&self) -> usize {
        self.rows * self.stride
    }

    /// Pixel of a position; `None` right of the picture.
    pub fn pixel(&self, position: usize) -> Option<[f64; 2]> {
        let (column, row) = (position % self.stride, position / self.stride);
        // The neighbourhood reaches half a pixel farther right and down.
        let middle = |k: usize| (k * SPREAD) as f64 + 0.5;
        (column < self.columns && row < self.rows).then(|| [middle(column), middle(row)])
    }

    /// True for a position and its eight neighbours.
    pub fn near(&self, a: usize, b: usize) -> bool {
        let ((ax, ay), (bx, by)) = ((a % self.stride, a / self.stride), (b % self.stride, b / self.stride));
        ax.abs_diff(bx) <= 1 && ay.abs_diff(by) <= 1
    }

    /// Sums of the answers that start at `starts` for [`BLOCK`] positions from `first` on.
    #[inline]
    pub fn sum(&self, starts: &[usize], first: usize, sum: &mut [u8; BLOCK]) {
        for &start in starts {
            if let Some(answers) = self.answers.get(start + first..start + first + BLOCK) {
                for (s, a) in sum.iter_mut().zip(answers) {
                    *s = s.wrapping_add(*a);
                }
            }
        }
    }
}

/// The picture resized by factors of at most 1 along its columns and rows; pixel areas cover each other.
pub fn resized(image: &GrayImage, factors: [f64; 2]) -> GrayImage {
    let size = |n: u32, f: f64| ((f64::from(n) * f).round() as u32).clamp(1, n.max(1));
    let (w, h) = image.dimensions();
    if w == 0 || h == 0 {
        return GrayImage::new(0, 0);
    }
    let (width, height) = (size(w, factors[0]), size(h, factors[1]));
    // Weights of the source pixels of each target pixel, by the overlap of their areas.
    let overlaps = |from: u32, to: u32, factor: f64| -> Vec<(usize, Vec<f32>)> {
        (0..to)
            .map(|k| {
                let (a, b) = (f64::from(k) / factor, (f64::from(k + 1) / factor).min(f64::from(from)));
                let first = (a as usize).min(from as usize - 1);
                let last = ((b.ceil() as usize).max(first + 1)).min(from as usize);
                let total = (b - a).max(1e-9);
                let part = |p: usize| (((p + 1) as f64).min(b) - (p as f64).max(a)).max(0.0) / total;
                (first, (first..last).map(|p| part(p) as f32).collect())
            })
            .collect()
    };
    let (across, down) = (overlaps(w, width, factors[0]), overlaps(h, height, factors[1]));
    let pixels = image.as_raw();
    let mut rows = vec![0.0_f32; width as usize];
    let mut out = GrayImage::new(width, height);
    for (y, (top, weights)) in down.iter().enumerate() {
        rows.fill(0.0);
        for (j, weight) in weights.iter().enumerate() {
            let line = &pixels[(top + j) * w as usize..][..w as usize];
            for (sum, (left, parts)) in rows.iter_mut().zip(&across) {
                let mean: f32 = parts.iter().zip(&line[*left..]).map(|(p, v)| p * f32::from(*v)).sum();
                *sum += weight * mean;
            }
        }
        for (x, value) in rows.iter().enumerate() {
            out.put_pixel(x as u32, y as u32, Luma([value.round().clamp(0.0, 255.0) as u8]));
        }
    }
    out
}
