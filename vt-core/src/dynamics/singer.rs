//! Accelerations that fade (Singer), and that stay (CWPA).

use nalgebra::{DefaultAllocator, Dim, DimAdd, DimSum};

use super::fading::Fading;
use super::noise::{check_density, driven_noise_in, fits};
use crate::agent::Dynamics;
use crate::belief::{Accelerating, Triple};
use crate::error::{ConfigError, EstimateError};
use crate::manifold::{Alloc, Manifold, Square, Tangent};
use crate::time::Seconds;

/// `dx/dt = ν`, `dν/dt = a`, `da/dt = −a/τ` with continuous white noise on `da/dt` (R. Singer, "Estimating optimal
/// tracking filter performance for manned maneuvering targets", 1970).
///
/// A manoeuvre of deviation `σ` that lasts about `τ` has the density `q = 2σ²/τ`. For `τ → ∞` this is
/// [`super::ConstantAcceleration`], for `τ → 0` [`super::ConstantVelocity`] with the density `q τ²`.
///
/// The path is two retractions of the velocity's first two moments, `x' = x ⊞ (½B − 2C) ⊞ (½B + 2C)` with `B = ∫ν dt`,
/// `C = ∫(t/Δ − ½) ν dt`: on `R^n` the exact path; on Lie groups the commutator-free Magnus integrator of fourth order
/// (S. Blanes, P. C. Moan, "Fourth- and sixth-order commutator-free Magnus integrators", 2006). `F` is the exact Jacobian
/// of the step; `Q` the integral of the noise along it, by Gauss–Legendre of five points on parts no longer than `τ/2`
/// (relative error below 1e-12 on `R^n`).
#[derive(Clone, Debug)]
pub struct Singer<P: Manifold>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// `1/τ`.
    pub(super) rate: f64,
    pub(super) density: Tangent<P>,
}

impl<P: Manifold> Singer<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// A model with the time constant `tau` and the spectral density `q` of the jerk noise of each tangent coordinate, in
    /// (tangent unit)²/s⁵. Zero locks a coordinate.
    ///
    /// # Errors
    /// When `tau` is not positive, or a density is negative or not finite.
    pub fn new(tau: Seconds, density: Tangent<P>) -> Result<Self, ConfigError> {
        Ok(Self { rate: super::rate_of(tau)?, density: check_density(density)? })
    }
}

impl<P: Manifold> Dynamics<Accelerating<P>> for Singer<P>
where
    P::D: DimAdd<P::D>,
    DimSum<P::D, P::D>: DimAdd<P::D>,
    DefaultAllocator: Alloc<P::D> + Alloc<Triple<P::D>>,
{
    fn propagate(&self, state: &Accelerating<P>, Seconds(dt): Seconds) -> Accelerating<P> {
        let fading = Fading::new(self.rate * dt);
        let (first, second) = parts(state, dt, fading);
        Accelerating {
            pose: state.pose.retract(&first).retract(&second),
            velocity: &state.velocity + &state.acceleration * (dt * fading.mean),
            acceleration: &state.acceleration * fading.end,
        }
    }

    fn jacobian(&self, state: &Accelerating<P>, Seconds(dt): Seconds) -> Square<Accelerating<P>> {
        let n = state.pose.dim();
        let fading = Fading::new(self.rate * dt);
        let (first, second) = parts(state, dt, fading);
        let middle = state.pose.retract(&first);
        let onward = middle.transport(&second);
        let pose = &onward * state.pose.transport(&first);
        let early = onward * state.pose.retract_jacobian(&first);
        let late = middle.retract_jacobian(&second);
        let size = state.dim();
        let mut f = Square::<Accelerating<P>>::identity_generic(size, size);
        f.generic_view_mut((0, 0), (n, n)).copy_from(&pose);
        f.generic_view_mut((0, n.value()), (n, n)).copy_from(&((&early + &late) * (0.5 * dt)));
        let [a, b] = shares(fading);
        let bent = early * (a * dt * dt) + late * (b * dt * dt);
        f.generic_view_mut((0, 2 * n.value()), (n, n)).copy_from(&bent);
        for k in n.value()..2 * n.value() {
            f[(k, k + n.value())] = dt * fading.mean;
            f[(k + n.value(), k + n.value())] = fading.end;
        }
        f
    }

    fn noise(&self, state: &Accelerating<P>, dt: Seconds) -> Square<Accelerating<P>> {
        driven_noise_in(super::parts_of(self.rate, dt), self, state, dt, self.density.as_slice())
    }
    fn fits(&self, state: &Accelerating<P>) -> Result<(), EstimateError> {
        fits(&self.density, &state.pose)
    }
}

/// Shares of `a Δ²` in the two retractions; `1/12` and `5/12` where it does not fade.
fn shares(fading: Fading) -> [f64; 2] {
    [0.5 * fading.path - 2.0 * fading.late, 0.5 * fading.path + 2.0 * fading.late]
}

/// The two retractions.
fn parts<P: Manifold>(state: &Accelerating<P>, dt: f64, fading: Fading) -> (Tangent<P>, Tangent<P>)
where
    DefaultAllocator: Alloc<P::D>,
{
    let (v, a) = (&state.velocity * (0.5 * dt), &state.acceleration * (dt * dt));
    let [early, late] = shares(fading);
    (&v + &a * early, v + a * late)
}
