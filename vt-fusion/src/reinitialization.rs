//! Where a lost target may be.

use nalgebra::DefaultAllocator;
use vt_core::agent::Reinitializer;
use vt_core::belief::Gaussian;
use vt_core::error::MeasureError;
use vt_core::evidence::Evidence;
use vt_core::manifold::{Alloc, Manifold};

/// A set of prior poses, tried one after the other (the paper samples its prior `P(s_0)`).
pub struct PriorPoses<P: Manifold>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// Priors to try.
    pub priors: Vec<Gaussian<P>>,
    /// Factor on the deviations of the last trusted belief, which is tried first; `None` to leave it out.
    pub last_trusted: Option<f64>,
}

impl<P: Manifold> Reinitializer<P> for PriorPoses<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    fn propose(
        &mut self,
        _: &Evidence,
        last: &Gaussian<P>,
        out: &mut Vec<Gaussian<P>>,
    ) -> Result<(), MeasureError> {
        if let Some(factor) = self.last_trusted {
            out.push(Gaussian { mean: last.mean.clone(), covariance: &last.covariance * (factor * factor) });
        }
        out.extend(self.priors.iter().cloned());
        Ok(())
    }
}
