//! Adaptation of the reference's colours.

use nalgebra::DefaultAllocator;
use vt_core::lie::PlanarMotion;
use vt_core::manifold::Alloc;
use vt_core::time::Timestamp;

use super::likelihood::ColorLikelihood;
use crate::adaptation::Adaptation;

/// A part of which a greater share lies outside of the picture teaches nothing.
const HIDDEN: f64 = 0.1;

impl<P: PlanarMotion> ColorLikelihood<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// Blends the histograms at `pose` into the reference, part by part; not where a part is not all in the picture.
    pub(super) fn adapt(&mut self, adaptation: &mut Adaptation, pose: &P, now: Timestamp) {
        adaptation.start(self.reference.iter().map(|root| root * root));
        let (m, outside) = (pose.matrix(), self.classes - 1);
        let (seen, mut whole) = (adaptation.seen(), true);
        for part in &self.parts {
            self.with_histogram(part, &m, |q, total| {
                whole &= total > 0.0 && q[outside] < HIDDEN;
                seen.extend_from_slice(q);
            });
        }
        if whole {
            self.reference.iter_mut().zip(adaptation.blend(now)).for_each(|(root, q)| *root = q.sqrt());
        }
    }
}
