#![doc = include_str!("../README.md")]

pub mod bracket;
pub mod camera;
pub mod path;
pub mod scene;
pub mod texture;
