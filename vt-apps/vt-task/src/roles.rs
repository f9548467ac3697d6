//! The roles for which a task chooses methods (classes of the paper's Fig. 2), with what each builds and from what.
//!
//! Roles that know poses are generic over the pose space; [`crate::registry::Method`]s are registered once for each
//! space they are made for.

use core::marker::PhantomData;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use nalgebra::{DefaultAllocator, DimAdd, DimSum};
use vt_core::agent::{Estimator, LossDetector, Output, Reinitializer, Sensor};
use vt_core::belief::Gaussian;
use vt_core::error::ConfigError;
use vt_core::evidence::Processing;
use vt_core::frame::{Frame, SensorId};
use vt_core::lie::SE3;
use vt_core::manifold::{Alloc, Coordinates, Manifold};
use vt_core::measurement::Modality;
use vt_io::boxes::Bounds;
use vt_io::report::Header;
use vt_io::summary::Summary;
use vt_io::truth::Truth;
use vt_models::camera::Camera;
use vt_sim::scene::World;

pub use crate::products::{
    AppearanceProduct, AssociationProduct, Chosen, Deviations, Freedom, FusionProduct, Ground, Motion,
    StateAlloc, TrackRule,
};

use crate::language::{FilePath, Level, Picture, SensorSection};
use crate::registry::Role;

/// Declares a role whose methods do not know poses.
macro_rules! plain_roles {
    ($($(#[$doc:meta])* $role:ident, $name:literal, $key:literal, $product:ty, $context:ty;)+) => {$(
        $(#[$doc])*
        pub struct $role;
        impl Role for $role {
            const NAME: &'static str = $name;
            const KEY: &'static str = $key;
            type Product = $product;
            type Context<'a> = $context;
        }
    )+};
}

plain_roles! {
    /// Where frames come from.
    Sensors, "sensor", "sensor", SensorProduct, SensorContext<'a>;
    /// Ground shape of a model.
    Shapes, "shape", "shape", Ground, Place<'a>;
    /// What a model's surface looks like.
    Appearances, "appearance", "appearance", AppearanceProduct, Place<'a>;
    /// True poses of a target.
    Truths, "truth", "truth", Truth, TruthContext<'a>;
    /// How measurements are given to targets.
    Association, "association", "association", AssociationProduct, ();
    /// How several measurements of a target become one.
    Fusions, "fusion", "fusion", FusionProduct, ();
    /// How loss is noticed.
    Losses, "loss detector", "loss", Box<dyn LossDetector>, ();
    /// What is written.
    Outputs, "output", "output", Box<dyn Output>, OutputContext<'a>;
}

/// Declares a role whose methods are made for a pose space `P`.
macro_rules! pose_roles {
    ($($(#[$doc:meta])* $role:ident, $name:literal, $key:literal, $product:ty, $context:ty;)+) => {$(
        $(#[$doc])*
        pub struct $role<P>(PhantomData<fn() -> P>);
        impl<P: Coordinates> Role for $role<P>
        where
            DefaultAllocator: Alloc<P::D>,
        {
            const NAME: &'static str = $name;
            const KEY: &'static str = $key;
            const SPACE: Option<&'static str> = Some(P::SPACE);
            type Product = $product;
            type Context<'a> = $context;
        }
    )+};
}

pose_roles! {
    /// Pose space and projection.
    Warps, "warp", "warp", Freedom, ();
    /// Prior of the first frame.
    Inits, "init", "init", Start<P>, InitContext<'a>;
    /// What is measured.
    Modalities, "modality", "modality", ModalityProduct<P>, ModalityContext<'a>;
    /// What is tried after a loss.
    Reinits, "re-initialiser", "reinit", ReinitProduct<P>, ReinitContext<'a, P>;
}

/// Motion model.
pub struct Motions<P>(PhantomData<fn() -> P>);

impl<P: Coordinates> Role for Motions<P>
where
    P::D: DimAdd<P::D>,
    DimSum<P::D, P::D>: DimAdd<P::D>,
    DefaultAllocator: StateAlloc<P::D>,
{
    const NAME: &'static str = "dynamics";
    const KEY: &'static str = "dynamics";
    const SPACE: Option<&'static str> = Some(P::SPACE);
    type Product = Motion<P>;
    type Context<'a> = &'a Freedom;
}

/// The filter.
pub struct Estimators<P>(PhantomData<fn() -> P>);

impl<P: Coordinates> Role for Estimators<P>
where
    P::D: DimAdd<P::D>,
    DimSum<P::D, P::D>: DimAdd<P::D>,
    DefaultAllocator: StateAlloc<P::D>,
{
    const NAME: &'static str = "estimator";
    const KEY: &'static str = "estimator";
    const SPACE: Option<&'static str> = Some(P::SPACE);
    type Product = Box<dyn Estimator<P>>;
    type Context<'a> = EstimatorContext<P>;
}

/// What an estimator is built from.
pub struct EstimatorContext<P: Manifold>
where
    P::D: DimAdd<P::D>,
    DimSum<P::D, P::D>: DimAdd<P::D>,
    DefaultAllocator: StateAlloc<P::D>,
{
    /// Motion model of the target's model.
    pub motion: Motion<P>,
    /// Prior of the first frame.
    pub prior: Gaussian<P>,
    /// Seed of the run.
    pub seed: u64,
    /// Number of the target, which keeps the random numbers of targets apart.
    pub target: u64,
}

/// A modality with the processing units that it asks for.
pub struct ModalityProduct<P: Manifold>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// The modality.
    pub modality: Box<dyn Modality<P>>,
    /// Units that make the evidence it needs; equal ones of several modalities run once.
    pub processing: Vec<Box<dyn Processing>>,
}

/// What a modality is built from.
#[derive(Clone, Copy)]
pub struct ModalityContext<'a> {
    /// For files.
    pub place: Place<'a>,
    /// Number of its sensor.
    pub sensor: SensorId,
    /// Intrinsic parameters of its sensor, where it is calibrated.
    pub camera: Option<&'a Camera>,
    /// Payload of its sensor.
    pub picture: Picture,
    /// Level at which it is to measure.
    pub level: Level,
    /// Shape of the target's model.
    pub shape: &'a Ground,
    /// Appearance of the target's model.
    pub appearance: &'a AppearanceProduct,
    /// Free and locked degrees of freedom.
    pub freedom: &'a Freedom,
}

/// Where files named in a task are looked for.
#[derive(Clone, Copy, Debug)]
pub struct Place<'a> {
    /// Folder that relative paths start from.
    pub base: &'a Path,
}

impl Place<'_> {
    /// The path of a file of the task.
    pub fn resolve(&self, file: &FilePath) -> PathBuf {
        self.base.join(&file.0)
    }
}

/// What a sensor is built from.
pub struct SensorContext<'a> {
    /// For its files.
    pub place: Place<'a>,
    /// Its number in the run.
    pub id: SensorId,
    /// Its section of the task.
    pub section: &'a SensorSection,
    /// Seed of the run.
    pub seed: u64,
    /// Its camera, where it is calibrated.
    pub camera: Option<&'a Camera>,
    /// Shapes of the task's models, for simulation.
    pub shapes: &'a BTreeMap<String, Ground>,
    /// Simulated sensors before this one, by name.
    pub simulated: &'a BTreeMap<String, Simulation>,
}

/// A sensor, and the true poses that only a simulated one knows.
pub struct SensorProduct {
    /// The sensor.
    pub sensor: Box<dyn Sensor>,
    /// What a simulated one knows besides its frames.
    pub truth: Option<Simulation>,
}

/// What a simulated sensor knows besides its frames.
#[derive(Clone)]
pub struct Simulation {
    /// What it sees, if that are bodies in space.
    pub world: Option<Arc<World>>,
    /// What is true of the objects, by the objects' names, in the order of the task.
    pub truths: Vec<(String, Truth)>,
}

/// What true poses are built from.
#[derive(Clone, Copy)]
pub struct TruthContext<'a> {
    /// For files.
    pub place: Place<'a>,
    /// Simulated sensors by name.
    pub simulated: &'a BTreeMap<String, Simulation>,
}

/// Where a target starts.
pub struct Start<P: Manifold>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// Prior of the first frame.
    pub prior: Gaussian<P>,
    /// False when the prior says nothing: the target begins as lost.
    pub known: bool,
}

impl<P: Manifold> From<Gaussian<P>> for Start<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    fn from(prior: Gaussian<P>) -> Self {
        Self { prior, known: true }
    }
}

/// A re-initialiser with the processing units that it asks for.
pub struct ReinitProduct<P: Manifold>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// The re-initialiser; none where a lost target coasts.
    pub reinitializer: Option<Box<dyn Reinitializer<P>>>,
    /// Units that make the evidence it needs.
    pub processing: Vec<Box<dyn Processing>>,
}

impl<P: Manifold> ReinitProduct<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// A re-initialiser that needs no evidence but frames.
    pub fn of_frames(reinitializer: impl Reinitializer<P> + 'static) -> Self {
        Self { reinitializer: Some(Box::new(reinitializer)), processing: vec![] }
    }

    /// A lost target coasts.
    pub fn none() -> Self {
        Self { reinitializer: None, processing: vec![] }
    }
}

/// What a re-initialiser is built from.
pub struct ReinitContext<'a, P: Manifold>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// Prior of the first frame; `None` when it said nothing.
    pub prior: Option<&'a Gaussian<P>>,
    /// The body as the target's first sensor sees it.
    pub body: Body<'a>,
    /// Payload of that sensor.
    pub picture: Picture,
    /// The first frames.
    pub frames: &'a [Frame],
}

/// A body and the sensor that sees it.
#[derive(Clone, Copy)]
pub struct Body<'a> {
    /// Number of the sensor.
    pub sensor: SensorId,
    /// Intrinsic parameters of the sensor, where it is calibrated.
    pub camera: Option<&'a Camera>,
    /// Shape of the target's model.
    pub shape: &'a Ground,
    /// Free and locked degrees of freedom.
    pub freedom: &'a Freedom,
}

/// What a prior is built from.
#[derive(Clone, Copy)]
pub struct InitContext<'a> {
    /// The body as the target's first sensor sees it.
    pub body: Body<'a>,
    /// The first frames.
    pub frames: &'a [Frame],
    /// For files.
    pub place: Place<'a>,
    /// True poses of the target.
    pub truth: Option<&'a Truth>,
    /// Number of the first frame.
    pub first_frame: u64,
    /// Free and locked degrees of freedom; locked ones have no uncertainty.
    pub freedom: &'a Freedom,
}

impl InitContext<'_> {
    /// The true pose of the first frame.
    ///
    /// # Errors
    /// [`ConfigError`] when no truth is known, or none of that frame.
    pub fn true_pose(&self) -> Result<SE3, ConfigError> {
        let found = match self.truth {
            None => "a target without `truth`".to_owned(),
            Some(_) => format!("truth without frame {}", self.first_frame),
        };
        self.truth.and_then(|t| t.poses.get(&self.first_frame)).copied().ok_or_else(|| {
            ConfigError::Mismatch {
                found,
                expected: format!("the true pose of frame {}, the first one", self.first_frame),
            }
        })
    }
}

/// What an output is built from.
#[derive(Clone, Copy)]
pub struct OutputContext<'a> {
    /// Folder for results.
    pub folder: &'a Path,
    /// Names of the targets in order.
    pub targets: &'a [String],
    /// Corners of the bounds of the targets that are flat.
    pub bounds: &'a [Bounds],
    /// Sensors in order.
    pub sensors: &'a [SensorSection],
    /// Cameras of the sensors, where they are calibrated.
    pub cameras: &'a [Option<Camera>],
    /// Heading of reports.
    pub header: &'a Header,
    /// An empty summary with the truth of the targets.
    pub summary: &'a Summary,
}
