//! Constant acceleration with white noise jerk (CWPA).

use nalgebra::{DefaultAllocator, DimAdd, DimSum};

use super::noise::{check_density, driven_noise};
use super::singer::Singer;
use crate::agent::Dynamics;
use crate::belief::{Accelerating, Triple};
use crate::error::{ConfigError, EstimateError};
use crate::manifold::{Alloc, Manifold, Square, Tangent};
use crate::time::Seconds;

/// `dx/dt = ν`, `dν/dt = a`, with continuous white noise on `da/dt`: [`Singer`]'s model whose acceleration stays.
///
/// Two steps equal one: propagation, `F` and `Q` compose exactly on `R^n`, where
/// `Q = q [Δ⁵/20 Δ⁴/8 Δ³/6; Δ⁴/8 Δ³/3 Δ²/2; Δ³/6 Δ²/2 Δ]`, and up to `O(Δ⁵)` in the brackets of `ν` and
/// `a` on Lie groups (exactly where these commute: a screw at varying speed). `F` is the exact Jacobian of the step.
#[derive(Clone, Debug)]
pub struct ConstantAcceleration<P: Manifold>(Singer<P>)
where
    DefaultAllocator: Alloc<P::D>;

impl<P: Manifold> ConstantAcceleration<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// Spectral density `q` of the jerk noise of each tangent coordinate, in (tangent unit)²/s⁵: m²/s⁵ for
    /// translations, rad²/s⁵ for rotations. After Δt the acceleration's standard deviation is `√(q Δt)`. Zero locks a
    /// coordinate.
    ///
    /// # Errors
    /// When a density is negative or not finite.
    pub fn new(density: Tangent<P>) -> Result<Self, ConfigError> {
        Ok(Self(Singer { rate: 0.0, density: check_density(density)? }))
    }
}

impl<P: Manifold> Dynamics<Accelerating<P>> for ConstantAcceleration<P>
where
    P::D: DimAdd<P::D>,
    DimSum<P::D, P::D>: DimAdd<P::D>,
    DefaultAllocator: Alloc<P::D> + Alloc<Triple<P::D>>,
{
    fn propagate(&self, state: &Accelerating<P>, dt: Seconds) -> Accelerating<P> {
        self.0.propagate(state, dt)
    }
    fn jacobian(&self, state: &Accelerating<P>, dt: Seconds) -> Square<Accelerating<P>> {
        self.0.jacobian(state, dt)
    }
    fn noise(&self, state: &Accelerating<P>, dt: Seconds) -> Square<Accelerating<P>> {
        driven_noise(&self.0, state, dt, self.0.density.as_slice())
    }
    fn fits(&self, state: &Accelerating<P>) -> Result<(), EstimateError> {
        self.0.fits(state)
    }
}
