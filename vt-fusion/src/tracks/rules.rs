//! How the loop fuses tracks, step by step.

use nalgebra::DefaultAllocator;
use vt_core::agent::{Dynamics, Estimator};
use vt_core::belief::Gaussian;
use vt_core::error::EstimateError;
use vt_core::manifold::{Alloc, Manifold};
use vt_core::measurement::Quality;
use vt_core::report::Innovation;
use vt_core::time::Seconds;

use super::{CrossCovariance, Intersection, bar_shalom_campo, equivalent_measurement};

/// One step of one track, or of the fused one.
#[derive(Clone, Debug)]
pub struct Track<P: Manifold>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// Belief before the data of this step.
    pub prediction: Gaussian<P>,
    /// Belief after them; the prediction when there were none.
    pub posterior: Gaussian<P>,
    /// How well the data of this step support it, where there were some.
    pub quality: Option<Quality>,
    /// Prediction against data.
    pub innovation: Option<Innovation>,
    /// True where it is not lost.
    pub usable: bool,
    /// True where it was re-initialised in this step: its posterior does not follow from its prediction.
    pub restarted: bool,
}

impl<P: Manifold> Track<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// A track at rest at this belief.
    pub fn at(belief: Gaussian<P>) -> Self {
        let prediction = belief.clone();
        let (quality, innovation) = (None, None);
        Self { prediction, posterior: belief, quality, innovation, usable: true, restarted: false }
    }

    fn fused(prediction: Gaussian<P>, posterior: Gaussian<P>) -> Self {
        Self { prediction, ..Self::at(posterior) }
    }
}

/// Several tracks of one object → one, step by step. Tracks that are lost do not count, unless all are.
pub trait TrackFusion<P: Manifold>: Send
where
    DefaultAllocator: Alloc<P::D>,
{
    /// Advances what is remembered by `dt`; `tracks` as they were after the last step.
    ///
    /// # Errors
    /// When numbers stop being finite.
    fn predict(&mut self, tracks: &[Track<P>], dt: Seconds) -> Result<(), EstimateError> {
        let _ = (tracks, dt);
        Ok(())
    }

    /// Fuses one step.
    ///
    /// # Errors
    /// When tracks cannot be fused.
    fn fuse(&mut self, tracks: &[Track<P>]) -> Result<Track<P>, EstimateError>;

    /// The track with this number starts again at the fused belief of the others; `tracks` hold that already.
    fn rejoin(&mut self, tracks: &[Track<P>], number: usize) {
        let _ = (tracks, number);
    }

    /// All tracks start again at this belief.
    ///
    /// # Errors
    /// When the belief is of no use; nothing has changed then.
    fn reset(&mut self, belief: &Gaussian<P>) -> Result<(), EstimateError> {
        let _ = belief;
        Ok(())
    }
}

/// Those that count.
fn counting<P: Manifold>(tracks: &[Track<P>]) -> impl Iterator<Item = &Track<P>> + Clone
where
    DefaultAllocator: Alloc<P::D>,
{
    let all = !tracks.iter().any(|t| t.usable);
    tracks.iter().filter(move |t| t.usable || all)
}

impl<P: Manifold> TrackFusion<P> for Intersection<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    fn fuse(&mut self, tracks: &[Track<P>]) -> Result<Track<P>, EstimateError> {
        let prediction = self.combine(counting(tracks).map(|t| &t.prediction))?;
        Ok(Track::fused(prediction, self.combine(counting(tracks).map(|t| &t.posterior))?))
    }
}

/// Fusion of two tracks with the cross-covariance that follows from the object's motion; exact where the pose is the
/// state of both filters.
pub struct BarShalomCampo<P: Manifold>
where
    DefaultAllocator: Alloc<P::D>,
{
    motion: Box<dyn Dynamics<P>>,
    cross: CrossCovariance<P>,
}

impl<P: Manifold> BarShalomCampo<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// Two tracks that start from one prior and predict by this motion.
    pub fn new(motion: Box<dyn Dynamics<P>>, prior: &Gaussian<P>) -> Self {
        Self { motion, cross: CrossCovariance::of_common_prior(prior) }
    }

    /// The cross-covariance after the last step.
    pub fn cross(&self) -> &CrossCovariance<P> {
        &self.cross
    }
}

impl<P: Manifold> TrackFusion<P> for BarShalomCampo<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    fn predict(&mut self, tracks: &[Track<P>], dt: Seconds) -> Result<(), EstimateError> {
        if let [a, b] = tracks {
            self.cross.predict(self.motion.as_ref(), [&a.posterior.mean, &b.posterior.mean], dt);
        }
        Ok(())
    }

    fn fuse(&mut self, tracks: &[Track<P>]) -> Result<Track<P>, EstimateError> {
        let [a, b] = tracks else {
            return Err(EstimateError::Unsupported("Bar-Shalom–Campo fusion of other than two tracks"));
        };
        let before = self.cross.0.clone();
        if a.restarted || b.restarted {
            self.cross = CrossCovariance::independent(&a.posterior.mean);
        } else {
            self.cross.correct([&a.prediction, &a.posterior], [&b.prediction, &b.posterior]);
        }
        if a.usable != b.usable {
            let one = if a.usable { a } else { b };
            return Ok(Track::fused(one.prediction.clone(), one.posterior.clone()));
        }
        let prediction = bar_shalom_campo(&a.prediction, &b.prediction, &before)?;
        Ok(Track::fused(prediction, bar_shalom_campo(&a.posterior, &b.posterior, &self.cross.0)?))
    }

    /// Its error is that of the other track.
    fn rejoin(&mut self, tracks: &[Track<P>], number: usize) {
        if let Some(other) = tracks.get(1 - number.min(1)) {
            self.cross.0.clone_from(&other.posterior.covariance);
        }
    }

    fn reset(&mut self, belief: &Gaussian<P>) -> Result<(), EstimateError> {
        self.cross = CrossCovariance::of_common_prior(belief);
        Ok(())
    }
}

/// A central filter that takes in what each track learnt in a step; it is the one that all data would have made,
/// as far as the tracks are linear, whatever their state.
pub struct EquivalentMeasurements<P: Manifold>
where
    DefaultAllocator: Alloc<P::D>,
{
    central: Box<dyn Estimator<P>>,
}

impl<P: Manifold> EquivalentMeasurements<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// With a filter that starts from the prior of the tracks.
    pub fn new(central: Box<dyn Estimator<P>>) -> Self {
        Self { central }
    }
}

impl<P: Manifold> TrackFusion<P> for EquivalentMeasurements<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    fn predict(&mut self, _: &[Track<P>], dt: Seconds) -> Result<(), EstimateError> {
        self.central.predict(dt)
    }

    fn fuse(&mut self, tracks: &[Track<P>]) -> Result<Track<P>, EstimateError> {
        let prediction = self.central.pose();
        let mut innovation: Option<Innovation> = None;
        for track in tracks.iter().filter(|t| t.usable && !t.restarted) {
            let Some(quality) = track.quality else { continue };
            let z = equivalent_measurement(&track.prediction, &track.posterior, quality)?;
            let new = self.central.correct(&z)?;
            innovation = Some(innovation.map_or(new, |sum| one_after_the_other(sum, new)));
        }
        // Where all were lost, the first one that was found again is all there is.
        if !tracks.iter().any(|t| t.usable && !t.restarted)
            && let Some(found) = tracks.iter().find(|t| t.usable)
        {
            self.central.reset(&found.posterior)?;
        }
        Ok(Track { innovation, ..Track::fused(prediction, self.central.pose()) })
    }

    fn reset(&mut self, belief: &Gaussian<P>) -> Result<(), EstimateError> {
        self.central.reset(belief)
    }
}

/// The innovation of two corrections in a row.
pub(crate) fn one_after_the_other(first: Innovation, second: Innovation) -> Innovation {
    Innovation {
        nis: first.nis + second.nis,
        dof: first.dof + second.dof,
        log_evidence: first.log_evidence + second.log_evidence,
        iterations: first.iterations.max(second.iterations),
        ..second
    }
}
