//! Kalman filters on manifolds, in error-state form: extended and iterated.

use nalgebra::DefaultAllocator;
use vt_core::agent::{Dynamics, Estimator};
use vt_core::belief::{Gaussian, State, pose_marginal, symmetrize};
use vt_core::error::EstimateError;
use vt_core::manifold::{Alloc, AllocPair, Manifold, Tangent};
use vt_core::measurement::Measurement;
use vt_core::report::Innovation;
use vt_core::time::Seconds;

use crate::map::maximum_a_posteriori;
use crate::prior::at_rest;

/// Kalman filter for a state `S` with a pose `P` under the dynamics `M`.
///
/// One iteration a correction linearises at the prediction (extended filter: the *loose* mode, with object-level
/// measurements); more iterations find the maximum a posteriori of prior and data together (iterated filter: the
/// *tight* mode, with feature-level measurements).
pub struct KalmanFilter<P, S, M>
where
    P: Manifold,
    S: Manifold,
    DefaultAllocator: Alloc<P::D> + Alloc<S::D>,
{
    belief: Gaussian<S>,
    dynamics: M,
    rest: Vec<Tangent<P>>,
    iterations: u32,
}

impl<P, S, M> KalmanFilter<P, S, M>
where
    P: Manifold,
    S: State<P>,
    M: Dynamics<S>,
    DefaultAllocator: AllocPair<S::D, P::D>,
{
    /// A filter that starts at rest at `prior`; `rest` holds the a-priori deviations of the derivatives (velocity,
    /// acceleration) in tangent units per second and second², used at every reset.
    ///
    /// # Errors
    /// When the prior is not finite, not positive semi-definite, or of another dimension than its deviations.
    pub fn new(
        prior: &Gaussian<P>,
        rest: Vec<Tangent<P>>,
        dynamics: M,
        iterations: u32,
    ) -> Result<Self, EstimateError> {
        Ok(Self { belief: at_rest(prior, &rest)?, dynamics, rest, iterations })
    }

    /// The belief over the whole state.
    pub fn belief(&self) -> &Gaussian<S> {
        &self.belief
    }
}

impl<P, S, M> Estimator<P> for KalmanFilter<P, S, M>
where
    P: Manifold,
    S: State<P>,
    M: Dynamics<S>,
    DefaultAllocator: AllocPair<S::D, P::D>,
{
    fn predict(&mut self, dt: Seconds) -> Result<(), EstimateError> {
        let mean = self.dynamics.propagate(&self.belief.mean, dt);
        let f = self.dynamics.jacobian(&self.belief.mean, dt);
        let q = self.dynamics.noise(&self.belief.mean, dt);
        let mut covariance = &f * &self.belief.covariance * f.transpose() + q;
        symmetrize(&mut covariance);
        let next = Gaussian { mean, covariance };
        if !next.is_finite() {
            return Err(EstimateError::NotFinite("the predicted state"));
        }
        self.belief = next;
        Ok(())
    }

    fn correct(&mut self, z: &dyn Measurement<P>) -> Result<Innovation, EstimateError> {
        let (posterior, innovation) = maximum_a_posteriori(&self.belief, z, self.iterations)?;
        self.belief = posterior;
        Ok(innovation)
    }

    fn pose(&self) -> Gaussian<P> {
        pose_marginal(&self.belief)
    }

    fn reset(&mut self, prior: &Gaussian<P>) -> Result<(), EstimateError> {
        self.belief = at_rest(prior, &self.rest)?;
        Ok(())
    }
}
