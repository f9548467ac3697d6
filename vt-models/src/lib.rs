//! What is tracked: shapes, edges, cameras, visibility.

pub mod camera;
pub mod edges;
#[cfg(feature = "loaders")]
pub mod loaders;
pub mod mesh;
pub mod raster;
#[cfg(feature = "raycast")]
pub mod raycast;
pub mod visibility;
