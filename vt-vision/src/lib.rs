//! What is seen: image processing and the visual modalities.

pub mod edge;
pub mod edge_map;
pub mod edge_search;
pub mod gradient;
pub mod pyramid;
