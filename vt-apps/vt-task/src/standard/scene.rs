//! The parts of a simulated scene in task files: paths, surfaces, light, background.

use std::sync::Arc;

use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use vt_core::error::ConfigError;
use vt_io::picture::read_rgb;
use vt_sim::backdrop::{self, Background};
use vt_sim::light::{Light, Lighting, Shadow};
use vt_sim::path::{Jump, Line, Motion, Path, SmoothPath};
use vt_sim::texture::Texture;

use crate::geometry::PoseText;
use crate::language::FilePath;
use crate::quantity::{Angle, AngularSpeed, Length, Pixels, Span, Speed};
use crate::roles::Place;

/// Motion in the axes of the world: rest at a pose, or one of swings (`period`), even motion (`velocity`, `spin`) and
/// `keys`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PathParams {
    /// Pose at time 0, world_from_object; the world is the camera unless `camera_from_world` is given.
    pub start: PoseText,
    /// Amplitudes of swings along the axes of the world.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub translation: Option<[Length; 3]>,
    /// Amplitudes of swings about the object's axes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rotation: Option<[Angle; 3]>,
    /// Period of the swing of the first coordinate; the others lie between 2/3 and 5/3 of it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub period: Option<Span>,
    /// Even motion along the axes of the world.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub velocity: Option<[Speed; 3]>,
    /// Even spin about the object's axes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub spin: Option<[AngularSpeed; 3]>,
    /// Poses at times, in order; `start` is the one before the first.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub keys: Vec<KeyParams>,
    /// Sudden displacements.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub jumps: Vec<JumpParams>,
}

/// A pose on a path.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct KeyParams {
    /// When.
    pub time: Span,
    /// Where.
    pub pose: PoseText,
}

/// A sudden displacement.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct JumpParams {
    /// From when on it holds.
    pub time: Span,
    /// Along the axes of the world.
    #[serde(default)]
    pub translation: [Length; 3],
    /// Rotation vector about the object's axes.
    #[serde(default)]
    pub rotation: [Angle; 3],
}

impl PathParams {
    /// The path.
    pub(super) fn path(&self) -> Result<Path, ConfigError> {
        let start = self.start.pose()?;
        let swings = self.period.is_some() || self.translation.is_some() || self.rotation.is_some();
        let even = self.velocity.is_some() || self.spin.is_some();
        if [swings, even, !self.keys.is_empty()].iter().filter(|x| **x).count() > 1 {
            let expected =
                "one of swings (`translation`, `rotation`, `period`), `velocity` with `spin`, `keys`";
            return Err(ConfigError::parameter("path", "more than one motion", expected));
        }
        let motion = if swings {
            let expected = "a positive span of time";
            let period =
                self.period.ok_or_else(|| ConfigError::parameter("path", "no `period`", expected))?;
            if period.si() <= 0.0 {
                return Err(ConfigError::parameter("path.period", period, expected));
            }
            Motion::Smooth(SmoothPath {
                start,
                translation: self.translation.unwrap_or_default().map(|v| v.si()),
                rotation: self.rotation.unwrap_or_default().map(|v| v.si()),
                period: period.si(),
            })
        } else if even {
            Motion::Line(Line {
                start,
                velocity: Vector3::from(self.velocity.unwrap_or_default().map(|v| v.si())),
                spin: Vector3::from(self.spin.unwrap_or_default().map(|v| v.si())),
            })
        } else {
            let mut keys = vec![(0.0, start)];
            for key in &self.keys {
                if keys.last().is_some_and(|(t, _)| key.time.si() <= *t) {
                    let expected = "times after 0 in rising order";
                    return Err(ConfigError::parameter("path.keys", key.time, expected));
                }
                keys.push((key.time.si(), key.pose.pose()?));
            }
            Motion::Keys(keys)
        };
        let jump = |j: &JumpParams| {
            let translation = Vector3::from(j.translation.map(|v| v.si()));
            (j.time.si(), Jump { translation, rotation: Vector3::from(j.rotation.map(|v| v.si())) })
        };
        Ok(Path { motion, jumps: self.jumps.iter().map(jump).collect() })
    }
}

/// Surface of a simulated model. Polygons in one plane look alike.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", content = "params", rename_all = "kebab-case", deny_unknown_fields)]
pub enum TextureParams {
    /// One reflectance everywhere.
    Plain(Plain),
    /// A random reflectance for each plane.
    #[default]
    Faces,
    /// Squares of random reflectance.
    Squares(Squares),
    /// The colours of the model's materials.
    Materials,
    /// A picture at the model's texture coordinates.
    Picture(PictureFile),
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

/// A picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PictureFile {
    /// PNG, JPEG or PNM file.
    pub file: FilePath,
}

impl PictureFile {
    fn read(&self, place: Place<'_>) -> Result<Arc<image::RgbImage>, ConfigError> {
        let picture = read_rgb(&place.resolve(&self.file)).map_err(|e| ConfigError::Mismatch {
            found: e.to_string(),
            expected: "a readable picture".into(),
        })?;
        Ok(Arc::new(picture))
    }
}

impl TextureParams {
    pub(super) fn check(&self) -> Result<(), ConfigError> {
        match self {
            Self::Plain(p) => share("texture.params.brightness", p.brightness),
            Self::Squares(s) if s.size.si() <= 0.0 => {
                Err(ConfigError::parameter("texture.params.size", s.size, "a positive length"))
            }
            Self::Squares(s) => share("texture.params.contrast", s.contrast),
            Self::Faces | Self::Materials | Self::Picture(_) => Ok(()),
        }
    }

    pub(super) fn file(&self) -> Option<&FilePath> {
        if let Self::Picture(p) = self { Some(&p.file) } else { None }
    }

    pub(super) fn texture(&self, place: Place<'_>) -> Result<Texture, ConfigError> {
        Ok(match self {
            Self::Plain(p) => Texture::Plain(p.brightness),
            Self::Faces => Texture::Faces { from: 0.35, to: 0.85 },
            Self::Squares(s) => Texture::Squares { size: s.size.si(), contrast: s.contrast },
            Self::Materials => Texture::Materials,
            Self::Picture(p) => Texture::Picture(p.read(place)?),
        })
    }
}

/// Background of a simulated scene: the same picture for every camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", content = "params", rename_all = "kebab-case", deny_unknown_fields)]
pub enum BackgroundParams {
    /// One brightness everywhere.
    Plain(Plain),
    /// Random rectangles and discs before random brightness.
    Clutter(Clutter),
    /// A picture that fills the view.
    Picture(PictureFile),
}

/// Random rectangles and discs before random brightness.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Clutter {
    /// Mean size of the shapes.
    pub size: Pixels,
    /// Number of shapes times `size²` in parts of the picture, 0 to 10; 1 covers about half.
    #[serde(default = "third")]
    pub density: f64,
    /// Mean brightness, 0 to 1.
    pub brightness: f32,
    /// Range of brightness, 0 to 1.
    pub contrast: f32,
}

fn third() -> f64 {
    0.35
}

impl Default for BackgroundParams {
    fn default() -> Self {
        Self::Plain(Plain { brightness: 0.2 })
    }
}

impl BackgroundParams {
    pub(super) fn check(&self) -> Result<(), ConfigError> {
        match self {
            Self::Plain(p) => share("background.params.brightness", p.brightness),
            Self::Clutter(c) if c.size.si() < 2.0 => {
                Err(ConfigError::parameter("background.params.size", c.size, "at least 2 px"))
            }
            Self::Clutter(c) => {
                within("background.params.density", c.density, 0.0, 10.0)?;
                share("background.params.brightness", c.brightness)?;
                share("background.params.contrast", c.contrast)
            }
            Self::Picture(_) => Ok(()),
        }
    }

    pub(super) fn file(&self) -> Option<&FilePath> {
        if let Self::Picture(p) = self { Some(&p.file) } else { None }
    }

    pub(super) fn background(&self, place: Place<'_>) -> Result<Background, ConfigError> {
        Ok(match self {
            Self::Plain(p) => Background::Plain(p.brightness),
            Self::Clutter(c) => {
                let (size, density) = (c.size.si(), c.density);
                let (brightness, contrast) = (c.brightness, c.contrast);
                Background::Clutter(backdrop::Clutter { size, density, brightness, contrast })
            }
            Self::Picture(p) => Background::Picture(p.read(place)?),
        })
    }
}

/// Light and its changes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LightParams {
    /// Share that reaches every surface alike, 0 to 1.
    pub ambient: f32,
    /// Share of a distant source, which falls in with the cosine of the angle to it, 0 to 1.
    pub diffuse: f32,
    /// Brightness of highlights, 0 to 1.
    pub specular: f32,
    /// Exponent of highlights as a power of two, 0 to 10.
    pub gloss: u32,
    /// Direction to the source in the axes of the world; its length does not matter.
    pub direction: [f64; 3],
    /// Turn of the source about the z axis of the world.
    pub turn: AngularSpeed,
    /// Relative amplitude of a swing of all brightness, 0 to 1.
    pub swing: f64,
    /// Period of the swing.
    pub period: Span,
    /// A shadow that sweeps over the picture.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shadow: Option<ShadowParams>,
}

/// A straight dark band that swings across the picture, from one far end to the other and back.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ShadowParams {
    /// Width of the band.
    pub width: Pixels,
    /// Width of its soft borders.
    #[serde(default)]
    pub soft: Pixels,
    /// Share of the light that it takes, 0 to 1.
    pub depth: f64,
    /// Direction in which it moves, from x to y.
    #[serde(default)]
    pub angle: Angle,
    /// Farthest distance of its middle from that of the picture.
    pub reach: Pixels,
    /// Period.
    pub period: Span,
}

impl Default for LightParams {
    fn default() -> Self {
        let light = Light::default();
        Self {
            ambient: light.ambient,
            diffuse: light.diffuse,
            specular: light.specular,
            gloss: light.gloss,
            direction: light.direction.into(),
            turn: AngularSpeed::default(),
            swing: 0.0,
            period: Span::new(1.0, "s").unwrap_or_default(),
            shadow: None,
        }
    }
}

impl LightParams {
    pub(super) fn check(&self) -> Result<(), ConfigError> {
        share("light.ambient", self.ambient)?;
        share("light.diffuse", self.diffuse)?;
        share("light.specular", self.specular)?;
        within("light.gloss", self.gloss.into(), 0.0, 10.0)?;
        within("light.swing", self.swing, 0.0, 1.0)?;
        let direction = Vector3::from(self.direction);
        if direction.try_normalize(1e-12).is_none() {
            let found = format!("{:?}", self.direction);
            return Err(ConfigError::parameter("light.direction", found, "a direction, not zero"));
        }
        let positive = |key, span: Span| {
            let expected = "a positive span of time";
            if span.si() > 0.0 { Ok(()) } else { Err(ConfigError::parameter(key, span, expected)) }
        };
        positive("light.period", self.period)?;
        let Some(shadow) = &self.shadow else { return Ok(()) };
        within("light.shadow.depth", shadow.depth, 0.0, 1.0)?;
        for (key, v) in [
            ("light.shadow.width", shadow.width),
            ("light.shadow.soft", shadow.soft),
            ("light.shadow.reach", shadow.reach),
        ] {
            within(key, v.si(), 0.0, 1e6)?;
        }
        positive("light.shadow.period", shadow.period)
    }

    pub(super) fn lighting(&self) -> Lighting {
        let light = Light {
            ambient: self.ambient,
            diffuse: self.diffuse,
            specular: self.specular,
            gloss: self.gloss,
            direction: Vector3::from(self.direction),
        };
        let shadow = self.shadow.as_ref().map(|s| Shadow {
            width: s.width.si(),
            soft: s.soft.si(),
            depth: s.depth,
            angle: s.angle.si(),
            reach: s.reach.si(),
            period: s.period.si(),
        });
        Lighting { light, swing: self.swing, period: self.period.si(), turn: self.turn.si(), shadow }
    }
}

/// A number from `low` to `high`.
pub(super) fn within(key: &'static str, v: f64, low: f64, high: f64) -> Result<(), ConfigError> {
    if (low..=high).contains(&v) {
        Ok(())
    } else {
        Err(ConfigError::parameter(key, v, format!("a number from {low} to {high}")))
    }
}

fn share(key: &'static str, v: f32) -> Result<(), ConfigError> {
    within(key, f64::from(v), 0.0, 1.0)
}
