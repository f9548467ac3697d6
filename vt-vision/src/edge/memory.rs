//! What each model edge looked like when it was last seen.

/// Signed contrast of every model edge, from the edges that were matched to it (contrast continuity of the moving
/// edges method, with polarity).
#[derive(Clone, Debug, Default)]
pub struct ContrastMemory {
    edges: Vec<Option<Contrast>>,
}

#[derive(Clone, Copy, Debug)]
struct Contrast {
    mean: f64,
    deviation: f64,
}

/// Share of a new observation in the running mean.
const RATE: f64 = 0.2;

/// Weight of an edge that contradicts the memory altogether: appearance does change.
const FLOOR: f64 = 0.1;

impl ContrastMemory {
    /// Prior weight of an edge with this contrast on the model edge `edge`, in `[0.1, 1]`; 1 where nothing is known.
    pub fn weight(&self, edge: u32, contrast: f64) -> f64 {
        let Some(Some(known)) = self.edges.get(edge as usize) else { return 1.0 };
        // A Cauchy kernel: contrast differs along an edge, and by much.
        let d = (contrast - known.mean) / known.deviation;
        FLOOR + (1.0 - FLOOR) / (1.0 + d * d)
    }

    /// Takes in the mean contrast of the edges matched to `edge` in one frame.
    pub fn observe(&mut self, edge: u32, contrast: f64) {
        if self.edges.len() <= edge as usize {
            self.edges.resize(edge as usize + 1, None);
        }
        let slot = &mut self.edges[edge as usize];
        let spread = |mean: f64| 0.5 * mean.abs() + 8.0;
        *slot = Some(match *slot {
            None => Contrast { mean: contrast, deviation: spread(contrast) },
            Some(c) => {
                let mean = c.mean + RATE * (contrast - c.mean);
                Contrast { mean, deviation: spread(mean) }
            }
        });
    }

    /// Forgets everything, after a re-initialisation.
    pub fn clear(&mut self) {
        self.edges.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn opposite_polarity_weighs_less_and_unknown_edges_are_neutral() {
        let mut memory = ContrastMemory::default();
        assert_eq!(memory.weight(7, -50.0), 1.0);
        memory.observe(7, 40.0);
        memory.observe(7, 60.0);
        assert!(memory.weight(7, 44.0) > 0.99);
        assert!(memory.weight(7, -44.0) < 0.2);
        assert_eq!(memory.weight(2, 10.0), 1.0);
        memory.clear();
        assert_eq!(memory.weight(7, -44.0), 1.0);
    }
}
