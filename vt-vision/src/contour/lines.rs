//! Edge pixels as bits of rows and columns: all edges on a normal by one shift.

use core::array::from_fn;

use nalgebra::{Point2, Vector2};
use vt_core::frame::Roi;

use crate::edge_map::EdgePixel;
use crate::plane::{area, reserve};

/// Longest half range along a normal, pixels: on a diagonal a word of 64 bits holds no more of a row.
pub const REACH: f64 = 21.0;

/// Bits before and after the middle of a window.
const HALF: u32 = 31;

/// Classes of directions within 45 degrees of an axis; each has bits of its own.
const CLASSES: usize = 8;

/// An edge lies on rows if its gradient has at least this share of the other axis' along them, and on columns alike: past
/// the diagonal both see it.
const SHARE: f32 = 0.35;

/// Cosine of the largest angle between the middle of a normal's class and the gradient of an edge that may belong to it.
const ALIGNED: f32 = 0.85;

/// Edges closer than this along a normal are one, pixels.
const SAME: f64 = 0.8;

/// A number below 2⁵¹ plus this has the nearest integer in its lowest bits.
const ROUND: f64 = 6_755_399_441_055_744.0;

/// One bit a pixel and class, by lines of whole words, a word of zeros on either end of each.
#[derive(Clone, Copy, Debug, Default)]
struct Layout {
    /// Where the words begin.
    first: u32,
    /// Words of a line.
    stride: u32,
    /// Lines of a class.
    lines: u32,
}

impl Layout {
    fn new(first: usize, length: u32, lines: u32) -> Self {
        Self { first: first as u32, stride: length / 64 + 3, lines }
    }

    /// Rows of a region, and its columns behind them.
    fn both(width: u32, height: u32) -> [Self; 2] {
        let rows = Self::new(0, width, height);
        [rows, Self::new(rows.end(), height, width)]
    }

    /// Number of the word behind the last.
    fn end(self) -> usize {
        self.first as usize + self.stride as usize * self.lines as usize * CLASSES
    }

    /// Word of a line's first bit.
    #[inline(always)]
    fn line(self, class: u32, line: u32) -> u32 {
        (class.wrapping_mul(self.lines).wrapping_add(line))
            .wrapping_mul(self.stride)
            .wrapping_add(self.first + 1)
    }
}

/// Where a normal meets edges: bits, and the positions of their pixels.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Aim {
    word: u32,
    shift: u32,
    reach: u32,
    /// Pixel of the first bit, and the way to the next.
    cell: u32,
    step: u32,
}

/// The edges of a region.
#[derive(Clone, Debug)]
pub struct EdgeLines {
    region: Roi,
    words: Vec<u64>,
    rows: Layout,
    columns: Layout,
    /// Positions of edges by pixel; those without a bit are never looked at.
    cells: Vec<[f32; 2]>,
    /// Middles of the classes: those along rows, then those along columns.
    directions: [[f32; 2 * CLASSES]; 2],
}

impl Default for EdgeLines {
    fn default() -> Self {
        let direction = |k: usize| {
            let slope = ((k % CLASSES) as f64 + 0.5) * 2.0 / CLASSES as f64 - 1.0;
            let along = 1.0 / (1.0 + slope * slope).sqrt();
            if k < CLASSES { [along, slope * along] } else { [slope * along, along] }
        };
        Self {
            region: Roi { x: 0, y: 0, width: 0, height: 0 },
            words: vec![0; 2],
            rows: Layout::default(),
            columns: Layout::default(),
            cells: vec![],
            directions: from_fn(|axis| from_fn(|k| direction(k)[axis] as f32)),
        }
    }
}

impl EdgeLines {
    /// Makes room for all edges of a picture, so that regions which grow take no memory later.
    pub fn reserve(&mut self, [width, height]: [u32; 2]) {
        reserve(&mut self.words, Layout::both(width, height)[1].end());
        reserve(&mut self.cells, area((width, height)));
    }

    /// Takes the edges of a region: column and row of the pixel, position and direction. Those outside are left out.
    pub fn fill(&mut self, region: Roi, edges: impl Iterator<Item = (u32, u32, EdgePixel)>) {
        let Roi { width, height, .. } = region;
        self.region = region;
        [self.rows, self.columns] = Layout::both(width, height);
        self.words.clear();
        self.words.resize(self.columns.end().max(2), 0);
        self.cells.resize(width as usize * height as usize, [0.0; 2]);
        let [x_middles, y_middles] = self.directions;
        for (x, y, edge) in edges {
            let (u, v) = (x.wrapping_sub(region.x), y.wrapping_sub(region.y));
            if u >= width || v >= height {
                continue;
            }
            let [along, across] = [edge.direction.x as f32, edge.direction.y as f32];
            let aligned: [bool; 2 * CLASSES] =
                from_fn(|k| (along * x_middles[k] + across * y_middles[k]).abs() >= ALIGNED);
            let [rows, columns] = [along.abs() >= SHARE * across.abs(), across.abs() >= SHARE * along.abs()];
            for (class, _) in aligned.iter().enumerate().filter(|(_, aligned)| **aligned) {
                let (seen, layout, line, at) =
                    if class < CLASSES { (rows, self.rows, v, u) } else { (columns, self.columns, u, v) };
                if seen {
                    let word = layout.line((class % CLASSES) as u32, line) + at / 64;
                    self.words[word as usize] |= 1 << (at % 64);
                }
            }
            self.cells[v as usize * width as usize + u as usize] = [edge.at.x as f32, edge.at.y as f32];
        }
    }

    /// Where the normal at a place looks: on the row or column nearer to it, from where the contour crosses that; a contour is
    /// not changed by sliding along itself. Nowhere for places that are not in the region.
    #[inline(always)]
    pub(super) fn aim(&self, x: f64, y: f64, nx: f64, ny: f64, range: f64) -> Aim {
        let along_row = nx.abs() >= ny.abs();
        let (left, top) = (f64::from(self.region.x), f64::from(self.region.y));
        let (width, height) = (self.region.width, self.region.height);
        let (s, ns) = if along_row { (x - left, nx) } else { (y - top, ny) };
        let (t, nt) = if along_row { (y - top, ny) } else { (x - left, nx) };
        let (length, lines) = if along_row { (width, height) } else { (height, width) };
        let reciprocal = 1.0 / ns;
        let slope = nt * reciprocal;
        let line = t + ROUND;
        // On the contour, n_s ds + n_t dt = 0.
        let start = s - slope * ((line - ROUND) - t);
        // NaN fails the comparisons.
        let inside =
            (t >= -0.5) & (t < f64::from(lines) - 0.5) & (start >= -0.5) & (start < f64::from(length) - 0.5);
        let line = line.to_bits() as u32;
        let middle = (start + ROUND).to_bits() as u32;
        // From -1 to 1 in equal parts; rounding never goes past the last.
        let class = (((slope + 1.0) * (0.499 * CLASSES as f64) - 0.499) + ROUND).to_bits() as u32;
        let reach = (range * reciprocal.abs() + ROUND).to_bits() as u32;
        let layout = if along_row { self.rows } else { self.columns };
        let first = middle.wrapping_add(64 - HALF);
        let word = layout.line(class, line).wrapping_add(first >> 6).wrapping_sub(1);
        let start = middle.wrapping_sub(HALF);
        let (u, v) = if along_row { (start, line) } else { (line, start) };
        // The first word of all has no bits.
        Aim {
            word: if inside { word } else { 0 },
            shift: if inside { first & 63 } else { 0 },
            reach: if inside { reach.min(HALF) } else { 0 },
            cell: v.wrapping_mul(width).wrapping_add(u),
            step: if along_row { 1 } else { width },
        }
    }

    /// Calls `f` with the distance along the unit normal of every edge within `range` pixels of the place, and with its position;
    /// distances ascend or descend.
    #[inline(always)]
    pub(super) fn hits(
        &self,
        aim: &Aim,
        [x, y, nx, ny]: [f64; 4],
        range: f64,
        mut f: impl FnMut(f64, [f64; 2]),
    ) {
        let wanted = (u64::MAX >> (63 - 2 * (aim.reach & 31))) << (HALF - (aim.reach & 31));
        let at = aim.word as usize;
        let [low, high] = [self.words[at], self.words[at + 1]];
        // Two shifts, since one by 64 is none.
        let mut window = (low >> (aim.shift & 63) | (high << 1) << (63 - (aim.shift & 63))) & wanted;
        let mut before = f64::INFINITY;
        while window != 0 {
            let cell = aim.cell.wrapping_add(window.trailing_zeros().wrapping_mul(aim.step));
            window &= window - 1;
            let edge = self.cells[cell as usize].map(f64::from);
            let r = nx * (edge[0] - x) + ny * (edge[1] - y);
            if (r.abs() <= range) & ((r - before).abs() >= SAME) {
                before = r;
                f(r, edge);
            }
        }
    }

    /// Calls `f` with the distance from `y` along the unit vector `normal` of every edge on that normal within `range`
    /// pixels, and with its position; distances ascend or descend.
    #[inline]
    pub fn each(
        &self,
        y: Point2<f64>,
        normal: Vector2<f64>,
        range: f64,
        mut f: impl FnMut(f64, Point2<f64>),
    ) {
        let at = [y.x, y.y, normal.x, normal.y];
        let aim = self.aim(y.x, y.y, normal.x, normal.y, range);
        self.hits(&aim, at, range, |r, edge| f(r, edge.into()));
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
