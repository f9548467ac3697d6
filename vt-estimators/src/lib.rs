#![doc = include_str!("../README.md")]

pub mod adaptive;
pub mod association;
mod congruence;
mod gain;
pub mod gaussian_filter;
pub mod imm;
pub mod information;
pub mod kalman;
#[cfg(feature = "faer")]
mod large;
pub mod map;
pub mod out_of_sequence;
pub mod particle;
mod prior;
pub mod resampling;
pub mod retrodiction;
pub mod sigma_point;
pub mod smoother;
pub mod square_root;
