//! What is wrong or suspicious with a mesh, found when it is loaded.

use crate::edges::weld;
use crate::mesh::{Mesh, Polygon};
use nalgebra::Point3;
use std::fmt;

/// Vertices closer than this part of the bounding box's diagonal count as one, as for model edges.
const WELD: f64 = 1e-5;
/// Diameters outside this range, in metres, are suspicious: what is tracked is rarely smaller than a screw or
/// larger than a building.
const USUAL: [f64; 2] = [1e-3, 100.0];
/// A closed shell's volume must exceed this part of its cubed diagonal to tell inside from outside.
const FLAT: f64 = 1e-9;

/// Findings about one mesh. Numbers of zero mean that all is well.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Diagnostics {
    /// Polygons without area (below 1e-9 of their squared extent), or with fewer than three different corners.
    pub degenerate_faces: usize,
    /// Polygons with the same corners as an earlier one, in any order.
    pub duplicate_faces: usize,
    /// Sides with one polygon.
    pub open_sides: usize,
    /// Closed loops or paths of such sides.
    pub boundaries: usize,
    /// Sides with three or more polygons.
    pub non_manifold_sides: usize,
    /// Sides along which two neighbours are wound against each other.
    pub inconsistent_sides: usize,
    /// Closed, consistently wound parts that are inside out: their signed volume is negative.
    pub inverted_parts: usize,
    /// Parts that share no vertex.
    pub parts: usize,
    /// Vertices that neither polygon nor line uses.
    pub unused_vertices: usize,
    /// Vertices at the place of an earlier one.
    pub double_vertices: usize,
    /// Largest distance of two vertices, metres.
    pub diameter: f64,
    /// Why the unit of length may be wrong.
    pub scale: Option<Scale>,
}

/// A diameter that suggests another unit of length.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// Less than 1 mm: the file may be in metres and was read in a smaller unit.
    Tiny,
    /// More than 100 m: the file may be in millimetres and was read in a larger unit.
    Huge,
}

/// Sides of polygons between welded vertices: low and high end, polygon, whether it runs from low to high.
type Side = ([u32; 2], u32, bool);

/// Examines a mesh.
#[must_use]
pub fn diagnose(mesh: &Mesh) -> Diagnostics {
    let tolerance = WELD * mesh.bounds().diagonal().max(f64::MIN_POSITIVE);
    let (ids, points) = weld(mesh.vertices(), tolerance);
    let diameter = mesh.diameter();
    let mut out = Diagnostics { diameter, ..Diagnostics::default() };
    out.scale = match diameter {
        d if d < USUAL[0] => Some(Scale::Tiny),
        d if d > USUAL[1] => Some(Scale::Huge),
        _ => None,
    };
    out.double_vertices = ids.len() - points.len();
    let mut used = vec![false; ids.len()];
    let corners = mesh.polygons().iter().flat_map(|p| p.corners.iter().copied());
    corners.chain(mesh.segments().iter().flat_map(|s| s.ends)).for_each(|c| used[c as usize] = true);
    out.unused_vertices = used.iter().filter(|u| !**u).count();

    let loops: Vec<Option<Vec<u32>>> =
        mesh.polygons().iter().map(|p| welded_loop(p, &ids, &points)).collect();
    out.degenerate_faces = loops.iter().filter(|l| l.is_none()).count();
    let duplicate = duplicates(&loops);
    out.duplicate_faces = duplicate.iter().filter(|d| **d).count();

    let mut sides: Vec<Side> = Vec::new();
    for (index, corners) in loops.iter().enumerate() {
        let Some(corners) = corners.as_ref().filter(|_| !duplicate[index]) else { continue };
        let next = corners.iter().cycle().skip(1);
        sides.extend(corners.iter().zip(next).map(|(&a, &b)| ([a.min(b), a.max(b)], index as u32, a < b)));
    }
    sides.sort_unstable();
    let mut parts = Union::new(points.len());
    for side in &sides {
        parts.join(side.0[0], side.0[1]);
    }
    for segment in mesh.segments() {
        let [a, b] = segment.ends.map(|e| ids[e as usize]);
        parts.join(a, b);
    }
    let mut open = Union::new(points.len());
    let mut open_ends = Vec::new();
    // Parts with a hole, a branch or a side wound both ways have no inside.
    let mut broken = vec![false; points.len()];
    for run in sides.chunk_by(|a, b| a.0 == b.0) {
        let [a, b] = run[0].0;
        let fault = match run {
            [_] => {
                open.join(a, b);
                open_ends.push(a);
                &mut out.open_sides
            }
            [first, second] if first.2 == second.2 => &mut out.inconsistent_sides,
            [_, _] => continue,
            _ => &mut out.non_manifold_sides,
        };
        *fault += 1;
        broken[parts.root(a) as usize] = true;
    }
    out.boundaries = open.count(open_ends.into_iter());
    let used_points = mesh.segments().iter().flat_map(|s| s.ends).map(|e| ids[e as usize]);
    out.parts = parts.count(sides.iter().map(|s| s.0[0]).chain(used_points));
    out.inverted_parts = inverted(mesh, &ids, &points, &mut parts, &broken);
    out
}

/// Corners between welded vertices without repetitions; `None` without area.
fn welded_loop(polygon: &Polygon, ids: &[u32], points: &[Point3<f64>]) -> Option<Vec<u32>> {
    let mut corners: Vec<u32> = polygon.corners.iter().map(|&c| ids[c as usize]).collect();
    corners.dedup();
    while corners.len() > 1 && corners.first() == corners.last() {
        corners.pop();
    }
    let at: Vec<Point3<f64>> = corners.iter().map(|&c| points[c as usize]).collect();
    crate::mesh::unit_normal(&at).map(|_| corners)
}

/// Whether each polygon repeats an earlier one.
fn duplicates(loops: &[Option<Vec<u32>>]) -> Vec<bool> {
    let mut keys: Vec<(Vec<u32>, usize)> = loops
        .iter()
        .enumerate()
        .filter_map(|(index, corners)| {
            let mut key = corners.clone()?;
            key.sort_unstable();
            Some((key, index))
        })
        .collect();
    keys.sort_unstable();
    let mut duplicate = vec![false; loops.len()];
    for pair in keys.windows(2) {
        duplicate[pair[1].1] = pair[0].0 == pair[1].0;
    }
    duplicate
}

/// Closed parts whose signed volume (sum over triangles, divergence theorem) is negative.
fn inverted(mesh: &Mesh, ids: &[u32], points: &[Point3<f64>], parts: &mut Union, broken: &[bool]) -> usize {
    let mut volume = vec![0.0; points.len()];
    let origin = mesh.bounds().center();
    for triangle in mesh.triangles() {
        let part = parts.root(ids[triangle.vertices[0] as usize]) as usize;
        let [a, b, c] = mesh.corners(triangle).map(|p| p - origin);
        volume[part] += a.dot(&b.cross(&c)) / 6.0;
    }
    let least = FLAT * mesh.bounds().diagonal().powi(3);
    volume.iter().zip(broken).filter(|(v, broken)| **v < -least && !**broken).count()
}

/// Disjoint sets of vertices.
struct Union(Vec<u32>);

impl Union {
    fn new(n: usize) -> Self {
        Self((0..n as u32).collect())
    }

    fn root(&mut self, mut i: u32) -> u32 {
        while self.0[i as usize] != i {
            let up = self.0[i as usize];
            self.0[i as usize] = self.0[up as usize];
            i = up;
        }
        i
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b) as usize] = a.min(b);
    }

    /// How many sets these members belong to.
    fn count(&mut self, members: impl Iterator<Item = u32>) -> usize {
        let mut roots: Vec<u32> = members.map(|m| self.root(m)).collect();
        roots.sort_unstable();
        roots.dedup();
        roots.len()
    }
}

impl Diagnostics {
    /// Whether nothing was found.
    #[must_use]
    pub fn is_clean(&self) -> bool {
        self.to_string().is_empty()
    }
}

/// One line for each finding, with what it means for tracking; nothing where all is well.
impl fmt::Display for Diagnostics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let d = self.diameter;
        match self.scale {
            Some(Scale::Tiny) => writeln!(
                f,
                "diameter {:.3} mm is less than 1 mm: probably the wrong unit; in metres the file would measure more",
                d * 1e3
            )?,
            Some(Scale::Huge) => writeln!(
                f,
                "diameter {d:.1} m is more than 100 m: probably the wrong unit; as millimetres it would be {:.3} m",
                d * 1e-3
            )?,
            None => {}
        }
        let findings = [
            (self.degenerate_faces, "faces without area: they are dropped"),
            (self.duplicate_faces, "faces that are there twice: they count once"),
            (self.non_manifold_sides, "sides with three or more faces: they are tracked as edges"),
            (
                self.inconsistent_sides,
                "sides whose two faces are wound against each other: inside and outside are unclear",
            ),
            (self.inverted_parts, "closed parts that are inside out: turn their faces"),
            (self.unused_vertices, "vertices that nothing uses"),
        ];
        for (count, text) in findings.iter().filter(|f| f.0 > 0) {
            writeln!(f, "{count} {text}")?;
        }
        if self.open_sides > 0 {
            let (sides, holes) = (self.open_sides, self.boundaries);
            writeln!(
                f,
                "{sides} open sides along {holes} boundaries: the surface is not closed, its rims are tracked as edges"
            )?;
        }
        if self.parts > 1 {
            writeln!(f, "{} parts that do not touch", self.parts)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{MeshData, Segment};

    const CUBE: [[u32; 4]; 6] =
        [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

    /// Cubes of this size side by side, twice their size apart.
    fn cubes(size: f64, n: u32) -> MeshData {
        let mut data = MeshData::default();
        for k in 0..n {
            let base = data.vertices.len() as u32;
            data.vertices.extend((0..8_u32).map(|i| {
                Point3::from(
                    [0, 1, 2].map(|b| {
                        size * (f64::from(i >> b & 1) + if b == 0 { 2.0 * f64::from(k) } else { 0.0 })
                    }),
                )
            }));
            let faces = CUBE.map(|f| f.map(|c| c + base).to_vec());
            data.polygons.extend(faces.map(|corners| Polygon { corners, ..Polygon::default() }));
        }
        data
    }

    fn examine(data: MeshData) -> Diagnostics {
        diagnose(&Mesh::new(data).unwrap())
    }

    #[test]
    fn a_closed_cube_is_clean() {
        let d = examine(cubes(0.1, 1));
        assert!(d.is_clean(), "{d}");
        assert_eq!(d.parts, 1);
        assert!((d.diameter - 0.03_f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn each_fault_is_found_and_no_other() {
        let change = |f: fn(&mut MeshData)| {
            let mut data = cubes(0.1, 2);
            f(&mut data);
            examine(data)
        };
        let base = Diagnostics { parts: 2, diameter: change(|_| ()).diameter, ..Diagnostics::default() };
        assert_eq!(change(|_| ()), base);
        let hole = change(|d| drop(d.polygons.pop()));
        assert_eq!(hole, Diagnostics { open_sides: 4, boundaries: 1, ..base.clone() });
        let holes = change(|d| d.polygons.retain(|p| !CUBE[4..].iter().any(|f| p.corners == f)));
        assert_eq!(holes, Diagnostics { open_sides: 8, boundaries: 2, ..base.clone() });
        let turned = change(|d| d.polygons[0].corners.reverse());
        assert_eq!(turned, Diagnostics { inconsistent_sides: 4, ..base.clone() });
        let inverted = change(|d| d.polygons[6..].iter_mut().for_each(|p| p.corners.reverse()));
        assert_eq!(inverted, Diagnostics { inverted_parts: 1, ..base.clone() });
        let double = change(|d| {
            let mut again = d.polygons[3].clone();
            again.corners.rotate_left(1);
            again.corners.reverse();
            d.polygons.push(again);
        });
        assert_eq!(double, Diagnostics { duplicate_faces: 1, ..base.clone() });
        let degenerate =
            change(|d| d.polygons.push(Polygon { corners: vec![0, 1, 0, 1], ..Polygon::default() }));
        assert_eq!(degenerate, Diagnostics { degenerate_faces: 1, ..base.clone() });
        let fin = change(|d| d.polygons.push(Polygon { corners: vec![0, 1, 15], ..Polygon::default() }));
        assert_eq!((fin.non_manifold_sides, fin.open_sides, fin.parts), (1, 2, 1));
        let unused = change(|d| d.vertices.push(Point3::origin()));
        assert_eq!(unused, Diagnostics { unused_vertices: 1, double_vertices: 1, ..base.clone() });
        let line = change(|d| d.segments.push(Segment { ends: [0, 8], material: None, part: 0 }));
        assert_eq!(line.parts, 1);
    }

    #[test]
    fn unwelded_soup_is_as_closed_as_its_model() {
        let cube = Mesh::new(cubes(0.1, 1)).unwrap();
        let mut data = MeshData::default();
        for t in cube.triangles() {
            let base = data.vertices.len() as u32;
            data.vertices.extend(cube.corners(t));
            data.polygons.push(Polygon { corners: vec![base, base + 1, base + 2], ..Polygon::default() });
        }
        let d = examine(data);
        assert!(d.is_clean() && d.double_vertices == 28, "{d:?}");
    }

    #[test]
    fn wrong_units_are_named() {
        let (tiny, huge) = (examine(cubes(1e-4, 1)), examine(cubes(170.0, 1)));
        assert_eq!((tiny.scale, huge.scale), (Some(Scale::Tiny), Some(Scale::Huge)));
        assert!(tiny.to_string().contains("0.173 mm") && tiny.to_string().contains("wrong unit"), "{tiny}");
        assert!(huge.to_string().contains("as millimetres it would be 0.294 m"), "{huge}");
    }
}
