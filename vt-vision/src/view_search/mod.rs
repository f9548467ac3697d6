//! Where is a known body in a picture? Automatic initialisation from its model alone.

mod alignment;
mod orientation_map;
mod scan;
mod search;
mod views;

pub use alignment::Support;
pub use search::{TRUTH, FoundPose, ViewSearch, ViewSearchParams};
