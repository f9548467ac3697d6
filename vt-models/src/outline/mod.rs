//! Flat shapes by their outline: rectangle, ellipse, polygon, spline, SVG path, silhouette of a mesh.
//!
//! Units are those of the plane (in pictures pixels, x right, y down). Loops around the shape have a positive area
//! `½ Σ x dy − y dx`, those around holes a negative one, so that the normal `(t_y, −t_x)` of the tangent `t` points out
//! of the shape everywhere.

mod silhouette;
#[cfg(feature = "loaders")]
mod svg;

use nalgebra::{Point2, Vector2};
use vt_core::error::ConfigError;
use vt_core::math;

use crate::contour::Contour;

/// Corners of the polygon that stands for an ellipse.
const ELLIPSE: usize = 360;

/// Points for each control point of a spline.
const SPAN: usize = 16;

/// A flat shape: closed polygons, finely divided where the shape is curved.
#[derive(Clone, Debug, PartialEq)]
pub struct Outline {
    loops: Vec<Vec<Point2<f64>>>,
}

/// Twice the area of a loop.
fn doubled_area(points: &[Point2<f64>]) -> f64 {
    sides(points).map(|(a, b)| a.x * b.y - a.y * b.x).sum()
}

/// The sides of a closed polygon.
fn sides(points: &[Point2<f64>]) -> impl Iterator<Item = (&Point2<f64>, &Point2<f64>)> {
    points.iter().zip(points.iter().cycle().skip(1))
}

/// Whether a ray from `p` to the right crosses the loop an odd number of times.
fn surrounds(points: &[Point2<f64>], p: &Point2<f64>) -> bool {
    let crosses = |(a, b): &(&Point2<f64>, &Point2<f64>)| {
        (a.y > p.y) != (b.y > p.y) && p.x < a.x + (p.y - a.y) / (b.y - a.y) * (b.x - a.x)
    };
    sides(points).filter(crosses).count() % 2 == 1
}

impl Outline {
    /// A shape bounded by closed polygons; holes are those that lie inside an odd number of others.
    ///
    /// # Errors
    /// Without a loop, and where one has fewer than three corners, encloses no area or is not finite.
    pub fn new(mut loops: Vec<Vec<Point2<f64>>>) -> Result<Self, ConfigError> {
        let wrong = |found: String| {
            Err(ConfigError::parameter(
                "outline",
                found,
                "closed loops of at least three points with an area",
            ))
        };
        if loops.is_empty() {
            return wrong("empty".into());
        }
        for points in &mut loops {
            let finite = points.iter().flat_map(|p| p.iter()).all(|c| c.is_finite());
            points.dedup();
            if points.len() > 1 && points.first() == points.last() {
                points.pop();
            }
            let area = doubled_area(points);
            if points.len() < 3 || !finite || area == 0.0 || !area.is_finite() {
                return wrong(format!("a loop of {} points and area {}", points.len(), 0.5 * area));
            }
        }
        let depth = |k: usize| {
            (0..loops.len()).filter(|&other| other != k && surrounds(&loops[other], &loops[k][0])).count()
        };
        let hole: Vec<bool> = (0..loops.len()).map(|k| depth(k) % 2 == 1).collect();
        for (points, hole) in loops.iter_mut().zip(hole) {
            if (doubled_area(points) < 0.0) != hole {
                points.reverse();
            }
        }
        Ok(Self { loops })
    }

    /// A polygon with these corners.
    ///
    /// # Errors
    /// As [`Outline::new`].
    pub fn polygon(corners: Vec<Point2<f64>>) -> Result<Self, ConfigError> {
        Self::new(vec![corners])
    }

    /// A rectangle about the origin.
    ///
    /// # Errors
    /// Where a side is not positive.
    pub fn rectangle(width: f64, height: f64) -> Result<Self, ConfigError> {
        let (x, y) = positive(width, height)?;
        Self::polygon([[-x, -y], [x, -y], [x, y], [-x, y]].map(Point2::from).to_vec())
    }

    /// An ellipse about the origin, its axes along those of the plane.
    ///
    /// # Errors
    /// Where an axis is not positive.
    pub fn ellipse(width: f64, height: f64) -> Result<Self, ConfigError> {
        let (x, y) = positive(width, height)?;
        let at = |k: usize| {
            let (s, c) = math::sin_cos(k as f64 * core::f64::consts::TAU / ELLIPSE as f64);
            Point2::new(x * c, y * s)
        };
        Self::polygon((0..ELLIPSE).map(at).collect())
    }

    /// The closed uniform cubic B-spline with these control points (A. Blake, M. Isard, "Active Contours", 1998, §3).
    ///
    /// # Errors
    /// As [`Outline::new`].
    pub fn spline(control: &[Point2<f64>]) -> Result<Self, ConfigError> {
        let n = control.len();
        let mut points = Vec::with_capacity(n * SPAN);
        for k in 0..n {
            let [a, b, c, d] = [0, 1, 2, 3].map(|i| control[(k + i) % n].coords);
            points.extend((0..SPAN).map(|i| {
                let t = i as f64 / SPAN as f64;
                let u = 1.0 - t;
                let weights =
                    [u * u * u, t * t * (3.0 * t - 6.0) + 4.0, u * u * (3.0 * u - 6.0) + 4.0, t * t * t];
                Point2::from((a * weights[0] + b * weights[1] + c * weights[2] + d * weights[3]) / 6.0)
            }));
        }
        Self::polygon(points)
    }

    /// The loops.
    #[must_use]
    pub fn loops(&self) -> &[Vec<Point2<f64>>] {
        &self.loops
    }

    /// Length of all loops.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.loops.iter().map(|points| perimeter(points)).sum()
    }

    /// Area without the holes.
    #[must_use]
    pub fn area(&self) -> f64 {
        0.5 * self.loops.iter().map(|points| doubled_area(points)).sum::<f64>()
    }

    /// Centre of the area.
    #[must_use]
    pub fn centroid(&self) -> Point2<f64> {
        // About the first corner, since products of large coordinates cancel.
        let origin = self.loops[0][0];
        let mut moment = Vector2::zeros();
        for (a, b) in self.loops.iter().flat_map(|points| sides(points)) {
            let (a, b) = (a - origin, b - origin);
            moment += (a + b) * (a.x * b.y - a.y * b.x);
        }
        origin + moment / (6.0 * self.area())
    }

    /// Smallest and largest coordinates.
    #[must_use]
    pub fn bounds(&self) -> [Point2<f64>; 2] {
        let all = || self.loops.iter().flatten();
        let bound = |start: f64, f: fn(f64, f64) -> f64| {
            Point2::from([0, 1].map(|axis| all().fold(start, |m, p| f(m, p[axis]))))
        };
        [bound(f64::INFINITY, f64::min), bound(f64::NEG_INFINITY, f64::max)]
    }

    /// The shape with its centre of area at the origin.
    #[must_use]
    pub fn centred(&self) -> Self {
        let centre = self.centroid().coords;
        self.moved(|p| p - centre)
    }

    /// The shape larger by a positive factor, about the origin.
    ///
    /// # Errors
    /// Where the factor is not positive.
    pub fn scaled(&self, factor: f64) -> Result<Self, ConfigError> {
        positive(factor, factor)?;
        Ok(self.moved(|p| p * factor))
    }

    fn moved(&self, f: impl Fn(&Point2<f64>) -> Point2<f64>) -> Self {
        Self { loops: self.loops.iter().map(|points| points.iter().map(&f).collect()).collect() }
    }

    /// Whether a point lies inside.
    #[must_use]
    pub fn contains(&self, p: &Point2<f64>) -> bool {
        self.loops.iter().filter(|points| surrounds(points, p)).count() % 2 == 1
    }

    /// About `count` points, at equal distances along each loop (at least three a loop).
    #[must_use]
    pub fn sample(&self, count: usize) -> Contour<Point2<f64>> {
        let spacing = self.length() / count.max(1) as f64;
        let (mut all, mut next) = (vec![], vec![]);
        for points in &self.loops {
            let length = perimeter(points);
            let n = ((length / spacing).round() as usize).max(3);
            let first = all.len() as u32;
            let (mut passed, mut k) = (0.0, 0);
            for (a, b) in sides(points) {
                let side = (b - a).norm();
                // The first point lies half a step from the first corner, so that samples of a square miss its corners.
                while k < n && (k as f64 + 0.5) * length / n as f64 <= passed + side {
                    let along = (k as f64 + 0.5) * length / n as f64 - passed;
                    all.push(a + (b - a) * (along / side).min(1.0));
                    k += 1;
                }
                passed += side;
            }
            // Rounding may leave the last one over.
            all.extend((k..n).map(|_| points[0]));
            next.extend((0..n as u32).map(|k| first + (k + 1) % n as u32));
        }
        match Contour::new(all, &next) {
            Ok(contour) => contour,
            Err(e) => unreachable!("loops of three or more points are closed chains: {e}"),
        }
    }
}

fn perimeter(points: &[Point2<f64>]) -> f64 {
    sides(points).map(|(a, b)| (b - a).norm()).sum()
}

/// Halves of two positive lengths.
fn positive(width: f64, height: f64) -> Result<(f64, f64), ConfigError> {
    if width > 0.0 && height > 0.0 && width.is_finite() && height.is_finite() {
        return Ok((0.5 * width, 0.5 * height));
    }
    Err(ConfigError::parameter("size", format!("{width} x {height}"), "positive and finite"))
}

#[cfg(test)]
mod tests;
