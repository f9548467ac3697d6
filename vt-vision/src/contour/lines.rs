//! Edge pixels as bits of rows and columns: all edges on a normal by one shift.

use nalgebra::{Point2, Vector2};
use vt_core::frame::Roi;

use crate::edge_map::EdgePixel;

/// Longest half range along a normal, pixels: on a diagonal a word of 64 bits holds no more of a row.
pub const REACH: f64 = 21.0;

/// Bits before and after the middle of a window.
const HALF: i64 = 31;

/// Directions are kept in this many sectors of the full circle.
const SECTORS: usize = 256;

/// Offsets are kept in this many steps a pixel.
const STEPS: f64 = 100.0;

/// An edge lies on rows if its gradient has at least this share of the other axis' along them, and on columns alike: past
/// the diagonal both see it.
const SHARE: f64 = 0.35;

/// Cosine of the largest angle between a normal and the gradient of an edge that may belong to it.
const ALIGNED: f64 = 0.85;

/// Edges closer than this along a normal are one, pixels.
const SAME: f64 = 0.8;

/// Position and direction of an edge pixel.
#[derive(Clone, Copy, Debug, Default)]
struct Cell {
    /// From the middle of the pixel, in [`STEPS`].
    offset: [i8; 2],
    sector: u8,
}

/// One bit a pixel, by lines of whole words, a word of zeros on either end of each.
#[derive(Clone, Debug, Default)]
struct Bits {
    words: Vec<u64>,
    stride: usize,
}

impl Bits {
    fn clear(&mut self, length: usize, lines: usize) {
        self.stride = length / 64 + 3;
        self.words.clear();
        self.words.resize(self.stride * lines, 0);
    }

    fn set(&mut self, line: usize, at: usize) {
        self.words[line * self.stride + at / 64 + 1] |= 1 << (at % 64);
    }

    /// The pixels from `HALF` before `at` to as many after it; `at` must lie on the line.
    #[inline]
    fn window(&self, line: usize, at: usize) -> u64 {
        let first = at + 64 - HALF as usize;
        let (word, shift) = (line * self.stride + first / 64, first % 64);
        let [low, high] = [self.words[word], self.words[word + 1]];
        // Two shifts, since one by 64 is none.
        low >> shift | (high << 1) << (63 - shift)
    }
}

/// The edges of a region.
#[derive(Clone, Debug)]
pub struct EdgeLines {
    region: Roi,
    rows: Bits,
    columns: Bits,
    cells: Vec<Cell>,
    directions: Vec<Vector2<f64>>,
}

impl Default for EdgeLines {
    fn default() -> Self {
        let direction = |k: usize| {
            let angle = k as f64 * core::f64::consts::TAU / SECTORS as f64;
            let (s, c) = vt_core::math::sin_cos(angle);
            Vector2::new(c, s)
        };
        Self {
            region: Roi { x: 0, y: 0, width: 0, height: 0 },
            rows: Bits::default(),
            columns: Bits::default(),
            cells: vec![],
            directions: (0..SECTORS).map(direction).collect(),
        }
    }
}

impl EdgeLines {
    /// Takes the edges of a region: column and row of the pixel, position and direction. Those outside are left out.
    pub fn fill(&mut self, region: Roi, edges: impl Iterator<Item = (u32, u32, EdgePixel)>) {
        let (width, height) = (region.width as usize, region.height as usize);
        self.region = region;
        self.rows.clear(width, height);
        self.columns.clear(height, width);
        // Cells without a bit are never looked at.
        self.cells.resize(width * height, Cell::default());
        for (x, y, edge) in edges {
            let (u, v) = (x.wrapping_sub(region.x), y.wrapping_sub(region.y));
            if u >= region.width || v >= region.height {
                continue;
            }
            let (u, v) = (u as usize, v as usize);
            let [along, across] = [edge.direction.x.abs(), edge.direction.y.abs()];
            if along >= SHARE * across {
                self.rows.set(v, u);
            }
            if across >= SHARE * along {
                self.columns.set(u, v);
            }
            let turn = vt_core::math::atan2(edge.direction.y, edge.direction.x) / core::f64::consts::TAU;
            let offset = edge.at - Point2::new(f64::from(x), f64::from(y));
            self.cells[v * width + u] = Cell {
                offset: [0, 1].map(|k| (offset[k] * STEPS).round() as i8),
                sector: ((turn * SECTORS as f64).round() as i64 & (SECTORS as i64 - 1)) as u8,
            };
        }
    }

    /// Calls `f` with the distance from `y` along the unit vector `normal` of every edge on that normal within `range`
    /// pixels, and with its position; distances ascend or descend. Searched is the row or column nearer to the normal, from where the
    /// contour crosses it: a contour is not changed by sliding along itself.
    #[inline]
    pub fn each(
        &self,
        y: Point2<f64>,
        normal: Vector2<f64>,
        range: f64,
        mut f: impl FnMut(f64, Point2<f64>),
    ) {
        let along_row = normal.x.abs() >= normal.y.abs();
        let (left, top) = (f64::from(self.region.x), f64::from(self.region.y));
        let (s, t, ns, nt) = if along_row {
            (y.x - left, y.y - top, normal.x, normal.y)
        } else {
            (y.y - top, y.x - left, normal.y, normal.x)
        };
        let (length, lines) = if along_row {
            (self.region.width, self.region.height)
        } else {
            (self.region.height, self.region.width)
        };
        // Truncation rounds positive numbers down; NaN fails the comparison.
        if !(t >= -0.5 && t < f64::from(lines) - 0.5) {
            return;
        }
        let line = (t + 0.5) as usize;
        let reciprocal = 1.0 / ns;
        // On the contour, n_s ds + n_t dt = 0.
        let start = s - nt * reciprocal * (line as f64 - t);
        if !(start >= -0.5 && start < f64::from(length) - 0.5) {
            return;
        }
        let middle = (start + 0.5) as usize;
        let bits = if along_row { &self.rows } else { &self.columns };
        // Bits within reach of the middle.
        let reach = ((range * reciprocal.abs() + 0.5) as i64).min(HALF);
        let wanted = (u64::MAX >> (63 - 2 * reach)) << (HALF - reach);
        let mut window = bits.window(line, middle) & wanted;
        let mut before = f64::INFINITY;
        while window != 0 {
            let at = middle as i64 + i64::from(window.trailing_zeros()) - HALF;
            window &= window - 1;
            let (u, v) = if along_row { (at as usize, line) } else { (line, at as usize) };
            let cell = self.cells[v * self.region.width as usize + u];
            let edge = Point2::new(
                left + u as f64 + f64::from(cell.offset[0]) * (1.0 / STEPS),
                top + v as f64 + f64::from(cell.offset[1]) * (1.0 / STEPS),
            );
            let r = normal.dot(&(edge - y));
            let aligned = self.directions[usize::from(cell.sector)].dot(&normal).abs() >= ALIGNED;
            if aligned && r.abs() <= range && (r - before).abs() >= SAME {
                before = r;
                f(r, edge);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Edge pixels of straight lines `n · y = c`, as a detector that thins along the nearer axis gives them.
    fn drawn(region: Roi, straight: &[(f64, f64)]) -> Vec<(u32, u32, EdgePixel)> {
        let mut edges = vec![];
        for &(angle, c) in straight {
            let (s, co) = vt_core::math::sin_cos(angle);
            let n = Vector2::new(co, s);
            for y in region.y..region.y + region.height {
                for x in region.x..region.x + region.width {
                    let p = Point2::new(f64::from(x), f64::from(y));
                    let step = if n.x.abs() >= n.y.abs() {
                        Vector2::new((c - n.dot(&p.coords)) / n.x, 0.0)
                    } else {
                        Vector2::new(0.0, (c - n.dot(&p.coords)) / n.y)
                    };
                    if step.amax() < 0.5 {
                        edges.push((x, y, EdgePixel { at: p + step, direction: n }));
                    }
                }
            }
        }
        edges
    }

    fn distances(lines: &EdgeLines, y: Point2<f64>, normal: Vector2<f64>, range: f64) -> Vec<f64> {
        let mut found = vec![];
        lines.each(y, normal, range, |r, _| found.push(r));
        found.sort_by(f64::total_cmp);
        found
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 200, rng_seed: proptest::test_runner::RngSeed::Fixed(2), ..Default::default() })]

        /// Parallel lines are met where they are, whatever their direction and a small error of the normal's.
        #[test]
        fn parallel_edges_are_met_at_their_distances(
            angle in 0.0..core::f64::consts::TAU,
            tilt in -0.1..0.1_f64,
            (x, y) in (70.0..90.0_f64, 60.0..80.0_f64),
            first in -12.0..-2.0_f64,
            gap in 3.0..9.0_f64,
        ) {
            let region = Roi { x: 30, y: 20, width: 100, height: 100 };
            let (s, c) = vt_core::math::sin_cos(angle);
            let n = Vector2::new(c, s);
            let at = Point2::new(x, y);
            let own = n.dot(&at.coords);
            let mut lines = EdgeLines::default();
            let expected = [first, first + gap];
            lines.fill(region, drawn(region, &expected.map(|d| (angle, own + d))).into_iter());
            let (s, c) = vt_core::math::sin_cos(angle + tilt);
            let found = distances(&lines, at, Vector2::new(c, s), 15.0);
            prop_assert_eq!(found.len(), 2, "{:?}", found);
            for (found, expected) in found.iter().zip(expected) {
                // The sideways distance of what is met, up to the distance itself, turns with the tilt.
                prop_assert!((found - expected).abs() < 0.02 + 1.1 * tilt.abs() * (expected.abs() + 1.0), "{} {}", found, expected);
            }
        }
    }

    #[test]
    fn edges_out_of_range_across_or_outside_are_not_met() {
        let region = Roi { x: 0, y: 0, width: 130, height: 40 };
        let mut lines = EdgeLines::default();
        lines.fill(region, drawn(region, &[(0.0, 64.3), (core::f64::consts::FRAC_PI_2, 20.2)]).into_iter());
        let x = Vector2::x();
        assert_eq!(distances(&lines, Point2::new(60.0, 10.0), x, 10.0).len(), 1);
        assert!((distances(&lines, Point2::new(60.0, 10.0), x, 10.0)[0] - 4.3).abs() < 0.01);
        assert!((distances(&lines, Point2::new(60.0, 10.0), -x, 10.0)[0] + 4.3).abs() < 0.01);
        assert!(distances(&lines, Point2::new(60.0, 10.0), x, 4.0).is_empty());
        assert!((distances(&lines, Point2::new(44.0, 10.0), x, REACH)[0] - 20.3).abs() < 0.01);
        for (u, v) in
            [(-0.6, 10.0), (129.6, 3.0), (f64::NAN, 1.0), (1.0, f64::NAN), (1e300, 2.0), (5.0, -1e300)]
        {
            assert!(distances(&lines, Point2::new(u, v), x, REACH).is_empty());
        }
        // Corners of the region, all directions, another region in the same buffers.
        lines.fill(Roi { x: 5, y: 5, width: 7, height: 3 }, core::iter::empty());
        for k in 0..64 {
            let (s, c) = vt_core::math::sin_cos(f64::from(k) * 0.1);
            for at in [Point2::new(5.0, 5.0), Point2::new(11.4, 7.4)] {
                assert!(distances(&lines, at, Vector2::new(c, s), REACH).is_empty());
            }
        }
        lines.fill(Roi { x: 0, y: 0, width: 0, height: 0 }, core::iter::empty());
        assert!(distances(&lines, Point2::origin(), x, 5.0).is_empty());
    }
}
