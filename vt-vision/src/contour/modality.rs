//! The contour modality of one target.

use nalgebra::DefaultAllocator;
use vt_core::agent::{Posed, Warp};
use vt_core::belief::Gaussian;
use vt_core::error::{ConfigError, MeasureError};
use vt_core::evidence::{Evidence, EvidenceKey};
use vt_core::frame::{Roi, SensorId};
use vt_core::manifold::{Alloc, Manifold};
use vt_core::measurement::{Measurement, Modality};
use vt_core::sketch::{Mark, Role};
use vt_models::contour::Contour;

use super::likelihood::ContourLikelihood;
use super::params::{ContourParams, MOST_SAMPLES};
use crate::canny::{CannyEvidence, CannyParams, CannyProcessing};
use crate::plane::intersection;
use crate::search_region::{check_prior, search_region};

/// Pixel-level contour modality of one target. It needs the evidence of [`CannyProcessing`] with its own parameters.
pub struct ContourModality<P, W: Warp<P>>
where
    P: Manifold,
    DefaultAllocator: Alloc<P::D>,
{
    params: ContourParams,
    canny: CannyParams,
    needs: [EvidenceKey; 1],
    likelihood: ContourLikelihood<P, W>,
    seen: bool,
}

/// Refuses contours without points and with too many.
pub(super) fn check_count<B>(contour: &Contour<B>) -> Result<(), ConfigError> {
    let count = contour.points().len();
    if (3..=MOST_SAMPLES).contains(&count) {
        return Ok(());
    }
    Err(ConfigError::parameter("samples", count, format!("3 to {MOST_SAMPLES} contour points")))
}

/// Draws a contour.
pub(super) fn sketch_contour<P: Manifold, T: Posed<P>>(
    posed: &T,
    contour: &Contour<T::Body>,
    out: &mut Vec<Mark>,
) where
    DefaultAllocator: Alloc<P::D>,
{
    for (point, &[_, after]) in contour.points().iter().zip(contour.links()) {
        if let (Some(from), Some(to)) = (posed.locate(point), posed.locate(&contour.points()[after as usize]))
        {
            out.push(Mark::Segment { from: from.into(), to: to.into(), role: Role::Model });
        }
    }
}

impl<P: Manifold, W: Warp<P>> ContourModality<P, W>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// A modality that looks with `warp` for `contour` among the edges that `canny` finds in the pictures of `sensor`.
    ///
    /// # Errors
    /// [`ConfigError`] for parameters out of range, and for a contour with too few or too many points.
    pub fn new(
        params: ContourParams,
        canny: CannyParams,
        sensor: SensorId,
        warp: W,
        contour: Contour<W::Body>,
    ) -> Result<Self, ConfigError> {
        let params = params.check()?;
        check_count(&contour)?;
        let needs = [CannyProcessing::key_for(sensor, &canny)];
        let likelihood = ContourLikelihood::new(&params, warp, contour);
        Ok(Self { params, canny, needs, likelihood, seen: false })
    }

    /// The processing unit whose evidence this modality reads.
    pub fn processing(&self) -> CannyProcessing {
        CannyProcessing::new(self.needs[0].sensor, self.canny.clone())
    }
}

impl<P: Manifold, W: Warp<P>> Modality<P> for ContourModality<P, W>
where
    DefaultAllocator: Alloc<P::D>,
{
    fn needs(&self) -> &[EvidenceKey] {
        &self.needs
    }

    /// Box around the contour at the predicted pose, widened by four predicted deviations and the range of the search.
    fn region(&self, prior: &Gaussian<P>) -> Option<Roi> {
        let points = self.likelihood.contour.points().iter();
        search_region(&self.likelihood.warp, points, prior, 4.0, self.params.range + 4.0)
    }

    fn measure(
        &mut self,
        evidence: &Evidence,
        prior: &Gaussian<P>,
    ) -> Result<Option<&dyn Measurement<P>>, MeasureError> {
        self.seen = false;
        check_prior(prior)?;
        let size = evidence.frame(self.needs[0].sensor)?.payload.size();
        let canny = evidence.get::<CannyEvidence>(&self.needs[0])?.edges.now();
        let searched = canny.mask().region();
        // Others may have asked for more of the picture.
        let region = self.region(prior).map_or(searched, |own| intersection(searched, own));
        if region.width == 0 || region.height == 0 {
            return Ok(None);
        }
        self.likelihood.lines.reserve(size.unwrap_or_default());
        self.likelihood.lines.fill(region, canny.edges());
        self.seen = true;
        Ok(self.last())
    }

    fn last(&self) -> Option<&dyn Measurement<P>> {
        self.seen.then_some(&self.likelihood as &dyn Measurement<P>)
    }

    fn sketch(&self, pose: &P, out: &mut Vec<Mark>) {
        let posed = self.likelihood.warp.at(pose);
        sketch_contour(&posed, &self.likelihood.contour, out);
        self.likelihood.each(&posed, |place, hits, _| {
            match hits.iter().max_by(|a, b| a.strength.total_cmp(&b.strength)) {
                Some(hit) => {
                    let to = place.y + place.normal * hit.residual;
                    let role = if hit.strength > 0.5 { Role::Inlier } else { Role::Outlier };
                    out.push(Mark::Segment { from: place.y.into(), to: to.into(), role });
                }
                None => out.push(Mark::Point { at: place.y.into(), role: Role::Missing }),
            }
        });
    }
}
