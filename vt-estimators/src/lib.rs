#![doc = include_str!("../README.md")]

pub mod association;
pub mod kalman;
pub mod map;
pub mod particle;
mod prior;
pub mod resampling;
