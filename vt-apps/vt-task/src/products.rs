//! What methods of the task language give: motion models, shapes, fusion rules, and how coordinates are free.

use nalgebra::{DefaultAllocator, DimAdd, DimSum};
use vt_core::agent::Dynamics;
use vt_core::batch::Row;
use vt_core::belief::{Accelerating, Moving, Triple};
use vt_core::error::{ConfigError, EstimateError};
use vt_core::manifold::{Alloc, AllocPair, Manifold, Square, Tangent};
use vt_core::time::Seconds;
use vt_fusion::stacked::StaticFusion;
use vt_fusion::tracks::Criterion;
use vt_models::mesh::Shape;
use vt_models::outline::Outline;

use crate::registry::Params;

/// Storage for poses with the coordinates `D`, for states with their velocity, and for those with acceleration, too.
pub trait StateAlloc<D: DimAdd<D>>:
    AllocPair<D, D> + AllocPair<DimSum<D, D>, D> + AllocPair<Triple<D>, D>
where
    DimSum<D, D>: DimAdd<D>,
{
}

impl<D: DimAdd<D>, A> StateAlloc<D> for A
where
    DimSum<D, D>: DimAdd<D>,
    A: AllocPair<D, D> + AllocPair<DimSum<D, D>, D> + AllocPair<Triple<D>, D>,
{
}

/// A motion model of any kind for a state of one of three kinds, with the a-priori deviations of the derivatives.
pub enum Motion<P: Manifold>
where
    P::D: DimAdd<P::D>,
    DimSum<P::D, P::D>: DimAdd<P::D>,
    DefaultAllocator: StateAlloc<P::D>,
{
    /// The state is the pose.
    Pose(Chosen<P>),
    /// The state is the pose with its velocity.
    Moving(Chosen<Moving<P>>, Vec<Tangent<P>>),
    /// The state is the pose with velocity and acceleration.
    Accelerating(Chosen<Accelerating<P>>, Vec<Tangent<P>>),
}

/// The motion model that a task chose, as one that generic filters take: one virtual call a step.
pub struct Chosen<S: Manifold>(pub Box<dyn Dynamics<S>>)
where
    DefaultAllocator: Alloc<S::D>;

impl<S: Manifold> Dynamics<S> for Chosen<S>
where
    DefaultAllocator: Alloc<S::D>,
{
    fn propagate(&self, state: &S, dt: Seconds) -> S {
        self.0.propagate(state, dt)
    }
    fn propagate_each(&self, states: &mut [S], dt: Seconds) {
        self.0.propagate_each(states, dt);
    }
    fn disturb_each(&self, states: &mut [S], dt: Seconds, noise: &[Row]) {
        self.0.disturb_each(states, dt, noise);
    }
    fn jacobian(&self, state: &S, dt: Seconds) -> Square<S> {
        self.0.jacobian(state, dt)
    }
    fn noise(&self, state: &S, dt: Seconds) -> Square<S> {
        self.0.noise(state, dt)
    }
    fn noise_root(&self, state: &S, dt: Seconds) -> Square<S> {
        self.0.noise_root(state, dt)
    }
    fn fits(&self, state: &S) -> Result<(), EstimateError> {
        self.0.fits(state)
    }
}

/// Deviations of each coordinate of a pose space, as parameters give them.
pub trait Deviations<P: Manifold>: Params
where
    DefaultAllocator: Alloc<P::D>,
{
    /// In tangent order; zero for what does not move.
    ///
    /// # Errors
    /// [`ConfigError`] for coordinates that the space does not have.
    fn tangent(&self) -> Result<Tangent<P>, ConfigError>;
}

/// Which degrees of freedom of a pose space are free, in tangent order.
#[derive(Clone, Debug, PartialEq)]
pub struct Freedom(pub Vec<bool>);

impl Freedom {
    /// The value of a coordinate where it is free, zero where it is locked.
    pub fn mask(&self, k: usize, value: f64) -> f64 {
        if self.0.get(k).copied().unwrap_or(true) { value } else { 0.0 }
    }
}

/// How several modalities of a target become one estimate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FusionProduct {
    /// Measurements are fused before the estimator.
    Static(StaticFusion),
    /// Each modality has an estimator of its own, and their tracks are fused.
    Dynamic {
        /// How.
        rule: TrackRule,
        /// Whether a track that is lost starts again at the fused pose.
        feedback: bool,
    },
}

/// How tracks are fused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum TrackRule {
    /// Covariance intersection.
    Intersection(Criterion),
    /// Best linear combination of two tracks.
    BarShalomCampo,
    /// A central filter of what the tracks learn.
    EquivalentMeasurements,
}

/// Ground shape of a model.
#[derive(Clone, Debug)]
pub enum Ground {
    /// A body in space, of one or several rigid parts.
    Body(Shape),
    /// A flat shape in the units of its plane.
    Flat(Outline),
}

impl Ground {
    /// The body in space.
    ///
    /// # Errors
    /// [`ConfigError`] for a flat shape.
    pub fn body(&self) -> Result<&Shape, ConfigError> {
        match self {
            Self::Body(shape) => Ok(shape),
            Self::Flat(_) => {
                let expected = "a body in space, such as `mesh`".into();
                Err(ConfigError::Mismatch { found: "a flat shape".into(), expected })
            }
        }
    }

    /// The flat shape.
    ///
    /// # Errors
    /// [`ConfigError`] for a body in space.
    pub fn outline(&self) -> Result<&Outline, ConfigError> {
        match self {
            Self::Flat(outline) => Ok(outline),
            Self::Body(_) => {
                let expected = "a flat shape, such as `rectangle` or `silhouette`".into();
                Err(ConfigError::Mismatch { found: "a body in space".into(), expected })
            }
        }
    }
}

/// Appearance of a model's surface.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum AppearanceProduct {
    /// Nothing is known of it.
    Unknown,
}

/// How measurements are given to targets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum AssociationProduct {
    /// Each target measures for itself.
    OneToOne,
}
