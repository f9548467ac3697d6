//! Tessellated solids and circles, in the frames VRML97 gives them.

use nalgebra::{Point3, Unit as Direction, Vector3};
use vt_core::math;

/// Points and polygon loops of a solid.
#[derive(Default)]
pub(super) struct Solid {
    pub points: Vec<Point3<f64>>,
    pub polygons: Vec<Vec<u32>>,
}

/// Corners of a tessellated circle; enough that the chord error is 0.1 % of the radius at 64.
pub(super) const SIDES: u32 = 64;

fn turn(i: u32, n: u32) -> (f64, f64) {
    math::sin_cos(std::f64::consts::TAU * f64::from(i) / f64::from(n))
}

/// Axis-aligned box about the origin.
pub(super) fn cuboid(size: Vector3<f64>) -> Solid {
    let h = size / 2.0;
    let points = (0..8)
        .map(|i| {
            let s = |bit: u32| if i & bit == 0 { -1.0 } else { 1.0 };
            Point3::new(s(1) * h.x, s(2) * h.y, s(4) * h.z)
        })
        .collect();
    let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    Solid { points, polygons: faces.map(|f| f.to_vec()).to_vec() }
}

/// Frustum about the y axis from `-height/2` to `height/2`; a zero top radius makes a cone.
pub(super) fn frustum(bottom: f64, top: f64, height: f64, caps: [bool; 2], side: bool) -> Solid {
    let n = SIDES;
    let mut solid = Solid::default();
    for (radius, y) in [(bottom, -height / 2.0), (top, height / 2.0)] {
        for i in 0..n {
            let (s, c) = turn(i, n);
            solid.points.push(Point3::new(radius * s, y, radius * c));
        }
    }
    if side {
        for i in 0..n {
            let j = (i + 1) % n;
            solid.polygons.push(if top == 0.0 { vec![i, j, n] } else { vec![i, j, n + j, n + i] });
        }
    }
    if caps[0] {
        solid.polygons.push((0..n).rev().collect());
    }
    if caps[1] && top > 0.0 {
        solid.polygons.push((n..2 * n).collect());
    }
    solid
}

/// Sphere about the origin, 32 meridians by 16 parallels.
pub(super) fn sphere(radius: f64) -> Solid {
    let (n, m) = (SIDES / 2, SIDES / 4);
    let mut solid = Solid { points: vec![Point3::new(0.0, -radius, 0.0)], polygons: Vec::new() };
    for k in 1..m {
        let (s, c) = math::sin_cos(std::f64::consts::PI * f64::from(k) / f64::from(m));
        for i in 0..n {
            let (si, ci) = turn(i, n);
            solid.points.push(Point3::new(radius * s * si, -radius * c, radius * s * ci));
        }
    }
    let last = solid.points.len() as u32;
    solid.points.push(Point3::new(0.0, radius, 0.0));
    let at = |k: u32, i: u32| 1 + (k - 1) * n + i % n;
    for i in 0..n {
        solid.polygons.push(vec![0, at(1, i + 1), at(1, i)]);
        for k in 1..m - 1 {
            solid.polygons.push(vec![at(k, i), at(k, i + 1), at(k + 1, i + 1), at(k + 1, i)]);
        }
        solid.polygons.push(vec![at(m - 1, i), at(m - 1, i + 1), last]);
    }
    solid
}

/// Circle about `center` in the plane with this normal.
pub(super) fn circle(center: Point3<f64>, normal: Direction<Vector3<f64>>, radius: f64) -> Vec<Point3<f64>> {
    let axis = if normal.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
    let u = normal.cross(&axis).normalize();
    let v = normal.cross(&u);
    (0..SIDES)
        .map(|i| {
            let (s, c) = turn(i, SIDES);
            center + (u * c + v * s) * radius
        })
        .collect()
}
