//! Information filter: the belief is kept as the information `Y = P⁻¹`, so that nothing need be known at the start.
//!
//! Around the mean `x` the belief is `−½ δᵀ Y δ + yᵀ δ`. While `Y` is singular, `x` is only the point at which it is
//! written and `y` gathers what is known; as soon as `Y` is regular, `x` moves to `x ⊞ Y⁻¹y` and `y` is zero.
//! Measurements add, `Y ← Y + HᵀR⁻¹H`, in any order; prediction with `M = F⁻ᵀ Y F⁻¹` and `Q = L Lᵀ` is
//!
//! ```text
//! J = M L (1 + Lᵀ M L)⁻¹,   Y⁻ = (1 − J Lᵀ) M (1 − J Lᵀ)ᵀ + J Jᵀ,   y⁻ = (1 − J Lᵀ) F⁻ᵀ y
//! ```
//!
//! (the dual of Joseph's form; P. Maybeck, "Stochastic Models, Estimation, and Control", 1979, §5.7).

use nalgebra::{DefaultAllocator, Dim};
use vt_core::agent::{Dynamics, Estimator};
use vt_core::belief::{Gaussian, State, pose_marginal, symmetrize};
use vt_core::dynamics::PivotedFactor;
use vt_core::error::EstimateError;
use vt_core::manifold::{Alloc, AllocPair, Manifold, Square, Tangent};
use vt_core::measurement::{Measurement, NormalEquations};
use vt_core::report::{Innovation, StopReason};
use vt_core::time::Seconds;

use crate::congruence::{cholesky, congruence};
use crate::gain::log_det;
use crate::gaussian_filter::GaussianFilter;
use crate::prior::{at_rest, checked, replaces};

/// Extended Kalman filter in information form for a state `S` with a pose `P` under the dynamics `M`.
#[derive(Clone)]
pub struct InformationFilter<P, S, M>
where
    P: Manifold,
    S: Manifold,
    DefaultAllocator: Alloc<P::D> + Alloc<S::D>,
{
    mean: S,
    information: Square<S>,
    /// `y`, zero once the information is regular.
    vector: Tangent<S>,
    dynamics: M,
    rest: Vec<Tangent<P>>,
    noise_factor: f64,
}

/// The inverse of a positive definite matrix and the logarithm of its determinant.
fn invert<D: Dim>(m: &nalgebra::OMatrix<f64, D, D>) -> Option<(nalgebra::OMatrix<f64, D, D>, f64)>
where
    DefaultAllocator: Alloc<D>,
{
    // A pivot that is rounding of its own diagonal entry says that the matrix is singular; without pivoting rounding grows.
    let PivotedFactor { root, rank, .. } = PivotedFactor::new(m);
    let regular = rank == m.nrows() && (0..rank).all(|k| root[(k, k)] * root[(k, k)] > 1e-12 * m[(k, k)]);
    let factor = cholesky(m.clone()).filter(|_| regular)?;
    Some((factor.inverse(), log_det(factor.l_dirty())))
}

impl<P, S, M> InformationFilter<P, S, M>
where
    P: Manifold,
    S: State<P>,
    M: Dynamics<S>,
    DefaultAllocator: AllocPair<S::D, P::D>,
{
    /// A filter that starts at rest at `prior`, see [`crate::kalman::KalmanFilter::new`].
    ///
    /// # Errors
    /// When the prior is not finite or not positive definite, or of another dimension than its deviations.
    pub fn new(prior: &Gaussian<P>, rest: Vec<Tangent<P>>, dynamics: M) -> Result<Self, EstimateError> {
        let belief = at_rest(prior, &rest, &dynamics)?;
        Self::start(belief, rest, dynamics)
    }

    /// A filter that starts at a belief over the whole state.
    ///
    /// # Errors
    /// When the belief is not finite or not positive definite.
    pub fn from_belief(belief: Gaussian<S>, dynamics: M) -> Result<Self, EstimateError> {
        Self::start(checked(belief, &dynamics)?, vec![], dynamics)
    }

    /// A filter that knows nothing; its Jacobians are taken at `at` until the data determine a state.
    pub fn ignorant(at: S, dynamics: M) -> Self {
        let n = at.dim();
        let (information, vector) = (Square::<S>::zeros_generic(n, n), at.zero());
        Self { mean: at, information, vector, dynamics, rest: vec![], noise_factor: 1.0 }
    }

    fn start(belief: Gaussian<S>, rest: Vec<Tangent<P>>, dynamics: M) -> Result<Self, EstimateError> {
        let unfit = EstimateError::NotPositiveDefinite("the prior's covariance");
        let (information, _) = invert(&belief.covariance).ok_or(unfit)?;
        let vector = belief.mean.zero();
        Ok(Self { mean: belief.mean, information, vector, dynamics, rest, noise_factor: 1.0 })
    }

    /// `Y`, in the chart at the mean.
    pub fn information(&self) -> &Square<S> {
        &self.information
    }

    /// The belief over the whole state; `None` while the data do not determine all of it.
    pub fn determined(&self) -> Option<Gaussian<S>> {
        let (covariance, _) = invert(&self.information)?;
        Some(Gaussian { mean: self.mean.clone(), covariance })
    }
}

impl<P, S, M> Estimator<P> for InformationFilter<P, S, M>
where
    P: Manifold,
    S: State<P>,
    M: Dynamics<S>,
    DefaultAllocator: AllocPair<S::D, P::D>,
{
    fn predict(&mut self, dt: Seconds) -> Result<(), EstimateError> {
        let n = self.mean.dim();
        let f = self.dynamics.jacobian(&self.mean, dt);
        let l = self.dynamics.noise_root(&self.mean, dt) * self.noise_factor.sqrt();
        let mean = self.dynamics.propagate(&self.mean, dt);
        let back =
            f.try_inverse().ok_or(EstimateError::NotFinite("the inverse of the transition"))?.transpose();
        let m = congruence::<S::D, S::D>(&back, &self.information);
        let ml = &m * &l;
        let mut inner = l.tr_mul(&ml);
        for k in 0..inner.nrows() {
            inner[(k, k)] += 1.0;
        }
        symmetrize(&mut inner);
        let factor =
            cholesky(inner).ok_or(EstimateError::NotPositiveDefinite("the predicted information"))?;
        let j = factor.solve(&ml.transpose()).transpose();
        let keep = Square::<S>::identity_generic(n, n) - &j * l.transpose();
        let mut information = congruence::<S::D, S::D>(&keep, &m) + &j * j.transpose();
        symmetrize(&mut information);
        let vector = keep * (back * &self.vector);
        if !(mean.is_finite() && information.iter().chain(vector.iter()).all(|v| v.is_finite())) {
            return Err(EstimateError::NotFinite("the predicted state"));
        }
        (self.mean, self.information, self.vector) = (mean, information, vector);
        Ok(())
    }

    /// While the information before is singular there is no prediction to compare with: NIS and its degrees of
    /// freedom are zero, and so is the evidence.
    fn correct(&mut self, z: &dyn Measurement<P>) -> Result<Innovation, EstimateError> {
        z.fits(self.mean.pose())?;
        let mut data = NormalEquations::empty(self.mean.pose());
        z.normal_equations(self.mean.pose(), &mut data);
        if !data.gradient.iter().chain(data.information.iter()).all(|v| v.is_finite()) {
            return Err(EstimateError::NotFinite("the measurement"));
        }
        let np = data.gradient.shape_generic().0;
        let before = invert(&self.information);
        let (mut information, mut vector) = (self.information.clone(), self.vector.clone());
        {
            let mut block = information.generic_view_mut((0, 0), (np, np));
            block += &data.information;
            let mut block = vector.rows_generic_mut(0, np);
            block += &data.gradient;
        }
        let mut innovation = Innovation { iterations: 1, stop: StopReason::Direct, ..Innovation::default() };
        let mut mean = self.mean.clone();
        if let Some((covariance, log_det)) = invert(&information) {
            let delta = &covariance * &vector;
            if let Some((_, log_det_before)) = before {
                // yᵀy − bᵀ(Y + A)⁻¹b with yᵀy = bᵀA⁺b.
                let factor = PivotedFactor::new(&data.information);
                let whitened = factor.solve(&data.gradient).norm_squared();
                let explained = vector.dot(&delta);
                innovation.nis = (whitened - explained).max(0.0);
                innovation.dof = factor.rank.min(data.rows);
                innovation.log_evidence = -data.cost + 0.5 * (explained - log_det + log_det_before);
            }
            mean = self.mean.retract(&delta);
            if !S::FLAT {
                let back = self.mean.retract_jacobian(&delta).try_inverse();
                let back = back.ok_or(EstimateError::NotFinite("the corrected state"))?.transpose();
                information = congruence::<S::D, S::D>(&back, &information);
            }
            vector.fill(0.0);
        }
        symmetrize(&mut information);
        if !(mean.is_finite() && information.iter().chain(vector.iter()).all(|v| v.is_finite())) {
            return Err(EstimateError::NotFinite("the corrected state"));
        }
        (self.mean, self.information, self.vector) = (mean, information, vector);
        Ok(innovation)
    }

    /// Infinite variances while the data do not determine the whole state.
    fn pose(&self) -> Gaussian<P> {
        pose_marginal(&self.belief())
    }

    fn reset(&mut self, prior: &Gaussian<P>) -> Result<(), EstimateError> {
        self.set_belief(at_rest(prior, &self.rest, &self.dynamics)?)
    }
}

impl<P, S, M> GaussianFilter<P, S> for InformationFilter<P, S, M>
where
    P: Manifold,
    S: State<P>,
    M: Dynamics<S>,
    DefaultAllocator: AllocPair<S::D, P::D>,
{
    fn belief(&self) -> Gaussian<S> {
        self.determined().unwrap_or_else(|| {
            let mean = self.mean.clone();
            let covariance = Square::<S>::from_diagonal(&mean.zero().map(|_| f64::INFINITY));
            Gaussian { mean, covariance }
        })
    }

    fn set_belief(&mut self, belief: Gaussian<S>) -> Result<(), EstimateError> {
        replaces(&belief, &self.mean)?;
        let unfit = EstimateError::NotPositiveDefinite("the belief's covariance");
        let (information, _) = invert(&belief.covariance).ok_or(unfit)?;
        self.vector.fill(0.0);
        (self.mean, self.information) = (belief.mean, information);
        Ok(())
    }

    fn predict_jointly(&mut self, dt: Seconds) -> Result<Square<S>, EstimateError> {
        let unfit = EstimateError::NotPositiveDefinite("the information");
        let (covariance, _) = invert(&self.information).ok_or(unfit)?;
        let f = self.dynamics.jacobian(&self.mean, dt);
        self.predict(dt)?;
        Ok(covariance * f.transpose())
    }

    fn scale_process_noise(&mut self, factor: f64) {
        self.noise_factor = factor;
    }
}
