//! Pose spaces and projections.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use vt_core::error::ConfigError;

use crate::registry::Params;
use crate::roles::Freedom;

/// A degree of freedom of a rigid body, in tangent order, along and about the object's axes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Axis {
    /// Translation along x.
    Tx,
    /// Translation along y.
    Ty,
    /// Translation along z.
    Tz,
    /// Rotation about x.
    Rx,
    /// Rotation about y.
    Ry,
    /// Rotation about z.
    Rz,
}

/// Parameters of the warp `se3`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Rigid {
    /// Degrees of freedom that keep their value.
    pub locked: Vec<Axis>,
}

impl Params for Rigid {
    fn check(&self) -> Result<(), ConfigError> {
        let twice = self.locked.iter().enumerate().any(|(k, a)| self.locked[..k].contains(a));
        if twice || self.locked.len() == 6 {
            let expected = "each degree of freedom at most once, and at least one free";
            return Err(ConfigError::parameter("locked", format!("{:?}", self.locked), expected));
        }
        Ok(())
    }
}

pub(super) fn rigid(p: Rigid, _: ()) -> Result<Freedom, ConfigError> {
    let mut free = vec![true; 6];
    p.locked.iter().for_each(|&axis| free[axis as usize] = false);
    Ok(Freedom(free))
}
