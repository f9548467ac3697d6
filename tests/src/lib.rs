//! What the tests across crates share: data sets and rigs.

pub mod rig;
