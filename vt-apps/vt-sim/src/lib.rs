#![doc = include_str!("../README.md")]

pub mod backdrop;
pub mod bodies;
pub mod bracket;
pub mod camera;
mod lens;
pub mod light;
pub mod noise;
pub mod path;
pub mod planar;
pub mod render;
pub mod scenario;
pub mod scene;
pub mod texture;
