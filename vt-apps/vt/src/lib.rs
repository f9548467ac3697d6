#![doc = include_str!("../README.md")]

pub mod eval;
pub mod failure;
pub mod interrupt;
pub mod progress;
pub mod protocol;
pub mod run;
pub mod run_command;
pub mod sequences;
pub mod sim;
pub mod verdict;
