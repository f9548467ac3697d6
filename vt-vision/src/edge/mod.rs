//! Edge modality: the contour of a model against the edges of a picture, at three levels (paper Fig. 4).

mod features;
mod locate;
mod memory;
mod mixture;
mod modality;
mod params;
mod pixel_modality;
mod pixels;
mod residuals;
mod rivals;
mod sketch;

pub use features::{EdgeFeatures, EdgeRow};
pub use memory::AppearanceMemory;
pub use mixture::{EdgeMixture, Line, LineEdge};
pub use modality::EdgeModality;
pub use params::{EdgeParams, Hypotheses};
pub use pixel_modality::EdgePixelModality;
pub use pixels::EdgePixels;
