//! Motion models of your own from two functions.

use nalgebra::DefaultAllocator;

use crate::agent::Dynamics;
use crate::manifold::{Alloc, Manifold, Square};
use crate::time::Seconds;

/// A model from a function for the motion and a function for the noise; `F` by central differences.
///
/// Where speed matters, implement [`Dynamics`] for a type of your own and check it with `dynamics_laws!`.
#[derive(Clone, Debug)]
pub struct Custom<M, N> {
    /// `(state, Δt) ↦ state` without noise.
    pub motion: M,
    /// `(state, Δt) ↦ Q(Δt)` in the tangent space at the new state.
    pub noise: N,
}

impl<S: Manifold, M, N> Dynamics<S> for Custom<M, N>
where
    M: Fn(&S, Seconds) -> S + Send + Sync,
    N: Fn(&S, Seconds) -> Square<S> + Send + Sync,
    DefaultAllocator: Alloc<S::D>,
{
    fn propagate(&self, state: &S, dt: Seconds) -> S {
        (self.motion)(state, dt)
    }
    fn noise(&self, state: &S, dt: Seconds) -> Square<S> {
        (self.noise)(state, dt)
    }
}
