#![doc = include_str!("../README.md")]

pub mod canvas;
pub mod covariances;
pub mod images;
pub mod overlay;
pub mod poses;
pub mod recording;
pub mod report;
pub mod sheet;
pub mod steps;
pub mod summary;
pub mod timestamps;
pub mod truth;

mod files;
