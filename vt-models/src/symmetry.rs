//! Symmetries of a mesh, by sampled distances of the turned or mirrored surface to itself.
//!
//! About a symmetry axis a pose is not unique: a tracker may jump between equivalent poses (finite order) or does not
//! know one of its freedoms at all (infinite order).

use crate::mesh::Mesh;
use crate::raycast::RayCaster;
use nalgebra::{Matrix3, Point3, Rotation3, SymmetricEigen, Unit, Vector3};
use vt_core::math;
use vt_core::random::{Random, Stream};

/// Largest distance of a turned surface point to the surface, as a part of the bounding box's diagonal.
pub const TOLERANCE: f64 = 0.005;

/// Sampled points on the surface; vertices come on top.
const SAMPLES: usize = 1500;
/// Most vertices taken in, evenly.
const VERTICES: usize = 500;
/// Points that a candidate must pass before all are tried.
const FIRST: usize = 48;
/// Largest finite order that is told from a circle.
const MOST: u32 = 12;
/// Most faces whose normals, and vertices whose directions, are tried as axes.
const DIRECTIONS: usize = 13;
/// Axes closer than this are one, as a cosine (1.5°).
const SAME: f64 = 0.999_66;

/// A rotational symmetry about an axis through the centroid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rotational {
    /// Direction of the axis, object frame.
    pub axis: Unit<Vector3<f64>>,
    /// Number of equal positions in a turn, 2 to 12; `None` where every angle is one.
    pub order: Option<u32>,
    /// Largest distance of a turned point to the surface, metres.
    pub residual: f64,
}

/// A plane through the centroid that mirrors the surface onto itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mirror {
    /// Normal of the plane, object frame.
    pub normal: Unit<Vector3<f64>>,
    /// Largest distance of a mirrored point to the surface, metres.
    pub residual: f64,
}

/// Symmetries of a mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Symmetries {
    /// Centroid of the surface, object frame, metres.
    pub center: Point3<f64>,
    /// Rotational ones, highest order first.
    pub rotational: Vec<Rotational>,
    /// Mirror planes, best first.
    pub mirrors: Vec<Mirror>,
}

impl Symmetries {
    /// Looks for the symmetries of a mesh about its principal axes, the axes of its frame, and through its largest
    /// faces, farthest vertices and between them. The sampling is deterministic. A mesh of lines only has none.
    #[must_use]
    pub fn find(mesh: &Mesh) -> Self {
        let (center, moments) = moments(mesh);
        let surface = Surface { shape: RayCaster::new(mesh), points: samples(mesh), center };
        let limit = TOLERANCE * mesh.bounds().diagonal();
        let mut found = Self { center, rotational: Vec::new(), mirrors: Vec::new() };
        if mesh.triangles().is_empty() {
            return found;
        }
        for axis in candidates(mesh, &center, &moments) {
            found.rotational.extend(surface.order(&axis, limit));
            if let Some(residual) = surface.mirrored(&axis, limit) {
                found.mirrors.push(Mirror { normal: axis, residual });
            }
        }
        found.rotational.sort_by_key(|r| std::cmp::Reverse(r.order.unwrap_or(u32::MAX)));
        found.mirrors.sort_by(|a, b| a.residual.total_cmp(&b.residual));
        found
    }
}

/// Centroid of the surface and second moments about it.
fn moments(mesh: &Mesh) -> (Point3<f64>, Matrix3<f64>) {
    let (mut area, mut first, mut second) = (0.0, Vector3::zeros(), Matrix3::zeros());
    let origin = mesh.bounds().center();
    for triangle in mesh.triangles() {
        let [a, b, c] = mesh.corners(triangle).map(|p| p - origin);
        let size = 0.5 * (b - a).cross(&(c - a)).norm();
        let sum = a + b + c;
        area += size;
        first += sum * (size / 3.0);
        // Exact for a triangle: ∫ x xᵀ = A/12 (Σ pᵢ pᵢᵀ + s sᵀ).
        let squares = a * a.transpose() + b * b.transpose() + c * c.transpose() + sum * sum.transpose();
        second += squares * (size / 12.0);
    }
    if area <= 0.0 {
        return (origin, Matrix3::zeros());
    }
    let mean = first / area;
    (origin + mean, second / area - mean * mean.transpose())
}

/// Points evenly spread by area (systematic sampling), and vertices.
fn samples(mesh: &Mesh) -> Vec<Point3<f64>> {
    let area = |t| {
        let [a, b, c] = mesh.corners(t);
        (b - a).cross(&(c - a)).norm()
    };
    let total: f64 = mesh.triangles().iter().map(area).sum();
    let mut out = Vec::with_capacity(SAMPLES + VERTICES);
    let (mut passed, mut taken) = (0.0, 0_u32);
    for triangle in mesh.triangles() {
        passed += area(triangle);
        while f64::from(taken) + 0.5 < passed / total * SAMPLES as f64 {
            let mut random = Random::new(0, Stream::Sim, 7, u64::from(taken), 0);
            let (mut u, mut v) = (random.uniform(), random.uniform());
            if u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            let [a, b, c] = mesh.corners(triangle);
            out.push(a + (b - a) * u + (c - a) * v);
            taken += 1;
        }
    }
    // Spread over the surface, so that the first few tell most.
    let n = out.len();
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by_key(|i| (*i as u32).wrapping_mul(2_654_435_761));
    let mut out: Vec<Point3<f64>> = order.into_iter().map(|i| out[i]).collect();
    let mut used = vec![false; mesh.vertices().len()];
    mesh.triangles().iter().flat_map(|t| t.vertices).for_each(|v| used[v as usize] = true);
    let used: Vec<usize> = (0..used.len()).filter(|i| used[*i]).collect();
    out.extend(used.iter().step_by(used.len().div_ceil(VERTICES).max(1)).map(|i| mesh.vertices()[*i]));
    out
}

/// Axes worth a test, each once.
fn candidates(mesh: &Mesh, center: &Point3<f64>, moments: &Matrix3<f64>) -> Vec<Unit<Vector3<f64>>> {
    let mut out: Vec<Unit<Vector3<f64>>> = Vec::new();
    let mut add = |v: Vector3<f64>| {
        if let Some(axis) = Unit::try_new(v, 1e-9)
            && out.iter().all(|o| o.dot(&axis).abs() < SAME)
        {
            // One sign for each axis: the largest coordinate is positive.
            let sign = axis[axis.iamax()].signum();
            out.push(Unit::new_unchecked(axis.into_inner() * sign));
        }
    };
    // Axes of the frame first: where they are as good as others, they are the nicer numbers.
    (0..3).for_each(|k| add(Matrix3::identity().column(k).into_owned()));
    let eigen = SymmetricEigen::new(*moments);
    (0..3).for_each(|k| add(eigen.eigenvectors.column(k).into_owned()));
    let normals = largest(mesh.triangles().iter().map(|t| {
        let [a, b, c] = mesh.corners(t);
        (b - a).cross(&(c - a))
    }));
    let far = mesh.vertices().iter().map(|p| (p - center).norm()).fold(0.0, f64::max);
    let spikes = mesh.vertices().iter().map(|p| p - center).filter(|d| d.norm() > 0.99 * far);
    let spikes = largest(spikes);
    for list in [&normals, &spikes] {
        list.iter().for_each(|v| add(*v));
        for (k, a) in list.iter().enumerate() {
            for b in &list[k + 1..] {
                add(a.normalize() + b.normalize());
                add(a.normalize() - b.normalize());
            }
        }
    }
    out
}

/// The longest sums of vectors of about one direction or its opposite; only the first hundred directions are told
/// apart, in order of appearance.
fn largest(vectors: impl Iterator<Item = Vector3<f64>>) -> Vec<Vector3<f64>> {
    let mut groups: Vec<Vector3<f64>> = Vec::new();
    for v in vectors {
        let length = v.norm();
        if length <= 0.0 {
            continue;
        }
        match groups.iter().position(|g| g.dot(&v).abs() > SAME * g.norm() * length) {
            Some(k) => {
                let sign = groups[k].dot(&v).signum();
                groups[k] += v * sign;
            }
            None if groups.len() < 100 => groups.push(v),
            None => {}
        }
    }
    groups.sort_by(|a, b| b.norm().total_cmp(&a.norm()));
    groups.truncate(DIRECTIONS);
    groups
}

/// A surface with the points to test it by.
struct Surface {
    shape: RayCaster,
    points: Vec<Point3<f64>>,
    center: Point3<f64>,
}

impl Surface {
    /// Largest distance to the surface of the moved points; `None` as soon as one exceeds the limit.
    fn residual(
        &self,
        moved: impl Fn(&Vector3<f64>) -> Vector3<f64>,
        points: usize,
        limit: f64,
    ) -> Option<f64> {
        let mut worst = 0.0_f64;
        for p in self.points.iter().take(points) {
            let distance = self.shape.distance(&(self.center + moved(&(p - self.center))))?;
            worst = worst.max(distance);
            if distance > limit {
                return None;
            }
        }
        Some(worst)
    }

    fn turned(&self, axis: &Unit<Vector3<f64>>, angle: f64, points: usize, limit: f64) -> Option<f64> {
        let (sin, cos) = math::sin_cos(angle);
        let axis = axis.into_inner();
        // Rodrigues' formula.
        let turn = Rotation3::from_matrix_unchecked(
            Matrix3::identity() * cos + axis.cross_matrix() * sin + axis * axis.transpose() * (1.0 - cos),
        );
        self.residual(|v| turn * v, points, limit)
    }

    /// Highest order about an axis.
    fn order(&self, axis: &Unit<Vector3<f64>>, limit: f64) -> Option<Rotational> {
        let part = |n: u32| std::f64::consts::TAU / f64::from(n);
        let holds = |angle: f64| {
            self.turned(axis, angle, FIRST, limit)?;
            self.turned(axis, angle, usize::MAX, limit)
        };
        // Any angle: none of these is a part of a turn up to the twelfth, nor a multiple of the others.
        let any = [0.1, 0.37, 1.0, 2.3].map(holds);
        if let [Some(a), Some(b), Some(c), Some(d)] = any {
            let residual = a.max(b).max(c).max(d);
            return Some(Rotational { axis: *axis, order: None, residual });
        }
        (2..=MOST).rev().find_map(|n| {
            let residual = holds(part(n))?;
            Some(Rotational { axis: *axis, order: Some(n), residual })
        })
    }

    fn mirrored(&self, normal: &Unit<Vector3<f64>>, limit: f64) -> Option<f64> {
        let mirror = |v: &Vector3<f64>| v - normal.into_inner() * (2.0 * normal.dot(v));
        self.residual(mirror, FIRST, limit)?;
        self.residual(mirror, usize::MAX, limit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{MeshData, Polygon};

    /// Prism over a polygon in the plane z = 0, turned out of the axes of its frame.
    fn prism(outline: &[[f64; 2]], height: f64) -> Mesh {
        let turn = Rotation3::from_euler_angles(0.3, -0.5, 0.8);
        let n = outline.len() as u32;
        let layer = |z: f64| outline.iter().map(move |p| turn * Point3::new(p[0] + 0.1, p[1] - 0.2, z));
        let mut polygons = vec![(0..n).rev().collect::<Vec<u32>>(), (n..2 * n).collect()];
        polygons.extend((0..n).map(|k| vec![k, (k + 1) % n, (k + 1) % n + n, k + n]));
        let polygons =
            polygons.into_iter().map(|corners| Polygon { corners, ..Polygon::default() }).collect();
        let vertices = layer(0.0).chain(layer(height)).collect();
        Mesh::new(MeshData { vertices, polygons, ..MeshData::default() }).unwrap()
    }

    fn regular(n: u32) -> Vec<[f64; 2]> {
        let at = |k| math::sin_cos(std::f64::consts::TAU * f64::from(k) / f64::from(n));
        (0..n).map(|k| [0.1 * at(k).1, 0.1 * at(k).0]).collect()
    }

    /// Orders of the axes, highest first; a circle is 99.
    fn orders(s: &Symmetries) -> Vec<u32> {
        s.rotational.iter().map(|r| r.order.unwrap_or(99)).collect()
    }

    fn along(s: &Symmetries, order: Option<u32>) -> f64 {
        let z = Rotation3::from_euler_angles(0.3, -0.5, 0.8) * Vector3::z();
        let axis = s.rotational.iter().find(|r| r.order == order).unwrap().axis;
        axis.dot(&z).abs()
    }

    #[test]
    fn a_cube_has_thirteen_axes_and_nine_mirrors() {
        let s = Symmetries::find(&prism(&[[0.0, 0.0], [0.1, 0.0], [0.1, 0.1], [0.0, 0.1]], 0.1));
        assert_eq!(orders(&s), [4, 4, 4, 3, 3, 3, 3, 2, 2, 2, 2, 2, 2]);
        assert_eq!(s.mirrors.len(), 9);
        assert!(s.rotational.iter().all(|r| r.residual < 1e-6));
    }

    #[test]
    fn prisms_and_cylinders() {
        for n in [3, 5, 6, 12] {
            let s = Symmetries::find(&prism(&regular(n), 0.3));
            assert_eq!(orders(&s)[0], n);
            assert!(along(&s, Some(n)) > 0.9999, "{n}");
            assert!(orders(&s)[1..].iter().all(|o| *o == 2) && orders(&s).len() > 1);
        }
        let s = Symmetries::find(&prism(&regular(64), 0.3));
        assert_eq!(orders(&s)[0], 99);
        assert!(along(&s, None) > 0.9999 && s.rotational[0].residual > 0.0);
        assert_eq!(s.rotational.iter().filter(|r| r.order.is_none()).count(), 1);
        // An asymmetric roof line: nothing.
        let s =
            Symmetries::find(&prism(&[[0.0, 0.0], [0.3, 0.0], [0.3, 0.1], [0.12, 0.17], [0.0, 0.05]], 0.2));
        assert_eq!((orders(&s).len(), s.mirrors.len()), (0, 1), "{s:?}");
    }

    #[test]
    fn an_l_shaped_bracket_has_a_half_turn_and_two_mirrors() {
        let l = [[0.0, 0.0], [0.2, 0.0], [0.2, 0.1], [0.1, 0.1], [0.1, 0.2], [0.0, 0.2]];
        let s = Symmetries::find(&prism(&l, 0.1));
        assert_eq!((orders(&s), s.mirrors.len()), (vec![2], 2));
    }

    #[test]
    fn results_repeat_and_lines_have_none() {
        let mesh = prism(&regular(6), 0.2);
        assert_eq!(Symmetries::find(&mesh), Symmetries::find(&mesh));
        let data = MeshData {
            vertices: vec![Point3::origin(), Point3::new(1.0, 0.0, 0.0)],
            segments: vec![crate::mesh::Segment { ends: [0, 1], material: None, part: 0 }],
            ..MeshData::default()
        };
        assert_eq!(Symmetries::find(&Mesh::new(data).unwrap()).rotational, []);
    }
}
