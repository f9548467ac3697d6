//! Smoothers on manifolds: what later measurements say of earlier states (H. Rauch, F. Tung, C. Striebel, "Maximum
//! likelihood estimates of linear dynamic systems", 1965).
//!
//! With `C` the covariance between a state and the next one as predicted from it, the gain is `G = C P⁻⁻¹`, and
//!
//! ```text
//! x_s = x ⊞ G (x_s⁺ ⊟ x⁻),   P_s = P + G (P_s⁺ − P⁻) Gᵀ
//! ```
//!
//! `C` is `P Fᵀ` for linearised filters and comes from the sigma points for the others, so that one smoother serves all.

use std::collections::VecDeque;

use nalgebra::DefaultAllocator;
use vt_core::agent::Estimator;
use vt_core::belief::{Gaussian, State};
use vt_core::error::EstimateError;
use vt_core::manifold::{Alloc, Manifold, Square};
use vt_core::measurement::Measurement;
use vt_core::report::Innovation;
use vt_core::time::Seconds;

use crate::congruence::{cholesky, congruence, divide_columns};
use crate::gaussian_filter::GaussianFilter;

/// A filter that remembers its steps and smooths them: all of them (RTS), or the last few (fixed lag).
///
/// It is an estimator itself and filters as the filter does. A step is a prediction with the corrections after it.
#[derive(Clone)]
pub struct Smoother<S, F>
where
    S: Manifold,
    DefaultAllocator: Alloc<S::D>,
{
    filter: F,
    steps: VecDeque<Remembered<S>>,
    lag: Option<usize>,
}

#[derive(Clone)]
struct Remembered<S>
where
    S: Manifold,
    DefaultAllocator: Alloc<S::D>,
{
    /// Covariance between the step before and this one as predicted; of no use in the first step.
    cross: Square<S>,
    predicted: Gaussian<S>,
    filtered: Gaussian<S>,
}

impl<S, F> Smoother<S, F>
where
    S: Manifold,
    DefaultAllocator: Alloc<S::D>,
{
    /// A smoother that remembers all steps since the start or the last reset, from the filter's belief on.
    pub fn new<P>(filter: F) -> Self
    where
        P: Manifold,
        S: State<P>,
        F: GaussianFilter<P, S>,
        DefaultAllocator: Alloc<P::D>,
    {
        let mut smoother = Self { filter, steps: VecDeque::new(), lag: None };
        smoother.restart::<P>();
        smoother
    }

    /// A smoother that remembers the last `lag` steps and the one before them.
    pub fn fixed_lag<P>(filter: F, lag: usize) -> Self
    where
        P: Manifold,
        S: State<P>,
        F: GaussianFilter<P, S>,
        DefaultAllocator: Alloc<P::D>,
    {
        Self { lag: Some(lag), ..Self::new(filter) }
    }

    /// The filter.
    pub fn filter(&self) -> &F {
        &self.filter
    }

    fn restart<P>(&mut self)
    where
        P: Manifold,
        S: State<P>,
        F: GaussianFilter<P, S>,
        DefaultAllocator: Alloc<P::D>,
    {
        let belief = self.filter.belief();
        let n = belief.mean.dim();
        self.steps.clear();
        let cross = Square::<S>::zeros_generic(n, n);
        self.steps.push_back(Remembered { cross, predicted: belief.clone(), filtered: belief });
    }

    /// Smoothed beliefs of all steps remembered, oldest first.
    ///
    /// # Errors
    /// When a predicted covariance is not positive definite in its free coordinates.
    pub fn smoothed(&self) -> Result<Vec<Gaussian<S>>, EstimateError> {
        let mut beliefs = Vec::with_capacity(self.steps.len());
        self.backward(|belief| beliefs.push(belief.clone()))?;
        beliefs.reverse();
        Ok(beliefs)
    }

    /// Smoothed belief of the oldest step remembered: with a fixed lag, that of so many steps ago.
    ///
    /// # Errors
    /// As [`Self::smoothed`].
    pub fn oldest(&self) -> Result<Gaussian<S>, EstimateError> {
        self.backward(|_| ())
    }

    fn backward(&self, mut each: impl FnMut(&Gaussian<S>)) -> Result<Gaussian<S>, EstimateError> {
        let mut steps = self.steps.iter().rev();
        let last = steps.next().ok_or(EstimateError::NotFinite("the memory of the smoother"))?;
        let mut later = last;
        let mut smoothed = last.filtered.clone();
        each(&smoothed);
        for step in steps {
            smoothed = smooth(&step.filtered, &later.predicted, &later.cross, &smoothed)?;
            each(&smoothed);
            later = step;
        }
        Ok(smoothed)
    }
}

/// One step back.
fn smooth<S: Manifold>(
    filtered: &Gaussian<S>,
    predicted: &Gaussian<S>,
    cross: &Square<S>,
    next: &Gaussian<S>,
) -> Result<Gaussian<S>, EstimateError>
where
    DefaultAllocator: Alloc<S::D>,
{
    let mut p = predicted.covariance.clone();
    for k in 0..p.nrows() {
        // Coordinates without variance are known; their gain is zero since `cross` is.
        if p[(k, k)] == 0.0 {
            p[(k, k)] = 1.0;
        }
    }
    let factor = cholesky(p).ok_or(EstimateError::NotPositiveDefinite("the predicted covariance"))?;
    let mut gain = cross.clone();
    divide_columns(&mut gain, factor.l_dirty());
    let d = predicted.mean.local(&next.mean);
    let mut spread = next.covariance.clone();
    if !S::FLAT {
        // Into the chart at the prediction.
        let back = predicted.mean.retract_jacobian(&d).try_inverse();
        let back = back.ok_or(EstimateError::NotFinite("the smoothed state"))?;
        spread = congruence::<S::D, S::D>(&back, &spread);
    }
    let delta = &gain * d;
    spread -= &predicted.covariance;
    let covariance = &filtered.covariance + congruence::<S::D, S::D>(&gain, &spread);
    let smoothed = Gaussian::from_chart(&filtered.mean, &delta, covariance);
    if smoothed.is_finite() { Ok(smoothed) } else { Err(EstimateError::NotFinite("the smoothed state")) }
}

impl<P, S, F> Estimator<P> for Smoother<S, F>
where
    P: Manifold,
    S: State<P>,
    F: GaussianFilter<P, S>,
    DefaultAllocator: Alloc<P::D> + Alloc<S::D>,
{
    fn predict(&mut self, dt: Seconds) -> Result<(), EstimateError> {
        let cross = self.filter.predict_jointly(dt)?;
        let predicted = self.filter.belief();
        self.steps.push_back(Remembered { cross, filtered: predicted.clone(), predicted });
        if self.lag.is_some_and(|lag| self.steps.len() > lag + 1) {
            self.steps.pop_front();
        }
        Ok(())
    }

    fn correct(&mut self, z: &dyn Measurement<P>) -> Result<Innovation, EstimateError> {
        let innovation = self.filter.correct(z)?;
        if let Some(step) = self.steps.back_mut() {
            step.filtered = self.filter.belief();
        }
        Ok(innovation)
    }

    fn pose(&self) -> Gaussian<P> {
        self.filter.pose()
    }

    fn reset(&mut self, prior: &Gaussian<P>) -> Result<(), EstimateError> {
        self.filter.reset(prior)?;
        self.restart::<P>();
        Ok(())
    }
}
