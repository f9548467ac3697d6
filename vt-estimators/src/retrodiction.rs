//! Measurements that are one step late, by retrodiction (Y. Bar-Shalom, "Update with out-of-sequence measurements in
//! tracking: exact solution", 2002): algorithms A1 (optimal) and B1 (without the retrodicted noise).
//!
//! A measurement of the time `κ` between the last two, `t_{k−1} ≤ κ < t_k`, corrects the belief of `t_k` at once. With
//! `F = F(κ, k)` back in time, `Q = Q(k, κ)` the noise since, and of the last update `Λ = HᵀS⁻¹H`, `λ = HᵀS⁻¹ν`:
//!
//! ```text
//! ŵ = Q λ (A1; zero in B1)             P_vv = Q − QΛQ (A1; Q in B1)      P_xv = Q − P⁻ΛQ
//! x(κ) = F (x − ŵ)                     P(κ) = F (P + P_vv − P_xv − P_xvᵀ) Fᵀ
//! P_xz = (P − P_xv) Fᵀ Hᵀ              x ← x + P_xz S⁻¹ (z − H x(κ)),    P ← P − P_xz S⁻¹ P_xzᵀ
//! ```
//!
//! A1 equals the right order on linear problems; [`crate::out_of_sequence`] does always, and keeps more.

use nalgebra::DefaultAllocator;
use vt_core::agent::Dynamics;
use vt_core::belief::{Gaussian, State, cholesky, symmetrize};
use vt_core::error::EstimateError;
use vt_core::manifold::{Alloc, AllocPair, Manifold, Square, Tangent};
use vt_core::measurement::Measurement;
use vt_core::measurement_model::{MeasurementModel, Reading};
use vt_core::report::{Innovation, StopReason};
use vt_core::time::Seconds;

use crate::gain::Gain;
use crate::gaussian_filter::linear_prediction;
use crate::kalman::fits;
use crate::prior::checked;

/// Whether the noise since a late measurement is estimated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Retrodiction {
    /// Algorithm A1: it is; optimal.
    #[default]
    Optimal,
    /// Algorithm B1: it counts as zero; its covariance is taken into account.
    WithoutNoise,
}

/// An extended Kalman filter that takes measurements up to one step late.
#[derive(Clone)]
pub struct RetrodictionFilter<S, M>
where
    S: Manifold,
    DefaultAllocator: Alloc<S::D>,
{
    belief: Gaussian<S>,
    dynamics: M,
    last: Option<LastUpdate<S>>,
    span: f64,
}

#[derive(Clone)]
struct LastUpdate<S>
where
    S: Manifold,
    DefaultAllocator: Alloc<S::D>,
{
    /// `P⁻`.
    predicted: Square<S>,
    /// `HᵀS⁻¹H`.
    information: Square<S>,
    /// `HᵀS⁻¹ν`.
    vector: Tangent<S>,
    /// Time since the update before.
    span: f64,
}

impl<S, M> RetrodictionFilter<S, M>
where
    S: Manifold,
    M: Dynamics<S>,
    DefaultAllocator: Alloc<S::D>,
{
    /// A filter that starts at this belief.
    ///
    /// # Errors
    /// When it is not finite or not positive semi-definite.
    pub fn new(belief: Gaussian<S>, dynamics: M) -> Result<Self, EstimateError> {
        Ok(Self { belief: checked(belief, &dynamics)?, dynamics, last: None, span: 0.0 })
    }

    /// The belief of the newest time.
    pub fn belief(&self) -> &Gaussian<S> {
        &self.belief
    }

    /// Advances the belief.
    ///
    /// # Errors
    /// When numbers stop being finite.
    pub fn predict(&mut self, dt: Seconds) -> Result<(), EstimateError> {
        self.belief = linear_prediction(&self.belief, &self.dynamics, dt, 1.0)?.0;
        self.span += dt.0;
        Ok(())
    }

    /// Takes in a reading of the newest time.
    ///
    /// # Errors
    /// When numbers are not finite or sizes differ; the belief is then unchanged.
    pub fn update<P, H>(&mut self, reading: &Reading<P, H>) -> Result<Innovation, EstimateError>
    where
        P: Manifold,
        S: State<P>,
        H: MeasurementModel<P>,
        DefaultAllocator: AllocPair<P::D, H::M> + AllocPair<S::D, H::M> + AllocPair<S::D, P::D>,
    {
        reading.fits(self.belief.mean.pose())?;
        let (nu, h) = reading.linearize(self.belief.mean.pose());
        fits(h.ncols(), self.belief.mean.pose())?;
        let noise = Some(reading.instrument().noise());
        let gain = Gain::<S::D, H::M>::new(&self.belief.covariance, &h, noise)?;
        let n = self.belief.mean.dim();
        let np = h.shape_generic().1;
        let weighted = gain.solve(&h); // S⁻¹ H
        let mut information = Square::<S>::zeros_generic(n, n);
        information.generic_view_mut((0, 0), (np, np)).copy_from(&h.tr_mul(&weighted));
        let mut vector = self.belief.mean.zero();
        vector.rows_generic_mut(0, np).copy_from(&weighted.tr_mul(&nu));
        let (nis, log_det) = gain.surprise(&nu);
        let delta = &gain.gain * &nu;
        let covariance = gain.joseph(&self.belief.covariance, &h, noise);
        let posterior = Gaussian::from_chart(&self.belief.mean, &delta, covariance);
        if !posterior.is_finite() {
            return Err(EstimateError::NotFinite("the corrected state"));
        }
        let predicted = core::mem::replace(&mut self.belief, posterior).covariance;
        self.last = Some(LastUpdate { predicted, information, vector, span: self.span });
        self.span = 0.0;
        Ok(Innovation {
            nis,
            dof: nu.len(),
            log_evidence: 0.5 * (reading.instrument().log_det() - nis - log_det),
            iterations: 1,
            stop: StopReason::Direct,
            ..Innovation::default()
        })
    }

    /// Takes in a reading that is `age` older than the last update.
    ///
    /// # Errors
    /// [`EstimateError::TooLate`] when it is older than the update before that, or when there was none; when the belief was
    /// predicted since; when numbers are not finite or sizes differ. The belief is then unchanged.
    pub fn update_late<P, H>(
        &mut self,
        reading: &Reading<P, H>,
        age: Seconds,
        retrodiction: Retrodiction,
    ) -> Result<Innovation, EstimateError>
    where
        P: Manifold,
        S: State<P>,
        H: MeasurementModel<P>,
        DefaultAllocator: AllocPair<P::D, H::M> + AllocPair<S::D, H::M> + AllocPair<S::D, P::D>,
    {
        if self.span != 0.0 {
            return Err(EstimateError::Unsupported("retrodiction between a prediction and its update"));
        }
        let last = self.last.as_ref().filter(|l| (0.0..=l.span).contains(&age.0));
        let last = last.ok_or(EstimateError::TooLate { seconds: age.0 })?;
        let Gaussian { mean, covariance: p } = &self.belief;
        let back = Seconds(-age.0);
        let then = self.dynamics.propagate(mean, back);
        // Noise from then to now, in the chart now.
        let q = self.dynamics.noise(&then, age);
        let (w, pvv) = match retrodiction {
            Retrodiction::Optimal => (&q * &last.vector, &q - &q * &last.information * &q),
            Retrodiction::WithoutNoise => (mean.zero(), q.clone()),
        };
        let pxv = &q - &last.predicted * &last.information * &q;
        let now = mean.retract(&-w);
        let then = self.dynamics.propagate(&now, back);
        let f = self.dynamics.jacobian(&now, back);
        let mut past = &f * (p + pvv - &pxv - pxv.transpose()) * f.transpose();
        symmetrize(&mut past);
        reading.fits(then.pose())?;
        let (nu, h) = reading.linearize(then.pose());
        fits(h.ncols(), then.pose())?;
        let gain = Gain::<S::D, H::M>::new(&past, &h, Some(reading.instrument().noise()))?;
        let np = h.shape_generic().1;
        let across = ((p - pxv) * f.transpose()).columns_generic(0, np) * h.transpose(); // P_xz
        let weighted = gain.solve(&across.transpose()); // S⁻¹ P_xzᵀ
        let delta = weighted.tr_mul(&nu);
        let mut covariance = p - across * weighted;
        symmetrize(&mut covariance);
        let (nis, log_det) = gain.surprise(&nu);
        let posterior = Gaussian::from_chart(mean, &delta, covariance);
        if !posterior.is_finite() {
            return Err(EstimateError::NotFinite("the corrected state"));
        }
        if cholesky(posterior.covariance.clone()).is_none() {
            return Err(EstimateError::NotPositiveDefinite("the corrected covariance"));
        }
        self.belief = posterior;
        // What the last update knew of the noise is spent.
        self.last = None;
        Ok(Innovation {
            nis,
            dof: nu.len(),
            log_evidence: 0.5 * (reading.instrument().log_det() - nis - log_det),
            iterations: 1,
            stop: StopReason::Direct,
            ..Innovation::default()
        })
    }
}
