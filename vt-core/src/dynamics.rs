//! Motion models for any manifold; the contract is [`crate::agent::Dynamics`].
//!
//! | model | state | noise drives | density unit |
//! |---|---|---|---|
//! | [`Brownian`] | pose | pose | (tangent unit)²/s |
//! | [`ConstantVelocity`] (CWNA) | [`crate::belief::Moving`] | velocity | (tangent unit)²/s³ |
//! | [`ConstantAcceleration`] (CWPA) | [`crate::belief::Accelerating`] | acceleration | (tangent unit)²/s⁵ |
//! | [`OrnsteinUhlenbeck`] | [`crate::belief::Moving`], velocity fades | velocity | (tangent unit)²/s³ |
//! | [`Singer`] | [`crate::belief::Accelerating`], acceleration fades | acceleration | (tangent unit)²/s⁵ |
//! | [`CameraVelocity`] | [`crate::belief::Moving`], velocity in the camera's frame | velocity | (tangent unit)²/s³ |
//! | [`CoordinatedTurn`] | `x, y, ẋ, ẏ, ω` | velocity, turn rate | m²/s³, rad²/s³ |
//! | [`LinearRate`] | `R^n`, `dx/dt = A x + w` | any | (unit)²/s |
//! | [`LinearStep`] | `R^n`, `x' = F x + w` a step | any | (unit)² a step |
//! | [`DiscreteWhiteAcceleration`] (DWNA) | [`crate::belief::Moving`] | velocity | variance, (tangent unit)²/s⁴ |
//! | [`Custom`] | any | any | yours |
//!
//! Noise is continuous and white, so that results do not depend on how time is cut into steps. The two exceptions say so:
//! `DiscreteWhiteAcceleration` (`Q = σ² G Gᵀ`, `G = [Δ²/2, Δ]`) and `LinearStep`.

mod brownian;
mod camera_velocity;
mod constant_acceleration;
mod constant_velocity;
mod coordinated_turn;
mod custom;
mod discrete;
mod fading;
mod linear;
mod noise;
mod ornstein_uhlenbeck;
mod semidefinite;
mod singer;

pub use brownian::Brownian;
pub use camera_velocity::CameraVelocity;
pub use constant_acceleration::ConstantAcceleration;
pub use constant_velocity::ConstantVelocity;
pub use coordinated_turn::CoordinatedTurn;
pub use custom::Custom;
pub use discrete::DiscreteWhiteAcceleration;
pub use linear::{LinearRate, LinearStep};
pub use noise::driven_noise;
pub use ornstein_uhlenbeck::OrnsteinUhlenbeck;
pub use semidefinite::{PivotedFactor, pivoted_root, semidefinite_root};
pub use singer::Singer;

use crate::error::ConfigError;
use crate::time::Seconds;

/// `1/τ` of a positive time constant.
fn rate_of(tau: Seconds) -> Result<f64, ConfigError> {
    if tau.0.is_finite() && tau.0 > 0.0 {
        return Ok(1.0 / tau.0);
    }
    Err(ConfigError::parameter("time constant", format!("{} s", tau.0), "a positive time"))
}

/// Parts of at most half a unit of `rate Δ` for a noise integral; not more than 64.
fn parts_of(rate: f64, dt: Seconds) -> u32 {
    let halves = (2.0 * rate * dt.0.abs()).ceil();
    halves.clamp(1.0, 64.0) as u32
}

#[cfg(test)]
mod tests;
