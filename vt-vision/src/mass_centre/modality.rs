//! The mass centre of one target.

use nalgebra::{DefaultAllocator, Matrix2, Point2, Vector2};
use vt_core::agent::{Posed, Warp};
use vt_core::belief::Gaussian;
use vt_core::error::{ConfigError, MeasureError};
use vt_core::evidence::{Evidence, EvidenceKey};
use vt_core::frame::Roi;
use vt_core::lie::PlanarMotion;
use vt_core::manifold::Alloc;
use vt_core::math;
use vt_core::measurement::{Measurement, Modality};
use vt_core::sketch::{Mark, Role};
use vt_core::time::Timestamp;
use vt_models::warp::PlanarWarp;

use super::window::{centre, clutter};
use super::{CentreMeasurement, MassCentreParams, MassLikelihood, MassSource, Places, Window};
use crate::rectangle::Rectangle;
use crate::search_region::check_prior;

/// Object-level modality of one target: the mass centre of what a source sees near the prediction.
pub struct MassCentreModality<P, S> {
    params: MassCentreParams,
    source: S,
    warp: PlanarWarp<P>,
    rectangle: Rectangle,
    expected: Option<Expected>,
    /// What was expected at the start.
    start: Option<Expected>,
    /// Share that was seen in this step.
    seen: Option<f64>,
    /// When the expected mass was adapted last.
    adapted: Option<Timestamp>,
    places: Places,
    measured: Option<CentreMeasurement<P>>,
}

/// Mean of the kernel over the window.
const KERNEL: f64 = 2.0 / 3.0;

/// Factor on the expected mass beyond which what is seen is not that of the object alone.
const MOST: f64 = 1.25;

/// What is known of the mass of an object.
#[derive(Clone, Copy, Debug)]
struct Expected {
    /// Mass under the kernel as a share of the object's box.
    share: f64,
    /// Its centre in the model.
    point: Point2<f64>,
}

/// The object and its place as they are predicted.
struct Predicted {
    object: Window,
    /// Covariance of the place.
    covariance: Matrix2<f64>,
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
        let (params, rectangle) = (params.check()?, Rectangle::new(size)?);
        Ok(Self {
            params,
            source,
            warp,
            rectangle,
            expected: None,
            start: None,
            seen: None,
            adapted: None,
            places: Places::default(),
            measured: None,
        })
    }

    /// Where the weights come from.
    pub fn source(&self) -> &S {
        &self.source
    }

    /// `None` where the object has no image.
    fn predict(&self, prior: &Gaussian<P>) -> Option<Predicted> {
        let posed = self.warp.at(&prior.mean);
        let (mut low, mut high): (Vector2<f64>, Vector2<f64>) =
            (Vector2::repeat(f64::INFINITY), Vector2::repeat(f64::NEG_INFINITY));
        for corner in self.rectangle.corners() {
            let y = posed.locate(&corner)?.coords;
            (low, high) = (low.inf(&y), high.sup(&y));
        }
        let (_, j) = posed.linearize(&Point2::origin())?;
        let centre = Point2::new(0.5 * (low.x + high.x), 0.5 * (low.y + high.y));
        let object = Window { centre, half: (high - low) * 0.5 };
        Some(Predicted { object, covariance: &j * &prior.covariance * j.transpose() })
    }

    /// Covariance of the mass about its prediction, and how far off it is looked for: some deviations of that, but not more than the
    /// object's size; what is farther away is found only after it came near.
    fn gate(&self, predicted: &Predicted) -> (Matrix2<f64>, Vector2<f64>) {
        let gate = predicted.covariance + self.swing(&predicted.object);
        let range = gate.diagonal().map(|v| self.params.deviations * v.max(0.0).sqrt());
        (gate, range.inf(&(predicted.object.half * 2.0)))
    }

    /// Covariance of the mass centre about the place of the object.
    fn swing(&self, object: &Window) -> Matrix2<f64> {
        Matrix2::from_partial_diagonal(object.half.map(|h| (2.0 * self.params.wobble * h).powi(2)).as_slice())
    }

    /// Looks at a picture.
    fn look(
        &mut self,
        evidence: &Evidence,
        prior: &Gaussian<P>,
    ) -> Result<Option<CentreMeasurement<P>>, MeasureError> {
        let params = self.params;
        let Some(predicted) = self.predict(prior) else { return Ok(None) };
        let (gate, range) = self.gate(&predicted);
        let (region, swing) = (self.looked_at(&predicted), self.swing(&predicted.object));
        let Predicted { object, .. } = predicted;
        let Some(plane) = self.source.weigh(evidence, region, object.pixels())? else { return Ok(None) };
        let clutter = clutter(plane, &object);
        let expected = match self.expected {
            Some(expected) => expected,
            None if S::SEEN_AT_START => {
                let matrix = prior.mean.matrix().try_inverse();
                let (Some(seen), Some(model_from_picture)) = (centre(plane, &object), matrix) else {
                    return Ok(None);
                };
                let point = model_from_picture.transform_point(&seen);
                self.places.compute(plane, &object.about(seen, 1.0), Vector2::zeros(), clutter);
                let Some(mass) = self.places.near(Vector2::zeros()).filter(|mass| *mass > 0.0) else {
                    return Ok(None);
                };
                Expected { share: mass / object.area(), point }
            }
            None => Expected { share: params.share * KERNEL, point: Point2::origin() },
        };
        self.expected = Some(expected);
        self.start.get_or_insert(expected);
        let Some(place) = self.warp.at(&prior.mean).locate(&expected.point) else { return Ok(None) };
        let likelihood = MassLikelihood {
            enough: params.enough * expected.share * object.area(),
            sharpness: params.sharpness,
            hidden: params.hidden,
        };
        self.places.compute(plane, &object.about(place, 1.0), range, clutter);
        let Some(seen) = self.places.measurement(&gate, &likelihood) else { return Ok(None) };
        self.seen = self.places.near(seen.shift).map(|mass| mass / object.area());
        let measured = CentreMeasurement::new(self.warp.clone(), place + seen.shift, seen.covariance + swing);
        Ok(measured.map(|z| z.of_point(expected.point)))
    }

    /// Everything that a look may reach, with a ring around it.
    fn looked_at(&self, predicted: &Predicted) -> Roi {
        let Predicted { object, .. } = predicted;
        Window { half: object.half * core::f64::consts::SQRT_2 + self.gate(predicted).1, ..*object }.pixels()
    }
}

impl<P: PlanarMotion, S: MassSource> Modality<P> for MassCentreModality<P, S>
where
    DefaultAllocator: Alloc<P::D>,
{
    fn needs(&self) -> &[EvidenceKey] {
        self.source.needs()
    }

    /// The object's box at the predicted pose, widened by some predicted deviations, and a ring around it.
    fn region(&self, prior: &Gaussian<P>) -> Option<Roi> {
        Some(self.looked_at(&self.predict(prior).filter(|_| prior.is_finite())?))
    }

    fn measure(
        &mut self,
        evidence: &Evidence,
        prior: &Gaussian<P>,
    ) -> Result<Option<&dyn Measurement<P>>, MeasureError> {
        (self.measured, self.seen) = (None, None);
        check_prior(prior)?;
        self.measured = self.look(evidence, prior)?;
        Ok(self.last())
    }

    fn last(&self) -> Option<&dyn Measurement<P>> {
        self.measured.as_ref().map(|z| z as _)
    }

    /// The mass that is expected follows what was seen: targets grow and turn.
    fn adapt(&mut self, evidence: &Evidence, _: &Gaussian<P>) -> Result<(), MeasureError> {
        let now = evidence.frames().iter().map(|f| f.time).max();
        if let (Some(now), Some(before), Some(seen), Some(expected)) =
            (now, self.adapted, self.seen, &mut self.expected)
        {
            let kept = math::exp(-(now - before).0.max(0.0) / self.params.follows.0);
            // More may be of another, less be hidden.
            let [low, high] = [1.0 / MOST, MOST].map(|f| f * expected.share);
            expected.share = kept * expected.share + (1.0 - kept) * seen.clamp(low, high);
        }
        self.adapted = now.or(self.adapted);
        Ok(())
    }

    /// What was learnt at the start is not what it forgets.
    fn revert(&mut self) {
        self.expected = self.start;
    }

    fn forget(&mut self) {
        (self.expected, self.start, self.adapted) = (None, None, None);
        self.source.forget();
    }

    fn sketch(&self, pose: &P, out: &mut Vec<Mark>) {
        self.rectangle.sketch(&self.warp, pose, out);
        if let Some(z) = &self.measured {
            out.push(Mark::Point { at: z.centre().into(), role: Role::Inlier });
            // Three deviations.
            let r = z.covariance() * 9.0;
            let shape = [r.m11, r.m12, r.m22];
            out.push(Mark::Ellipse { center: z.centre().into(), shape, role: Role::Uncertainty });
        }
    }
}
