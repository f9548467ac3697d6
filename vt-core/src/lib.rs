#![doc = include_str!("../README.md")]

pub mod agent;
pub mod batch;
pub mod belief;
pub mod dynamics;
pub mod error;
pub mod evidence;
pub mod file;
pub mod frame;
#[cfg(feature = "laws")]
pub mod laws;
pub mod least_squares;
pub mod lie;
pub mod manifold;
pub mod math;
pub mod measurement;
pub mod measurement_model;
pub mod metrics;
pub mod pose_measurement;
pub mod random;
pub mod report;
pub mod robust;
pub mod sketch;
pub mod tempering;
pub mod time;

pub use nalgebra;
