//! Version 1 of the task language: one struct for each class of the paper's Fig. 2.
//!
//! Wherever a method is chosen, the text says `kind` and, where the method has parameters, `params`; the registry
//! knows the kinds. Unknown keys are errors.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::geometry::CameraSection;
use crate::schema::choice;

/// A path as written in a task; relative ones start from the folder of the task file.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct FilePath(pub String);

/// A method out of the registry with its parameters.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Choice {
    /// Name of the method.
    pub kind: String,
    /// Its parameters; their keys depend on the kind.
    #[serde(default, skip_serializing_if = "toml::Table::is_empty")]
    pub params: toml::Table,
}

impl Choice {
    /// A method without parameters.
    pub fn of(kind: &str) -> Self {
        Self { kind: kind.into(), params: toml::Table::new() }
    }
}

/// A whole task.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Task {
    /// Version of the language: 1.
    #[schemars(schema_with = "crate::schema::version")]
    pub version: u32,
    /// One line that says what is tracked.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub title: Option<String>,
    /// Seed of all random numbers of the run.
    #[serde(default)]
    pub seed: u32,
    /// Values for `${NAME}` in texts of this file; variables that are not here come from the environment.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub variables: BTreeMap<String, String>,
    /// Where frames come from.
    pub sensors: Vec<SensorSection>,
    /// What is tracked.
    pub models: Vec<ModelSection>,
    /// Instances of models in the scene, each with its pipeline.
    pub targets: Vec<TargetSection>,
    /// How measurements are given to targets.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(schema_with = "choice::association")]
    pub association: Option<Choice>,
    /// What is written.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[schemars(schema_with = "choice::outputs")]
    pub outputs: Vec<Choice>,
}

/// Payload of a sensor's pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Picture {
    /// 8-bit grey; colour pictures are converted.
    #[default]
    Grey,
    /// 8-bit sRGB.
    Colour,
}

/// A sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SensorSection {
    /// Name by which modalities refer to it.
    pub name: String,
    /// Kind of sensor; see `vt list`.
    #[schemars(schema_with = "choice::sensor_kind")]
    pub kind: String,
    /// What its frames are converted to.
    #[serde(default)]
    pub picture: Picture,
    /// Parameters of the kind.
    #[serde(default, skip_serializing_if = "toml::Table::is_empty")]
    #[schemars(schema_with = "choice::params")]
    pub params: toml::Table,
    /// Intrinsic parameters; without them the sensor is uncalibrated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<CameraSection>,
}

/// A model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ModelSection {
    /// Name by which targets refer to it.
    pub name: String,
    /// Ground shape.
    #[schemars(schema_with = "choice::shape")]
    pub shape: Choice,
    /// What its surface looks like.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(schema_with = "choice::appearance")]
    pub appearance: Option<Choice>,
    /// Pose space and projection, with free and locked degrees of freedom.
    #[schemars(schema_with = "choice::warp")]
    pub warp: Choice,
    /// Motion model.
    #[schemars(schema_with = "choice::dynamics")]
    pub dynamics: Choice,
}

/// An instance of a model in the scene with its pipeline.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TargetSection {
    /// Name in reports and file names.
    pub name: String,
    /// Name of its model.
    pub model: String,
    /// Prior of the first frame.
    #[schemars(schema_with = "choice::init")]
    pub init: Choice,
    /// True poses, for scores only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(schema_with = "choice::truth")]
    pub truth: Option<Choice>,
    /// What is measured.
    pub modalities: Vec<ModalitySection>,
    /// How several measurements become one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(schema_with = "choice::fusion")]
    pub fusion: Option<Choice>,
    /// The filter.
    #[schemars(schema_with = "choice::estimator")]
    pub estimator: Choice,
    /// How loss is noticed; without it the target counts as tracked always.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(schema_with = "choice::loss")]
    pub loss: Option<Choice>,
    /// What is tried after a loss; without it the picture is searched where the sensor is calibrated and the body free to
    /// move, otherwise the target coasts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(schema_with = "choice::reinit")]
    pub reinit: Option<Choice>,
}

/// Processing level of a measurement (columns of the paper's Fig. 4).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Level {
    /// Evidence maps with a likelihood.
    Pixel,
    /// Image features with residuals.
    Feature,
    /// A pose with its information.
    Object,
}

impl Level {
    /// As in task files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Pixel => "pixel",
            Self::Feature => "feature",
            Self::Object => "object",
        }
    }
}

impl From<Level> for vt_core::measurement::Level {
    fn from(level: Level) -> Self {
        match level {
            Level::Pixel => Self::Pixel,
            Level::Feature => Self::Feature,
            Level::Object => Self::Object,
        }
    }
}

/// A modality of a target.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ModalitySection {
    /// Kind of modality; see `vt list`.
    #[schemars(schema_with = "choice::modality_kind")]
    pub kind: String,
    /// Level at which it measures.
    pub level: Level,
    /// Name of the sensor it looks at.
    pub sensor: String,
    /// Parameters of the kind.
    #[serde(default, skip_serializing_if = "toml::Table::is_empty")]
    #[schemars(schema_with = "choice::params")]
    pub params: toml::Table,
}

impl Task {
    /// The canonical text of this task; reading it gives an equal task.
    pub fn print(&self) -> String {
        let mut table = toml::Table::try_from(self).unwrap_or_default();
        table.iter_mut().for_each(|(_, v)| escape(v));
        table.to_string()
    }
}

/// Texts with `${` would be taken for variables.
fn escape(value: &mut toml::Value) {
    match value {
        toml::Value::String(s) if s.contains("${") => *s = s.replace("${", "$${"),
        toml::Value::Array(a) => a.iter_mut().for_each(escape),
        toml::Value::Table(t) => t.iter_mut().for_each(|(_, v)| escape(v)),
        _ => {}
    }
}
