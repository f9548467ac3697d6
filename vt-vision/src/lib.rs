#![doc = include_str!("../README.md")]

pub mod edge;
pub mod edge_map;
pub mod edge_search;
pub mod gradient;
pub mod noise;
pub mod pyramid;
pub mod view_search;
