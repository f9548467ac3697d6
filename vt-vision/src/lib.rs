//! What is seen: image processing and the visual modalities.

pub mod edge;
pub mod edge_search;
