//! Pixel-level measurement: contour likelihood on an edge map (Isard and Blake 1998; paper Fig. 4 and 5).

use std::sync::Arc;

use nalgebra::{DefaultAllocator, OMatrix, Point2, Point3, U2, Vector2, Vector3};
use vt_core::agent::{Posed, Warp};
use vt_core::manifold::{Alloc, Manifold};
use vt_core::math;
use vt_core::measurement::{Level, Linearized, Measurement, NormalEquations, Quality};

use super::mixture::{Vote, vote};
use crate::edge_map::EdgeMap;

/// Most edges that one normal may meet.
const MOST_EDGES: usize = 32;

/// Cosine of the largest angle between a contour's normal and the gradient of an edge that may belong to it.
const ALIGNED: f64 = 0.85;

/// A contour point with its tangent on the model, body coordinates, metres.
#[derive(Clone, Copy, Debug)]
pub(super) struct ContourPoint {
    pub point: Point3<f64>,
    pub probe: Vector3<f64>,
    pub edge: u32,
}

/// The evidence map and the contour: every hypothesis projects the contour anew and walks along its own normals.
pub struct EdgePixels<P, W> {
    pub(super) warp: W,
    pub(super) map: Arc<EdgeMap>,
    pub(super) contour: Vec<ContourPoint>,
    pub(super) sigma: f64,
    pub(super) clutter: f64,
    /// Half range of the walk in pixels.
    pub(super) range: f64,
    /// Weight of a normal: share of independent information over temperature.
    pub(super) weight: f64,
    pub(super) pose: core::marker::PhantomData<fn() -> P>,
}

impl<P: Manifold, W: Warp<P, Body = Point3<f64>>> EdgePixels<P, W>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// Residuals of the edges on the normal through `y`.
    fn walk(&self, y: Point2<f64>, normal: Vector2<f64>, out: &mut [f64; MOST_EDGES]) -> usize {
        let reach = self.range.ceil() as i32;
        let mut count = 0;
        for d in -reach..=reach {
            let Some(edge) = self.map.get(y + normal * f64::from(d)) else { continue };
            if edge.direction.dot(&normal).abs() < ALIGNED {
                continue;
            }
            let r = normal.dot(&(edge.at - y));
            // Two steps may meet the same edge; it counts once.
            if r.abs() > self.range || (count > 0 && (r - out[count - 1]).abs() < 0.8) {
                continue;
            }
            out[count] = r;
            count += 1;
            if count == MOST_EDGES {
                break;
            }
        }
        count
    }

    fn normal_at(&self, y: Point2<f64>, ahead: Point2<f64>) -> Option<Vector2<f64>> {
        let direction = ahead - y;
        let length = direction.norm();
        (length > 0.0).then(|| Vector2::new(-direction.y, direction.x) / length)
    }

    /// Calls `f` with every normal's place, direction and vote under `pose`.
    pub(super) fn each(
        &self,
        pose: &P,
        mut f: impl FnMut(&ContourPoint, &W::Posed<'_>, Point2<f64>, Vector2<f64>, Vote, &[f64]),
    ) {
        let posed = self.warp.at(pose);
        let mut residuals = [0.0; MOST_EDGES];
        for c in &self.contour {
            let Some(y) = posed.locate(&c.point) else { continue };
            let Some(ahead) = posed.locate(&(c.point + c.probe)) else { continue };
            let Some(normal) = self.normal_at(y, ahead) else { continue };
            let count = self.walk(y, normal, &mut residuals);
            let found = &residuals[..count];
            let vote = vote(found.iter().map(|&r| (r, 1.0)), self.sigma, self.clutter);
            f(c, &posed, y, normal, vote, found);
        }
    }

    fn jacobian(posed: &W::Posed<'_>, c: &ContourPoint) -> Option<OMatrix<f64, U2, P::D>> {
        posed.linearize(&c.point).map(|(_, j)| j)
    }
}

impl<P: Manifold, W: Warp<P, Body = Point3<f64>>> Measurement<P> for EdgePixels<P, W>
where
    DefaultAllocator: Alloc<P::D>,
{
    fn log_likelihoods(&self, poses: &[P], out: &mut [f64]) {
        for (pose, l) in poses.iter().zip(out) {
            let mut sum = 0.0;
            self.each(pose, |_, _, _, _, vote, _| sum += math::ln(vote.ratio));
            *l = self.weight * sum;
        }
    }

    /// Mean residual of the edges on every normal under their probabilities, weighted by the probability that one of
    /// them is the contour's: the rows whose normal equations are those of the likelihood.
    fn residuals(&self, at: &P, out: &mut Linearized<P>) {
        out.clear();
        let variance = self.sigma * self.sigma / self.weight;
        self.each(at, |c, posed, _, normal, vote, _| {
            if vote.probability == 0.0 {
                return;
            }
            let Some(j) = Self::jacobian(posed, c) else { return };
            out.push(vote.pull / vote.probability, j.tr_mul(&normal), variance, vote.probability);
        });
    }

    /// Gradient of the contour likelihood with the edges that the normals at `at` meet, and its Gauss–Newton matrix.
    fn normal_equations(&self, at: &P, out: &mut NormalEquations<P>) {
        out.clear();
        let information = self.weight / (self.sigma * self.sigma);
        self.each(at, |c, posed, _, normal, vote, _| {
            out.cost -= self.weight * math::ln(vote.ratio);
            if vote.probability == 0.0 {
                return;
            }
            let Some(j) = Self::jacobian(posed, c) else { return };
            let j = j.tr_mul(&normal);
            out.information.ger(information * vote.probability, &j, &j, 1.0);
            out.gradient.axpy(information * vote.pull, &j, 1.0);
            out.rows += 1;
        });
    }

    fn quality(&self, at: &P) -> Quality {
        let mut q = Quality::default();
        let (mut squares, mut log_ratio) = (0.0, 0.0);
        self.each(at, |_, _, _, _, vote, _| {
            q.expected += 1;
            log_ratio += math::ln(vote.ratio);
            if vote.probability > 0.5 {
                q.inliers += 1;
                squares += (vote.pull / vote.probability / self.sigma).powi(2);
            }
        });
        let expected = (q.expected as f64).max(1.0);
        q.inlier_ratio = q.inliers as f64 / expected;
        q.log_ratio = log_ratio / expected;
        q.normalized_rms = (squares / (q.inliers as f64).max(1.0)).sqrt();
        q
    }

    fn level(&self) -> Level {
        Level::Pixel
    }
}

/// Weight of one of `count` normals that stand `spacing` pixels apart, when errors are correlated over
/// `correlation_length` pixels, at temperature `temperature`.
pub(super) fn weight(spacing: f64, correlation_length: f64, temperature: f64) -> f64 {
    (1.0 - math::exp(-spacing / correlation_length)) / temperature
}
