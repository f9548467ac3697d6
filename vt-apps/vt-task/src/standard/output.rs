//! Outputs.

use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use vt_core::agent::Output;
use vt_core::error::{ConfigError, DeviceError};
use vt_core::frame::SensorId;
use vt_io::boxes::{Form, PlanarFile};
use vt_io::covariances::Covariances;
use vt_io::gif::{Gif, GifSettings};
use vt_io::overlay::{Drawing, Overlays, Projector, Settings};
use vt_io::poses::Poses;
use vt_io::report::Report;
use vt_io::run_plot::{Plotted, RunPlot};
use vt_io::steps::Steps;

use crate::quantity::Span;
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
        sensor_name(self.sensor.as_ref())
    }
}

/// Parameters of the output `gif`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct GifParams {
    /// Name of the sensor whose pictures are drawn on; the first when absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sensor: Option<String>,
    /// Every how many steps a frame is added.
    pub every: u64,
    /// Size of a frame as a share of the picture's, from 0.01 to 1.
    pub scale: f64,
    /// How long a frame is shown; players know hundredths of a second.
    pub delay: Span,
    /// Size of the file in megabytes from which on no frame is added.
    pub max_megabytes: f64,
    /// Whether search lines are drawn.
    pub search: bool,
}

impl Default for GifParams {
    fn default() -> Self {
        let GifSettings { every, scale, delay, max_bytes } = GifSettings::default();
        // A finite number of a known unit always is a quantity.
        let delay = Span::new(1e3 * delay, "ms").unwrap_or_default();
        Self { sensor: None, every, scale, delay, max_megabytes: 1e-6 * max_bytes as f64, search: false }
    }
}

impl Params for GifParams {
    fn check(&self) -> Result<(), ConfigError> {
        if self.every == 0 {
            return Err(ConfigError::parameter("every", 0, "a number of steps from 1"));
        }
        if !(0.01..=1.0).contains(&self.scale) {
            return Err(ConfigError::parameter("scale", self.scale, "a share from 0.01 to 1"));
        }
        if !(0.01..=600.0).contains(&self.delay.si()) {
            return Err(ConfigError::parameter("delay", self.delay, "10 ms to 600 s"));
        }
        if !(self.max_megabytes > 0.0 && self.max_megabytes <= 1e6) {
            return Err(ConfigError::parameter("max_megabytes", self.max_megabytes, "above 0, up to 1e6"));
        }
        Ok(())
    }
    fn names(&self) -> Vec<Reference> {
        sensor_name(self.sensor.as_ref())
    }
}

fn sensor_name(sensor: Option<&String>) -> Vec<Reference> {
    let reference = |s: &String| Reference { key: "sensor", to: Referent::Sensor, name: s.clone() };
    sensor.map(reference).into_iter().collect()
}

/// The sensor of this name, or the first, and how it projects where it is calibrated.
fn sensor(name: Option<&String>, c: &OutputContext<'_>) -> (SensorId, Option<Projector>) {
    let index = c.sensors.iter().position(|s| name.is_none_or(|n| *n == s.name)).unwrap_or(0);
    let camera = c.cameras.get(index).copied().flatten();
    let project = camera.map(|camera| Box::new(move |p: &Point3<f64>| camera.project(p)) as Projector);
    (SensorId(index as u32), project)
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
    let settings = Settings { every: p.every, search: p.search, sheet: p.sheet };
    let (sensor, project) = sensor(p.sensor.as_ref(), &c);
    Ok(Box::new(Overlays::create(c.folder, sensor, project, settings).map_err(failed)?))
}

pub(super) fn gif(p: GifParams, c: OutputContext<'_>) -> Built {
    let (sensor, project) = sensor(p.sensor.as_ref(), &c);
    let settings = GifSettings {
        every: p.every,
        scale: p.scale,
        delay: p.delay.si(),
        max_bytes: (1e6 * p.max_megabytes) as u64,
    };
    let drawing = Drawing::new(sensor, project, p.search);
    Ok(Box::new(Gif::create(c.folder, drawing, settings).map_err(failed)?))
}

pub(super) fn plot(_: NoParams, c: OutputContext<'_>) -> Built {
    let targets = c.summary.targets.iter().zip(c.bounds);
    let targets = targets.map(|(t, bounds)| Plotted {
        name: t.name.clone(),
        truth: t.truth().cloned(),
        bounds: *bounds,
    });
    Ok(Box::new(RunPlot::create(c.folder, targets.collect()).map_err(failed)?))
}

/// One line a frame for flat targets.
fn planar(form: Form, c: &OutputContext<'_>) -> Built {
    if c.bounds.iter().all(Option::is_none) {
        return Err(ConfigError::Mismatch {
            found: "no flat target".into(),
            expected: "a target whose model has a flat shape".into(),
        });
    }
    Ok(Box::new(PlanarFile::create(c.folder, form, c.targets, c.bounds).map_err(failed)?))
}

pub(super) fn boxes(_: NoParams, c: OutputContext<'_>) -> Built {
    planar(Form::Boxes, &c)
}

pub(super) fn corners(_: NoParams, c: OutputContext<'_>) -> Built {
    planar(Form::Corners, &c)
}
