//! Constant acceleration with white noise jerk (CWPA).

use nalgebra::{DefaultAllocator, Dim, DimAdd, DimSum};

use super::noise::{check_density, driven_noise};
use crate::agent::Dynamics;
use crate::belief::{Accelerating, Triple};
use crate::error::ConfigError;
use crate::manifold::{Alloc, Manifold, Square, Tangent};
use crate::time::Seconds;

/// `dx/dt = ν`, `dν/dt = a`, with continuous white noise on `da/dt`.
///
/// The path is two retractions, `x' = x ⊞ (½ν Δ + a Δ²/12) ⊞ (½ν Δ + 5a Δ²/12)`: on `R^n` the parabola itself; on Lie
/// groups the commutator-free Magnus integrator of fourth order (S. Blanes, P. C. Moan, "Fourth- and sixth-order
/// commutator-free Magnus integrators", 2006). Two steps equal one: propagation, `F` and `Q` compose exactly on
/// `R^n`, where `Q = q [Δ⁵/20 Δ⁴/8 Δ³/6; Δ⁴/8 Δ³/3 Δ²/2; Δ³/6 Δ²/2 Δ]`, and up to `O(Δ⁵)` in the brackets of `ν` and
/// `a` on Lie groups (exactly where these commute: a screw at varying speed). `F` is the exact Jacobian of the step.
#[derive(Clone, Debug)]
pub struct ConstantAcceleration<P: Manifold>
where
    DefaultAllocator: Alloc<P::D>,
{
    density: Tangent<P>,
}

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
        Ok(Self { density: check_density(density)? })
    }
}

/// Shares of `ν Δ` and `a Δ²` in the two retractions.
const VELOCITY: f64 = 0.5;
const EARLY: f64 = 1.0 / 12.0;
const LATE: f64 = 5.0 / 12.0;

impl<P: Manifold> Dynamics<Accelerating<P>> for ConstantAcceleration<P>
where
    P::D: DimAdd<P::D>,
    DimSum<P::D, P::D>: DimAdd<P::D>,
    DefaultAllocator: Alloc<P::D> + Alloc<Triple<P::D>>,
{
    fn propagate(&self, state: &Accelerating<P>, Seconds(dt): Seconds) -> Accelerating<P> {
        let (v, a) = (&state.velocity * dt, &state.acceleration * (dt * dt));
        let middle = state.pose.retract(&(&v * VELOCITY + &a * EARLY));
        Accelerating {
            pose: middle.retract(&(v * VELOCITY + a * LATE)),
            velocity: &state.velocity + &state.acceleration * dt,
            acceleration: state.acceleration.clone(),
        }
    }

    fn jacobian(&self, state: &Accelerating<P>, Seconds(dt): Seconds) -> Square<Accelerating<P>> {
        let n = state.pose.dim();
        let (v, a) = (&state.velocity * dt, &state.acceleration * (dt * dt));
        let (first, second) = (&v * VELOCITY + &a * EARLY, v * VELOCITY + a * LATE);
        let middle = state.pose.retract(&first);
        let onward = middle.transport(&second);
        let pose = &onward * state.pose.transport(&first);
        let early = onward * state.pose.retract_jacobian(&first);
        let late = middle.retract_jacobian(&second);
        let size = state.dim();
        let mut f = Square::<Accelerating<P>>::identity_generic(size, size);
        f.generic_view_mut((0, 0), (n, n)).copy_from(&pose);
        f.generic_view_mut((0, n.value()), (n, n)).copy_from(&((&early + &late) * (VELOCITY * dt)));
        let bent = early * (EARLY * dt * dt) + late * (LATE * dt * dt);
        f.generic_view_mut((0, 2 * n.value()), (n, n)).copy_from(&bent);
        for k in n.value()..2 * n.value() {
            f[(k, k + n.value())] = dt;
        }
        f
    }

    fn noise(&self, state: &Accelerating<P>, dt: Seconds) -> Square<Accelerating<P>> {
        driven_noise(self, state, dt, self.density.as_slice())
    }
}
