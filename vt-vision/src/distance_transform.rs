//! Exact Euclidean distance of every pixel to the nearest marked one, and which that is (Felzenszwalb and Huttenlocher, "Distance
//! transforms of sampled functions", 2012): first along columns, then the lower envelope of parabolas along rows.

use vt_core::batch::vectorized;
use vt_core::error::MeasureError;
use vt_core::evidence::{EvidenceKey, Processing, Slot};
use vt_core::frame::{Frame, Roi, SensorId};

use crate::canny::{Canny, CannyEvidence, CannyParams};
use crate::plane::{Plane, reserve};
use crate::turns::Turns;

/// Rows without a marked pixel in a column.
const NONE: u16 = u16::MAX;

/// Columns that there is room for from the start.
const WIDTH: usize = 4096;

/// Distances to marked pixels.
#[derive(Clone, Debug, Default)]
pub struct DistanceTransform {
    distance: Plane<f32>,
    /// Column and row, both within the region, of the nearest marked pixel.
    nearest: Plane<[u16; 2]>,
    /// Row of the nearest marked pixel in the same column.
    rows: Vec<u16>,
    envelope: Envelope,
    inverse: Vec<f64>,
}

/// Lower envelope of the parabolas `(x − c)² + h_c` along a row.
#[derive(Clone, Debug, Default)]
struct Envelope {
    /// Columns of the parabolas, from left to right, with `c² + h_c`.
    columns: Vec<(u16, f64)>,
    /// First column in which each is the lowest.
    starts: Vec<f64>,
}

impl DistanceTransform {
    /// Distances to the pixels of `mask` that are not zero. Regions of more than 65,534 columns or rows have no distances.
    pub fn compute(&mut self, mask: &Plane<u8>) {
        let region = mask.region();
        let (width, height) = (region.width as usize, region.height as usize);
        let fits = width < usize::from(NONE) && height < usize::from(NONE);
        let region = if fits { region } else { Roi { width: 0, height: 0, ..region } };
        let most = mask.capacity();
        self.distance.reserve(most);
        self.nearest.reserve(most);
        reserve(&mut self.rows, most);
        let (distance, nearest) = (self.distance.reshape(region), self.nearest.reshape(region));
        if distance.is_empty() {
            return;
        }
        columns(mask.values(), width, &mut self.rows);
        let known = self.inverse.len();
        if known < width {
            self.inverse.extend((known..width.max(WIDTH)).map(|d| 0.5 / d.max(1) as f64));
        }
        reserve(&mut self.envelope.columns, self.inverse.len());
        reserve(&mut self.envelope.starts, self.inverse.len());
        let lines = self.rows.chunks_exact(width).zip(distance.chunks_exact_mut(width));
        for (y, ((rows, distance), nearest)) in lines.zip(nearest.chunks_exact_mut(width)).enumerate() {
            self.envelope.build(rows, y, &self.inverse);
            self.envelope.fill(nearest, rows);
            lengths(nearest, y, distance);
        }
    }

    /// Distances in pixels, infinite where nothing is marked.
    pub fn distance(&self) -> &Plane<f32> {
        &self.distance
    }

    /// Distance of a pixel of the picture, and column and row of the marked pixel that is nearest to it. None outside of the
    /// region, and where nothing is marked.
    #[inline]
    pub fn get(&self, x: u32, y: u32) -> Option<(f32, [u32; 2])> {
        let distance = self.distance.get(x, y).filter(|d| d.is_finite())?;
        let [u, v] = self.nearest.get(x, y)?.map(u32::from);
        let region = self.distance.region();
        Some((distance, [region.x + u, region.y + v]))
    }
}

/// Row of the nearest marked pixel in every column.
fn columns(mask: &[u8], width: usize, rows: &mut Vec<u16>) {
    rows.resize(mask.len(), NONE);
    vectorized(
        #[inline(always)]
        move || {
            // Downwards: the last one seen above.
            for y in 0..mask.len() / width {
                let (before, here) = rows.split_at_mut(y * width);
                let mask = &mask[y * width..][..width];
                let here = &mut here[..width];
                if y == 0 {
                    here.iter_mut().zip(mask).for_each(|(r, &m)| *r = if m != 0 { 0 } else { NONE });
                } else {
                    let above = &before[(y - 1) * width..][..width];
                    for ((r, &m), &a) in here.iter_mut().zip(mask).zip(above) {
                        *r = if m != 0 { y as u16 } else { a };
                    }
                }
            }
            // Upwards: the one below where that is nearer.
            for y in (0..mask.len() / width - 1).rev() {
                let (here, below) = rows.split_at_mut((y + 1) * width);
                let at = y as i32;
                for (r, &b) in here[y * width..].iter_mut().zip(&below[..width]) {
                    let (up, down) = (at - i32::from(*r), i32::from(b) - at);
                    // No row is both NONE and nearer than another, except where both are.
                    let up = if *r == NONE { i32::from(NONE) } else { up };
                    *r = if down < up { b } else { *r };
                }
            }
        },
    );
}

impl Envelope {
    /// Finds which columns' pixels are nearest somewhere on row `y`.
    fn build(&mut self, rows: &[u16], y: usize, inverse: &[f64]) {
        self.columns.clear();
        self.starts.clear();
        for (c, &row) in rows.iter().enumerate() {
            if row == NONE {
                continue;
            }
            let h = (f64::from(row) - y as f64) * (f64::from(row) - y as f64);
            let value = (c * c) as f64 + h;
            let mut start = 0.0;
            while let Some(&(last, other)) = self.columns.last() {
                // Where both parabolas are equal. The product may miss a whole number by a rounding error; there both
                // pixels are as near.
                let crossing = (value - other) * inverse[c - usize::from(last)];
                if crossing > self.starts[self.starts.len() - 1] {
                    start = crossing;
                    break;
                }
                self.columns.pop();
                self.starts.pop();
            }
            if self.columns.is_empty() {
                start = -1.0;
            }
            self.columns.push((c as u16, value));
            self.starts.push(start);
        }
    }

    /// Nearest marked pixel of every pixel of the row.
    fn fill(&self, nearest: &mut [[u16; 2]], rows: &[u16]) {
        if self.columns.is_empty() {
            nearest.fill([NONE; 2]);
        }
        let width = nearest.len();
        let first = |start: f64| if start < 0.0 { 0 } else { (start as usize + 1).min(width) };
        let ends = self.starts.iter().skip(1).map(|&s| first(s)).chain([width]);
        let mut begin = 0;
        for (&(c, _), end) in self.columns.iter().zip(ends) {
            nearest[begin..end].fill([c, rows[usize::from(c)]]);
            begin = end;
        }
    }
}

/// Distances of the pixels of row `y` to their nearest marked ones.
fn lengths(nearest: &[[u16; 2]], y: usize, distance: &mut [f32]) {
    vectorized(
        #[inline(always)]
        move || {
            let (y, n) = (y as i32, distance.len().min(nearest.len()));
            let (distance, nearest) = (&mut distance[..n], &nearest[..n]);
            for x in 0..n {
                let [u, v] = nearest[x].map(i32::from);
                let (a, b) = ((u - x as i32) as f32, (v - y) as f32);
                let length = (a * a + b * b).sqrt();
                distance[x] = if u == i32::from(NONE) { f32::INFINITY } else { length };
            }
        },
    );
}

/// Edges of a frame and the distance of every pixel to them.
#[derive(Default)]
pub struct EdgeDistance {
    canny: CannyEvidence,
    distance: Turns<DistanceTransform>,
}

impl EdgeDistance {
    /// The edges.
    pub fn edges(&self) -> &Turns<Canny> {
        &self.canny.edges
    }

    /// Distances to them.
    pub fn distance(&self) -> &Turns<DistanceTransform> {
        &self.distance
    }
}

/// Makes an [`EdgeDistance`] of every frame of a sensor.
pub struct EdgeDistanceProcessing {
    key: EvidenceKey,
    params: CannyParams,
}

impl EdgeDistanceProcessing {
    /// Distances to the edges of the pictures of `sensor`.
    pub fn new(sensor: SensorId, params: CannyParams) -> Self {
        Self { key: Self::key_for(sensor, &params), params }
    }

    /// Key under which the [`EdgeDistance`] is found.
    pub fn key_for(sensor: SensorId, params: &CannyParams) -> EvidenceKey {
        EvidenceKey { sensor, name: format!("edge-distance/{}", params.name()).into() }
    }
}

impl Processing for EdgeDistanceProcessing {
    fn key(&self) -> &EvidenceKey {
        &self.key
    }

    fn run(&self, frame: &Frame, roi: Option<Roi>, slot: &mut Slot) -> Result<(), MeasureError> {
        let evidence = slot.buffer::<EdgeDistance>();
        evidence.canny.compute(frame, roi, &self.params)?;
        evidence.distance.turn().compute(evidence.canny.edges.now().mask());
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn distances_are_the_least_of_all(
            (width, height) in (1u32..24, 1u32..24), rarity in 1u8..60, draws in prop::collection::vec(any::<u8>(), 576),
        ) {
            let region = Roi { x: 4, y: 9, width, height };
            let mut mask = Plane::default();
            for (m, &d) in mask.reshape(region).iter_mut().zip(&draws) {
                *m = u8::from(d % rarity == 0);
            }
            let mut found = DistanceTransform::default();
            found.compute(&mask);
            let pixels = || (9..9 + height).flat_map(|y| (4..4 + width).map(move |x| (x, y)));
            let squared = |(x, y): (u32, u32), (u, v): (u32, u32)| x.abs_diff(u).pow(2) + y.abs_diff(v).pow(2);
            for p in pixels() {
                let least = pixels().filter(|&q| mask.get(q.0, q.1) == Some(1)).map(|q| squared(p, q)).min();
                match (least, found.get(p.0, p.1)) {
                    (None, None) => prop_assert_eq!(found.distance().get(p.0, p.1), Some(f32::INFINITY)),
                    (Some(least), Some((distance, [u, v]))) => {
                        prop_assert_eq!(mask.get(u, v), Some(1));
                        prop_assert_eq!(squared(p, (u, v)), least);
                        prop_assert_eq!(distance, (least as f32).sqrt());
                    }
                    other => prop_assert!(false, "{:?}", other),
                }
            }
        }
    }

    #[test]
    fn far_pixels_of_a_large_region_are_exact() {
        let mut mask = Plane::default();
        mask.reshape(Roi { x: 0, y: 0, width: 5000, height: 700 }).fill(0);
        for (x, y) in [(3, 690), (4990, 2), (2500, 350)] {
            mask.values_mut()[y * 5000 + x] = 1;
        }
        let mut found = DistanceTransform::default();
        found.compute(&mask);
        for (x, y) in [(0u32, 0u32), (4999, 699), (1251, 520), (1252, 520), (3745, 176)] {
            let squares = [(3u32, 690u32), (4990, 2), (2500, 350)]
                .map(|(u, v)| u64::from(x.abs_diff(u)).pow(2) + u64::from(y.abs_diff(v)).pow(2));
            let least = *squares.iter().min().unwrap();
            assert_eq!(found.get(x, y).unwrap().0, (least as f64).sqrt() as f32);
        }
        found.compute(&Plane::default());
        assert_eq!(found.get(0, 0), None);
    }
}
