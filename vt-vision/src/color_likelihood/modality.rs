//! The colour modality of one target.

use std::sync::Arc;

use image::RgbImage;
use nalgebra::{DefaultAllocator, Point2};
use vt_core::belief::Gaussian;
use vt_core::error::{ConfigError, MeasureError};
use vt_core::evidence::{Evidence, EvidenceKey};
use vt_core::frame::{Roi, SensorId};
use vt_core::lie::PlanarMotion;
use vt_core::manifold::Alloc;
use vt_core::measurement::{Measurement, Modality};
use vt_core::sketch::Mark;
use vt_models::warp::PlanarWarp;

use super::likelihood::ColorLikelihood;
use super::params::ColorParams;
use crate::adaptation::Adaptation;
use crate::histogram::{Binning, ColorBins, ColorBinsProcessing};
use crate::rectangle::Rectangle;
use crate::search_region::{check_prior, search_region};
use crate::turns::Turns;

/// Pixel-level colour modality of a rectangular target of a known size about the origin. It needs the evidence of
/// [`ColorBinsProcessing`] with its own binning. Without a reference it takes that of the first frame, at the predicted
/// pose.
pub struct ColorModality<P> {
    binning: Binning,
    needs: [EvidenceKey; 1],
    rectangle: Rectangle,
    likelihood: ColorLikelihood<P>,
    adaptation: Option<Adaptation>,
    given: bool,
    /// The target was seen and trusted with this reference.
    settled: bool,
    seen: bool,
}

impl<P: PlanarMotion> ColorModality<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// A modality for an object of `width × height` in its own units, seen by `sensor` under `warp`.
    ///
    /// # Errors
    /// [`ConfigError`] for parameters and sizes out of range.
    pub fn new(
        params: ColorParams,
        sensor: SensorId,
        warp: PlanarWarp<P>,
        size: [f64; 2],
    ) -> Result<Self, ConfigError> {
        let (params, binning) = (params.check()?, params.binning.check()?);
        let rectangle = Rectangle::new(size)?;
        let needs = [ColorBinsProcessing::key_for(sensor, &binning)];
        let likelihood = ColorLikelihood::new(&params, binning.count(), warp, size);
        let adaptation = params.adapt.map(Adaptation::new);
        Ok(Self {
            binning,
            needs,
            rectangle,
            likelihood,
            adaptation,
            given: false,
            settled: false,
            seen: false,
        })
    }

    /// Takes the reference from a picture that shows the object at `pose`.
    ///
    /// # Errors
    /// [`ConfigError::Mismatch`] where half of a part or more is not in the picture.
    pub fn with_reference(mut self, picture: &RgbImage, pose: &P) -> Result<Self, ConfigError> {
        let mut bins = ColorBins::default();
        bins.compute(picture, None, &self.binning);
        self.likelihood.bins = Arc::new(bins);
        self.given = self.likelihood.learn(pose);
        if self.given {
            return Ok(self);
        }
        let found = format!("a reference pose outside of a picture of {:?} pixels", picture.dimensions());
        Err(ConfigError::Mismatch { found, expected: "a pose at which the picture shows the object".into() })
    }

    /// The processing unit whose evidence this modality reads.
    pub fn processing(&self) -> ColorBinsProcessing {
        ColorBinsProcessing::new(self.needs[0].sensor, self.binning)
    }
}

impl<P: PlanarMotion> Modality<P> for ColorModality<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    fn needs(&self) -> &[EvidenceKey] {
        &self.needs
    }

    /// Box around the object at the predicted pose, twice as far out as its corners lie, widened by four predicted
    /// deviations: hypotheses up to twice the predicted size see all their pixels.
    fn region(&self, prior: &Gaussian<P>) -> Option<Roi> {
        let corners: [Point2<f64>; 4] = self.rectangle.corners().map(|p| p * 2.0);
        search_region(&self.likelihood.warp, corners.iter(), prior, 4.0, 2.0)
    }

    fn measure(
        &mut self,
        evidence: &Evidence,
        prior: &Gaussian<P>,
    ) -> Result<Option<&dyn Measurement<P>>, MeasureError> {
        self.seen = false;
        check_prior(prior)?;
        evidence.frame(self.needs[0].sensor)?;
        self.likelihood.bins = evidence.get::<Turns<ColorBins>>(&self.needs[0])?.now().clone();
        if !self.likelihood.has_reference() && !self.likelihood.learn(&prior.mean) {
            return Ok(None);
        }
        self.likelihood.choose_lattice(&prior.mean);
        self.seen = true;
        Ok(self.last())
    }

    fn last(&self) -> Option<&dyn Measurement<P>> {
        self.seen.then_some(&self.likelihood as &dyn Measurement<P>)
    }

    /// A reference that was given stays.
    fn forget(&mut self) {
        self.revert();
        if !self.given {
            self.likelihood.forget();
            self.adaptation.iter_mut().for_each(Adaptation::forget);
            self.settled = false;
        }
    }

    fn adapt(&mut self, evidence: &Evidence, posterior: &Gaussian<P>) -> Result<(), MeasureError> {
        check_prior(posterior)?;
        let now = evidence.frame(self.needs[0].sensor)?.time;
        self.settled = true;
        if let Some(adaptation) = &mut self.adaptation {
            self.likelihood.adapt(adaptation, &posterior.mean, now);
        }
        Ok(())
    }

    /// What was learnt in trusted steps stays, which its anchor holds. A reference that was never trusted goes.
    fn revert(&mut self) {
        if !self.given && !self.settled {
            self.likelihood.forget();
        }
    }

    fn sketch(&self, pose: &P, out: &mut Vec<Mark>) {
        self.rectangle.sketch(&self.likelihood.warp, pose, out);
    }
}
