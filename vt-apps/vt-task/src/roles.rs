//! The roles for which a task chooses methods (classes of the paper's Fig. 2), with what each builds and from what.
//!
//! Roles that know poses are generic over the pose space; [`crate::registry::Method`]s are registered once for each
//! space they are made for.

use core::marker::PhantomData;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use nalgebra::DefaultAllocator;
use vt_core::agent::{Output, Sensor};
use vt_core::belief::Gaussian;
use vt_core::frame::SensorId;
use vt_core::manifold::{Alloc, Coordinates};
use vt_io::report::Header;
use vt_io::summary::Summary;
use vt_io::truth::Truth;
use vt_models::mesh::Shape;

use crate::language::{FilePath, SensorSection};
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
    Shapes, "shape", "shape", Shape, Place<'a>;
    /// What a model's surface looks like.
    Appearances, "appearance", "appearance", AppearanceProduct, Place<'a>;
    /// True poses of a target.
    Truths, "truth", "truth", Truth, TruthContext<'a>;
    /// How measurements are given to targets.
    Association, "association", "association", AssociationProduct, ();
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
    /// Prior of the first frame.
    Inits, "init", "init", Gaussian<P>, InitContext<'a>;
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
    /// Shapes of the task's models, for simulation.
    pub shapes: &'a BTreeMap<String, Shape>,
}

/// A sensor, and the true poses that only a simulated one knows.
pub struct SensorProduct {
    /// The sensor.
    pub sensor: Box<dyn Sensor>,
    /// True poses of the model with this name.
    pub truth: Option<(String, Truth)>,
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

/// What true poses are built from.
#[derive(Clone, Copy)]
pub struct TruthContext<'a> {
    /// For files.
    pub place: Place<'a>,
    /// Truth of the simulated sensors by name, each with the model that it shows.
    pub simulated: &'a BTreeMap<String, (String, Truth)>,
}

/// What a prior is built from.
#[derive(Clone, Copy)]
pub struct InitContext<'a> {
    /// For files.
    pub place: Place<'a>,
    /// True poses of the target.
    pub truth: Option<&'a Truth>,
    /// Number of the first frame.
    pub first_frame: u64,
}

/// What an output is built from.
#[derive(Clone, Copy)]
pub struct OutputContext<'a> {
    /// Folder for results.
    pub folder: &'a Path,
    /// Names of the targets in order.
    pub targets: &'a [String],
    /// Sensors by name.
    pub sensors: &'a [SensorSection],
    /// Heading of reports.
    pub header: &'a Header,
    /// An empty summary with the truth of the targets.
    pub summary: &'a Summary,
}
