#![doc = include_str!("../README.md")]

pub mod association;
mod congruence;
mod gain;
pub mod gaussian_filter;
pub mod information;
pub mod kalman;
pub mod map;
pub mod particle;
mod prior;
pub mod resampling;
pub mod sigma_point;
pub mod square_root;
