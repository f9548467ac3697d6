//! Velocities that fade (Ornstein–Uhlenbeck).

use nalgebra::{DefaultAllocator, Dim, DimAdd, DimSum};

use super::fading::Fading;
use super::noise::{check_density, driven_noise_in, fits};
use crate::agent::Dynamics;
use crate::belief::Moving;
use crate::error::{ConfigError, EstimateError};
use crate::manifold::{Alloc, Manifold, Square, Tangent};
use crate::time::Seconds;

/// `dx/dt = ν`, `dν/dt = −ν/τ` with continuous white noise on `dν/dt`: an integrated Ornstein–Uhlenbeck process.
///
/// Speeds stay bounded, of variance `qτ/2` in the long run: a target that does not run away while it is not seen. The
/// velocity keeps its direction, so that `x' = x ⊞ ν τ(1 − exp(−Δ/τ))` is exact on every Lie group, and two steps equal
/// one; `Q` as for [`super::Singer`].
#[derive(Clone, Debug)]
pub struct OrnsteinUhlenbeck<P: Manifold>
where
    DefaultAllocator: Alloc<P::D>,
{
    rate: f64,
    density: Tangent<P>,
}

impl<P: Manifold> OrnsteinUhlenbeck<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// A model with the time constant `tau` and the spectral density `q` of the acceleration noise of each tangent
    /// coordinate, in (tangent unit)²/s³. Zero locks a coordinate.
    ///
    /// # Errors
    /// When `tau` is not positive, or a density is negative or not finite.
    pub fn new(tau: Seconds, density: Tangent<P>) -> Result<Self, ConfigError> {
        Ok(Self { rate: super::rate_of(tau)?, density: check_density(density)? })
    }
}

impl<P: Manifold> Dynamics<Moving<P>> for OrnsteinUhlenbeck<P>
where
    P::D: DimAdd<P::D>,
    DefaultAllocator: Alloc<P::D> + Alloc<DimSum<P::D, P::D>>,
{
    fn propagate(&self, state: &Moving<P>, Seconds(dt): Seconds) -> Moving<P> {
        let fading = Fading::new(self.rate * dt);
        let pose = state.pose.retract(&(&state.velocity * (dt * fading.mean)));
        Moving { pose, velocity: &state.velocity * fading.end }
    }

    fn jacobian(&self, state: &Moving<P>, Seconds(dt): Seconds) -> Square<Moving<P>> {
        let n = state.pose.dim();
        let fading = Fading::new(self.rate * dt);
        let span = dt * fading.mean;
        let mut f = super::constant_velocity::moved(state, span);
        for k in n.value()..2 * n.value() {
            f[(k, k)] = fading.end;
        }
        f
    }

    fn noise(&self, state: &Moving<P>, dt: Seconds) -> Square<Moving<P>> {
        driven_noise_in(super::parts_of(self.rate, dt), self, state, dt, self.density.as_slice())
    }
    fn fits(&self, state: &Moving<P>) -> Result<(), EstimateError> {
        fits(&self.density, &state.pose)
    }
}
