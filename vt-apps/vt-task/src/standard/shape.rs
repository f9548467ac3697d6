//! Ground shapes.

use std::path::Path;

use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use vt_core::error::ConfigError;
use vt_models::loaders::load_mesh;
use vt_models::mesh::{Mesh, Shape, Unit};

use crate::geometry::PoseText;
use crate::language::FilePath;
use crate::registry::Params;
use crate::roles::{Ground, Place};

/// Length unit of the coordinates of a model file. Files do not say it, so the task must.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum FileUnit {
    /// Metre.
    #[serde(rename = "m")]
    Metre,
    /// Centimetre.
    #[serde(rename = "cm")]
    Centimetre,
    /// Millimetre.
    #[serde(rename = "mm")]
    Millimetre,
    /// Inch.
    #[serde(rename = "in")]
    Inch,
}

impl FileUnit {
    /// The unit of this name.
    pub fn named(name: &str) -> Option<Self> {
        Some(match name {
            "m" => Self::Metre,
            "cm" => Self::Centimetre,
            "mm" => Self::Millimetre,
            "in" => Self::Inch,
            _ => return None,
        })
    }

    fn unit(self) -> Unit {
        match self {
            Self::Metre => Unit::Metre,
            Self::Centimetre => Unit::Centimetre,
            Self::Millimetre => Unit::Millimetre,
            Self::Inch => Unit::Inch,
        }
    }
}

/// The vertices of a model file in metres, for scores.
///
/// # Errors
/// [`ConfigError`] when the file cannot be read.
pub fn vertices(path: &Path, unit: FileUnit) -> Result<Vec<Point3<f64>>, ConfigError> {
    Ok(load(path, unit)?.vertices().to_vec())
}

pub(super) fn load(path: &Path, unit: FileUnit) -> Result<Mesh, ConfigError> {
    load_mesh(path, unit.unit())
        .map_err(|e| ConfigError::Mismatch { found: e.to_string(), expected: "a readable model file".into() })
}

/// A rigid part of a shape.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PartFile {
    /// VRML 97, OBJ, PLY, STL, glTF or CAO file.
    pub file: FilePath,
    /// Length unit of the file.
    pub unit: FileUnit,
    /// Where the part sits in the object.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub object_from_part: Option<PoseText>,
}

/// Parameters of the shape `mesh`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MeshFiles {
    /// The parts.
    pub parts: Vec<PartFile>,
}

impl Params for MeshFiles {
    fn check(&self) -> Result<(), ConfigError> {
        if self.parts.is_empty() {
            return Err(ConfigError::parameter("parts", "no part", "at least one part"));
        }
        self.parts.iter().filter_map(|p| p.object_from_part.as_ref()).try_for_each(|p| p.pose().map(drop))
    }

    fn files(&self) -> Vec<(String, FilePath)> {
        self.parts.iter().enumerate().map(|(k, p)| (format!("parts.{k}.file"), p.file.clone())).collect()
    }
}

/// Builds the shape `mesh`.
pub(super) fn mesh(p: MeshFiles, place: Place<'_>) -> Result<Ground, ConfigError> {
    let mut shape = Shape::default();
    for part in &p.parts {
        let path = place.resolve(&part.file);
        let mesh = load(&path, part.unit)?;
        let name = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
        let pose = part.object_from_part.clone().unwrap_or_default().pose()?;
        shape = shape.with(&name, mesh, pose);
    }
    Ok(Ground::Body(shape))
}
