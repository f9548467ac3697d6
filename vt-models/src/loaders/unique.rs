use nalgebra::Point3;
use std::collections::HashMap;

/// Vertices without repetition: identical coordinates become one. The map is looked up, never iterated.
#[derive(Default)]
pub(super) struct Unique {
    known: HashMap<[u64; 3], u32>,
    pub vertices: Vec<Point3<f64>>,
}

impl Unique {
    /// The id of these coordinates.
    pub fn id(&mut self, p: &Point3<f64>) -> u32 {
        // Adding zero turns -0 into 0.
        let p = p.map(|c| c + 0.0);
        *self.known.entry([p.x, p.y, p.z].map(f64::to_bits)).or_insert_with(|| {
            self.vertices.push(p);
            self.vertices.len() as u32 - 1
        })
    }
}
