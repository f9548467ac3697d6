//! Contour likelihood with several edges on each search line (Isard and Blake 1998).
//!
//! For a line with edges at positions `c_k` and a contour predicted at `u = n · y(p)`,
//!
//! ```text
//! P(line | p) ∝ 1 + β Σ_k π_k exp(−(c_k − u)² / 2σ²),      β = 1 / (√(2π) σ q λ)
//! ```
//!
//! with the probability `q` of a miss and `λ` clutter edges per pixel. The constant bounds the influence of any line:
//! seen as an M-estimator it is redescending, and no edge or only far edges mean "missing", not "impossible".

use nalgebra::{DefaultAllocator, Dim, OMatrix, OVector, Point3, Vector2, Vector3};
use vt_core::agent::{Posed, Warp};
use vt_core::manifold::{Alloc, Manifold, Tangent};
use vt_core::math;
use vt_core::measurement::{NormalEquations, Quality};
use vt_models::visibility::Side;

/// `√(2π)`.
const SQRT_TAU: f64 = 2.506_628_274_631_000_7;

/// A search line that was looked at.
#[derive(Clone, Debug)]
pub struct Line<P: Manifold>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// Contour point on the model, body coordinates, metres.
    pub point: Point3<f64>,
    /// Unit tangent of the contour on the model.
    pub tangent: Vector3<f64>,
    /// Normal of the contour in the image.
    pub normal: Vector2<f64>,
    /// Position `n · y` of the contour when it was searched, pixels.
    pub searched_at: f64,
    /// `∂(n · y)/∂δ` when it was searched, pixels per tangent unit.
    pub jacobian: Tangent<P>,
    /// First of the line's edges in the common list.
    pub first: u32,
    /// Number of the line's edges.
    pub count: u32,
    /// Model edge that the point lies on.
    pub edge: u32,
    /// Side of the object, at an occluding contour.
    pub contour: Option<Side>,
    /// Weight of the line; below 1 where neighbours share their errors.
    pub weight: f64,
    /// Variance of what else may lie between the line's edge and the contour, px²: where two contours nearly coincide
    /// the edge may be that of the other.
    pub slack: f64,
}

/// An edge on a search line.
#[derive(Clone, Copy, Debug)]
pub struct LineEdge {
    /// Position along the line's normal, `n · m`, pixels.
    pub position: f64,
    /// Grey levels before and after it along the normal.
    pub sides: [f32; 2],
    /// Prior weight `π`: how well the edge fits what this contour looked like before, and where it is predicted.
    pub prior: f64,
}

/// All lines of one search with their edges, as a likelihood of the pose.
pub struct EdgeMixture<P: Manifold, W>
where
    DefaultAllocator: Alloc<P::D>,
{
    pub(super) warp: W,
    pub(super) lines: Vec<Line<P>>,
    pub(super) edges: Vec<LineEdge>,
    /// Scale of the residuals, pixels.
    pub(super) sigma: f64,
    /// `q`: probability of a miss.
    pub(super) miss: f64,
    /// `q λ`: miss probability times clutter density.
    pub(super) clutter: f64,
}

/// What one line says about a contour position.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Vote {
    /// Probability that one of the edges is the contour's.
    pub probability: f64,
    /// Mean residual of the edges under that probability, times the probability.
    pub pull: f64,
    /// `P` against clutter.
    pub ratio: f64,
    /// Index among the line's edges and probability of the most probable one.
    pub best: Option<(usize, f64)>,
}

/// Adds `w j jᵀ` to the lower triangle of `m`.
#[inline]
fn accumulate_lower<D: Dim>(m: &mut OMatrix<f64, D, D>, j: &OVector<f64, D>, w: f64)
where
    DefaultAllocator: Alloc<D>,
{
    for c in 0..j.len() {
        let wj = w * j[c];
        for r in c..j.len() {
            m[(r, c)] += wj * j[r];
        }
    }
}

/// The vote of a line whose edges have the given residuals and prior weights.
#[inline]
pub(super) fn vote(edges: impl Iterator<Item = (f64, f64)>, sigma: f64, clutter: f64) -> Vote {
    let beta = 1.0 / (SQRT_TAU * sigma * clutter);
    let scale = -0.5 / (sigma * sigma);
    let (mut sum, mut pull, mut best) = (0.0, 0.0, None);
    for (k, (r, prior)) in edges.enumerate() {
        let exponent = r * r * scale;
        if exponent < -30.0 {
            continue;
        }
        let p = beta * prior * math::exp_fast(exponent);
        sum += p;
        pull += p * r;
        if best.is_none_or(|(_, q)| p > q) {
            best = Some((k, p));
        }
    }
    let total = 1.0 + sum;
    Vote {
        probability: sum / total,
        pull: pull / total,
        ratio: total,
        best: best.map(|(k, p)| (k, p / total)),
    }
}

impl<P: Manifold, W: Warp<P, Body = Point3<f64>>> EdgeMixture<P, W>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// Scale of the residuals `sigma`, probability `miss` of a miss, and `density` clutter edges a pixel.
    pub(super) fn new(warp: W, sigma: f64, miss: f64, density: f64) -> Self {
        Self { warp, lines: vec![], edges: vec![], sigma, miss, clutter: miss * density }
    }

    /// The vote of `line` for a contour at position `u` with scale `sigma`.
    #[inline]
    pub(super) fn vote(&self, line: &Line<P>, u: f64, sigma: f64) -> Vote {
        let first = line.first as usize;
        let edges = &self.edges[first..first + line.count as usize];
        let sigma = if line.slack > 0.0 { (sigma * sigma + line.slack).sqrt() } else { sigma };
        vote(edges.iter().map(|e| (e.position - u, e.prior)), sigma, self.clutter)
    }

    /// Gradient and Gauss–Newton matrix of the negative log-likelihood with scale `sigma` at the pose that lies `delta`
    /// away from the one at which the lines were searched, with the contour linearised there. Returns the summed weight
    /// of the lines that entered.
    pub(super) fn linear_equations(
        &self,
        delta: &Tangent<P>,
        sigma: f64,
        out: &mut NormalEquations<P>,
    ) -> f64 {
        out.clear();
        let mut total = 0.0;
        let variance = sigma * sigma;
        for line in &self.lines {
            let vote = self.vote(line, line.searched_at + line.jacobian.dot(delta), sigma);
            if vote.probability > 0.0 {
                let w = line.weight / (variance + line.slack);
                accumulate_lower(&mut out.information, &line.jacobian, w * vote.probability);
                out.gradient.axpy(w * vote.pull, &line.jacobian, 1.0);
                out.rows += 1;
                total += w * variance * vote.probability;
            }
        }
        out.information.fill_upper_triangle_with_lower_triangle();
        total
    }

    /// Log-likelihood ratio of a pose against clutter with scale `sigma`, and the share of the contour that an edge
    /// supports. Lines without an edge count against the pose, so that poses with different lines compare.
    pub(super) fn compare(&self, at: &P, sigma: f64) -> (f64, f64) {
        let posed = self.warp.at(at);
        let miss = math::ln(self.miss);
        let (mut score, mut support, mut weight) = (0.0, 0.0, 0.0);
        for line in &self.lines {
            let Some(y) = posed.locate(&line.point) else { continue };
            let vote = self.vote(line, line.normal.dot(&y.coords), sigma);
            score += line.weight * (math::ln(vote.ratio) + miss);
            support += line.weight * vote.probability;
            weight += line.weight;
        }
        (score, if weight > 0.0 { support / weight } else { 0.0 })
    }

    /// Root mean square motion of the lines' contour points along their normals under a change of pose, pixels.
    pub(super) fn motion(&self, delta: &Tangent<P>) -> f64 {
        let squares: f64 = self.lines.iter().map(|l| l.jacobian.dot(delta).powi(2)).sum();
        (squares / (self.lines.len() as f64).max(1.0)).sqrt()
    }

    /// Support of a pose by the lines, those on contours that nearly coincide apart.
    pub(super) fn quality(&self, at: &P) -> Quality {
        let posed = self.warp.at(at);
        let mut q = Quality::default();
        let (mut weight, mut inlier_weight, mut squares, mut log_ratio) = (0.0, 0.0, 0.0, 0.0);
        for line in self.lines.iter().filter(|l| l.slack == 0.0) {
            let Some(y) = posed.locate(&line.point) else { continue };
            let vote = self.vote(line, line.normal.dot(&y.coords), self.sigma);
            q.expected += 1;
            weight += line.weight;
            log_ratio += line.weight * math::ln(vote.ratio);
            if vote.probability > 0.5 {
                q.inliers += 1;
                inlier_weight += line.weight;
                let r = vote.pull / vote.probability / self.sigma;
                squares += line.weight * r * r;
            }
        }
        if weight > 0.0 {
            q.inlier_ratio = inlier_weight / weight;
            q.log_ratio = log_ratio / weight;
        }
        if inlier_weight > 0.0 {
            q.normalized_rms = (squares / inlier_weight).sqrt();
        }
        q
    }
}
