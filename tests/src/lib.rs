//! What the tests across crates share.

pub mod basin;
pub mod data;
pub mod estimators;
pub mod flat;
pub mod logistic;
pub mod monte_carlo;
pub mod planar;
pub mod replay;
pub mod sot;

/// The example of the project's README runs as a test.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
pub struct Readme;
