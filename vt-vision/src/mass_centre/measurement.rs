//! A place in the picture as a measurement of a pose.

use nalgebra::{DefaultAllocator, Matrix2, Point2};
use vt_core::agent::{Posed, Warp};
use vt_core::lie::PlanarMotion;
use vt_core::manifold::{Alloc, Tangent};
use vt_core::measurement::{Level, Linearized, Measurement, NormalEquations, Quality};
use vt_models::warp::PlanarWarp;

/// The place of a point of the model in the picture.
#[derive(Clone, Debug)]
pub struct CentreMeasurement<P> {
    warp: PlanarWarp<P>,
    /// In the model.
    point: Point2<f64>,
    centre: Point2<f64>,
    covariance: Matrix2<f64>,
    /// `R = L Lᵀ`; this is `L⁻¹`.
    whitening: Matrix2<f64>,
}

impl<P: PlanarMotion> CentreMeasurement<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// A place of the model's origin in pixels with its covariance; `None` where that is not positive definite.
    pub fn new(warp: PlanarWarp<P>, centre: Point2<f64>, covariance: Matrix2<f64>) -> Option<Self> {
        let whitening = covariance.cholesky()?.l().try_inverse()?;
        let finite = whitening.iter().chain(centre.iter()).all(|v| v.is_finite());
        finite.then_some(Self { warp, point: Point2::origin(), centre, covariance, whitening })
    }

    /// The same place of another point of the model, in its units.
    #[must_use]
    pub fn of_point(self, point: Point2<f64>) -> Self {
        Self { point, ..self }
    }

    /// The place, pixels.
    pub fn centre(&self) -> Point2<f64> {
        self.centre
    }

    /// Its covariance, square pixels.
    pub fn covariance(&self) -> Matrix2<f64> {
        self.covariance
    }

    /// Residuals in deviations; `None` where the pose has no image of the point.
    fn whitened(&self, at: &P) -> Option<nalgebra::Vector2<f64>> {
        Some(self.whitening * (self.centre - self.warp.at(at).locate(&self.point)?))
    }

    fn rows(&self, at: &P, mut f: impl FnMut(f64, Tangent<P>)) {
        let Some((y, j)) = self.warp.at(at).linearize(&self.point) else { return };
        let (r, j) = (self.whitening * (self.centre - y), self.whitening * j);
        (0..2).for_each(|k| f(r[k], j.row(k).transpose()));
    }
}

impl<P: PlanarMotion> Measurement<P> for CentreMeasurement<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    fn log_likelihoods(&self, poses: &[P], out: &mut [f64]) {
        for (pose, l) in poses.iter().zip(out) {
            *l = self.whitened(pose).map_or(f64::NEG_INFINITY, |r| -0.5 * r.norm_squared());
        }
    }

    fn residuals(&self, at: &P, out: &mut Linearized<P>) {
        out.clear();
        self.rows(at, |r, j| out.push(r, j, 1.0, 1.0));
    }

    fn normal_equations(&self, at: &P, out: &mut NormalEquations<P>) {
        out.clear();
        self.rows(at, |r, j| out.add(r, &j, 1.0));
    }

    fn normalized_residuals(&self, poses: &[P], out: &mut Vec<f64>) -> Option<usize> {
        out.clear();
        for pose in poses {
            out.extend(self.whitened(pose)?.iter());
        }
        Some(2)
    }

    fn quality(&self, at: &P) -> Quality {
        let squared = self.whitened(at).map_or(f64::INFINITY, |r| r.norm_squared());
        // 99 % of χ² with two degrees of freedom.
        let near = squared < 9.21;
        Quality {
            expected: 1,
            inliers: usize::from(near),
            inlier_ratio: if near { 1.0 } else { 0.0 },
            log_ratio: 0.5 * (9.21 - squared.min(1e6)),
            normalized_rms: if near { (0.5 * squared).sqrt() } else { 0.0 },
        }
    }

    fn level(&self) -> Level {
        Level::Object
    }
}
