//! What is tracked: shapes, edges, cameras, visibility.

pub mod mesh;
