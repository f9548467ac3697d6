//! Motion models for any manifold; the contract is [`crate::agent::Dynamics`].
//!
//! | model | state | noise drives | density unit |
//! |---|---|---|---|
//! | [`Brownian`] | pose | pose | (tangent unit)²/s |
//! | [`ConstantVelocity`] (CWNA) | [`crate::belief::Moving`] | velocity | (tangent unit)²/s³ |
//! | [`ConstantAcceleration`] (CWPA) | [`crate::belief::Accelerating`] | acceleration | (tangent unit)²/s⁵ |
//! | [`Custom`] | any | any | yours |
//!
//! Noise is continuous and white, so that results do not depend on how time is cut into steps. Models whose noise is
//! constant within a step (DWNA: `Q = σ² G Gᵀ`, `G = [Δ²/2, Δ]`) differ and are not these.

mod brownian;
mod constant_acceleration;
mod constant_velocity;
mod custom;
mod linear;
mod noise;

pub use brownian::Brownian;
pub use constant_acceleration::ConstantAcceleration;
pub use constant_velocity::ConstantVelocity;
pub use custom::Custom;
pub use linear::{LinearRate, LinearStep};
pub(crate) use noise::pivoted_factor;
pub use noise::{driven_noise, pivoted_root, semidefinite_root};

#[cfg(test)]
mod tests;
