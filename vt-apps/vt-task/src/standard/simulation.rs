//! The simulated camera, and a model made in code.

use std::sync::Arc;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use vt_core::error::ConfigError;
use vt_core::lie::LieGroup;
use vt_core::lie::SE3;
use vt_io::truth::Truth;
use vt_models::mesh::Shape;
use vt_sim::backdrop::{self, Background};
use vt_sim::bracket::bracket as bracket_mesh;
use vt_sim::camera::{Settings, SimulatedCamera};
use vt_sim::light::Lighting;
use vt_sim::noise::Noise;
use vt_sim::path::SmoothPath;
use vt_sim::scene::{Body, Object, World};
use vt_sim::texture::Texture;

use crate::geometry::PoseText;
use crate::language::Picture;
use crate::quantity::{Angle, Length, Pixels, Rate, Span};
use crate::registry::{Params, Reference, Referent};
use crate::roles::{Place, SensorContext, SensorProduct};

/// Parameters of the sensor `simulated`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Simulated {
    /// Name of the model that is shown.
    pub model: String,
    /// Number of frames.
    pub frames: u64,
    /// Frames per second.
    pub rate: Rate,
    /// Standard deviation of the sensor's noise in grey levels of 255.
    #[serde(default = "two")]
    pub noise: f64,
    /// Motion.
    pub path: PathParams,
    /// Surface of the model.
    #[serde(default)]
    pub texture: TextureParams,
    /// Background.
    #[serde(default)]
    pub background: BackgroundParams,
}

fn two() -> f64 {
    2.0
}

/// Motion: a start pose, and sines of all six coordinates about it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PathParams {
    /// Pose of the first frame, camera_from_object.
    pub start: PoseText,
    /// Amplitudes along the camera's axes.
    pub translation: [Length; 3],
    /// Amplitudes about the object's axes.
    pub rotation: [Angle; 3],
    /// Period of the first coordinate.
    pub period: Span,
}

/// Surface of a simulated model.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", content = "params", rename_all = "kebab-case", deny_unknown_fields)]
pub enum TextureParams {
    /// One reflectance everywhere.
    Plain(Plain),
    /// A random reflectance for each face.
    #[default]
    Faces,
    /// Squares of random reflectance.
    Squares(Squares),
}

/// One brightness.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Plain {
    /// 0 to 1.
    pub brightness: f32,
}

/// Squares of random reflectance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Squares {
    /// Edge length of a square.
    pub size: Length,
    /// Range of reflectance, 0 to 1.
    pub contrast: f32,
}

/// Background of a simulated scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", content = "params", rename_all = "kebab-case", deny_unknown_fields)]
pub enum BackgroundParams {
    /// One brightness everywhere.
    Plain(Plain),
    /// Random rectangles before random brightness.
    Clutter(Clutter),
}

/// Random rectangles before random brightness.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Clutter {
    /// Size of the rectangles.
    pub size: Pixels,
    /// Mean brightness, 0 to 1.
    pub brightness: f32,
    /// Range of brightness, 0 to 1.
    pub contrast: f32,
}

impl Default for BackgroundParams {
    fn default() -> Self {
        Self::Plain(Plain { brightness: 0.2 })
    }
}

fn share(key: &'static str, v: f32) -> Result<(), ConfigError> {
    if (0.0..=1.0).contains(&v) {
        Ok(())
    } else {
        Err(ConfigError::parameter(key, v, "a number from 0 to 1"))
    }
}

impl Params for Simulated {
    fn check(&self) -> Result<(), ConfigError> {
        if self.frames == 0 {
            return Err(ConfigError::parameter("frames", 0, "at least 1 frame"));
        }
        if self.rate.si() <= 0.0 {
            return Err(ConfigError::parameter("rate", self.rate, "a positive rate"));
        }
        if self.noise < 0.0 {
            return Err(ConfigError::parameter("noise", self.noise, "zero or a positive deviation"));
        }
        if self.path.period.si() <= 0.0 {
            return Err(ConfigError::parameter("path.period", self.path.period, "a positive span of time"));
        }
        self.path.start.pose()?;
        match self.texture {
            TextureParams::Plain(p) => share("texture.params.brightness", p.brightness)?,
            TextureParams::Squares(s) if s.size.si() <= 0.0 => {
                return Err(ConfigError::parameter("texture.params.size", s.size, "a positive length"));
            }
            TextureParams::Squares(s) => share("texture.params.contrast", s.contrast)?,
            TextureParams::Faces => {}
        }
        match self.background {
            BackgroundParams::Plain(p) => share("background.params.brightness", p.brightness),
            BackgroundParams::Clutter(c) if c.size.si() < 2.0 => {
                Err(ConfigError::parameter("background.params.size", c.size, "at least 2 px"))
            }
            BackgroundParams::Clutter(c) => {
                share("background.params.brightness", c.brightness)?;
                share("background.params.contrast", c.contrast)
            }
        }
    }

    fn names(&self) -> Vec<Reference> {
        vec![Reference { key: "model", to: Referent::Model, name: self.model.clone() }]
    }
}

/// Builds the sensor `simulated`.
pub(super) fn simulated(p: Simulated, context: SensorContext<'_>) -> Result<SensorProduct, ConfigError> {
    let mismatch = |found: String, expected: &str| ConfigError::Mismatch { found, expected: expected.into() };
    let camera = context.camera.ok_or_else(|| {
        mismatch("a simulated sensor without `camera`".into(), "a `camera` section, since it draws with it")
    })?;
    let shape =
        context.shapes.get(&p.model).ok_or_else(|| mismatch(format!("model `{}`", p.model), "a model"))?;
    let mesh = shape.flatten().map_err(|e| mismatch(e.to_string(), "a shape with surfaces"))?;
    let path = SmoothPath {
        start: p.path.start.pose()?,
        translation: p.path.translation.map(|v| v.si()),
        rotation: p.path.rotation.map(|v| v.si()),
        period: p.path.period.si(),
    };
    let texture = match p.texture {
        TextureParams::Plain(p) => Texture::Plain(p.brightness),
        TextureParams::Faces => Texture::Faces { from: 0.35, to: 0.85 },
        TextureParams::Squares(s) => Texture::Squares { size: s.size.si(), contrast: s.contrast },
    };
    let background = match p.background {
        BackgroundParams::Plain(p) => Background::Plain(p.brightness),
        BackgroundParams::Clutter(c) => {
            let (size, brightness, contrast) = (c.size.si(), c.brightness, c.contrast);
            Background::Clutter(backdrop::Clutter { size, density: 0.35, brightness, contrast })
        }
    };
    let body = Body::new(mesh, texture, context.seed);
    let object = Object { name: p.model.clone(), body, path: path.into() };
    let (objects, lighting, seed) = (vec![object], Lighting::default(), context.seed);
    let world = World { objects, lighting, background, seed };
    let settings = Settings {
        frames: p.frames,
        rate: p.rate.si(),
        noise: Noise { gaussian: p.noise, ..Noise::default() },
        colour: context.section.picture == Picture::Colour,
        seed: context.seed,
        ..Settings::default()
    };
    let sensor = SimulatedCamera::new(context.id, Arc::new(world), *camera, SE3::identity(), settings);
    let truth = Truth(sensor.truth(0));
    Ok(SensorProduct { sensor: Box::new(sensor), truth: Some((p.model, truth)) })
}

/// Parameters of the shape `bracket`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Bracket {
    /// Edge length of one of the three cubic cells.
    pub cell: Length,
}

impl Params for Bracket {
    fn check(&self) -> Result<(), ConfigError> {
        if self.cell.si() <= 0.0 {
            return Err(ConfigError::parameter("cell", self.cell, "a positive length"));
        }
        Ok(())
    }
}

/// Builds the shape `bracket`.
pub(super) fn bracket(p: Bracket, _: Place<'_>) -> Result<Shape, ConfigError> {
    p.check()?;
    let origin = SE3::new(nalgebra::UnitQuaternion::identity(), nalgebra::Vector3::zeros());
    Ok(Shape::default().with("bracket", bracket_mesh(p.cell.si()), origin))
}
