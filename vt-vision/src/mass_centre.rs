//! Mass centres as object-level measurements: where what moved, or what has the target's colour, is on average (paper Fig. 7).
//!
//! The measured place is that of the model's origin; its covariance follows from the moments (spread over the number of
//! independent patches). Nothing seen is **no measurement**. Poses with more than a place get information about the place
//! alone.

use nalgebra::{DefaultAllocator, Matrix2, Point2};
use vt_core::agent::{Posed, Warp};
use vt_core::belief::Gaussian;
use vt_core::error::{ConfigError, MeasureError};
use vt_core::evidence::{Evidence, EvidenceKey};
use vt_core::frame::Roi;
use vt_core::lie::PlanarMotion;
use vt_core::manifold::{Alloc, Tangent};
use vt_core::measurement::{Level, Linearized, Measurement, Modality, NormalEquations, Quality};
use vt_core::sketch::{Mark, Role};
use vt_models::warp::PlanarWarp;

use crate::moments::Moments;
use crate::search_region::{check_prior, search_region};

/// Pixels with weights, from some evidence: motion history, classes of colours, back-projection.
pub trait MassSource: Send {
    /// Evidence that must be prepared.
    fn needs(&self) -> &[EvidenceKey];

    /// Moments of what was seen in a region of the picture; all of it without one.
    ///
    /// # Errors
    /// When the evidence does not fit.
    fn moments(&mut self, evidence: &Evidence, region: Option<Roi>) -> Result<Moments, MeasureError>;
}

/// Parameters of a [`MassCentreModality`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MassCentreParams {
    /// Pixels of mass below which nothing was seen.
    pub least_count: f64,
    /// Square pixels that share their error: so much fewer than pixels are the independent ones.
    pub patch: f64,
    /// Half size of the search in predicted deviations beyond the object's box.
    pub deviations: f64,
}

impl Default for MassCentreParams {
    fn default() -> Self {
        Self { least_count: 20.0, patch: 25.0, deviations: 3.0 }
    }
}

impl MassCentreParams {
    /// Checks all ranges.
    ///
    /// # Errors
    /// [`ConfigError::Parameter`] with the first parameter that is out of its range.
    pub fn check(self) -> Result<Self, ConfigError> {
        for (key, v) in
            [("least_count", self.least_count), ("patch", self.patch), ("deviations", self.deviations)]
        {
            if !(v > 0.0 && v.is_finite()) {
                return Err(ConfigError::parameter(key, v, "a positive number"));
            }
        }
        Ok(self)
    }
}

/// The place of the model's origin in the picture.
#[derive(Clone, Debug)]
pub struct CentreMeasurement<P> {
    warp: PlanarWarp<P>,
    centre: Point2<f64>,
    covariance: Matrix2<f64>,
    /// `R = L Lᵀ`; this is `L⁻¹`.
    whitening: Matrix2<f64>,
}

impl<P: PlanarMotion> CentreMeasurement<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// A place in pixels with its covariance; `None` where that is not positive definite.
    pub fn new(warp: PlanarWarp<P>, centre: Point2<f64>, covariance: Matrix2<f64>) -> Option<Self> {
        let whitening = covariance.cholesky()?.l().try_inverse()?;
        let finite = whitening.iter().chain(centre.iter()).all(|v| v.is_finite());
        finite.then_some(Self { warp, centre, covariance, whitening })
    }

    /// The place, pixels.
    pub fn centre(&self) -> Point2<f64> {
        self.centre
    }

    /// Its covariance, square pixels.
    pub fn covariance(&self) -> Matrix2<f64> {
        self.covariance
    }

    /// Residuals in deviations; `None` where the pose has no image of the origin.
    fn whitened(&self, at: &P) -> Option<nalgebra::Vector2<f64>> {
        Some(self.whitening * (self.centre - self.warp.at(at).locate(&Point2::origin())?))
    }

    fn rows(&self, at: &P, mut f: impl FnMut(f64, Tangent<P>)) {
        let Some((y, j)) = self.warp.at(at).linearize(&Point2::origin()) else { return };
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

/// Object-level modality of one target: the mass centre of what a source sees near the prediction.
pub struct MassCentreModality<P, S> {
    params: MassCentreParams,
    source: S,
    warp: PlanarWarp<P>,
    /// Corners of the object's box.
    corners: [Point2<f64>; 4],
    measured: Option<CentreMeasurement<P>>,
}

impl<P: PlanarMotion, S: MassSource> MassCentreModality<P, S>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// A modality for an object of `width × height` in its own units about its origin.
    ///
    /// # Errors
    /// [`ConfigError`] for parameters and sizes out of range.
    pub fn new(
        params: MassCentreParams,
        source: S,
        warp: PlanarWarp<P>,
        size: [f64; 2],
    ) -> Result<Self, ConfigError> {
        let corners = crate::rectangle::Rectangle::new(size)?.corners();
        Ok(Self { params: params.check()?, source, warp, corners, measured: None })
    }
}

impl<P: PlanarMotion, S: MassSource> Modality<P> for MassCentreModality<P, S>
where
    DefaultAllocator: Alloc<P::D>,
{
    fn needs(&self) -> &[EvidenceKey] {
        self.source.needs()
    }

    /// The object's box at the predicted pose, widened by some predicted deviations.
    fn region(&self, prior: &Gaussian<P>) -> Option<Roi> {
        search_region(&self.warp, self.corners.iter(), prior, self.params.deviations, 0.0)
    }

    fn measure(
        &mut self,
        evidence: &Evidence,
        prior: &Gaussian<P>,
    ) -> Result<Option<&dyn Measurement<P>>, MeasureError> {
        self.measured = None;
        check_prior(prior)?;
        let moments = self.source.moments(evidence, self.region(prior))?;
        if moments.effective_count() < self.params.least_count {
            return Ok(None);
        }
        if let (Some(centre), Some(covariance)) =
            (moments.centroid(), moments.centroid_covariance(self.params.patch))
        {
            self.measured = CentreMeasurement::new(self.warp.clone(), centre, covariance);
        }
        Ok(self.last())
    }

    fn last(&self) -> Option<&dyn Measurement<P>> {
        self.measured.as_ref().map(|z| z as _)
    }

    fn sketch(&self, pose: &P, out: &mut Vec<Mark>) {
        if let Some(y) = self.warp.at(pose).locate(&Point2::origin()) {
            out.push(Mark::Point { at: y.into(), role: Role::Model });
        }
        if let Some(z) = &self.measured {
            out.push(Mark::Point { at: z.centre.into(), role: Role::Inlier });
            // Three deviations.
            let r = z.covariance * 9.0;
            let shape = [r.m11, r.m12, r.m22];
            out.push(Mark::Ellipse { center: z.centre.into(), shape, role: Role::Uncertainty });
        }
    }
}
