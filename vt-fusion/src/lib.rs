#![doc = include_str!("../README.md")]

pub mod fused;
pub mod group;
pub mod loss;
pub mod reinitialization;
pub mod stacked;
pub mod summed;
pub mod target;
pub mod tracking;
pub mod tracks;
mod unobservable;

pub use fused::FusedTarget;
pub use group::Group;
pub use target::{AnyTarget, Target};
pub use tracking::TrackingLoop;
