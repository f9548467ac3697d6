//! Feature-level measurement: distances of image edges from the model's contour along its normals.

use nalgebra::{DefaultAllocator, Point3, Vector2};
use vt_core::agent::{Projected, Warp};
use vt_core::manifold::{Alloc, Manifold, Tangent};
use vt_core::measurement::{Level, Linearized, Measurement, NormalEquations, Quality};

/// One contour point with the edge that belongs to it.
#[derive(Clone, Copy, Debug)]
pub struct EdgeRow {
    /// Point of the contour on the model, body coordinates, metres.
    pub point: Point3<f64>,
    /// Normal of the contour in the image.
    pub normal: Vector2<f64>,
    /// Position of the edge along the normal, `n · m`, pixels.
    pub position: f64,
    /// Inverse variance times the probability that this edge is the right one, 1/px².
    pub weight: f64,
}

/// Distances `n · (m − y(p))` of matched edges from the contour: the paper's variable-length feature-level `z`.
///
/// Edges were matched to contour points by the modality; the match is part of the data and does not change with the
/// hypothesis, so that the negative log-likelihood is a sum of squares and its two forms agree exactly.
pub struct EdgeFeatures<P: Manifold, W: Warp<P, Body = Point3<f64>>>
where
    DefaultAllocator: Alloc<P::D>,
{
    pub(super) warp: W,
    pub(super) points: Vec<Point3<f64>>,
    pub(super) rows: Vec<EdgeRow>,
    pub(super) quality: Quality,
    pub(super) sigma: f64,
    pub(super) pose: core::marker::PhantomData<fn() -> P>,
}

impl<P: Manifold, W: Warp<P, Body = Point3<f64>>> EdgeFeatures<P, W>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// The matched edges.
    pub fn rows(&self) -> &[EdgeRow] {
        &self.rows
    }

    /// Calls `f(residual, Jacobian, weight)` for every row that can be projected.
    pub(super) fn each(
        &self,
        at: &P,
        projected: &mut Projected<P>,
        mut f: impl FnMut(f64, Tangent<P>, f64),
    ) {
        self.warp.project(at, &self.points, projected);
        for (k, row) in self.rows.iter().enumerate() {
            if projected.valid[k] {
                let r = row.position - row.normal.dot(&projected.points[k].coords);
                f(r, projected.jacobians[k].tr_mul(&row.normal), row.weight);
            }
        }
    }
}
