//! Where is a known body in a picture? Automatic initialisation from its model alone.
//!
//! Views of the model from all around are compared with the orientations of the picture's edges at all places, turns and
//! sizes (LINE-MOD: Hinterstoisser and others, 2012); the picture is resized so that the body always has the same few
//! pixels. The best hits of every size are aligned with the edges, compared by a likelihood ratio against edges that
//! are there by chance, and refined by the edge modality. Nothing is learnt and nothing is random.
//!
//! A pose found is a proposal: pictures without the body give some, too, where the background has shapes like it.

mod alignment;
mod candidates;
mod lookalikes;
mod orientation_map;
mod params;
mod reinitializer;
mod scan;
mod search;
mod views;

pub use alignment::{Support, TRUSTED};
pub use params::ViewSearchParams;
pub use reinitializer::ViewReinitializer;
pub use search::{FoundPose, ViewSearch};
