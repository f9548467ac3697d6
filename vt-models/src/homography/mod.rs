//! Homographies of a plane to its picture from pairs of points: linear fit, and search among pairs of which many are wrong.
//!
//! Coordinates of the plane should have their origin among the points: far from it, the parts of a homography can hardly be told
//! apart. Planes are seen from the front: the map has positive determinant and positive depth.

mod consensus;

pub use consensus::{Consensus, ConsensusParams, Found};

use nalgebra::{Matrix3, Point2, SMatrix, SVector, Vector2};
use vt_core::least_squares::symmetric_eigen;
use vt_core::lie::SL3;

use crate::reprojection::Pair;

/// Smallest but one eigenvalue of the normalised equations, as a part of the largest, that determines a homography.
const LEAST_RANK: f64 = 1e-10;

/// The homography with the least algebraic error, weighted by the pairs' deviations, in normalised coordinates (R. Hartley, "In
/// defense of the eight-point algorithm", 1997). A start for [`refine`](crate::reprojection::refine), which minimises distances in the picture.
/// None for fewer than four pairs, and where all points but one lie on a line.
pub fn fit<'a>(pairs: impl Iterator<Item = &'a Pair<Point2<f64>>> + Clone) -> Option<SL3> {
    if pairs.clone().count() < 4 {
        return None;
    }
    let from = normalizing(pairs.clone().map(|p| p.body))?;
    let to = normalizing(pairs.clone().map(|p| p.seen))?;
    let mut equations = SMatrix::<f64, 9, 9>::zeros();
    for pair in pairs {
        let (x, u) = (from * pair.body.to_homogeneous(), to * pair.seen.to_homogeneous());
        let weight = 1.0 / (pair.deviation * pair.deviation);
        let [a, b] = [u.x, u.y].map(|u| x * -u);
        let rows =
            [[x.x, x.y, x.z, 0.0, 0.0, 0.0, a.x, a.y, a.z], [0.0, 0.0, 0.0, x.x, x.y, x.z, b.x, b.y, b.z]];
        for row in rows.map(SVector::<f64, 9>::from) {
            equations.ger(weight, &row, &row, 1.0);
        }
    }
    if !equations.iter().all(|v| v.is_finite()) {
        return None;
    }
    let (eigenvalues, eigenvectors) = symmetric_eigen(&equations);
    let least = eigenvalues.imin();
    let next = (0..9).filter(|&k| k != least).map(|k| eigenvalues[k]).fold(f64::INFINITY, f64::min);
    if next <= LEAST_RANK * eigenvalues.max() {
        return None;
    }
    let h = eigenvectors.column(least);
    let normalized = Matrix3::from_row_iterator(h.iter().copied());
    SL3::from_matrix(&(to.try_inverse()? * normalized * from))
}

/// Moves the mean to the origin and scales the mean distance from it to √2. None when all points are one.
fn normalizing(points: impl Iterator<Item = Point2<f64>> + Clone) -> Option<Matrix3<f64>> {
    let count = points.clone().count() as f64;
    let mean = points.clone().map(|p| p.coords).sum::<Vector2<f64>>() / count;
    let distance = points.map(|p| (p.coords - mean).norm()).sum::<f64>() / count;
    let scale = core::f64::consts::SQRT_2 / distance;
    let valid = scale.is_finite() && mean.iter().all(|v| v.is_finite());
    valid.then(|| Matrix3::new(scale, 0.0, -scale * mean.x, 0.0, scale, -scale * mean.y, 0.0, 0.0, 1.0))
}

#[cfg(test)]
mod tests;
