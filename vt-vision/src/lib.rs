#![doc = include_str!("../README.md")]

pub mod canny;
pub mod color;
pub mod distance_transform;
pub mod edge;
pub mod edge_map;
pub mod edge_search;
pub mod gaussian;
pub mod gradient;
pub mod histogram;
pub mod integral;
pub mod noise;
pub mod plane;
pub mod pyramid;
pub mod turns;
pub mod view_search;
