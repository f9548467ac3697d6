//! Mass centres as object-level measurements: where what moved, or what has the target's colour, is on average (paper Fig. 7).
//!
//! A [`MassSource`] gives every pixel near the prediction a weight. The [`MassCentreModality`] weighs all places that a window of the
//! object's size may have within some deviations of the prediction ([`Places`]): by how much mass it has there, and by how
//! near it is to the prediction. More mass than the object has is no better than as much, and no place is better than that at which the
//! window comes to rest when it slides to the mean place of what is in it. So another mass that touches the object's makes
//! the measurement uncertain along the line between them, one farther off does not draw it away, and nothing seen, or so much that the
//! object may be anywhere, is **no measurement**. Poses with more than a place get information about the place alone.

mod color;
mod measurement;
mod modality;
mod motion;
mod params;
mod places;
mod window;

pub use color::ColorMass;
pub use measurement::CentreMeasurement;
pub use modality::MassCentreModality;
pub use motion::{MotionMass, MotionWeights};
pub use params::MassCentreParams;
pub use places::{MassLikelihood, Placed, Places};
pub use window::Window;

use vt_core::error::MeasureError;
use vt_core::evidence::{Evidence, EvidenceKey};
use vt_core::frame::Roi;

use crate::plane::Plane;

/// Pixels with weights, from some evidence: motion, classes of colours, back-projection.
pub trait MassSource: Send {
    /// Whether the first frame, in which the object fills its predicted box, shows how much mass it has and where.
    const SEEN_AT_START: bool;

    /// Evidence that must be prepared.
    fn needs(&self) -> &[EvidenceKey];

    /// Weights of the pixels of `region` at least, 0 to 255; `None` while there are none. A source that has to learn
    /// what the object looks like does so from the box `object`, where it is predicted.
    ///
    /// # Errors
    /// When the evidence does not fit.
    fn weigh<'a>(
        &'a mut self,
        evidence: &'a Evidence,
        region: Roi,
        object: Roi,
    ) -> Result<Option<&'a Plane<u8>>, MeasureError>;

    /// Drops what was learnt, but for what was given.
    fn forget(&mut self) {}
}
