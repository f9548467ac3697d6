//! The sensor `planar-scene`: a flat model that wanders over a background.

use nalgebra::Vector4;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use vt_core::error::ConfigError;
use vt_core::lie::Sim2;
use vt_sim::noise::Noise;
use vt_sim::planar::PlanarScene;

use super::planar::PlanarPose;
use super::scene::{BackgroundParams, within};
use crate::language::{FilePath, Picture};
use crate::quantity::{Angle, Pixels, Rate, Share};
use crate::registry::{Params, Reference, Referent};
use crate::roles::{SensorContext, SensorProduct};

/// Parameters of the sensor `planar-scene`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlanarSceneParams {
    /// Name of the model that is shown; its shape must be flat.
    pub model: String,
    /// Width and height of the picture, pixels.
    pub size: [u32; 2],
    /// Colours of the model, red, green and blue from 0 to 1, by rows of equal cells.
    pub colours: Vec<[f32; 3]>,
    /// Cells in a row.
    #[serde(default = "one")]
    pub columns: u32,
    /// Pose of the first frame.
    pub start: PlanarPose,
    /// Deviations of its steps.
    pub step: Step,
    /// The model's origin stays so far from the picture's border.
    pub margin: Pixels,
    /// Background.
    #[serde(default)]
    pub background: BackgroundParams,
    /// Number of frames.
    pub frames: u64,
    /// Frames per second.
    pub rate: Rate,
    /// First and last number of runs of frames in which the model is hidden.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub hidden: Vec<[u64; 2]>,
    /// Standard deviation of Gaussian noise in grey levels of 255.
    #[serde(default = "two")]
    pub noise: f64,
}

fn one() -> u32 {
    1
}

fn two() -> f64 {
    2.0
}

/// Deviations of a step from frame to frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Step {
    /// Of each coordinate of the position.
    pub translation: Pixels,
    /// Of the orientation.
    pub rotation: Angle,
    /// Of the scale.
    pub scale: Share,
}

/// Largest side of a picture.
const MOST_PIXELS: u32 = 8192;

/// Most frames.
const MOST_FRAMES: u64 = 1_000_000;

impl Params for PlanarSceneParams {
    fn check(&self) -> Result<(), ConfigError> {
        if let Some(side) = self.size.iter().find(|n| !(1..=MOST_PIXELS).contains(*n)) {
            return Err(ConfigError::parameter("size", side, format!("1 to {MOST_PIXELS} pixels")));
        }
        if self.colours.is_empty() || self.colours.iter().flatten().any(|c| !(0.0..=1.0).contains(c)) {
            let found = format!("{:?}", self.colours);
            return Err(ConfigError::parameter(
                "colours",
                found,
                "at least one colour of numbers from 0 to 1",
            ));
        }
        if self.columns == 0 || !self.colours.len().is_multiple_of(self.columns as usize) {
            let expected = format!("a divisor of the number of colours, {}", self.colours.len());
            return Err(ConfigError::parameter("columns", self.columns, expected));
        }
        let scale = self.start.scale;
        if !(scale > 0.0 && scale.is_finite()) {
            return Err(ConfigError::parameter("start.scale", scale, "a positive number"));
        }
        let steps = [self.step.translation.si(), self.step.rotation.si(), self.step.scale.si()];
        if let Some(step) = steps.iter().find(|s| **s < 0.0) {
            return Err(ConfigError::parameter("step", step, "deviations from 0"));
        }
        if self.margin.si() < 0.0 {
            return Err(ConfigError::parameter("margin", self.margin, "a distance from 0"));
        }
        if !(1..=MOST_FRAMES).contains(&self.frames) {
            return Err(ConfigError::parameter("frames", self.frames, format!("1 to {MOST_FRAMES} frames")));
        }
        if !(1e-6..=1e6).contains(&self.rate.si()) {
            return Err(ConfigError::parameter("rate", self.rate, "a positive rate from 1e-6 Hz to 1 MHz"));
        }
        if let Some(run) = self.hidden.iter().find(|[first, last]| first > last) {
            return Err(ConfigError::parameter(
                "hidden",
                format!("{run:?}"),
                "a first and a later last frame",
            ));
        }
        within("noise", self.noise, 0.0, 255.0)?;
        self.background.check()
    }

    fn files(&self) -> Vec<(String, FilePath)> {
        self.background.file().map(|f| ("background.params.file".to_owned(), f.clone())).into_iter().collect()
    }

    fn names(&self) -> Vec<Reference> {
        vec![Reference { key: "model", to: Referent::Model, name: self.model.clone() }]
    }
}

pub(super) fn scene(p: PlanarSceneParams, context: SensorContext<'_>) -> Result<SensorProduct, ConfigError> {
    let shape = context.shapes.get(&p.model).ok_or_else(|| ConfigError::Mismatch {
        found: format!("model `{}`", p.model),
        expected: "a model of the task".into(),
    })?;
    let PlanarPose { translation: [x, y], rotation, scale } = p.start;
    let shift = p.step.translation.si();
    let scene = PlanarScene {
        loops: shape.outline()?.loops().to_vec(),
        colours: p.colours,
        columns: p.columns,
        start: Sim2::new(x.si(), y.si(), rotation.si(), scale),
        step: Vector4::new(shift, shift, p.step.rotation.si(), p.step.scale.si()),
        margin: p.margin.si(),
        background: p.background.background(context.place)?,
        size: p.size,
        frames: p.frames,
        rate: p.rate.si(),
        hidden: p.hidden.iter().map(|&[first, last]| first..last.saturating_add(1)).collect(),
        noise: Noise { gaussian: p.noise, ..Noise::default() },
        colour: context.section.picture == Picture::Colour,
        seed: context.seed,
    };
    Ok(SensorProduct { sensor: Box::new(scene.sensor(context.id)), truth: None })
}
