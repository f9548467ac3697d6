//! Constant velocity with white noise acceleration (CWNA).

use nalgebra::{DefaultAllocator, Dim, DimAdd, DimSum};

use super::noise::{check_density, driven_noise, fits};
use crate::agent::Dynamics;
use crate::batch::{Row, with_rows};
use crate::belief::Moving;
use crate::error::{ConfigError, EstimateError};
use crate::manifold::{Alloc, Manifold, Square, Tangent};
use crate::time::Seconds;

/// `x' = x ⊞ ν Δt`, `ν' = ν`, with continuous white noise on `dν/dt` (on SE(3), `ν` is the body twist).
///
/// Two steps equal one: propagation, `F` and `Q` compose exactly on `R^n`, where
/// `Q = q [Δ³/3 Δ²/2; Δ²/2 Δ]` (Bar-Shalom, Li, Kirubarajan, "Estimation with Applications to Tracking and
/// Navigation", 2001, §6.2.2). On Lie groups propagation and `F` compose exactly too; `Q` is the exact covariance to
/// first order in the noise, its integral over the curved path taken by a rule whose error is of the sixth order in
/// the rotation `|ν Δt|` of the step (relative to `Q`, 1e-11 at 0.1 rad, 1e-5 at 1 rad). On other manifolds all this
/// holds where the coordinates of `ν` keep their meaning along `retract`.
#[derive(Clone, Debug)]
pub struct ConstantVelocity<P: Manifold>
where
    DefaultAllocator: Alloc<P::D>,
{
    density: Tangent<P>,
}

impl<P: Manifold> ConstantVelocity<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// Spectral density `q` of the acceleration noise of each tangent coordinate, in (tangent unit)²/s³: m²/s³ for
    /// translations, rad²/s³ for rotations. After Δt the velocity's standard deviation is `√(q Δt)`. Zero locks a
    /// coordinate (its velocity stays what it is).
    ///
    /// # Errors
    /// When a density is negative or not finite.
    pub fn new(density: Tangent<P>) -> Result<Self, ConfigError> {
        Ok(Self { density: check_density(density)? })
    }
}

impl<P: Manifold> Dynamics<Moving<P>> for ConstantVelocity<P>
where
    P::D: DimAdd<P::D>,
    DefaultAllocator: Alloc<P::D> + Alloc<DimSum<P::D, P::D>>,
{
    fn propagate(&self, state: &Moving<P>, dt: Seconds) -> Moving<P> {
        Moving { pose: state.pose.retract(&(&state.velocity * dt.0)), velocity: state.velocity.clone() }
    }

    fn propagate_each(&self, states: &mut [Moving<P>], dt: Seconds) {
        self.disturb_each(states, dt, &[]);
    }

    fn disturb_each(&self, states: &mut [Moving<P>], dt: Seconds, noise: &[Row]) {
        let n = states.first().map_or(0, |s| s.velocity.len());
        let (pose, velocity) = noise.split_at(n.min(noise.len()));
        with_rows(n + pose.len(), |steps| {
            let (along, aside) = steps.split_at_mut(n);
            aside.copy_from_slice(pose);
            for (k, state) in states.iter_mut().enumerate() {
                for (r, v) in state.velocity.iter_mut().enumerate() {
                    along[r][k] = *v * dt.0;
                    *v += velocity.get(r).map_or(0.0, |row| row[k]);
                }
            }
            P::retract_each(states, |s| &mut s.pose, steps);
        });
    }

    fn jacobian(&self, state: &Moving<P>, dt: Seconds) -> Square<Moving<P>> {
        moved(state, dt.0)
    }

    fn noise(&self, state: &Moving<P>, dt: Seconds) -> Square<Moving<P>> {
        driven_noise(self, state, dt, self.density.as_slice())
    }
    fn fits(&self, state: &Moving<P>) -> Result<(), EstimateError> {
        fits(&self.density, &state.pose)
    }
}

/// Jacobian of `(x, ν) ↦ (x ⊞ ν span, ν)`.
pub(super) fn moved<P: Manifold>(state: &Moving<P>, span: f64) -> Square<Moving<P>>
where
    P::D: DimAdd<P::D>,
    DefaultAllocator: Alloc<P::D> + Alloc<DimSum<P::D, P::D>>,
{
    let n = state.pose.dim();
    let step = &state.velocity * span;
    let mut f = Square::<Moving<P>>::identity_generic(state.dim(), state.dim());
    f.generic_view_mut((0, 0), (n, n)).copy_from(&state.pose.transport(&step));
    f.generic_view_mut((0, n.value()), (n, n)).copy_from(&(state.pose.retract_jacobian(&step) * span));
    f
}
