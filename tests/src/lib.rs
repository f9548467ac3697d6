//! What the tests across crates share: data sets and rigs.

pub mod rig;

/// The example of the project's README runs as a test.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
pub struct Readme;
