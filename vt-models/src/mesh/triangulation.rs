//! Ear clipping (Meisters 1975) of simple planar polygons.

use std::cell::Cell;

use nalgebra::{Point3, Vector3};

/// Most corners looked at in search of ears; of a loop made to have few of them the rest is cut anywhere.
const MAX_TESTS: usize = 400_000_000;

/// Twice the vector area of a closed loop (Newell's method); its direction is the plane normal.
pub(crate) fn newell(points: &[Point3<f64>]) -> Vector3<f64> {
    let Some(&origin) = points.first() else { return Vector3::zeros() };
    points.windows(2).map(|w| (w[0] - origin).cross(&(w[1] - origin))).sum()
}

/// Unit normal, or `None` where the loop encloses no area relative to its extent.
pub(crate) fn unit_normal(points: &[Point3<f64>]) -> Option<Vector3<f64>> {
    let area = newell(points);
    let origin = points.first()?;
    let extent = points.iter().map(|p| (p - origin).norm_squared()).fold(0.0, f64::max);
    let norm = area.norm();
    (norm > 1e-9 * extent && norm > 0.0).then(|| area / norm)
}

/// Triangulates a polygon; returns corner positions in loop order, wound as the polygon is.
///
/// Non-convex, collinear and repeated corners are welcome; a polygon without area gives no triangle. Where the
/// loop crosses itself the result covers its corners but not a defined region.
#[must_use]
pub fn triangulate(points: &[Point3<f64>]) -> Vec<[u32; 3]> {
    let Some(normal) = unit_normal(points) else { return Vec::new() };
    if points.len() == 3 {
        return vec![[0, 1, 2]];
    }
    let axis = if normal.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
    let u = normal.cross(&axis).normalize();
    let v = normal.cross(&u);
    let flat: Vec<[f64; 2]> = points
        .iter()
        .map(|p| {
            let d = p - points[0];
            [d.dot(&u), d.dot(&v)]
        })
        .collect();
    let extent = flat.iter().map(|p| p[0] * p[0] + p[1] * p[1]).fold(0.0, f64::max);
    let tiny = 1e-12 * extent;
    let cross = |a: usize, b: usize, c: usize| {
        (flat[b][0] - flat[a][0]) * (flat[c][1] - flat[a][1])
            - (flat[b][1] - flat[a][1]) * (flat[c][0] - flat[a][0])
    };
    let same = |a: usize, b: usize| {
        let (dx, dy) = (flat[a][0] - flat[b][0], flat[a][1] - flat[b][1]);
        dx * dx + dy * dy <= tiny * 1e-6
    };
    let mut rest: Vec<usize> = (0..points.len()).collect();
    let mut triangles = Vec::with_capacity(points.len() - 2);
    let tests = Cell::new(0);
    while rest.len() > 3 {
        let n = rest.len();
        let around = |i: usize| (rest[(i + n - 1) % n], rest[i], rest[(i + 1) % n]);
        let is_ear = |i: usize| {
            let (a, b, c) = around(i);
            if cross(a, b, c) <= tiny || tests.get() > MAX_TESTS {
                return false;
            }
            tests.set(tests.get() + n);
            rest.iter().all(|&q| {
                q == a
                    || q == b
                    || q == c
                    || same(q, a)
                    || same(q, b)
                    || same(q, c)
                    || cross(a, b, q) < -tiny
                    || cross(b, c, q) < -tiny
                    || cross(c, a, q) < -tiny
            })
        };
        // Proper ears first, so that collinear corners stay shared with the neighbour polygons; then a corner
        // without area; then, for loops that cross themselves, any convex corner: the loop always shrinks.
        let pick = (0..n).find(|&i| is_ear(i)).or_else(|| {
            (0..n).find(|&i| {
                let (a, b, c) = around(i);
                cross(a, b, c).abs() <= tiny
            })
        });
        let pick = pick.or_else(|| {
            (0..n).find(|&i| {
                let (a, b, c) = around(i);
                cross(a, b, c) > tiny
            })
        });
        let i = pick.unwrap_or(0);
        let (a, b, c) = around(i);
        if cross(a, b, c) > tiny {
            triangles.push([a as u32, b as u32, c as u32]);
        }
        rest.remove(i);
    }
    if cross(rest[0], rest[1], rest[2]) > tiny {
        triangles.push([rest[0] as u32, rest[1] as u32, rest[2] as u32]);
    }
    triangles
}
