//! Bodies made in code: closed, with outward normals, and without any rotation that maps them onto themselves, so that
//! their poses are determined. `size` is the longest side of the bounding box in metres; the origin is in its middle.

use std::collections::BTreeMap;

use nalgebra::Point3;
use vt_models::mesh::{Mesh, MeshData, Polygon};

/// A house with a gable roof, a dormer on one slope and a chimney on the other.
///
/// # Panics
/// When `size` is not a positive number, as all functions of this module.
pub fn house(size: f64) -> Mesh {
    let grid: [&[f64]; 3] =
        [&[0.0, 0.3, 0.55, 0.75, 0.85, 1.0], &[0.0, 0.15, 0.38, 0.5, 0.62, 0.76, 1.0], &[0.0, 1.0, 2.0]];
    let filled = |[x, y, z]: [usize; 3]| z == 0 || [(1, 1), (3, 4)].contains(&(x, y));
    let slope = |y: f64| 0.42 + 0.7 * (0.5 - (y - 0.5).abs());
    blocks(grid, filled, size, |p| {
        let top = match p.z {
            0.0 => 0.0,
            1.0 => slope(p.y),
            _ if p.y < 0.5 => 0.73,
            _ => 0.88,
        };
        Point3::new(p.x, 0.7 * p.y, top)
    })
}

/// Four unequal steps with a cheek on one side.
pub fn stairs(size: f64) -> Mesh {
    let grid: [&[f64]; 3] =
        [&[0.0, 0.3, 0.56, 0.8, 1.0], &[0.0, 0.5, 0.6], &[0.0, 0.12, 0.27, 0.4, 0.58, 0.68]];
    blocks(grid, |[x, y, z]| z < 4 - x + y, size, |p| p)
}

/// A wedge that falls off in two directions, with a slot that ends in the body.
pub fn wedge(size: f64) -> Mesh {
    let grid: [&[f64]; 3] = [&[0.0, 0.3, 0.48, 1.0], &[0.0, 0.7, 0.8], &[0.0, 0.4, 1.0]];
    blocks(
        grid,
        |cell| cell != [1, 0, 1],
        size,
        |p| Point3::new(p.x, p.y, 0.62 * p.z * (1.0 - 0.6 * p.x - 0.2 * p.y)),
    )
}

/// A flat connector in the form of a T with arms of different lengths, one of them with a boss.
pub fn tee(size: f64) -> Mesh {
    let grid: [&[f64]; 3] = [&[0.0, 0.38, 0.62, 0.8, 1.0], &[0.0, 0.28, 0.75], &[0.0, 0.2, 0.36]];
    let filled = |[x, y, z]: [usize; 3]| match (y, z) {
        (0, 0) => true,
        (0, _) => x == 3,
        _ => z == 0 && x == 1,
    };
    blocks(grid, filled, size, |p| p)
}

/// A box with these sides in metres, the origin in its middle.
pub fn cuboid(sides: [f64; 3]) -> Mesh {
    let longest = sides.iter().copied().fold(0.0, f64::max);
    let [x, y, z] = sides.map(|s| [0.0, s]);
    blocks([&x, &y, &z], |_| true, longest, |p| p)
}

/// The surface of the filled cells of a grid, moved by `place` and scaled. `place` must keep planes of the grid plane,
/// and right-handed axes right-handed.
fn blocks(
    grid: [&[f64]; 3],
    filled: impl Fn([usize; 3]) -> bool,
    size: f64,
    place: impl Fn(Point3<f64>) -> Point3<f64>,
) -> Mesh {
    assert!(size > 0.0 && size.is_finite(), "a body of size {size}; expected a positive length");
    let cells = grid.map(|g| g.len() - 1);
    let mut nodes = BTreeMap::new();
    let mut vertices: Vec<Point3<f64>> = vec![];
    let mut polygons = vec![];
    for k in 0..cells.iter().product() {
        let cell = [k % cells[0], k / cells[0] % cells[1], k / (cells[0] * cells[1])];
        for (axis, front) in (0..6).map(|k| (k / 2, k % 2)).filter(|_| filled(cell)) {
            let mut beyond = cell;
            beyond[axis] = (cell[axis] + front).wrapping_add(front).wrapping_sub(1);
            if beyond[axis] < cells[axis] && filled(beyond) {
                continue;
            }
            // Anti-clockwise seen along the axis from its front.
            let mut corners: Vec<u32> = [[0, 0], [1, 0], [1, 1], [0, 1]]
                .map(|step| {
                    let mut node = cell;
                    node[axis] += front;
                    node[(axis + 1) % 3] += step[0];
                    node[(axis + 2) % 3] += step[1];
                    *nodes.entry(node).or_insert_with(|| {
                        vertices.push(place(Point3::new(
                            grid[0][node[0]],
                            grid[1][node[1]],
                            grid[2][node[2]],
                        )));
                        vertices.len() as u32 - 1
                    })
                })
                .into();
            if front == 0 {
                corners.reverse();
            }
            polygons.push(Polygon { corners, ..Polygon::default() });
        }
    }
    let first = vertices[0];
    let (low, high) = vertices.iter().fold((first, first), |(l, h), p| (l.inf(p), h.sup(p)));
    let (middle, scale) = (nalgebra::center(&low, &high), size / (high - low).max());
    vertices.iter_mut().for_each(|p| *p = Point3::from((*p - middle) * scale));
    let data = MeshData { vertices, polygons, ..MeshData::default() };
    Mesh::new(data).expect("filled cells have a surface")
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix3;

    fn all() -> [(&'static str, Mesh); 4] {
        [("house", house(0.2)), ("stairs", stairs(0.2)), ("wedge", wedge(0.2)), ("tee", tee(0.2))]
    }

    #[test]
    fn bodies_are_closed_and_their_normals_point_outward() {
        for (name, mesh) in all() {
            let mut sides = BTreeMap::new();
            let mut volume = 0.0;
            for t in mesh.triangles() {
                let [a, b, c] = mesh.corners(t).map(|p| p.coords);
                volume += a.dot(&b.cross(&c)) / 6.0;
                for k in 0..3 {
                    *sides.entry((t.vertices[k], t.vertices[(k + 1) % 3])).or_insert(0) += 1;
                }
            }
            assert!(sides.iter().all(|(&(a, b), n)| *n == 1 && sides.get(&(b, a)) == Some(&1)), "{name}");
            assert!(volume > 0.05 * 0.2_f64.powi(3), "{name}: {volume}");
            let sides = mesh.bounds().max - mesh.bounds().min;
            assert!((sides.max() - 0.2).abs() < 1e-12 && mesh.bounds().center().coords.norm() < 1e-12);
        }
    }

    #[test]
    fn polygons_are_plane() {
        for (name, mesh) in all() {
            for (k, polygon) in mesh.polygons().iter().enumerate() {
                let normal = mesh.normal(k).unwrap();
                let corners: Vec<_> = polygon.corners.iter().map(|&c| mesh.vertices()[c as usize]).collect();
                assert!(corners.iter().all(|c| (c - corners[0]).dot(&normal).abs() < 1e-12), "{name} {k}");
            }
        }
    }

    #[test]
    fn no_turn_maps_a_body_onto_itself() {
        // A turn that maps a body onto itself keeps its moments; with three different ones only half turns about the
        // principal axes do, and those are refused by the third moments along the axes.
        for (name, mesh) in all() {
            let points: Vec<_> = mesh.vertices().iter().map(|p| p.coords).collect();
            let mean = points.iter().sum::<nalgebra::Vector3<f64>>() / points.len() as f64;
            let second: Matrix3<f64> = points.iter().map(|p| (p - mean) * (p - mean).transpose()).sum();
            let axes = second.symmetric_eigen();
            let mut spread: Vec<f64> = axes.eigenvalues.iter().copied().collect();
            spread.sort_by(f64::total_cmp);
            assert!(spread.windows(2).all(|w| w[1] > 1.05 * w[0]), "{name}: {spread:?}");
            let skewed = (0..3)
                .filter(|&k| {
                    let along: Vec<f64> =
                        points.iter().map(|p| (p - mean).dot(&axes.eigenvectors.column(k))).collect();
                    let third: f64 = along.iter().map(|v| v * v * v).sum();
                    let size: f64 = along.iter().map(|v| v.abs() * v * v).sum();
                    third.abs() > 0.02 * size
                })
                .count();
            assert!(skewed >= 2, "{name}: a half turn might map it onto itself");
        }
    }
}
