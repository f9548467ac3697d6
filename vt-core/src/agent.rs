//! Contracts of the agents of the pipeline that are not measurements: warps, dynamics, estimators, associators,
//! loss detectors, sensors and outputs (paper Fig. 1 and 2).

use core::ops::ControlFlow;

use nalgebra::{DefaultAllocator, OMatrix, Point2, U2};

use crate::batch::Row;
use crate::belief::Gaussian;
use crate::error::{DeviceError, EstimateError, MeasureError};
use crate::evidence::{Evidence, EvidenceKey};
use crate::frame::Frame;
use crate::manifold::{Alloc, Manifold, Square, differences};
use crate::measurement::Measurement;
use crate::report::{Assessment, Innovation, StepReport, Verdict};
use crate::sketch::Mark;
use crate::time::Seconds;

/// Image points of body points under one pose, with their Jacobians; storage is used again.
#[derive(Clone, Debug)]
pub struct Projected<P: Manifold>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// Image points in pixels.
    pub points: Vec<Point2<f64>>,
    /// `∂y/∂δ` of each point under `p ⊞ δ`, in pixels per tangent unit.
    pub jacobians: Vec<OMatrix<f64, U2, P::D>>,
    /// False where a point cannot be projected (behind the camera, outside the lens model); its values are void.
    pub valid: Vec<bool>,
}

impl<P: Manifold> Default for Projected<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    fn default() -> Self {
        Self { points: vec![], jacobians: vec![], valid: vec![] }
    }
}

impl<P: Manifold> Projected<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// Removes all points and keeps the storage.
    pub fn clear(&mut self) {
        self.points.clear();
        self.jacobians.clear();
        self.valid.clear();
    }
}

/// `y = W(x, p)` with its exact Jacobian (paper Eq. 1–4). The warp owns camera and lens; the pose is an argument.
pub trait Warp<P: Manifold>: Send + Sync
where
    DefaultAllocator: Alloc<P::D>,
{
    /// A point of the model in body coordinates.
    type Body: Send + Sync;

    /// The warp at one pose: whatever all points share (rotation matrices, forward kinematics) is computed once.
    type Posed<'a>: Posed<P, Body = Self::Body>
    where
        Self: 'a;

    /// Fixes the pose.
    fn at<'a>(&'a self, pose: &P) -> Self::Posed<'a>;

    /// Projects all `points` under `pose`, values and Jacobians in one call; replaces the content of `out`.
    fn project(&self, pose: &P, points: &[Self::Body], out: &mut Projected<P>) {
        let n = pose.dim();
        let posed = self.at(pose);
        out.clear();
        for point in points {
            let image = posed.linearize(point);
            out.valid.push(image.is_some());
            let (y, j) = image.unwrap_or_else(|| (Point2::origin(), OMatrix::zeros_generic(U2, n)));
            out.points.push(y);
            out.jacobians.push(j);
        }
    }
}

/// A warp at a fixed pose.
pub trait Posed<P: Manifold>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// A point of the model in body coordinates.
    type Body;

    /// The image point in pixels; `None` where it cannot be projected (behind the camera, outside the lens model).
    fn locate(&self, point: &Self::Body) -> Option<Point2<f64>>;

    /// The image point and `∂y/∂δ` under `p ⊞ δ`. Locked degrees of freedom have zero columns.
    fn linearize(&self, point: &Self::Body) -> Option<(Point2<f64>, OMatrix<f64, U2, P::D>)>;
}

/// Model features that a camera sees from a pose (paper §4.5), within a budget.
pub trait Visibility<P: Manifold>: Send
where
    DefaultAllocator: Alloc<P::D>,
{
    /// A feature of the model.
    type Feature;

    /// Features visible under `pose`. The list is kept from call to call until the view has changed enough to matter.
    fn visible(&mut self, pose: &P) -> &[Self::Feature];
}

/// `s_t = f(s_{t-1}, Δt, w)` (paper Eq. 7–9) with white noise `w` in the tangent space of the new state.
pub trait Dynamics<S: Manifold>: Send + Sync
where
    DefaultAllocator: Alloc<S::D>,
{
    /// The state after `dt` without noise (Eq. 8).
    fn propagate(&self, state: &S, dt: Seconds) -> S;

    /// [`Dynamics::propagate`] of up to [`crate::batch::LANES`] states, in place.
    fn propagate_each(&self, states: &mut [S], dt: Seconds) {
        for state in states {
            *state = self.propagate(state, dt);
        }
    }

    /// `f(s) ⊞ w` of up to [`crate::batch::LANES`] states, in place; row `r` of `noise` holds coordinate `r` of all `w`.
    fn disturb_each(&self, states: &mut [S], dt: Seconds, noise: &[Row]) {
        self.propagate_each(states, dt);
        S::retract_each(states, |s| s, noise);
    }

    /// `F = ∂f/∂s` at `state`, between the charts at `state` and at the propagated state (Eq. 9).
    /// By central differences unless overridden.
    fn jacobian(&self, state: &S, dt: Seconds) -> Square<S> {
        let ahead = self.propagate(state, dt);
        differences(state.dim(), |e| ahead.local(&self.propagate(&state.retract(e), dt)))
    }

    /// Covariance `Q(Δt)` of the accumulated noise in the tangent space at the propagated state.
    fn noise(&self, state: &S, dt: Seconds) -> Square<S>;

    /// A matrix `L` with `L Lᵀ = Q(Δt)`, for sampling: `f(s) ⊞ L n` with standard normal `n`.
    fn noise_root(&self, state: &S, dt: Seconds) -> Square<S> {
        crate::dynamics::pivoted_root(&self.noise(state, dt))
    }

    /// Whether the model is made for states of this size; estimators ask before they start. Models of a size that is only known
    /// at run time override it.
    ///
    /// # Errors
    /// [`EstimateError::Dimension`] when it is not.
    fn fits(&self, state: &S) -> Result<(), EstimateError> {
        let _ = state;
        Ok(())
    }
}

/// Bayesian estimator of a pose (paper Eq. 6).
pub trait Estimator<P: Manifold>: Send
where
    DefaultAllocator: Alloc<P::D>,
{
    /// Advances the belief by `dt`, which may vary from call to call.
    ///
    /// # Errors
    /// When numbers stop being finite.
    fn predict(&mut self, dt: Seconds) -> Result<(), EstimateError>;

    /// Takes in one measurement.
    ///
    /// # Errors
    /// When numbers are not finite or all hypotheses are impossible; the belief is then unchanged.
    fn correct(&mut self, z: &dyn Measurement<P>) -> Result<Innovation, EstimateError>;

    /// The pose with its covariance.
    fn pose(&self) -> Gaussian<P>;

    /// Starts again from this prior, at rest.
    ///
    /// # Errors
    /// When the prior is not finite or not positive semi-definite.
    fn reset(&mut self, prior: &Gaussian<P>) -> Result<(), EstimateError>;

    /// Hypotheses with normalised weights, for estimators that have them.
    fn particles(&self) -> Option<(&[P], &[f64])> {
        None
    }
}

/// Costs of giving detections to targets, by rows of targets; infinite where gated out.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Costs {
    /// Number of targets.
    pub targets: usize,
    /// Number of detections.
    pub detections: usize,
    /// `targets × detections` negative log-likelihoods.
    pub pair: Vec<f64>,
    /// Cost of leaving each target without a detection.
    pub miss: Vec<f64>,
}

/// Weight of each detection for each target: hard associators give 0 and 1, soft ones probabilities.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Association {
    /// `targets × detections` weights; a row's sum may be below 1, the rest is "no detection".
    pub weights: Vec<f64>,
}

/// Gated costs → hard pairs or soft weights (paper §2).
pub trait Associator: Send {
    /// Associates; replaces the content of `out`.
    fn associate(&mut self, costs: &Costs, out: &mut Association);
}

/// Judges from the figures of a step whether the target is lost (paper §2, §6).
pub trait LossDetector: Send {
    /// Judges one step, with the memory of the steps before.
    fn assess(&mut self, figures: &Assessment) -> Verdict;

    /// Forgets the past, after a re-initialisation.
    fn reset(&mut self);
}

/// Proposes where a lost target may be (paper §2, §6).
pub trait Reinitializer<P: Manifold>: Send
where
    DefaultAllocator: Alloc<P::D>,
{
    /// Evidence that must be prepared before `propose`.
    fn needs(&self) -> &[EvidenceKey] {
        &[]
    }

    /// Learns what the target looks like at `posterior`, in steps whose estimate is trusted, as
    /// [`Modality::adapt`](crate::measurement::Modality::adapt); evidence that others asked for may be there.
    ///
    /// # Errors
    /// When the frame does not fit.
    fn adapt(&mut self, evidence: &Evidence, posterior: &Gaussian<P>) -> Result<(), MeasureError> {
        let _ = (evidence, posterior);
        Ok(())
    }

    /// Forgets what it learnt: the target is placed anew.
    fn forget(&mut self) {}

    /// Appends priors to try, best first. `last` is the last belief that was trusted.
    ///
    /// # Errors
    /// When the evidence does not fit.
    fn propose(
        &mut self,
        evidence: &Evidence,
        last: &Gaussian<P>,
        out: &mut Vec<Gaussian<P>>,
    ) -> Result<(), MeasureError>;
}

/// Delivers frames in order of time.
pub trait Sensor: Send {
    /// The next frame; `None` at the end.
    ///
    /// # Errors
    /// When a file or device fails; the message names it.
    fn next(&mut self) -> Result<Option<Frame>, DeviceError>;

    /// Number of frames to come, where it is known.
    fn remaining(&self) -> Option<usize> {
        None
    }
}

/// One step as outputs see it.
pub struct Step<'a> {
    /// Frames and evidence.
    pub evidence: &'a Evidence,
    /// One report a target.
    pub reports: &'a [StepReport],
    /// Appends the marks of the target with this index.
    pub sketch: &'a dyn Fn(usize, &mut Vec<Mark>),
}

/// Takes results (paper Fig. 1, "output"); may stop the run.
pub trait Output: Send {
    /// Takes one step.
    ///
    /// # Errors
    /// When it cannot be written.
    fn step(&mut self, step: &Step<'_>) -> Result<ControlFlow<()>, DeviceError>;

    /// Completes the output, also after an interruption.
    ///
    /// # Errors
    /// When it cannot be written.
    fn finish(&mut self) -> Result<(), DeviceError> {
        Ok(())
    }
}
