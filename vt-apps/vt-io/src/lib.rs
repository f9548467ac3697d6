#![doc = include_str!("../README.md")]

pub mod canvas;
pub mod covariances;
pub mod files;
pub mod gif;
pub mod images;
pub mod overlay;
pub mod plot;
pub mod poses;
pub mod recording;
pub mod report;
pub mod run_plot;
pub mod sheet;
pub mod steps;
pub mod summary;
pub mod timestamps;
pub mod truth;
