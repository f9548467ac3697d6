//! Unscented and cubature Kalman filters on manifolds: moments from sigma points, no Jacobians.
//!
//! The points are `x ⊞ ±c l_k` with the columns `l_k` of a Cholesky factor of `P`, and `x` itself; they are drawn
//! anew from the prediction before every correction. Means are manifold means and deviations are taken in the
//! chart at the mean, so that the same code serves `R^n` and SE(3).
//!
//! | rule | `c²` | weight of `x` (mean; covariance) | of the others |
//! |---|---|---|---|
//! | [`Rule::Cubature`] (Arasaratnam, Haykin 2009) | `n` | 0; 0 | `1/(2n)` |
//! | [`Rule::Unscented`] (Julier 1997; Wan, van der Merwe 2000) | `n + λ`, `λ = α²(n + κ) − n` | `λ/(n + λ)`; the same `+ 1 − α² + β` | `1/(2(n + λ))` |
//!
//! A small `α` gives the centre a large negative weight (`α` of 1e-3: −10⁶), and differences of large numbers with it; the
//! cubature rule has no negative weight. With `L Lᵀ = P`, `B` the derivative of the normalised residuals along the columns of
//! `L` (a central difference as wide as the belief) and `Ω` what they vary beyond it, plus unit noise, the correction is
//!
//! ```text
//! G = 1 + B Ω⁻¹ Bᵀ,   δ = −L G⁻¹ B Ω⁻¹ ȳ,   P⁺ = L G⁻¹ Lᵀ,   S = Ω + BᵀB,   det S = det Ω det G
//! ```
//!
//! which equals `P − K S Kᵀ` and is positive semi-definite whatever the rounding.

use nalgebra::{DVector, DefaultAllocator, Dim, Dyn, OMatrix, OVector};
use vt_core::agent::{Dynamics, Estimator};
use vt_core::belief::{Gaussian, State, pose_marginal, symmetrize};
use vt_core::dynamics::semidefinite_root;
use vt_core::error::{ConfigError, EstimateError};
use vt_core::manifold::{Alloc, AllocPair, Manifold, Square, Tangent};
use vt_core::measurement::Measurement;
use vt_core::measurement_model::{MeasurementModel, Reading};
use vt_core::report::{Innovation, StopReason};
use vt_core::robust::Robust;
use vt_core::time::Seconds;

use crate::congruence::cholesky;
use crate::gain::log_det;
use crate::gaussian_filter::GaussianFilter;
use crate::map::maximum_a_posteriori;
use crate::prior::{at_rest, checked, replaces};

/// Where sigma points lie and what they weigh; see the [table](self).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Rule {
    /// Third degree, `2n` points of equal weight.
    #[default]
    Cubature,
    /// Scaled unscented transform, `2n + 1` points.
    Unscented {
        /// Spread of the points, in `(0, 1]`.
        alpha: f64,
        /// What is known of the fourth moment; 2 for Gaussians.
        beta: f64,
        /// Second spread; `n + κ` must be positive.
        kappa: f64,
    },
}

impl Rule {
    /// The usual unscented transform: `α = 1`, `β = 2`, `κ = 0`.
    pub const UNSCENTED: Self = Self::Unscented { alpha: 1.0, beta: 2.0, kappa: 0.0 };

    fn weights(self, n: usize) -> Weights {
        let n = n as f64;
        match self {
            Self::Cubature => Weights { spread: n.sqrt(), mean: 0.0, covariance: 0.0, other: 0.5 / n },
            Self::Unscented { alpha, beta, kappa } => {
                let sum = alpha * alpha * (n + kappa); // n + λ
                let mean = 1.0 - n / sum;
                let covariance = mean + 1.0 - alpha * alpha + beta;
                Weights { spread: sum.sqrt(), mean, covariance, other: 0.5 / sum }
            }
        }
    }

    fn check(self, n: usize) -> Result<(), ConfigError> {
        let Self::Unscented { alpha, beta, kappa } = self else { return Ok(()) };
        if !(alpha > 0.0 && alpha <= 1.0) {
            return Err(ConfigError::parameter("alpha", alpha, "a number above 0, at most 1"));
        }
        if !(beta.is_finite() && beta >= 0.0) {
            return Err(ConfigError::parameter("beta", beta, "zero or a positive number"));
        }
        if !(kappa.is_finite() && n as f64 + kappa > 0.0) {
            return Err(ConfigError::parameter("kappa", kappa, format!("a number above -{n}")));
        }
        Ok(())
    }
}

/// `c`, weights of the centre in means and covariances, weight of every other point.
#[derive(Clone, Copy, Debug)]
struct Weights {
    spread: f64,
    mean: f64,
    covariance: f64,
    other: f64,
}

/// Sigma-point Kalman filter for a state `S` with a pose `P` under the dynamics `M`.
///
/// [`Estimator::correct`] uses the residuals at every sigma point where the measurement has a fixed set of rows with
/// Gaussian noise ([`Measurement::normalized_residuals`]); other measurements are linearised at the iterate, in up to
/// `iterations` Gauss–Newton steps, as in [`crate::kalman`]. [`Self::update`] takes a [`Reading`] without memory from
/// the heap.
#[derive(Clone)]
pub struct SigmaPointFilter<P, S, M>
where
    P: Manifold,
    S: Manifold,
    DefaultAllocator: Alloc<P::D> + Alloc<S::D>,
{
    belief: Gaussian<S>,
    dynamics: M,
    rest: Vec<Tangent<P>>,
    weights: Weights,
    iterations: u32,
    noise_factor: f64,
    points: Vec<S>,
    poses: Vec<P>,
    deviations: Vec<Tangent<S>>,
    rows: Vec<f64>,
}

impl<P, S, M> SigmaPointFilter<P, S, M>
where
    P: Manifold,
    S: State<P>,
    M: Dynamics<S>,
    DefaultAllocator: AllocPair<S::D, P::D>,
{
    /// A filter that starts at rest at `prior`, see [`crate::kalman::KalmanFilter::new`].
    ///
    /// # Errors
    /// When the prior is not finite, not positive semi-definite, or of another dimension than its deviations; when the
    /// rule's numbers are out of range.
    pub fn new(
        prior: &Gaussian<P>,
        rest: Vec<Tangent<P>>,
        dynamics: M,
        rule: Rule,
    ) -> Result<Self, EstimateError> {
        Self::start(at_rest(prior, &rest, &dynamics)?, rest, dynamics, rule)
    }

    /// A filter that starts at a belief over the whole state.
    ///
    /// # Errors
    /// When the belief is not finite or not positive semi-definite, or when the rule's numbers are out of range.
    pub fn from_belief(belief: Gaussian<S>, dynamics: M, rule: Rule) -> Result<Self, EstimateError> {
        Self::start(checked(belief, &dynamics)?, vec![], dynamics, rule)
    }

    /// The same filter with at most so many linearisations for measurements without sigma points.
    #[must_use]
    pub fn iterated(self, iterations: u32) -> Self {
        Self { iterations, ..self }
    }

    fn start(
        belief: Gaussian<S>,
        rest: Vec<Tangent<P>>,
        dynamics: M,
        rule: Rule,
    ) -> Result<Self, EstimateError> {
        let n = belief.mean.dim().value();
        rule.check(n)?;
        Ok(Self {
            weights: rule.weights(n),
            points: Vec::with_capacity(2 * n + 1),
            poses: Vec::with_capacity(2 * n + 1),
            deviations: Vec::with_capacity(2 * n + 1),
            rows: vec![],
            belief,
            dynamics,
            rest,
            iterations: 1,
            noise_factor: 1.0,
        })
    }

    /// Takes in a reading by its values at the sigma points.
    ///
    /// # Errors
    /// When numbers are not finite or the innovation's covariance is not positive definite; the belief is then
    /// unchanged.
    pub fn update<H>(&mut self, reading: &Reading<P, H>) -> Result<Innovation, EstimateError>
    where
        H: MeasurementModel<P> + 'static,
        DefaultAllocator: AllocPair<P::D, H::M> + AllocPair<S::D, H::M>,
    {
        if reading.instrument().loss() != Robust::Square {
            return self.correct(reading);
        }
        reading.fits(self.belief.mean.pose())?;
        let root = semidefinite_root(&self.belief.covariance);
        self.draw(&root);
        let m = reading.z().shape_generic().0;
        let points = core::mem::take(&mut self.points);
        let conditioned = self.condition::<H::M>(&root, m, |k| reading.normalized(points[k].pose()));
        self.points = points;
        conditioned
    }

    /// The points: the mean, then the two of every column of the root.
    fn draw(&mut self, root: &Square<S>) {
        let mean = &self.belief.mean;
        let spread = self.weights.spread;
        self.points.clear();
        self.points.push(mean.clone());
        for column in root.column_iter() {
            let step = column * spread;
            self.points.push(mean.retract(&step));
            self.points.push(mean.retract(&-step));
        }
    }

    /// Conditions the belief on normalised residuals of zero, given those at every point.
    fn condition<R: Dim>(
        &mut self,
        root: &Square<S>,
        m: R,
        residuals: impl Fn(usize) -> OVector<f64, R>,
    ) -> Result<Innovation, EstimateError>
    where
        DefaultAllocator: AllocPair<S::D, R>,
    {
        let n = self.belief.mean.dim();
        let w = self.weights;
        let center = residuals(0);
        let mut mean = &center * w.mean;
        // Second differences: what a linear model would not show.
        let mut b = OMatrix::<f64, S::D, R>::zeros_generic(n, m);
        let mut bend = OMatrix::<f64, S::D, R>::zeros_generic(n, m);
        for k in 0..n.value() {
            let (ahead, behind) = (residuals(2 * k + 1), residuals(2 * k + 2));
            let sum = &ahead + &behind;
            mean.axpy(w.other, &sum, 1.0);
            b.row_mut(k).copy_from(&((ahead - behind) * (w.spread * w.other)).transpose());
            bend.row_mut(k).copy_from(&(sum * 0.5).transpose());
        }
        // Of a pair y± = s ± d around ȳ, w Σ (y − ȳ)(y − ȳ)ᵀ = 2w (s − ȳ)(s − ȳ)ᵀ + 2w d dᵀ, and 2w d dᵀ are rows of BᵀB.
        let mut omega = OMatrix::<f64, R, R>::identity_generic(m, m);
        let off = &center - &mean;
        omega.ger(w.covariance, &off, &off, 1.0);
        for k in 0..n.value() {
            let off = bend.row(k).transpose() - &mean;
            omega.ger(2.0 * w.other, &off, &off, 1.0);
        }
        symmetrize(&mut omega);
        let unfit = EstimateError::NotPositiveDefinite("the innovation's covariance");
        let omega = cholesky(omega).ok_or(unfit)?;
        let half = omega.solve(&b.transpose()); // Ω⁻¹ Bᵀ
        let mut g = &b * &half;
        for k in 0..n.value() {
            g[(k, k)] += 1.0;
        }
        symmetrize(&mut g);
        let unfit = EstimateError::NotPositiveDefinite("the corrected covariance");
        let g = cholesky(g).ok_or(unfit)?;
        let pull = half.tr_mul(&mean); // B Ω⁻¹ ȳ
        let turned = g.solve(&pull);
        let delta = -(root * &turned);
        // L T⁻ᵀ with T Tᵀ = G.
        let mut thin = root.transpose();
        g.l_dirty().solve_lower_triangular_mut(&mut thin);
        let mut covariance = thin.tr_mul(&thin);
        symmetrize(&mut covariance);
        let posterior = Gaussian::from_chart(&self.belief.mean, &delta, covariance);
        if !posterior.is_finite() {
            return Err(EstimateError::NotFinite("the corrected state"));
        }
        self.belief = posterior;
        // S = Ω + BᵀB: det S = det Ω det G, and its inverse by Woodbury's identity.
        let log_det = log_det(omega.l_dirty()) + log_det(g.l_dirty());
        let nis = (mean.dot(&omega.solve(&mean)) - pull.dot(&turned)).max(0.0);
        Ok(Innovation {
            nis,
            dof: mean.len(),
            log_evidence: -0.5 * (nis + log_det),
            iterations: 1,
            stop: StopReason::Direct,
            ..Innovation::default()
        })
    }

    /// Manifold mean of the points and their deviations from it.
    fn moments(&mut self) -> Result<S, EstimateError> {
        let w = self.weights;
        let mut mean = self.points[0].clone();
        for _ in 0..50 {
            self.deviations.clear();
            self.deviations.extend(self.points.iter().map(|p| mean.local(p)));
            let mut step = &self.deviations[0] * w.mean;
            for d in &self.deviations[1..] {
                step.axpy(w.other, d, 1.0);
            }
            let length = step.norm();
            if !length.is_finite() {
                return Err(EstimateError::NotFinite("a predicted sigma point"));
            }
            mean = mean.retract(&step);
            if S::FLAT {
                self.deviations.iter_mut().for_each(|d| *d -= &step);
                break;
            }
            // The deviations are from the last mean; on the way to less than this they need not be taken again.
            if length < 1e-13 {
                break;
            }
        }
        Ok(mean)
    }
}

impl<P, S, M> Estimator<P> for SigmaPointFilter<P, S, M>
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
        z.fits(self.belief.mean.pose())?;
        let root = semidefinite_root(&self.belief.covariance);
        self.draw(&root);
        self.poses.clear();
        self.poses.extend(self.points.iter().map(|s| s.pose().clone()));
        let mut rows = core::mem::take(&mut self.rows);
        let corrected = match z.normalized_residuals(&self.poses, &mut rows) {
            Some(m) if rows.len() == m * self.poses.len() => {
                if m == 0 {
                    return Ok(Innovation::default());
                }
                let mut innovation = self.condition::<Dyn>(&root, Dyn(m), |k| {
                    DVector::from_column_slice(&rows[k * m..(k + 1) * m])
                });
                if let Ok(innovation) = &mut innovation {
                    // Rows without noise of their own say nothing.
                    innovation.dof =
                        (0..m).filter(|&r| rows.iter().skip(r).step_by(m).any(|v| *v != 0.0)).count();
                }
                innovation
            }
            _ => maximum_a_posteriori(&self.belief, z, self.iterations).map(|(posterior, innovation)| {
                self.belief = posterior;
                innovation
            }),
        };
        self.rows = rows;
        corrected
    }

    fn pose(&self) -> Gaussian<P> {
        pose_marginal(&self.belief)
    }

    fn reset(&mut self, prior: &Gaussian<P>) -> Result<(), EstimateError> {
        self.belief = at_rest(prior, &self.rest, &self.dynamics)?;
        Ok(())
    }
}

impl<P, S, M> GaussianFilter<P, S> for SigmaPointFilter<P, S, M>
where
    P: Manifold,
    S: State<P>,
    M: Dynamics<S>,
    DefaultAllocator: AllocPair<S::D, P::D>,
{
    fn belief(&self) -> Gaussian<S> {
        self.belief.clone()
    }

    fn set_belief(&mut self, belief: Gaussian<S>) -> Result<(), EstimateError> {
        replaces(&belief, &self.belief.mean)?;
        self.belief = belief;
        Ok(())
    }

    fn predict_jointly(&mut self, dt: Seconds) -> Result<Square<S>, EstimateError> {
        let w = self.weights;
        let root = semidefinite_root(&self.belief.covariance);
        self.draw(&root);
        for point in &mut self.points {
            *point = self.dynamics.propagate(point, dt);
        }
        let mut covariance = self.dynamics.noise(&self.belief.mean, dt) * self.noise_factor;
        let mean = self.moments()?;
        let n = mean.dim();
        let mut cross = Square::<S>::zeros_generic(n, n);
        let center = &self.deviations[0];
        covariance.ger(w.covariance, center, center, 1.0);
        for k in 0..n.value() {
            let (ahead, behind) = (&self.deviations[2 * k + 1], &self.deviations[2 * k + 2]);
            covariance.ger(w.other, ahead, ahead, 1.0);
            covariance.ger(w.other, behind, behind, 1.0);
            cross.ger(w.other * w.spread, &root.column(k), &(ahead - behind), 1.0);
        }
        symmetrize(&mut covariance);
        let next = Gaussian { mean, covariance };
        if !next.is_finite() {
            return Err(EstimateError::NotFinite("the predicted state"));
        }
        if (0..n.value()).any(|k| next.covariance[(k, k)] < 0.0) {
            return Err(EstimateError::NotPositiveDefinite("the predicted covariance"));
        }
        self.belief = next;
        Ok(cross)
    }

    fn scale_process_noise(&mut self, factor: f64) {
        self.noise_factor = factor;
    }
}
