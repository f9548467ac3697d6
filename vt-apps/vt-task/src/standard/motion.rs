//! Motion models of rigid bodies. Noise is given as the deviation that one second of it brings; locked degrees of
//! freedom have none.

use nalgebra::Vector6;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use vt_core::dynamics::{
    Brownian, CameraVelocity, ConstantAcceleration, ConstantVelocity, OrnsteinUhlenbeck,
};
use vt_core::error::ConfigError;
use vt_core::lie::SE3;
use vt_core::time::Seconds;

use crate::quantity::{
    Acceleration, AccelerationDiffusion, AngularAcceleration, AngularAccelerationDiffusion, AngularDiffusion,
    AngularSpeed, AngularSpeedDiffusion, Diffusion, Dimension, Quantity, Span, Speed, SpeedDiffusion,
};
use crate::registry::Params;
use crate::roles::{Chosen, Freedom, Motion};

/// Parameters of the dynamics `brownian`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BrownianParams {
    /// Random walk of each coordinate of the position.
    pub translation: Diffusion,
    /// Random walk of each coordinate of the orientation.
    pub rotation: AngularDiffusion,
}

/// Parameters of the dynamics `constant-velocity` and, in the axes of the camera, `camera-velocity`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct VelocityParams {
    /// White acceleration.
    pub translation: SpeedDiffusion,
    /// White angular acceleration.
    pub rotation: AngularSpeedDiffusion,
    /// Deviation of the speed at the start and after a re-initialisation.
    pub speed: Speed,
    /// Deviation of the angular speed at the start and after a re-initialisation.
    pub angular_speed: AngularSpeed,
}

/// Parameters of the dynamics `fading-velocity`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FadingParams {
    /// Time in which a velocity falls to a third.
    pub fades_in: Span,
    /// White acceleration.
    pub translation: SpeedDiffusion,
    /// White angular acceleration.
    pub rotation: AngularSpeedDiffusion,
    /// Deviation of the speed at the start and after a re-initialisation.
    pub speed: Speed,
    /// Deviation of the angular speed at the start and after a re-initialisation.
    pub angular_speed: AngularSpeed,
}

/// Parameters of the dynamics `constant-acceleration`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AccelerationParams {
    /// White jerk.
    pub translation: AccelerationDiffusion,
    /// White angular jerk.
    pub rotation: AngularAccelerationDiffusion,
    /// Deviation of the speed at the start and after a re-initialisation.
    pub speed: Speed,
    /// Deviation of the angular speed at the start and after a re-initialisation.
    pub angular_speed: AngularSpeed,
    /// Deviation of the acceleration at the start and after a re-initialisation.
    pub acceleration: Acceleration,
    /// Deviation of the angular acceleration at the start and after a re-initialisation.
    pub angular_acceleration: AngularAcceleration,
}

/// Deviations must not be negative.
fn check<A: Dimension, B: Dimension>(
    keys: [&'static str; 2],
    a: Quantity<A>,
    b: Quantity<B>,
) -> Result<(), ConfigError> {
    let wrong = [(keys[0], a.si(), a.to_string()), (keys[1], b.si(), b.to_string())];
    match wrong.into_iter().find(|(_, v, _)| *v < 0.0) {
        Some((key, _, found)) => Err(ConfigError::parameter(key, found, "zero or a positive value")),
        None => Ok(()),
    }
}

impl Params for BrownianParams {
    fn check(&self) -> Result<(), ConfigError> {
        check(["translation", "rotation"], self.translation, self.rotation)
    }
}

impl Params for VelocityParams {
    fn check(&self) -> Result<(), ConfigError> {
        check(["translation", "rotation"], self.translation, self.rotation)?;
        check(["speed", "angular_speed"], self.speed, self.angular_speed)
    }
}

impl Params for FadingParams {
    fn check(&self) -> Result<(), ConfigError> {
        if self.fades_in.si() <= 0.0 {
            return Err(ConfigError::parameter("fades_in", self.fades_in, "a positive time"));
        }
        check(["translation", "rotation"], self.translation, self.rotation)?;
        check(["speed", "angular_speed"], self.speed, self.angular_speed)
    }
}

impl Params for AccelerationParams {
    fn check(&self) -> Result<(), ConfigError> {
        check(["translation", "rotation"], self.translation, self.rotation)?;
        check(["speed", "angular_speed"], self.speed, self.angular_speed)?;
        check(["acceleration", "angular_acceleration"], self.acceleration, self.angular_acceleration)
    }
}

/// A tangent vector with one value for positions and one for rotations.
fn tangent<A: Dimension, B: Dimension>(t: Quantity<A>, r: Quantity<B>, free: &Freedom) -> Vector6<f64> {
    Vector6::from_fn(|k, _| free.mask(k, if k < 3 { t.si() } else { r.si() }))
}

/// Spectral densities of deviations after one second.
fn density<A: Dimension, B: Dimension>(t: Quantity<A>, r: Quantity<B>, free: &Freedom) -> Vector6<f64> {
    tangent(t, r, free).map(|s| s * s)
}

pub(super) fn brownian(p: BrownianParams, free: &Freedom) -> Result<Motion<SE3>, ConfigError> {
    Ok(Motion::Pose(Chosen(Box::new(Brownian::new(density(p.translation, p.rotation, free))?))))
}

pub(super) fn velocity(p: VelocityParams, free: &Freedom) -> Result<Motion<SE3>, ConfigError> {
    let model = ConstantVelocity::new(density(p.translation, p.rotation, free))?;
    Ok(Motion::Moving(Chosen(Box::new(model)), vec![tangent(p.speed, p.angular_speed, free)]))
}

pub(super) fn camera(p: VelocityParams, free: &Freedom) -> Result<Motion<SE3>, ConfigError> {
    let model = CameraVelocity::new(density(p.translation, p.rotation, free))?;
    Ok(Motion::Moving(Chosen(Box::new(model)), vec![tangent(p.speed, p.angular_speed, free)]))
}

pub(super) fn fading(p: FadingParams, free: &Freedom) -> Result<Motion<SE3>, ConfigError> {
    let model = OrnsteinUhlenbeck::new(Seconds(p.fades_in.si()), density(p.translation, p.rotation, free))?;
    Ok(Motion::Moving(Chosen(Box::new(model)), vec![tangent(p.speed, p.angular_speed, free)]))
}

pub(super) fn acceleration(p: AccelerationParams, free: &Freedom) -> Result<Motion<SE3>, ConfigError> {
    let model = ConstantAcceleration::new(density(p.translation, p.rotation, free))?;
    let rest =
        vec![tangent(p.speed, p.angular_speed, free), tangent(p.acceleration, p.angular_acceleration, free)];
    Ok(Motion::Accelerating(Chosen(Box::new(model)), rest))
}
