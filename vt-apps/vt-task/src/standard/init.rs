//! Priors of the first frame for rigid bodies, and where to try again after a loss.

use nalgebra::{DefaultAllocator, Vector6};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use vt_core::belief::Gaussian;
use vt_core::error::ConfigError;
use vt_core::lie::SE3;
use vt_core::manifold::{Alloc, Manifold};
use vt_fusion::reinitialization::PriorPoses;
use vt_io::truth::read_pose;

use crate::geometry::PoseText;
use crate::language::FilePath;
use crate::quantity::{Angle, Length};
use crate::registry::Params;
use crate::roles::{Deviations, InitContext, ReinitContext, ReinitProduct, Start};

/// Deviations of a prior pose, the same for all axes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Sigma {
    /// Of each coordinate of the translation.
    pub translation: Length,
    /// Of each coordinate of the rotation vector.
    pub rotation: Angle,
}

impl Params for Sigma {
    fn check(&self) -> Result<(), ConfigError> {
        if self.translation.si() <= 0.0 {
            return Err(ConfigError::parameter("sigma.translation", self.translation, "a positive length"));
        }
        if self.rotation.si() <= 0.0 {
            return Err(ConfigError::parameter("sigma.rotation", self.rotation, "a positive angle"));
        }
        Ok(())
    }
}

impl Deviations<SE3> for Sigma {
    fn tangent(&self) -> Result<Vector6<f64>, ConfigError> {
        Ok(Vector6::from_fn(|k, _| if k < 3 { self.translation.si() } else { self.rotation.si() }))
    }
}

/// A prior about `mean`; locked coordinates have no uncertainty.
pub(super) fn around<P: Manifold>(
    mean: P,
    sigma: &impl Deviations<P>,
    context: &InitContext<'_>,
) -> Result<Gaussian<P>, ConfigError>
where
    DefaultAllocator: Alloc<P::D>,
{
    let mut deviations = sigma.tangent()?;
    deviations.iter_mut().enumerate().for_each(|(k, s)| *s = context.freedom.mask(k, *s));
    Ok(Gaussian::from_sigmas(mean, &deviations))
}

/// Parameters of the init `pose`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct InitPose {
    /// The pose.
    pub camera_from_object: PoseText,
    /// Its uncertainty.
    pub sigma: Sigma,
}

impl Params for InitPose {
    fn check(&self) -> Result<(), ConfigError> {
        self.camera_from_object.pose()?;
        self.sigma.check()
    }
}

/// Parameters of the init `file`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct InitFile {
    /// File with camera_from_object in metres and radians: translation and rotation vector (6 numbers), translation
    /// and quaternion (7, or 8 with a frame before), or a matrix (12 or 16).
    pub path: FilePath,
    /// Its uncertainty.
    pub sigma: Sigma,
}

impl Params for InitFile {
    fn check(&self) -> Result<(), ConfigError> {
        self.sigma.check()
    }
    fn files(&self) -> Vec<(String, FilePath)> {
        vec![("path".into(), self.path.clone())]
    }
}

/// Parameters of the init `truth`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct InitTruth {
    /// Error that is put on the true pose: init = truth · offset.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub offset: Option<PoseText>,
    /// Its uncertainty.
    pub sigma: Sigma,
}

impl Params for InitTruth {
    fn check(&self) -> Result<(), ConfigError> {
        self.offset.as_ref().map_or(Ok(()), |o| o.pose().map(drop))?;
        self.sigma.check()
    }
}

pub(super) fn pose(p: InitPose, context: InitContext<'_>) -> Result<Start<SE3>, ConfigError> {
    Ok(around(p.camera_from_object.pose()?, &p.sigma, &context)?.into())
}

pub(super) fn file(p: InitFile, context: InitContext<'_>) -> Result<Start<SE3>, ConfigError> {
    let pose = read_pose(&context.place.resolve(&p.path))
        .map_err(|e| ConfigError::Mismatch { found: e.to_string(), expected: "a readable pose".into() })?;
    Ok(around(pose, &p.sigma, &context)?.into())
}

pub(super) fn truth(p: InitTruth, context: InitContext<'_>) -> Result<Start<SE3>, ConfigError> {
    let offset = p.offset.unwrap_or_default().pose()?;
    Ok(around(context.true_pose()? * offset, &p.sigma, &context)?.into())
}

/// Parameters of the re-initialiser `prior`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ReinitPrior {
    /// Factor on the deviations of the last trusted pose, which is tried first; 0 leaves it out.
    pub last_trusted: f64,
}

impl Default for ReinitPrior {
    fn default() -> Self {
        Self { last_trusted: 3.0 }
    }
}

impl Params for ReinitPrior {
    fn check(&self) -> Result<(), ConfigError> {
        last_trusted(self.last_trusted).map(drop)
    }
}

/// The factor on the deviations of the last trusted pose; none for zero.
pub(super) fn last_trusted(factor: f64) -> Result<Option<f64>, ConfigError> {
    if factor >= 0.0 {
        return Ok((factor > 0.0).then_some(factor));
    }
    Err(ConfigError::parameter("last_trusted", factor, "a number from 0"))
}

pub(super) fn prior<P: Manifold>(
    p: ReinitPrior,
    context: ReinitContext<'_, P>,
) -> Result<ReinitProduct<P>, ConfigError>
where
    DefaultAllocator: Alloc<P::D>,
{
    let last_trusted = last_trusted(p.last_trusted)?;
    let priors = context.prior.cloned().into_iter().collect();
    Ok(ReinitProduct::of_frames(PriorPoses { priors, last_trusted }))
}
