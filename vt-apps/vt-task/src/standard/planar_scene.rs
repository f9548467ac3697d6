//! The simulated scene of planar targets as a sensor.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use vt_core::error::ConfigError;
use vt_io::truth::Truth;
use vt_sim::noise::Noise;
use vt_sim::planar::{Fill, PlanarCamera, Settings, Walk};

use crate::language::Picture;
use crate::quantity::{Angle, Pixels, Rate};
use crate::registry::{Params, Reference, Referent};
use crate::roles::{SensorContext, SensorProduct, Simulation};

/// Parameters of the sensor `simulated-planar`. With `picture = "colour"` the background has weak colours.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Planar {
    /// Name of the model that is shown: a flat shape in pixels, about its origin.
    pub model: String,
    /// Columns and rows.
    #[serde(default = "size")]
    pub size: [u32; 2],
    /// Number of frames.
    pub frames: u64,
    /// Frames per second.
    pub rate: Rate,
    /// Deviation of a step of the position from frame to frame.
    #[serde(default)]
    pub translation: Pixels,
    /// Deviation of a step of the angle.
    #[serde(default)]
    pub rotation: Angle,
    /// Deviation of a step of the scale's logarithm.
    #[serde(default)]
    pub scale: f64,
    /// Number of strong colours of the shape; without it one grey level.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub colours: Option<u32>,
    /// Least difference of a grey shape to the background, in levels of 255.
    #[serde(default = "contrast")]
    pub contrast: f64,
    /// Edges of the background per pixel of a straight line.
    #[serde(default = "clutter")]
    pub clutter: f64,
    /// First and last number of runs of frames in which the shape is hidden.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub occlusions: Vec<[u64; 2]>,
    /// Standard deviation of Gaussian noise in grey levels of 255.
    #[serde(default = "noise")]
    pub noise: f64,
}

fn size() -> [u32; 2] {
    Settings::default().size
}

fn contrast() -> f64 {
    Settings::default().contrast
}

fn clutter() -> f64 {
    Settings::default().clutter
}

fn noise() -> f64 {
    Noise::default().gaussian
}

impl Params for Planar {
    fn check(&self) -> Result<(), ConfigError> {
        if !(self.noise >= 0.0 && self.noise <= 255.0) {
            return Err(ConfigError::parameter("noise", self.noise, "a deviation from 0 to 255"));
        }
        Ok(())
    }

    fn names(&self) -> Vec<Reference> {
        vec![Reference { key: "model", to: Referent::Model, name: self.model.clone() }]
    }
}

/// Builds the sensor `simulated-planar`.
pub(super) fn planar(p: Planar, context: SensorContext<'_>) -> Result<SensorProduct, ConfigError> {
    let shape = context.shapes.get(&p.model).ok_or_else(|| ConfigError::Mismatch {
        found: format!("model `{}`", p.model),
        expected: "a model of the task".into(),
    })?;
    let settings = Settings {
        size: p.size,
        frames: p.frames,
        rate: p.rate.si(),
        walk: Walk { translation: p.translation.si(), rotation: p.rotation.si(), scale: p.scale },
        fill: p.colours.map_or(Fill::Plain, Fill::Patches),
        contrast: p.contrast,
        clutter: p.clutter,
        occlusions: p.occlusions,
        noise: Noise { gaussian: p.noise, ..Noise::default() },
        colour: context.section.picture == Picture::Colour,
        seed: context.seed,
    };
    let camera = PlanarCamera::new(context.id, shape.outline()?.clone(), settings)?;
    let corners = (0..camera.settings().frames).filter_map(|k| Some((k, camera.corners(k)?)));
    let truths = vec![(p.model, Truth::of_corners(corners.collect()))];
    Ok(SensorProduct { sensor: Box::new(camera), truth: Some(Simulation { world: None, truths }) })
}
