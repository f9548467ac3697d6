//! The simulated camera as a sensor of a task.

use std::collections::BTreeMap;
use std::sync::Arc;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use vt_core::error::ConfigError;
use vt_io::truth::Truth;
use vt_sim::camera::{Settings, SimulatedCamera};
use vt_sim::noise::Noise;
use vt_sim::scene::{Body, Object, World};

use super::scene::{BackgroundParams, LightParams, PathParams, TextureParams, within};
use crate::geometry::PoseText;
use crate::language::{FilePath, Picture};
use crate::quantity::Rate;
use crate::registry::{Params, Reference, Referent};
use crate::roles::{Ground, Place, SensorContext, SensorProduct, Simulation};

/// Parameters of the sensor `simulated`: either a scene (`model`, `path`, `texture`, `others`, `light`, `background`)
/// or the name of the simulated sensor whose scene it sees too (`scene`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Simulated {
    /// Name of the model that is shown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model: Option<String>,
    /// Its motion.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub path: Option<PathParams>,
    /// Its surface.
    #[serde(default)]
    pub texture: TextureParams,
    /// Further objects, tracked ones and occluders.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub others: Vec<ObjectParams>,
    /// Light.
    #[serde(default)]
    pub light: LightParams,
    /// Background.
    #[serde(default)]
    pub background: BackgroundParams,
    /// Name of the simulated sensor, earlier in the task, whose scene this one sees too.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scene: Option<String>,
    /// Where the camera stands; without it the world is that of the camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera_from_world: Option<PoseText>,
    /// Number of frames.
    pub frames: u64,
    /// Frames per second.
    pub rate: Rate,
    /// Part of the time between frames in which the shutter is open, 0 to 1: motion blur.
    #[serde(default)]
    pub exposure: f64,
    /// Standard deviation of Gaussian noise in grey levels of 255.
    #[serde(default = "two")]
    pub noise: f64,
    /// Shot noise: its variance is this times the grey level.
    #[serde(default)]
    pub photon: f64,
    /// Share of pixels that are black or white at random, 0 to 1.
    #[serde(default)]
    pub salt_and_pepper: f64,
    /// Exponent of the response curve; 1 is linear.
    #[serde(default = "one")]
    pub gamma: f64,
    /// Bits of the converter, 1 to 8.
    #[serde(default = "eight")]
    pub bits: u32,
    /// Frames that do not arrive as they should.
    #[serde(default)]
    pub losses: FrameLosses,
}

/// A further object of a simulated scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ObjectParams {
    /// Name of its model.
    pub model: String,
    /// Name by which its truth is asked for; the model's name when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Its motion.
    pub path: PathParams,
    /// Its surface.
    #[serde(default)]
    pub texture: TextureParams,
}

impl ObjectParams {
    fn name(&self) -> &str {
        self.name.as_ref().unwrap_or(&self.model)
    }
}

/// Frames that do not arrive as they should.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FrameLosses {
    /// Share of frames that never arrive, 0 to 1; the first always does.
    pub dropped: f64,
    /// First and last number of runs of frames that never arrive.
    pub gaps: Vec<[u64; 2]>,
    /// Share of frames that show the picture of the frame before, 0 to 1. Number, time and truth are their own.
    pub duplicated: f64,
}

/// More objects than this are refused.
const MOST_OBJECTS: usize = 64;
/// More frames than this are refused.
const MOST_FRAMES: u64 = 1_000_000;

fn one() -> f64 {
    1.0
}

fn two() -> f64 {
    2.0
}

fn eight() -> u32 {
    8
}

impl Simulated {
    /// The objects of its own scene, the first one too.
    fn objects(&self) -> Vec<ObjectParams> {
        let first = self.model.clone().zip(self.path.clone());
        let first = first.map(|(model, path)| ObjectParams {
            model,
            name: None,
            path,
            texture: self.texture.clone(),
        });
        first.into_iter().chain(self.others.iter().cloned()).collect()
    }

    /// A scene of its own, or that of another sensor.
    fn check_scene(&self) -> Result<(), ConfigError> {
        if self.scene.is_some() {
            let own = self.model.is_some()
                || self.path.is_some()
                || !self.others.is_empty()
                || self.texture != TextureParams::default()
                || self.light != LightParams::default()
                || self.background != BackgroundParams::default();
            let expected = "either `scene`, or `model`, `path` and what else makes a scene";
            return if own {
                Err(ConfigError::parameter("scene", "beside a scene", expected))
            } else {
                Ok(())
            };
        }
        if self.model.is_none() {
            return Err(ConfigError::parameter("model", "missing", "the name of a model, or `scene`"));
        }
        let Some(path) = &self.path else {
            return Err(ConfigError::parameter("path", "missing", "a motion, such as { start = … }"));
        };
        path.path()?;
        self.texture.check()?;
        if self.others.len() >= MOST_OBJECTS {
            let expected = format!("at most {} others", MOST_OBJECTS - 1);
            return Err(ConfigError::parameter("others", self.others.len(), expected));
        }
        let objects = self.objects();
        for (k, object) in objects.iter().enumerate().skip(1) {
            let fail = |e: ConfigError| match e {
                ConfigError::Parameter { key, found, expected } => {
                    let found = format!("{found} (`{key}` of `{}`)", object.name());
                    ConfigError::Parameter { key: "others", found, expected }
                }
                e => e,
            };
            object.path.path().map_err(fail)?;
            object.texture.check().map_err(fail)?;
            if objects[..k].iter().any(|o| o.name() == object.name()) {
                let found = format!("two objects with the name `{}`", object.name());
                return Err(ConfigError::parameter("others", found, "a `name` of its own for each"));
            }
        }
        self.light.check()?;
        self.background.check()
    }
}

impl Params for Simulated {
    fn check(&self) -> Result<(), ConfigError> {
        if !(1..=MOST_FRAMES).contains(&self.frames) {
            let expected = format!("at least 1 frame and at most {MOST_FRAMES}");
            return Err(ConfigError::parameter("frames", self.frames, expected));
        }
        if self.rate.si() <= 0.0 {
            return Err(ConfigError::parameter("rate", self.rate, "a positive rate"));
        }
        if self.noise < 0.0 {
            return Err(ConfigError::parameter("noise", self.noise, "zero or a positive deviation"));
        }
        within("photon", self.photon, 0.0, 255.0)?;
        within("exposure", self.exposure, 0.0, 1.0)?;
        within("salt_and_pepper", self.salt_and_pepper, 0.0, 1.0)?;
        within("gamma", self.gamma, 0.1, 10.0)?;
        within("bits", self.bits.into(), 1.0, 8.0)?;
        within("losses.dropped", self.losses.dropped, 0.0, 1.0)?;
        within("losses.duplicated", self.losses.duplicated, 0.0, 1.0)?;
        if let Some(gap) = self.losses.gaps.iter().find(|[first, last]| first > last) {
            let expected = "pairs of a first and a last number";
            return Err(ConfigError::parameter("losses.gaps", format!("{gap:?}"), expected));
        }
        self.camera_from_world.as_ref().map(PoseText::pose).transpose()?;
        self.check_scene()
    }

    fn files(&self) -> Vec<(String, FilePath)> {
        let file = |key: String, file: Option<&FilePath>| file.map(|f| (key, f.clone()));
        let own = [
            file("texture.params.file".into(), self.texture.file()),
            file("background.params.file".into(), self.background.file()),
        ];
        let others = self.others.iter().enumerate();
        let others = others.map(|(k, o)| file(format!("others.{k}.texture.params.file"), o.texture.file()));
        own.into_iter().chain(others).flatten().collect()
    }

    fn names(&self) -> Vec<Reference> {
        let reference = |key, to, name: &String| Reference { key, to, name: name.clone() };
        let model = self.model.iter().map(|m| reference("model", Referent::Model, m));
        let others = self.others.iter().map(|o| reference("others", Referent::Model, &o.model));
        let scene = self.scene.iter().map(|s| reference("scene", Referent::Sensor, s));
        model.chain(others).chain(scene).collect()
    }
}

fn mismatch(found: String, expected: &str) -> ConfigError {
    ConfigError::Mismatch { found, expected: expected.into() }
}

/// The scene that a sensor describes.
fn world(
    p: &Simulated,
    place: Place<'_>,
    shapes: &BTreeMap<String, Ground>,
    seed: u64,
) -> Result<World, ConfigError> {
    let object = |(k, o): (usize, &ObjectParams)| {
        let shape =
            shapes.get(&o.model).ok_or_else(|| mismatch(format!("model `{}`", o.model), "a model"))?;
        let mesh = shape.body()?.flatten().map_err(|e| mismatch(e.to_string(), "a shape with surfaces"))?;
        let body = Body::new(mesh, o.texture.texture(place)?, seed.wrapping_add(k as u64));
        Ok(Object { name: o.name().to_owned(), body, path: o.path.path()? })
    };
    let objects = p.objects().iter().enumerate().map(object).collect::<Result<_, ConfigError>>()?;
    Ok(World { objects, lighting: p.light.lighting(), background: p.background.background(place)?, seed })
}

/// The camera that a section describes.
pub(crate) fn camera(p: &Simulated, context: &SensorContext<'_>) -> Result<SimulatedCamera, ConfigError> {
    let intrinsics = context.camera.ok_or_else(|| {
        mismatch("a simulated sensor without `camera`".into(), "a `camera` section, since it draws with it")
    })?;
    let world = match &p.scene {
        None => Arc::new(world(p, context.place, context.shapes, context.seed)?),
        Some(name) => context.simulated.get(name).and_then(|s| s.world.clone()).ok_or_else(|| {
            mismatch(
                format!("scene of sensor `{name}`"),
                "the scene of a simulated sensor earlier in the task",
            )
        })?,
    };
    let settings = Settings {
        frames: p.frames,
        rate: p.rate.si(),
        exposure: p.exposure,
        noise: Noise {
            gaussian: p.noise,
            photon: p.photon,
            salt_and_pepper: p.salt_and_pepper,
            gamma: p.gamma,
            bits: p.bits,
        },
        colour: context.section.picture == Picture::Colour,
        dropped: p.losses.dropped,
        gaps: p.losses.gaps.clone(),
        duplicated: p.losses.duplicated,
        seed: context.seed,
    };
    let camera_from_world = p.camera_from_world.clone().unwrap_or_default().pose()?;
    Ok(SimulatedCamera::new(context.id, world, *intrinsics, camera_from_world, settings))
}

/// Builds the sensor `simulated`.
pub(super) fn simulated(p: Simulated, context: SensorContext<'_>) -> Result<SensorProduct, ConfigError> {
    let camera = camera(&p, &context)?;
    let simulation = Simulation::of(&camera);
    Ok(SensorProduct { sensor: Box::new(camera), truth: Some(simulation) })
}

impl Simulation {
    /// What a simulated camera knows besides its frames.
    pub(crate) fn of(camera: &SimulatedCamera) -> Self {
        let world = camera.world().clone();
        let names = world.objects.iter().map(|o| o.name.clone()).enumerate();
        let truths = names.map(|(k, name)| (name, Truth::of_poses(camera.truth(k)))).collect();
        Self { world: Some(world), truths }
    }
}
