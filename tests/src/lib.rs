//! What the tests across crates share.

pub mod data;
pub mod replay;
