//! Kalman filters on manifolds, in error-state form: extended and iterated, with the covariance in Joseph's form.

use nalgebra::{DefaultAllocator, Dim};
use vt_core::agent::{Dynamics, Estimator};
use vt_core::belief::{Gaussian, State, pose_marginal};
use vt_core::error::EstimateError;
use vt_core::manifold::{Alloc, AllocPair, Manifold, Square, Tangent};
use vt_core::measurement::Measurement;
use vt_core::measurement_model::{MeasurementModel, Reading};
use vt_core::report::{Innovation, StopReason};
use vt_core::robust::Robust;
use vt_core::time::Seconds;

use crate::congruence::{congruence, mirror};
use crate::gain::Gain;
use crate::gaussian_filter::{GaussianFilter, linear_prediction};
use crate::map::maximum_a_posteriori;
use crate::prior::{at_rest, checked, replaces};

/// Kalman filter for a state `S` with a pose `P` under the dynamics `M`.
///
/// One iteration a correction linearises at the prediction (extended filter: the *loose* mode, with object-level
/// measurements); more iterations find the maximum a posteriori of prior and data together (iterated filter: the
/// *tight* mode, with feature-level measurements).
///
/// [`Estimator::correct`] takes any measurement of the pose by its normal equations; [`KalmanFilter::update`] takes a
/// [`Reading`] by its `H` and `R`, which is faster. Both give the same posterior.
#[derive(Clone)]
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
    considered: Option<Tangent<S>>,
    noise_factor: f64,
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
        let belief = at_rest(prior, &rest, &dynamics)?;
        Ok(Self { belief, dynamics, rest, iterations, considered: None, noise_factor: 1.0 })
    }

    /// An extended filter that starts at a belief over the whole state; resets start at rest with deviations of zero.
    ///
    /// # Errors
    /// When the belief is not finite or not positive semi-definite.
    pub fn from_belief(belief: Gaussian<S>, dynamics: M) -> Result<Self, EstimateError> {
        let belief = checked(belief, &dynamics)?;
        Ok(Self { belief, dynamics, rest: vec![], iterations: 1, considered: None, noise_factor: 1.0 })
    }

    /// The same filter with at most so many linearisations a correction.
    #[must_use]
    pub fn iterated(self, iterations: u32) -> Self {
        Self { iterations, ..self }
    }

    /// The same filter with coordinates that are considered but not estimated: those where `considered` is not zero
    /// (Schmidt 1966). Their uncertainty enters every update, and no update moves them or lessens it. It holds for
    /// [`Self::update`]; `correct` refuses, since it solves for all coordinates at once.
    #[must_use]
    pub fn considering(self, considered: Tangent<S>) -> Self {
        Self { considered: Some(considered), ..self }
    }

    /// The belief over the whole state.
    pub fn belief(&self) -> &Gaussian<S> {
        &self.belief
    }

    /// The motion model.
    pub fn dynamics(&self) -> &M {
        &self.dynamics
    }

    /// Takes in a reading by its `m × m` innovation, without normal equations. With several iterations or an
    /// M-estimator it is [`Estimator::correct`].
    ///
    /// # Errors
    /// When numbers are not finite or sizes differ; the belief is then unchanged.
    pub fn update<H>(&mut self, reading: &Reading<P, H>) -> Result<Innovation, EstimateError>
    where
        H: MeasurementModel<P> + 'static,
        DefaultAllocator: AllocPair<P::D, H::M> + AllocPair<S::D, H::M>,
    {
        let instrument = reading.instrument();
        let direct = self.iterations <= 1 && instrument.loss() == Robust::Square;
        if !direct && self.considered.is_none() {
            return self.correct(reading);
        }
        reading.fits(self.belief.mean.pose())?;
        let (nu, h) = reading.linearize(self.belief.mean.pose());
        fits(h.ncols(), self.belief.mean.pose())?;
        let weight = match instrument.loss() {
            Robust::Square => 1.0,
            loss => loss.weight(reading.normalize(self.belief.mean.pose()).0.norm()),
        };
        let weighted = (weight != 1.0).then(|| instrument.noise() / weight.max(f64::MIN_POSITIVE));
        let noise = weighted.as_ref().unwrap_or(instrument.noise());
        let gain = match Gain::new(&self.belief.covariance, &h, Some(noise)) {
            Ok(gain) => gain,
            // Nearly parallel rows of nearly no noise: normal equations put them together first.
            Err(_) if self.considered.is_none() => return self.correct(reading),
            Err(_) => return self.update_by_rows(reading),
        };
        let (nis, log_det) = gain.surprise(&nu);
        let mut delta = &gain.gain * &nu;
        let mut covariance = gain.joseph(&self.belief.covariance, &h, Some(noise));
        self.keep_considered(&mut delta, &mut covariance);
        let posterior = Gaussian::from_chart(&self.belief.mean, &delta, covariance);
        if !posterior.is_finite() {
            return Err(EstimateError::NotFinite("the corrected state"));
        }
        self.belief = posterior;
        let log_evidence = 0.5 * (instrument.log_det() - nis - log_det);
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

    /// Takes in a reading row by row, each row of the whitened reading a scalar measurement: no matrix is factored. On
    /// one linearisation this is [`Self::update`].
    ///
    /// # Errors
    /// When numbers are not finite or sizes differ; the belief is then unchanged.
    pub fn update_by_rows<H>(&mut self, reading: &Reading<P, H>) -> Result<Innovation, EstimateError>
    where
        H: MeasurementModel<P> + 'static,
        DefaultAllocator: AllocPair<P::D, H::M> + AllocPair<S::D, H::M>,
    {
        reading.fits(self.belief.mean.pose())?;
        let (r, j) = reading.normalize(self.belief.mean.pose());
        fits(j.ncols(), self.belief.mean.pose())?;
        let mut p = self.belief.covariance.clone();
        let mut delta = self.belief.mean.zero();
        let mut innovation =
            Innovation { dof: r.len(), iterations: 1, stop: StopReason::Direct, ..Innovation::default() };
        let a = j.shape_generic().1;
        for k in 0..r.len() {
            let row = j.row(k).transpose();
            let side = p.columns_generic(0, a) * &row; // P Hᵀ
            let s = 1.0 + row.dot(&side.rows_generic(0, a));
            let nu = r[k] - row.dot(&delta.rows_generic(0, a));
            if !(s.is_finite() && s > 0.0 && nu.is_finite()) {
                return Err(EstimateError::NotFinite("the innovation"));
            }
            let gain = &side / s;
            delta.axpy(nu, &gain, 1.0);
            // Joseph's form for one row, in the order of `Gain::joseph`: with A = (1 − KH) P, A − (A Hᵀ − K) Kᵀ.
            p.ger(-1.0, &gain, &side, 1.0);
            let rest = p.columns_generic(0, a) * &row - &gain;
            p.ger(-1.0, &rest, &gain, 1.0);
            mirror(&mut p);
            innovation.nis += nu * nu / s;
            innovation.log_evidence -= 0.5 * (nu * nu / s + vt_core::math::ln(s));
        }
        self.keep_considered(&mut delta, &mut p);
        let posterior = Gaussian::from_chart(&self.belief.mean, &delta, p);
        if !posterior.is_finite() {
            return Err(EstimateError::NotFinite("the corrected state"));
        }
        self.belief = posterior;
        Ok(innovation)
    }
}

impl<P, S, M> KalmanFilter<P, S, M>
where
    P: Manifold,
    S: Manifold,
    DefaultAllocator: Alloc<P::D> + Alloc<S::D>,
{
    /// Gives considered coordinates back what they were believed to be. What is left of the full update is Schmidt's: his gain
    /// is the optimal one without their rows, which changes neither the estimates of the others nor any covariance with them.
    fn keep_considered(&self, delta: &mut Tangent<S>, covariance: &mut Square<S>) {
        let Some(considered) = &self.considered else { return };
        let kept = |k: usize| considered[k] != 0.0;
        for c in (0..considered.len()).filter(|c| kept(*c)) {
            delta[c] = 0.0;
            for r in (0..considered.len()).filter(|r| kept(*r)) {
                covariance[(r, c)] = self.belief.covariance[(r, c)];
            }
        }
    }
}

/// The columns of a Jacobian against the pose's coordinates.
pub(crate) fn fits<P: Manifold>(columns: usize, pose: &P) -> Result<(), EstimateError>
where
    DefaultAllocator: Alloc<P::D>,
{
    let expected = pose.dim().value();
    if columns == expected {
        return Ok(());
    }
    Err(EstimateError::Dimension { what: "the measurement's Jacobian", found: columns, expected })
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
        let mut covariance = self.dynamics.noise(&self.belief.mean, dt);
        if self.noise_factor != 1.0 {
            covariance *= self.noise_factor;
        }
        covariance += congruence::<S::D, S::D>(&f, &self.belief.covariance);
        let next = Gaussian { mean, covariance };
        if !next.is_finite() {
            return Err(EstimateError::NotFinite("the predicted state"));
        }
        self.belief = next;
        Ok(())
    }

    fn correct(&mut self, z: &dyn Measurement<P>) -> Result<Innovation, EstimateError> {
        if self.considered.is_some() {
            return Err(EstimateError::Unsupported(
                "considered coordinates in a correction by normal equations",
            ));
        }
        let (posterior, innovation) = maximum_a_posteriori(&self.belief, z, self.iterations)?;
        self.belief = posterior;
        Ok(innovation)
    }

    fn pose(&self) -> Gaussian<P> {
        pose_marginal(&self.belief)
    }

    fn reset(&mut self, prior: &Gaussian<P>) -> Result<(), EstimateError> {
        self.belief = at_rest(prior, &self.rest, &self.dynamics)?;
        Ok(())
    }
}

impl<P, S, M> GaussianFilter<P, S> for KalmanFilter<P, S, M>
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
        let (next, cross) = linear_prediction(&self.belief, &self.dynamics, dt, self.noise_factor)?;
        self.belief = next;
        Ok(cross)
    }

    fn scale_process_noise(&mut self, factor: f64) {
        self.noise_factor = factor;
    }
}
