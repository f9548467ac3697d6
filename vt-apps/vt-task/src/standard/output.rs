//! Outputs.

use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use vt_core::agent::Output;
use vt_core::error::{ConfigError, DeviceError};
use vt_core::frame::SensorId;
use vt_io::covariances::Covariances;
use vt_io::overlay::{Overlays, Projector, Settings};
use vt_io::poses::Poses;
use vt_io::report::Report;
use vt_io::steps::Steps;

use crate::registry::{NoParams, Params, Reference, Referent};
use crate::roles::OutputContext;

type Built = Result<Box<dyn Output>, ConfigError>;

/// Parameters of the outputs `poses` and `covariances`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Estimates {
    /// Whether estimates of lost targets are written too.
    pub lost: bool,
}

impl Params for Estimates {}

/// Parameters of the output `steps`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct StepsParams {
    /// Whether wall-clock times are written too; they differ from run to run.
    pub timings: bool,
}

impl Params for StepsParams {}

/// Parameters of the output `overlays`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct OverlaysParams {
    /// Name of the sensor whose pictures are drawn on; the first when absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sensor: Option<String>,
    /// Every how many steps a picture is written; 0 writes none.
    pub every: u64,
    /// Whether search lines are drawn.
    pub search: bool,
    /// Whether a contact sheet is written at the end.
    pub sheet: bool,
}

impl Default for OverlaysParams {
    fn default() -> Self {
        let Settings { every, search, sheet } = Settings::default();
        Self { sensor: None, every, search, sheet }
    }
}

impl Params for OverlaysParams {
    fn names(&self) -> Vec<Reference> {
        self.sensor
            .iter()
            .map(|s| Reference { key: "sensor", to: Referent::Sensor, name: s.clone() })
            .collect()
    }
}

fn failed(e: DeviceError) -> ConfigError {
    ConfigError::Mismatch { found: e.to_string(), expected: "a folder that can be written".into() }
}

pub(super) fn poses(p: Estimates, c: OutputContext<'_>) -> Built {
    Ok(Box::new(Poses::create(c.folder, c.targets, p.lost).map_err(failed)?))
}

pub(super) fn covariances(p: Estimates, c: OutputContext<'_>) -> Built {
    Ok(Box::new(Covariances::create(c.folder, c.targets, p.lost).map_err(failed)?))
}

pub(super) fn steps(p: StepsParams, c: OutputContext<'_>) -> Built {
    Ok(Box::new(Steps::create(c.folder, p.timings).map_err(failed)?))
}

pub(super) fn report(_: NoParams, c: OutputContext<'_>) -> Built {
    Ok(Box::new(Report::create(c.folder, c.header.clone(), c.summary.clone()).map_err(failed)?))
}

pub(super) fn overlays(p: OverlaysParams, c: OutputContext<'_>) -> Built {
    let index = c.sensors.iter().position(|s| p.sensor.as_ref().is_none_or(|n| *n == s.name)).unwrap_or(0);
    let settings = Settings { every: p.every, search: p.search, sheet: p.sheet };
    let camera = c.cameras.get(index).copied().flatten();
    let project = camera.map(|camera| Box::new(move |p: &Point3<f64>| camera.project(p)) as Projector);
    Ok(Box::new(Overlays::new(c.folder, SensorId(index as u32), project, settings)))
}
