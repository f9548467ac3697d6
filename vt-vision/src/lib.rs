#![doc = include_str!("../README.md")]

pub mod canny;
pub mod color;
pub mod color_likelihood;
pub mod contour;
pub mod distance_transform;
pub mod edge;
pub mod edge_map;
pub mod edge_search;
pub mod gaussian;
pub mod gradient;
pub mod histogram;
pub mod integral;
pub mod moments;
pub mod motion;
pub mod noise;
pub mod plane;
pub mod pyramid;
mod rectangle;
mod search_region;
pub mod turns;
pub mod view_search;
