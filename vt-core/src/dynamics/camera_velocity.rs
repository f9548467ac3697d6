//! Constant velocity in the frame that a pose maps to.

use nalgebra::{DefaultAllocator, Dim, DimAdd, DimSum};

use super::noise::{check_density, driven_noise, fits};
use crate::agent::Dynamics;
use crate::belief::Moving;
use crate::error::{ConfigError, EstimateError};
use crate::lie::LieGroup;
use crate::manifold::{Alloc, Manifold, Square, Tangent};
use crate::time::Seconds;

/// `T(t + Δ) = Exp(νΔ) T(t)` with white noise on `dν/dt`: for a pose `camera_from_object` the velocity is that of the
/// **camera's frame** (the paper: "all referred to the camera frame"), where [`super::ConstantVelocity`] has that of the
/// body.
///
/// An object that turns about its own axis and drifts has a constant body twist; one that is seen by a turning camera has
/// a constant twist here. Errors of the pose live in the body frame as everywhere: `F = [1  Ad(T'⁻¹) J_l(νΔ) Δ; 0 1]`.
/// The pose and `F` compose exactly; `Q` as for [`super::ConstantVelocity`].
#[derive(Clone, Debug)]
pub struct CameraVelocity<P: Manifold>
where
    DefaultAllocator: Alloc<P::D>,
{
    density: Tangent<P>,
}

impl<P: Manifold> CameraVelocity<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// Spectral density `q` of the acceleration noise of each tangent coordinate of the camera's frame, in
    /// (tangent unit)²/s³. Zero locks a coordinate.
    ///
    /// # Errors
    /// When a density is negative or not finite.
    pub fn new(density: Tangent<P>) -> Result<Self, ConfigError> {
        Ok(Self { density: check_density(density)? })
    }
}

impl<P> Dynamics<Moving<P>> for CameraVelocity<P>
where
    P: Manifold + LieGroup<Dim = <P as Manifold>::D>,
    P::D: DimAdd<P::D>,
    DefaultAllocator: Alloc<P::D> + Alloc<DimSum<P::D, P::D>>,
{
    fn propagate(&self, state: &Moving<P>, Seconds(dt): Seconds) -> Moving<P> {
        let pose = P::exp(&(&state.velocity * dt)).compose(&state.pose);
        Moving { pose, velocity: state.velocity.clone() }
    }

    fn jacobian(&self, state: &Moving<P>, Seconds(dt): Seconds) -> Square<Moving<P>> {
        let n = state.pose.dim();
        let step = &state.velocity * dt;
        let ahead = P::exp(&step).compose(&state.pose);
        let block = ahead.inverse().adjoint() * P::left_jacobian(&step) * dt;
        let mut f = Square::<Moving<P>>::identity_generic(state.dim(), state.dim());
        f.generic_view_mut((0, n.value()), (n, n)).copy_from(&block);
        f
    }

    fn noise(&self, state: &Moving<P>, dt: Seconds) -> Square<Moving<P>> {
        driven_noise(self, state, dt, self.density.as_slice())
    }
    fn fits(&self, state: &Moving<P>) -> Result<(), EstimateError> {
        fits(&self.density, &state.pose)
    }
}
