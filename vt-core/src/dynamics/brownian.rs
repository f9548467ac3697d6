//! Brownian motion.

use nalgebra::DefaultAllocator;

use super::noise::{check_density, fits};
use crate::agent::Dynamics;
use crate::error::{ConfigError, EstimateError};
use crate::manifold::{Alloc, Manifold, Square, Tangent};
use crate::time::Seconds;

/// A pose that stays where it is but for white noise: `x' = x ⊞ w`, `w ~ N(0, diag(q) |Δt|)`.
///
/// `F = 1`; noise of consecutive steps adds exactly on every manifold.
#[derive(Clone, Debug)]
pub struct Brownian<P: Manifold>
where
    DefaultAllocator: Alloc<P::D>,
{
    density: Tangent<P>,
}

impl<P: Manifold> Brownian<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// Spectral density `q` of each tangent coordinate, in (tangent unit)²/s: m²/s for translations, rad²/s for
    /// rotations. After Δt the standard deviation is `√(q Δt)`. Zero locks a coordinate.
    ///
    /// # Errors
    /// When a density is negative or not finite.
    pub fn new(density: Tangent<P>) -> Result<Self, ConfigError> {
        Ok(Self { density: check_density(density)? })
    }
}

impl<P: Manifold> Dynamics<P> for Brownian<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    fn propagate(&self, state: &P, _: Seconds) -> P {
        state.clone()
    }
    fn propagate_each(&self, _: &mut [P], _: Seconds) {}
    fn jacobian(&self, state: &P, _: Seconds) -> Square<P> {
        Square::<P>::identity_generic(state.dim(), state.dim())
    }
    fn noise(&self, _: &P, dt: Seconds) -> Square<P> {
        Square::<P>::from_diagonal(&(&self.density * dt.0.abs()))
    }
    fn noise_root(&self, _: &P, dt: Seconds) -> Square<P> {
        Square::<P>::from_diagonal(&self.density.map(|q| (q * dt.0.abs()).sqrt()))
    }
    fn fits(&self, state: &P) -> Result<(), EstimateError> {
        fits(&self.density, state)
    }
}
