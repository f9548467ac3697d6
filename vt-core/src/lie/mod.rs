//! Lie groups of motions.
mod se3;
pub use se3::SE3;
