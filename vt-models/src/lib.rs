#![doc = include_str!("../README.md")]

pub mod appearance;
pub mod camera;
pub mod contour;
pub mod diagnostics;
pub mod edges;
pub mod feature;
pub mod homography;
#[cfg(feature = "loaders")]
pub mod loaders;
pub mod mesh;
pub mod outline;
pub mod plane_pose;
pub mod raster;
#[cfg(feature = "raycast")]
pub mod raycast;
pub mod reprojection;
#[cfg(feature = "raycast")]
pub mod symmetry;
pub mod visibility;
pub mod warp;

pub use vt_core::dynamics;
