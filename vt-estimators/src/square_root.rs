//! Square-root Kalman filter: the belief's covariance is kept as a factor `P = L Lᵀ` and never formed.
//!
//! Both steps are orthogonal transformations (Householder) of arrays, which leave `L Lᵀ` positive semi-definite whatever
//! the rounding and keep twice the digits of a covariance (G. Golub, C. Van Loan, "Matrix Computations"; P. Kaminski,
//! A. Bryson, S. Schmidt, "Discrete square root filtering", 1971):
//!
//! ```text
//! [F L  √Q] Θ = [L⁻ 0],      [1  H L⁻; 0  L⁻] Θ = [√S  0; K√S  L⁺]
//! ```

use nalgebra::{DefaultAllocator, Dim, OMatrix, OVector};
use vt_core::agent::{Dynamics, Estimator};
use vt_core::belief::{Gaussian, State, pose_marginal, symmetrize};
use vt_core::dynamics::{PivotedFactor, pivoted_root};
use vt_core::error::EstimateError;
use vt_core::manifold::{Alloc, AllocPair, Manifold, Square, Tangent};
use vt_core::math;
use vt_core::measurement::{Measurement, NormalEquations};
use vt_core::measurement_model::{MeasurementModel, Reading};
use vt_core::report::{Innovation, StopReason};
use vt_core::robust::Robust;
use vt_core::time::Seconds;

use crate::gaussian_filter::GaussianFilter;
use crate::kalman::fits;
use crate::prior::{at_rest, checked, replaces};

/// Extended Kalman filter in square-root form for a state `S` with a pose `P` under the dynamics `M`.
#[derive(Clone)]
pub struct SquareRootFilter<P, S, M>
where
    P: Manifold,
    S: Manifold,
    DefaultAllocator: Alloc<P::D> + Alloc<S::D>,
{
    mean: S,
    /// `L`, of any form.
    root: Square<S>,
    dynamics: M,
    rest: Vec<Tangent<P>>,
    noise_factor: f64,
}

impl<P, S, M> SquareRootFilter<P, S, M>
where
    P: Manifold,
    S: State<P>,
    M: Dynamics<S>,
    DefaultAllocator: AllocPair<S::D, P::D>,
{
    /// A filter that starts at rest at `prior`, see [`crate::kalman::KalmanFilter::new`].
    ///
    /// # Errors
    /// When the prior is not finite, not positive semi-definite, or of another dimension than its deviations.
    pub fn new(prior: &Gaussian<P>, rest: Vec<Tangent<P>>, dynamics: M) -> Result<Self, EstimateError> {
        let Gaussian { mean, covariance } = at_rest(prior, &rest, &dynamics)?;
        Ok(Self { mean, root: pivoted_root(&covariance), dynamics, rest, noise_factor: 1.0 })
    }

    /// A filter that starts at a belief over the whole state.
    ///
    /// # Errors
    /// When the belief is not finite or not positive semi-definite.
    pub fn from_belief(belief: Gaussian<S>, dynamics: M) -> Result<Self, EstimateError> {
        let Gaussian { mean, covariance } = checked(belief, &dynamics)?;
        Ok(Self { mean, root: pivoted_root(&covariance), dynamics, rest: vec![], noise_factor: 1.0 })
    }

    /// The factor `L` with `P = L Lᵀ`.
    pub fn root(&self) -> &Square<S> {
        &self.root
    }

    /// Takes in a reading by its own number of rows.
    ///
    /// # Errors
    /// When numbers are not finite or sizes differ; the belief is then unchanged.
    pub fn update<H>(&mut self, reading: &Reading<P, H>) -> Result<Innovation, EstimateError>
    where
        H: MeasurementModel<P> + 'static,
        DefaultAllocator: AllocPair<P::D, H::M> + AllocPair<S::D, H::M>,
    {
        reading.fits(self.mean.pose())?;
        let (mut nu, mut h) = reading.normalize(self.mean.pose());
        fits(h.ncols(), self.mean.pose())?;
        let loss = reading.instrument().loss();
        if loss != Robust::Square {
            let weight = loss.weight(nu.norm()).sqrt();
            nu *= weight;
            h *= weight;
        }
        let (nis, log_det) = self.condition::<H::M>(&nu, &h)?;
        let log_evidence = -0.5 * (nis + log_det);
        let dof = nu.len();
        Ok(Innovation {
            nis,
            dof,
            log_evidence,
            iterations: 1,
            stop: StopReason::Direct,
            ..Innovation::default()
        })
    }

    /// Conditions the belief on `nu = H δ + v` with unit noise; returns the NIS and `ln det S`.
    fn condition<R: Dim>(
        &mut self,
        nu: &OVector<f64, R>,
        h: &OMatrix<f64, R, P::D>,
    ) -> Result<(f64, f64), EstimateError>
    where
        DefaultAllocator: AllocPair<P::D, R> + AllocPair<S::D, R>,
    {
        let (m, np) = h.shape_generic();
        let n = self.mean.dim();
        let mut s = OMatrix::<f64, R, R>::identity_generic(m, m);
        let mut across = h * self.root.rows_generic(0, np);
        let mut gain = OMatrix::<f64, S::D, R>::zeros_generic(n, m);
        let mut root = self.root.clone();
        eliminate::<R, S::D, S::D>(&mut s, &mut across, &mut gain, &mut root);
        let mut w = nu.clone();
        if !s.solve_lower_triangular_mut(&mut w) {
            return Err(EstimateError::NotPositiveDefinite("the innovation's covariance"));
        }
        let delta = gain * &w;
        let mean = self.mean.retract(&delta);
        if !S::FLAT {
            root = self.mean.retract_jacobian(&delta) * root;
        }
        if !(mean.is_finite() && root.iter().all(|v| v.is_finite())) {
            return Err(EstimateError::NotFinite("the corrected state"));
        }
        (self.mean, self.root) = (mean, root);
        let log_det = (0..s.nrows()).map(|k| 2.0 * math::ln(s[(k, k)].abs())).sum();
        Ok((w.norm_squared(), log_det))
    }
}

/// `[x y; z w] ← [x y; z w] Θ` with an orthogonal `Θ` that makes `x` lower triangular and `y` zero.
fn eliminate<M: Dim, N: Dim, R: Dim>(
    x: &mut OMatrix<f64, M, M>,
    y: &mut OMatrix<f64, M, N>,
    z: &mut OMatrix<f64, R, M>,
    w: &mut OMatrix<f64, R, N>,
) where
    DefaultAllocator: AllocPair<M, N> + AllocPair<R, M> + AllocPair<R, N>,
{
    let (m, n) = (x.nrows(), y.ncols());
    for k in 0..m {
        // The reflection of row k onto its entry k: Θ = 1 − β v vᵀ.
        let mut square = 0.0;
        for c in k..m {
            square += x[(k, c)] * x[(k, c)];
        }
        for c in 0..n {
            square += y[(k, c)] * y[(k, c)];
        }
        let length = square.sqrt();
        if length == 0.0 {
            continue;
        }
        let pivot = x[(k, k)];
        let alpha = if pivot > 0.0 { -length } else { length };
        let head = pivot - alpha;
        let beta = 1.0 / (length * (length + pivot.abs()));
        let tail = x.row(k).transpose();
        let side = y.row(k).transpose();
        let reflect = |a: &mut dyn FnMut(usize) -> f64| {
            let mut dot = a(k) * head;
            for c in k + 1..m {
                dot += a(c) * tail[c];
            }
            dot
        };
        for r in k + 1..m {
            let mut dot = reflect(&mut |c| x[(r, c)]);
            for c in 0..n {
                dot += y[(r, c)] * side[c];
            }
            let step = beta * dot;
            x[(r, k)] -= step * head;
            for c in k + 1..m {
                x[(r, c)] -= step * tail[c];
            }
            for c in 0..n {
                y[(r, c)] -= step * side[c];
            }
        }
        for r in 0..w.nrows() {
            let mut dot = reflect(&mut |c| z[(r, c)]);
            for c in 0..n {
                dot += w[(r, c)] * side[c];
            }
            let step = beta * dot;
            z[(r, k)] -= step * head;
            for c in k + 1..m {
                z[(r, c)] -= step * tail[c];
            }
            for c in 0..n {
                w[(r, c)] -= step * side[c];
            }
        }
        x[(k, k)] = alpha;
        for c in k + 1..m {
            x[(k, c)] = 0.0;
        }
        y.row_mut(k).fill(0.0);
    }
}

impl<P, S, M> Estimator<P> for SquareRootFilter<P, S, M>
where
    P: Manifold,
    S: State<P>,
    M: Dynamics<S>,
    DefaultAllocator: AllocPair<S::D, P::D>,
{
    fn predict(&mut self, dt: Seconds) -> Result<(), EstimateError> {
        self.predict_jointly(dt).map(|_| ())
    }

    fn correct(&mut self, z: &dyn Measurement<P>) -> Result<Innovation, EstimateError> {
        z.fits(self.mean.pose())?;
        let mut data = NormalEquations::empty(self.mean.pose());
        z.normal_equations(self.mean.pose(), &mut data);
        if !data.gradient.iter().chain(data.information.iter()).all(|v| v.is_finite()) {
            return Err(EstimateError::NotFinite("the measurement"));
        }
        let factor = PivotedFactor::new(&data.information);
        let y = factor.solve(&data.gradient);
        let (nis, log_det) = self.condition::<P::D>(&y, &factor.root.transpose())?;
        Ok(Innovation {
            nis,
            dof: factor.rank.min(data.rows),
            log_evidence: -data.cost + 0.5 * (y.norm_squared() - nis - log_det),
            iterations: 1,
            stop: StopReason::Direct,
            ..Innovation::default()
        })
    }

    fn pose(&self) -> Gaussian<P> {
        pose_marginal(&self.belief())
    }

    fn reset(&mut self, prior: &Gaussian<P>) -> Result<(), EstimateError> {
        let Gaussian { mean, covariance } = at_rest(prior, &self.rest, &self.dynamics)?;
        (self.mean, self.root) = (mean, pivoted_root(&covariance));
        Ok(())
    }
}

impl<P, S, M> GaussianFilter<P, S> for SquareRootFilter<P, S, M>
where
    P: Manifold,
    S: State<P>,
    M: Dynamics<S>,
    DefaultAllocator: AllocPair<S::D, P::D>,
{
    fn belief(&self) -> Gaussian<S> {
        let mut covariance = &self.root * self.root.transpose();
        symmetrize(&mut covariance);
        Gaussian { mean: self.mean.clone(), covariance }
    }

    fn set_belief(&mut self, belief: Gaussian<S>) -> Result<(), EstimateError> {
        replaces(&belief, &self.mean)?;
        (self.mean, self.root) = (belief.mean, pivoted_root(&belief.covariance));
        Ok(())
    }

    fn predict_jointly(&mut self, dt: Seconds) -> Result<Square<S>, EstimateError> {
        let n = self.mean.dim();
        let mut moved = self.dynamics.jacobian(&self.mean, dt) * &self.root;
        let cross = &self.root * moved.transpose();
        let mut noise = self.dynamics.noise_root(&self.mean, dt) * self.noise_factor.sqrt();
        let mean = self.dynamics.propagate(&self.mean, dt);
        let mut none = OMatrix::<f64, nalgebra::U1, S::D>::zeros_generic(nalgebra::Const, n);
        eliminate::<S::D, S::D, nalgebra::U1>(&mut moved, &mut noise, &mut none.clone(), &mut none);
        if !(mean.is_finite() && moved.iter().all(|v| v.is_finite())) {
            return Err(EstimateError::NotFinite("the predicted state"));
        }
        (self.mean, self.root) = (mean, moved);
        Ok(cross)
    }

    fn scale_process_noise(&mut self, factor: f64) {
        self.noise_factor = factor;
    }
}
