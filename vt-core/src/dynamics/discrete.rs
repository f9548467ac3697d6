//! Noise that is constant within a step (DWNA).

use nalgebra::{DefaultAllocator, Dim, DimAdd, DimSum, U1};

use super::constant_velocity::moved;
use super::noise::{check_density, fits};
use crate::agent::Dynamics;
use crate::belief::Moving;
use crate::error::{ConfigError, EstimateError};
use crate::manifold::{Alloc, Manifold, Square, Tangent};
use crate::time::Seconds;

/// Constant velocity with an acceleration that is constant within each step and independent between steps (DWNA,
/// "discrete white noise acceleration"; Bar-Shalom, Li, Kirubarajan 2001, §6.3.2).
///
/// `Q = G diag(σ²) Gᵀ` with `G = [Δ²/2; Δ]` on `R^n` (on Lie groups its image along the curved path). This is what many
/// filter libraries call discrete white noise. It is not [`super::ConstantVelocity`] (CWNA) at another scale: `Q` has rank
/// one an axis, and **results depend on how time is cut into steps**. Choose it where the acceleration is truly held between
/// samples.
#[derive(Clone, Debug)]
pub struct DiscreteWhiteAcceleration<P: Manifold>
where
    DefaultAllocator: Alloc<P::D>,
{
    variance: Tangent<P>,
}

impl<P: Manifold> DiscreteWhiteAcceleration<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// Variance `σ²` of the acceleration of each tangent coordinate, in (tangent unit)²/s⁴. Zero locks a coordinate.
    ///
    /// # Errors
    /// When a variance is negative or not finite.
    pub fn new(variance: Tangent<P>) -> Result<Self, ConfigError> {
        Ok(Self { variance: check_density(variance)? })
    }
}

impl<P: Manifold> Dynamics<Moving<P>> for DiscreteWhiteAcceleration<P>
where
    P::D: DimAdd<P::D>,
    DefaultAllocator: Alloc<P::D> + Alloc<DimSum<P::D, P::D>>,
{
    fn propagate(&self, state: &Moving<P>, dt: Seconds) -> Moving<P> {
        Moving { pose: state.pose.retract(&(&state.velocity * dt.0)), velocity: state.velocity.clone() }
    }

    fn jacobian(&self, state: &Moving<P>, dt: Seconds) -> Square<Moving<P>> {
        moved(state, dt.0)
    }

    fn noise(&self, state: &Moving<P>, Seconds(dt): Seconds) -> Square<Moving<P>> {
        let n = state.pose.dim().value();
        let f = moved(state, dt);
        let mut q = Square::<Moving<P>>::zeros_generic(state.dim(), state.dim());
        let mut g = Tangent::<Moving<P>>::zeros_generic(state.dim(), U1);
        for k in 0..n {
            // The velocity builds up from zero to aΔ: half of what a velocity of aΔ would do.
            g.copy_from(&f.column(n + k));
            for (row, v) in g.iter_mut().enumerate() {
                *v *= if row < n { 0.5 * dt } else { dt };
            }
            q.ger(self.variance[k], &g, &g, 1.0);
        }
        q
    }
    fn fits(&self, state: &Moving<P>) -> Result<(), EstimateError> {
        fits(&self.variance, &state.pose)
    }
}
