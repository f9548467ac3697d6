//! What is tracked: shapes, edges, cameras, visibility.

#[cfg(feature = "loaders")]
pub mod loaders;
pub mod mesh;
