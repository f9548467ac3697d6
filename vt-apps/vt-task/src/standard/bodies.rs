//! Shapes made in code.

use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use vt_core::error::ConfigError;
use vt_core::lie::SE3;
use vt_models::mesh::{Mesh, Shape};
use vt_sim::bodies;

use crate::quantity::Length;
use crate::registry::Params;
use crate::roles::{Ground, Place};

/// Parameters of the shape `bracket`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Bracket {
    /// Edge length of one of the three cubic cells.
    pub cell: Length,
}

/// Parameters of the shapes `house`, `stairs`, `wedge` and `tee`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Size {
    /// Longest side of its box.
    pub size: Length,
}

/// Parameters of the shape `cuboid`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Sides {
    /// Lengths along x, y and z.
    pub sides: [Length; 3],
}

fn positive(key: &'static str, v: Length) -> Result<(), ConfigError> {
    if v.si() > 0.0 { Ok(()) } else { Err(ConfigError::parameter(key, v, "a positive length")) }
}

impl Params for Bracket {
    fn check(&self) -> Result<(), ConfigError> {
        positive("cell", self.cell)
    }
}

impl Params for Size {
    fn check(&self) -> Result<(), ConfigError> {
        positive("size", self.size)
    }
}

impl Params for Sides {
    fn check(&self) -> Result<(), ConfigError> {
        self.sides.iter().try_for_each(|s| positive("sides", *s))
    }
}

fn shape(name: &str, p: &impl Params, mesh: impl FnOnce() -> Mesh) -> Result<Ground, ConfigError> {
    p.check()?;
    let origin = SE3::from_rotation_vector(&Vector3::zeros(), Vector3::zeros());
    Ok(Ground::Body(Shape::default().with(name, mesh(), origin)))
}

/// Builds the shape `bracket`.
pub(super) fn bracket(p: Bracket, _: Place<'_>) -> Result<Ground, ConfigError> {
    shape("bracket", &p, || vt_sim::bracket::bracket(p.cell.si()))
}

/// Builds the shape `house`.
pub(super) fn house(p: Size, _: Place<'_>) -> Result<Ground, ConfigError> {
    shape("house", &p, || bodies::house(p.size.si()))
}

/// Builds the shape `stairs`.
pub(super) fn stairs(p: Size, _: Place<'_>) -> Result<Ground, ConfigError> {
    shape("stairs", &p, || bodies::stairs(p.size.si()))
}

/// Builds the shape `wedge`.
pub(super) fn wedge(p: Size, _: Place<'_>) -> Result<Ground, ConfigError> {
    shape("wedge", &p, || bodies::wedge(p.size.si()))
}

/// Builds the shape `tee`.
pub(super) fn tee(p: Size, _: Place<'_>) -> Result<Ground, ConfigError> {
    shape("tee", &p, || bodies::tee(p.size.si()))
}

/// Builds the shape `cuboid`.
pub(super) fn cuboid(p: Sides, _: Place<'_>) -> Result<Ground, ConfigError> {
    shape("cuboid", &p, || bodies::cuboid(p.sides.map(|s| s.si())))
}
