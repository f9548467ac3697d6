//! What all Gaussian filters share: a belief over the whole state, which others may read, mix and set.

use nalgebra::DefaultAllocator;
use vt_core::agent::{Dynamics, Estimator};
use vt_core::belief::{Gaussian, State};
use vt_core::error::EstimateError;
use vt_core::manifold::{Alloc, Manifold, Square};
use vt_core::time::Seconds;

use crate::congruence::{congruence, times_transpose};

/// A filter whose belief over the state `S` is Gaussian, in whatever form it keeps it.
///
/// Multiple models ([`crate::imm`]), smoothers ([`crate::smoother`]) and adaptation ([`crate::adaptive`]) are made of these.
pub trait GaussianFilter<P: Manifold, S: State<P>>: Estimator<P>
where
    DefaultAllocator: Alloc<P::D> + Alloc<S::D>,
{
    /// The belief over the whole state.
    fn belief(&self) -> Gaussian<S>;

    /// Replaces it.
    ///
    /// # Errors
    /// When it is not finite, or not positive semi-definite where that matters; the old belief then stays.
    fn set_belief(&mut self, belief: Gaussian<S>) -> Result<(), EstimateError>;

    /// Predicts, and returns the covariance between the state before (rows, chart at its mean) and after (columns).
    ///
    /// # Errors
    /// As [`Estimator::predict`].
    fn predict_jointly(&mut self, dt: Seconds) -> Result<Square<S>, EstimateError>;

    /// Multiplies the covariance of the process noise of all later predictions by this factor (of the model's own, not
    /// of the last factor).
    fn scale_process_noise(&mut self, factor: f64);
}

/// Mean and covariance after `dt` by linearisation, and the covariance between before and after.
pub(crate) fn linear_prediction<S: Manifold>(
    belief: &Gaussian<S>,
    dynamics: &impl Dynamics<S>,
    dt: Seconds,
    noise_factor: f64,
) -> Result<(Gaussian<S>, Square<S>), EstimateError>
where
    DefaultAllocator: Alloc<S::D>,
{
    let f = dynamics.jacobian(&belief.mean, dt);
    let mean = dynamics.propagate(&belief.mean, dt);
    let covariance =
        congruence::<S::D, S::D>(&f, &belief.covariance) + dynamics.noise(&belief.mean, dt) * noise_factor;
    let cross = times_transpose::<S::D, S::D, S::D, S::D>(&belief.covariance, &f);
    let next = Gaussian { mean, covariance };
    if next.is_finite() { Ok((next, cross)) } else { Err(EstimateError::NotFinite("the predicted state")) }
}
