#![doc = include_str!("../README.md")]

pub mod group;
pub mod loss;
pub mod reinitialization;
pub mod stacked;
pub mod target;
pub mod tracking;

pub use group::Group;
pub use target::{AnyTarget, Target};
pub use tracking::TrackingLoop;
