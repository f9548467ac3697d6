//! What the object looked like on both sides of its edges when they were last seen.

use nalgebra::{Point3, Vector3};
use vt_models::visibility::Side;

/// Grey levels beside an edge, before and after it along the normal.
pub type Sides = [f32; 2];

/// Appearance along every model edge, from the image edges that were matched to it.
///
/// At an occluding contour only one side belongs to the object: the other shows whatever lies behind, and the step
/// between them may change its sign from frame to frame. So grey levels are kept for each side, and only those of the
/// object count. Texture changes along an edge: levels are kept in cells of fixed length.
///
/// The cells live in a table of fixed size, each at the place that its edge and number say; two cells at one place
/// displace each other. It is a cache: what is displaced is only learnt again.
#[derive(Clone, Debug)]
pub struct AppearanceMemory {
    cell: f64,
    table: Vec<Option<Entry>>,
}

/// A cell of an edge, counted along the edge's direction, with the levels of its sides.
#[derive(Clone, Copy, Debug)]
struct Entry {
    edge: u32,
    cell: i64,
    levels: [Option<f32>; 2],
}

/// Places in the table, a power of two.
const PLACES: usize = 4096;

/// Share of a new observation in the running mean.
const RATE: f32 = 0.2;

/// Weight of a side that contradicts the memory altogether: appearance does change.
const FLOOR: f64 = 0.2;

/// Difference in grey levels at which a side has lost half of its weight.
const TOLERANCE: f64 = 20.0;

/// Sides of an edge that belong to the object: one at an occluding contour, otherwise both.
fn own_sides(contour: Option<Side>) -> [bool; 2] {
    [contour != Some(Side::Positive), contour != Some(Side::Negative)]
}

impl AppearanceMemory {
    /// A memory with cells of this length in metres.
    pub fn new(cell: f64) -> Self {
        Self { cell, table: vec![None; PLACES] }
    }

    fn cell(&self, p: &Point3<f64>, tangent: &Vector3<f64>) -> i64 {
        (p.coords.dot(tangent) / self.cell).floor() as i64
    }

    /// Neighbouring cells of an edge lie side by side, edges far apart (multiplicative hashing, Knuth).
    fn place(edge: u32, cell: i64) -> usize {
        ((u64::from(edge) * 2_654_435_761).wrapping_add(cell as u64) % PLACES as u64) as usize
    }

    /// The levels remembered at the place `p` of the edge `edge` with direction `tangent`.
    pub fn recall(&self, edge: u32, p: &Point3<f64>, tangent: &Vector3<f64>) -> [Option<f32>; 2] {
        let cell = self.cell(p, tangent);
        let entry = self.table[Self::place(edge, cell)].filter(|e| e.edge == edge && e.cell == cell);
        entry.map(|e| e.levels).unwrap_or_default()
    }

    /// Prior weight of an edge with levels `seen` where `known` is remembered; 1 where nothing is known.
    pub fn weight(known: [Option<f32>; 2], contour: Option<Side>, seen: Sides) -> f64 {
        let own = own_sides(contour);
        let mut weight = 1.0;
        for k in 0..2 {
            let Some(level) = known[k].filter(|_| own[k]) else { continue };
            let d = f64::from(seen[k] - level) / TOLERANCE;
            weight *= FLOOR + (1.0 - FLOOR) / (1.0 + d * d);
        }
        weight
    }

    /// Takes in the levels beside the image edge that was matched at a place.
    pub fn observe(
        &mut self,
        edge: u32,
        p: &Point3<f64>,
        tangent: &Vector3<f64>,
        contour: Option<Side>,
        seen: Sides,
    ) {
        let cell = self.cell(p, tangent);
        let place = &mut self.table[Self::place(edge, cell)];
        let known = place.filter(|e| e.edge == edge && e.cell == cell).map(|e| e.levels);
        let mut levels = known.unwrap_or_default();
        let own = own_sides(contour);
        for (k, slot) in levels.iter_mut().enumerate().filter(|(k, _)| own[*k]) {
            *slot = Some(slot.map_or(seen[k], |mean| mean + RATE * (seen[k] - mean)));
        }
        *place = Some(Entry { edge, cell, levels });
    }

    /// Forgets everything, after a re-initialisation.
    pub fn clear(&mut self) {
        self.table.fill(None);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_are_remembered_by_place_and_side() {
        let mut memory = AppearanceMemory::new(0.01);
        let (t, at) = (Vector3::x(), |x: f64| Point3::new(x, 5.0, 0.0));
        assert_eq!(memory.recall(7, &at(0.0), &t), [None, None]);
        memory.observe(7, &at(0.005), &t, None, [40.0, 50.0]);
        memory.observe(7, &at(-0.025), &t, Some(Side::Positive), [10.0, 90.0]);
        memory.observe(7, &at(0.055), &t, Some(Side::Negative), [10.0, 20.0]);
        memory.observe(7, &at(0.055), &t, None, [20.0, 20.0]);
        memory.observe(7, &at(0.055), &t, None, [30.0, 20.0]);
        assert_eq!(memory.recall(7, &at(0.009), &t), [Some(40.0), Some(50.0)]);
        assert_eq!(memory.recall(7, &at(-0.021), &t), [None, Some(90.0)]);
        assert_eq!(memory.recall(7, &at(0.051), &t), [Some(15.6), Some(20.0)]);
        assert_eq!(memory.recall(7, &at(0.02), &t), [None, None]);
        assert_eq!(memory.recall(7, &at(-9.0), &t), [None, None]);
        memory.clear();
        assert_eq!(memory.recall(7, &at(0.009), &t), [None, None]);
    }

    #[test]
    fn only_the_objects_own_side_counts_at_a_contour() {
        let known = [Some(100.0), Some(30.0)];
        let weight = |contour, seen| AppearanceMemory::weight(known, contour, seen);
        assert!(weight(None, [101.0, 29.0]) > 0.99);
        assert!(weight(None, [101.0, 200.0]) < 0.3);
        assert!(weight(Some(Side::Negative), [101.0, 200.0]) > 0.99);
        assert!(weight(Some(Side::Positive), [101.0, 200.0]) < 0.3);
        assert_eq!(AppearanceMemory::weight([None, None], None, [0.0, 255.0]), 1.0);
    }
}
