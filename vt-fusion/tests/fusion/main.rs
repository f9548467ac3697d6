//! Fusion of measurements and the tracking loop, on sensors that deliver numbers.

mod adaptation;
mod fused;
mod groups;
mod loops;
mod losses;
mod observability;
mod placed;
mod sensors;
mod static_fusion;
mod tracks;
