//! A model made in code.

use nalgebra::Point3;
use vt_models::mesh::{Mesh, MeshData, Polygon};

/// Three cubic cells of edge length `cell` (metres) in an L, the origin in the middle of its bounding box. Faces are
/// whole polygons seen anti-clockwise from outside: two L-shaped ones and six rectangles.
///
/// # Panics
/// When `cell` is not a positive number.
pub fn bracket(cell: f64) -> Mesh {
    assert!(cell > 0.0 && cell.is_finite(), "the cell of a bracket is {cell}; expected a positive length");
    // Corners of the L in cells, anti-clockwise seen from +z.
    const OUTLINE: [[f64; 2]; 6] = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]];
    let layer = |z: f64| OUTLINE.map(|[x, y]| Point3::new((x - 1.0) * cell, (y - 1.0) * cell, z * cell));
    let vertices = layer(-0.5).into_iter().chain(layer(0.5)).collect();
    let n = OUTLINE.len() as u32;
    let sides = (0..n).map(|k| {
        let next = (k + 1) % n;
        vec![k, next, next + n, k + n]
    });
    let faces = [(0..n).rev().collect(), (n..2 * n).collect()].into_iter().chain(sides);
    let polygons = faces.map(|corners| Polygon { corners, ..Polygon::default() }).collect();
    let data = MeshData { vertices, polygons, ..MeshData::default() };
    Mesh::new(data).expect("the numbers above are a mesh")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bracket_is_closed_and_has_the_volume_of_three_cells() {
        let mesh = bracket(0.04);
        let volume: f64 = mesh
            .triangles()
            .iter()
            .map(|t| {
                let [a, b, c] = mesh.corners(t).map(|p| p.coords);
                a.dot(&b.cross(&c)) / 6.0
            })
            .sum();
        assert!((volume - 3.0 * 0.04_f64.powi(3)).abs() < 1e-12);
        assert_eq!((mesh.polygons().len(), mesh.vertices().len()), (8, 12));
    }
}
