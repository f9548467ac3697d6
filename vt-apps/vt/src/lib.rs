#![doc = include_str!("../README.md")]

pub mod interrupt;
pub mod progress;
pub mod run;
pub mod sim;
pub mod verdict;
