//! What is true of targets.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use vt_core::error::{ConfigError, DeviceError};
use vt_io::truth::Truth;

use crate::language::FilePath;
use crate::registry::{Params, Reference, Referent};
use crate::roles::TruthContext;

/// Parameters of the truths `tum` and `matrices`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TruthFile {
    /// File or folder.
    pub path: FilePath,
}

impl Params for TruthFile {
    fn files(&self) -> Vec<(String, FilePath)> {
        vec![("path".into(), self.path.clone())]
    }
}

/// Parameters of the truths `boxes` and `corners`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlanarTruthFile {
    /// File with one line a frame.
    pub path: FilePath,
    /// Number of the frame of the first line.
    #[serde(default = "first")]
    pub first: u64,
}

fn first() -> u64 {
    1
}

impl Params for PlanarTruthFile {
    fn files(&self) -> Vec<(String, FilePath)> {
        vec![("path".into(), self.path.clone())]
    }
}

/// Parameters of the truth `simulated`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SimulatedTruth {
    /// Name of the simulated sensor.
    pub sensor: String,
    /// Name of the object; the first one of the scene when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub object: Option<String>,
}

impl Params for SimulatedTruth {
    fn names(&self) -> Vec<Reference> {
        vec![Reference { key: "sensor", to: Referent::Sensor, name: self.sensor.clone() }]
    }
}

fn unreadable(e: DeviceError) -> ConfigError {
    ConfigError::Mismatch { found: e.to_string(), expected: "a readable truth".into() }
}

pub(super) fn tum(p: TruthFile, context: TruthContext<'_>) -> Result<Truth, ConfigError> {
    Truth::read_tum(&context.place.resolve(&p.path)).map_err(unreadable)
}

pub(super) fn matrices(p: TruthFile, context: TruthContext<'_>) -> Result<Truth, ConfigError> {
    Truth::read_matrices(&context.place.resolve(&p.path)).map_err(unreadable)
}

pub(super) fn boxes(p: PlanarTruthFile, context: TruthContext<'_>) -> Result<Truth, ConfigError> {
    Truth::read_boxes(&context.place.resolve(&p.path), p.first).map_err(unreadable)
}

pub(super) fn corners(p: PlanarTruthFile, context: TruthContext<'_>) -> Result<Truth, ConfigError> {
    Truth::read_corners(&context.place.resolve(&p.path), p.first).map_err(unreadable)
}

pub(super) fn simulated(p: SimulatedTruth, context: TruthContext<'_>) -> Result<Truth, ConfigError> {
    let simulation = context.simulated.get(&p.sensor).ok_or_else(|| ConfigError::Mismatch {
        found: format!("sensor `{}`, which knows no truth", p.sensor),
        expected: "a simulated sensor".into(),
    })?;
    let mut truths = simulation.truths.iter();
    let found = truths.find(|(name, _)| p.object.as_ref().is_none_or(|o| o == name));
    found.map(|(_, truth)| truth.clone()).ok_or_else(|| {
        let names: Vec<_> = simulation.truths.iter().map(|(name, _)| format!("`{name}`")).collect();
        let found = format!("`{}`", p.object.unwrap_or_default());
        ConfigError::parameter("object", found, format!("an object of the scene ({})", names.join(", ")))
    })
}
