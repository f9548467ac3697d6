//! Feature-level measurement: distances of image edges from the model's contour along its normals.

use nalgebra::{DefaultAllocator, Point3, Vector2};
use vt_core::agent::{Posed, Warp};
use vt_core::manifold::{Alloc, Manifold, Tangent};
use vt_core::measurement::{Level, Linearized, Measurement, NormalEquations, Quality};

use super::mixture::EdgeMixture;

/// One contour point with the edge that was matched to it.
#[derive(Clone, Copy, Debug)]
pub struct EdgeRow {
    /// Model edge.
    pub edge: u32,
    /// Point of the contour on the model, body coordinates, metres.
    pub point: Point3<f64>,
    /// Normal of the contour in the image.
    pub normal: Vector2<f64>,
    /// Position of the edge along the normal, `n · m`, pixels.
    pub position: f64,
    /// Variance of the localisation in px², neighbouring rows' correlation included.
    pub variance: f64,
    /// Probability that this is the right edge.
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
    /// Matched edges; the mixture behind them answers for quality.
    pub(super) rows: Vec<EdgeRow>,
    pub(super) mixture: EdgeMixture<P, W>,
}

impl<P: Manifold, W: Warp<P, Body = Point3<f64>>> EdgeFeatures<P, W>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// The matched edges.
    pub fn rows(&self) -> &[EdgeRow] {
        &self.rows
    }

    /// Calls `f(residual, Jacobian, row)` for every row that can be projected.
    fn each(&self, at: &P, mut f: impl FnMut(f64, Tangent<P>, &EdgeRow)) {
        let posed = self.mixture.warp.at(at);
        for row in &self.rows {
            if let Some((y, j)) = posed.linearize(&row.point) {
                f(row.position - row.normal.dot(&y.coords), j.tr_mul(&row.normal), row);
            }
        }
    }
}

impl<P: Manifold, W: Warp<P, Body = Point3<f64>>> Measurement<P> for EdgeFeatures<P, W>
where
    DefaultAllocator: Alloc<P::D>,
{
    fn log_likelihoods(&self, poses: &[P], out: &mut [f64]) {
        for (pose, l) in poses.iter().zip(out) {
            let posed = self.mixture.warp.at(pose);
            *l = -0.5
                * self
                    .rows
                    .iter()
                    .filter_map(|row| Some((row, posed.locate(&row.point)?)))
                    .map(|(row, y)| {
                        let r = row.position - row.normal.dot(&y.coords);
                        r * r * row.weight / row.variance
                    })
                    .sum::<f64>();
        }
    }

    fn residuals(&self, at: &P, out: &mut Linearized<P>) {
        out.clear();
        self.each(at, |r, j, row| out.push(r, j, row.variance, row.weight));
    }

    fn normal_equations(&self, at: &P, out: &mut NormalEquations<P>) {
        out.clear();
        self.each(at, |r, j, row| out.add(r, &j, row.weight / row.variance));
    }

    fn quality(&self, at: &P) -> Quality {
        self.mixture.quality(at)
    }

    fn level(&self) -> Level {
        Level::Feature
    }
}
