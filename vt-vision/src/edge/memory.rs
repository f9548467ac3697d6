//! What each stretch of the model's edges looked like when it was last seen.

use nalgebra::{Point3, Vector3};

/// Signed contrast along every model edge, from the edges that were matched to it (contrast continuity of the moving
/// edges method, with polarity). Texture changes along an edge, so contrast is kept in cells of fixed length.
#[derive(Clone, Debug)]
pub struct ContrastMemory {
    cell: f64,
    edges: Vec<Cells>,
}

/// Cells of one edge, counted along the edge's direction from its first one.
#[derive(Clone, Debug, Default)]
struct Cells {
    first: i64,
    contrasts: Vec<Option<f64>>,
}

/// Share of a new observation in the running mean.
const RATE: f64 = 0.2;

/// Weight of an edge that contradicts the memory altogether: appearance does change.
const FLOOR: f64 = 0.1;

/// Most cells of an edge; beyond it contrast is not remembered.
const MOST_CELLS: i64 = 4096;

impl ContrastMemory {
    /// A memory with cells of this length in metres.
    pub fn new(cell: f64) -> Self {
        Self { cell, edges: vec![] }
    }

    fn cell(&self, p: &Point3<f64>, tangent: &Vector3<f64>) -> i64 {
        (p.coords.dot(tangent) / self.cell).floor() as i64
    }

    /// The contrast remembered at the place `p` of the edge `edge` with direction `tangent`.
    pub fn recall(&self, edge: u32, p: &Point3<f64>, tangent: &Vector3<f64>) -> Option<f64> {
        let cells = self.edges.get(edge as usize)?;
        let index = self.cell(p, tangent).checked_sub(cells.first)?;
        *cells.contrasts.get(usize::try_from(index).ok()?)?
    }

    /// Prior weight of an edge with `contrast` where `known` is remembered, in `[0.1, 1]`; 1 where nothing is known.
    pub fn weight(known: Option<f64>, contrast: f64) -> f64 {
        let Some(known) = known else { return 1.0 };
        // A Cauchy kernel: contrast differs with light and view, and by much.
        let d = (contrast - known) / (0.5 * known.abs() + 8.0);
        FLOOR + (1.0 - FLOOR) / (1.0 + d * d)
    }

    /// Takes in the contrast of the edge matched at a place.
    pub fn observe(&mut self, edge: u32, p: &Point3<f64>, tangent: &Vector3<f64>, contrast: f64) {
        let cell = self.cell(p, tangent);
        if self.edges.len() <= edge as usize {
            self.edges.resize(edge as usize + 1, Cells::default());
        }
        let cells = &mut self.edges[edge as usize];
        if cells.contrasts.is_empty() {
            cells.first = cell;
        }
        let Some(index) = cell.checked_sub(cells.first) else { return };
        if index.abs() > MOST_CELLS {
            return;
        }
        if index < 0 {
            cells.contrasts.splice(0..0, core::iter::repeat_n(None, index.unsigned_abs() as usize));
            cells.first = cell;
        }
        let index = index.max(0) as usize;
        if cells.contrasts.len() <= index {
            cells.contrasts.resize(index + 1, None);
        }
        let slot = &mut cells.contrasts[index];
        *slot = Some(slot.map_or(contrast, |mean| mean + RATE * (contrast - mean)));
    }

    /// Forgets everything, after a re-initialisation.
    pub fn clear(&mut self) {
        self.edges.iter_mut().for_each(|cells| cells.contrasts.clear());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contrast_is_remembered_by_place_and_polarity() {
        let mut memory = ContrastMemory::new(0.01);
        let (t, at) = (Vector3::x(), |x: f64| Point3::new(x, 5.0, 0.0));
        assert_eq!(memory.recall(7, &at(0.0), &t), None);
        memory.observe(7, &at(0.005), &t, 40.0);
        memory.observe(7, &at(-0.025), &t, -60.0);
        memory.observe(7, &at(0.055), &t, 10.0);
        memory.observe(7, &at(0.055), &t, 20.0);
        assert_eq!(memory.recall(7, &at(0.009), &t), Some(40.0));
        assert_eq!(memory.recall(7, &at(-0.021), &t), Some(-60.0));
        assert_eq!(memory.recall(7, &at(0.051), &t), Some(12.0));
        assert_eq!(memory.recall(7, &at(0.02), &t), None);
        assert_eq!(memory.recall(7, &at(-9.0), &t), None);
        memory.clear();
        assert_eq!(memory.recall(7, &at(0.009), &t), None);
    }

    #[test]
    fn opposite_polarity_weighs_less_and_unknown_places_are_neutral() {
        assert_eq!(ContrastMemory::weight(None, -50.0), 1.0);
        assert!(ContrastMemory::weight(Some(40.0), 44.0) > 0.95);
        assert!(ContrastMemory::weight(Some(40.0), -44.0) < 0.2);
    }
}
