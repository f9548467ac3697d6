//! Interacting multiple models (H. Blom, Y. Bar-Shalom, "The interacting multiple model algorithm for systems with
//! Markovian switching coefficients", 1988) over any Gaussian filters, on any manifold, with states of unlike size.
//!
//! Probabilities are logarithms throughout. Before each prediction the beliefs are mixed by the probabilities of having
//! switched: means as manifold means, covariances in the chart at the mean with the spread of the means added. A model that
//! lacks coordinates (a pose without a velocity) gives the model that has them what that one believes already, so that
//! mixing with it neither moves nor narrows them.

use core::marker::PhantomData;

use nalgebra::{DMatrix, DefaultAllocator, Dim};
use vt_core::agent::Estimator;
use vt_core::belief::{Extends, Gaussian, State, pose_marginal, symmetrize};
use vt_core::error::{ConfigError, EstimateError};
use vt_core::manifold::{Alloc, Manifold, Square};
use vt_core::math;
use vt_core::measurement::Measurement;
use vt_core::report::Innovation;
use vt_core::time::Seconds;

use crate::gaussian_filter::GaussianFilter;

/// How models follow one another.
#[derive(Clone, Debug, PartialEq)]
pub enum Switching {
    /// Probability of going from a model (row) to another (column) in one prediction, whatever its time.
    Step(DMatrix<f64>),
    /// Switches per second (off the diagonal; the diagonal is ignored). The probabilities of a prediction are
    /// `exp(rates Δt)`, so that results do not depend on how time is cut into steps.
    Rate(DMatrix<f64>),
}

impl Switching {
    /// All switches between `models` models at the same rate: a model lasts `sojourn` in the mean.
    pub fn every(sojourn: Seconds, models: usize) -> Self {
        let rate = 1.0 / (sojourn.0 * (models.saturating_sub(1)).max(1) as f64);
        Self::Rate(DMatrix::from_element(models, models, rate))
    }

    /// The generator or the transition, checked.
    fn check(self, models: usize) -> Result<Self, ConfigError> {
        let (Self::Step(m) | Self::Rate(m)) = &self;
        if m.shape() != (models, models) {
            let found = format!("{} × {}", m.nrows(), m.ncols());
            return Err(ConfigError::parameter("switching", found, format!("{models} × {models}")));
        }
        if let Some(bad) = m.iter().find(|v| !(v.is_finite() && **v >= 0.0)) {
            return Err(ConfigError::parameter("switching", bad, "numbers, zero or positive"));
        }
        match self {
            Self::Step(m) => match m.row_iter().map(|r| r.sum()).find(|sum| (sum - 1.0).abs() > 1e-9) {
                Some(sum) => Err(ConfigError::parameter("switching", sum, "rows that add to 1")),
                None => Ok(Self::Step(m)),
            },
            Self::Rate(mut m) => {
                for k in 0..models {
                    m[(k, k)] = 0.0;
                    m[(k, k)] = -m.row(k).sum();
                }
                Ok(Self::Rate(m))
            }
        }
    }
}

/// One of the models of an [`Imm`] with the common state `C`, which has the coordinates of all.
pub trait Mode<P: Manifold, C: Manifold>: Estimator<P>
where
    DefaultAllocator: Alloc<P::D> + Alloc<C::D>,
{
    /// Its belief over the common state; coordinates that it lacks as in `pad`.
    fn lift(&self, pad: &Gaussian<C>) -> Gaussian<C>;

    /// Takes over its part of a belief.
    ///
    /// # Errors
    /// As [`GaussianFilter::set_belief`].
    fn adopt(&mut self, belief: &Gaussian<C>) -> Result<(), EstimateError>;

    /// Number of its coordinates.
    fn size(&self) -> usize;

    /// A copy.
    fn duplicate(&self) -> Box<dyn Mode<P, C>>;
}

/// A filter over the state `S` as one of several models.
#[derive(Clone)]
struct Member<S, F> {
    filter: F,
    state: PhantomData<fn() -> S>,
}

/// A filter as one of the models of an [`Imm`].
pub fn mode<P, S, C, F>(filter: F) -> Box<dyn Mode<P, C>>
where
    P: Manifold,
    S: State<P>,
    C: Extends<S>,
    F: GaussianFilter<P, S> + Clone + 'static,
    DefaultAllocator: Alloc<P::D> + Alloc<S::D> + Alloc<C::D>,
{
    Box::new(Member { filter, state: PhantomData::<fn() -> S> })
}

impl<P, S, F> Estimator<P> for Member<S, F>
where
    P: Manifold,
    S: State<P>,
    F: GaussianFilter<P, S>,
    DefaultAllocator: Alloc<P::D> + Alloc<S::D>,
{
    fn predict(&mut self, dt: Seconds) -> Result<(), EstimateError> {
        self.filter.predict(dt)
    }
    fn correct(&mut self, z: &dyn Measurement<P>) -> Result<Innovation, EstimateError> {
        self.filter.correct(z)
    }
    fn pose(&self) -> Gaussian<P> {
        self.filter.pose()
    }
    fn reset(&mut self, prior: &Gaussian<P>) -> Result<(), EstimateError> {
        self.filter.reset(prior)
    }
}

impl<P, S, C, F> Mode<P, C> for Member<S, F>
where
    P: Manifold,
    S: State<P>,
    C: Extends<S>,
    F: GaussianFilter<P, S> + Clone + 'static,
    DefaultAllocator: Alloc<P::D> + Alloc<S::D> + Alloc<C::D>,
{
    fn lift(&self, pad: &Gaussian<C>) -> Gaussian<C> {
        let own = self.filter.belief();
        let n = own.mean.dim();
        let mean = pad.mean.with_part(&own.mean);
        let mut covariance = pad.covariance.clone();
        covariance.rows_generic_mut(0, n).fill(0.0);
        covariance.columns_generic_mut(0, n).fill(0.0);
        covariance.generic_view_mut((0, 0), (n, n)).copy_from(&own.covariance);
        Gaussian { mean, covariance }
    }

    fn adopt(&mut self, belief: &Gaussian<C>) -> Result<(), EstimateError> {
        let mean: S = belief.mean.part();
        let n = mean.dim();
        let covariance = belief.covariance.generic_view((0, 0), (n, n)).into_owned();
        self.filter.set_belief(Gaussian { mean, covariance })
    }

    fn size(&self) -> usize {
        self.filter.belief().mean.dim().value()
    }

    fn duplicate(&self) -> Box<dyn Mode<P, C>> {
        Box::new(self.clone())
    }
}

/// Several models of motion at once: the state follows one of them and may change to another at any time.
pub struct Imm<P, C>
where
    P: Manifold,
    C: Manifold,
    DefaultAllocator: Alloc<P::D> + Alloc<C::D>,
{
    modes: Vec<Box<dyn Mode<P, C>>>,
    switching: Switching,
    /// Probabilities of switching in a prediction; where they depend on its time, over the last `span`.
    transition: DMatrix<f64>,
    span: Option<f64>,
    start: Vec<f64>,
    log_probabilities: Vec<f64>,
    combined: Gaussian<C>,
    /// Storage: beliefs before, beliefs mixed, log-probabilities to be.
    before: Vec<Gaussian<C>>,
    mixed: Vec<Gaussian<C>>,
    next: Vec<f64>,
    terms: Vec<f64>,
}

impl<P, C> Clone for Imm<P, C>
where
    P: Manifold,
    C: Manifold,
    DefaultAllocator: Alloc<P::D> + Alloc<C::D>,
{
    fn clone(&self) -> Self {
        Self {
            modes: self.modes.iter().map(|m| m.duplicate()).collect(),
            switching: self.switching.clone(),
            transition: self.transition.clone(),
            span: self.span,
            start: self.start.clone(),
            log_probabilities: self.log_probabilities.clone(),
            combined: self.combined.clone(),
            before: self.before.clone(),
            mixed: self.mixed.clone(),
            next: self.next.clone(),
            terms: self.terms.clone(),
        }
    }
}

impl<P, C> Imm<P, C>
where
    P: Manifold,
    C: State<P>,
    DefaultAllocator: Alloc<P::D> + Alloc<C::D>,
{
    /// Models that start with these probabilities. `belief` stands for coordinates that no model has.
    ///
    /// # Errors
    /// When numbers of models and probabilities differ or probabilities do not add to one, when the switching has another
    /// size or wrong numbers.
    pub fn new(
        modes: Vec<Box<dyn Mode<P, C>>>,
        probabilities: &[f64],
        switching: Switching,
        belief: &Gaussian<C>,
    ) -> Result<Self, ConfigError> {
        if modes.is_empty() || modes.len() != probabilities.len() {
            let found = format!("{} models and {} probabilities", modes.len(), probabilities.len());
            return Err(ConfigError::Mismatch { found, expected: "as many of both, at least one".into() });
        }
        let sum: f64 = probabilities.iter().sum();
        if !(probabilities.iter().all(|p| *p >= 0.0) && (sum - 1.0).abs() <= 1e-9) {
            return Err(ConfigError::parameter("probabilities", sum, "positive numbers that add to 1"));
        }
        let switching = switching.check(modes.len())?;
        let (Switching::Step(transition) | Switching::Rate(transition)) = &switching;
        let start: Vec<f64> = probabilities.iter().map(|p| math::ln(*p)).collect();
        let mut imm = Self {
            log_probabilities: start.clone(),
            start,
            transition: transition.clone(),
            span: None,
            switching,
            combined: belief.clone(),
            before: Vec::with_capacity(modes.len()),
            mixed: Vec::with_capacity(modes.len()),
            next: Vec::with_capacity(modes.len()),
            terms: Vec::with_capacity(modes.len()),
            modes,
        };
        imm.combine().map_err(|e| ConfigError::Mismatch {
            found: e.to_string(),
            expected: "beliefs that can be combined".into(),
        })?;
        Ok(imm)
    }

    /// Probability of each model, in order.
    pub fn probabilities(&self) -> impl Iterator<Item = f64> + '_ {
        self.log_probabilities.iter().map(|l| math::exp(*l))
    }

    /// Mean and covariance of the mixture of all models over the common state.
    pub fn belief(&self) -> &Gaussian<C> {
        &self.combined
    }

    /// The models.
    pub fn modes(&self) -> &[Box<dyn Mode<P, C>>] {
        &self.modes
    }

    /// The mixture's moments from the models' beliefs; coordinates that some lack from the most probable of the largest.
    fn combine(&mut self) -> Result<(), EstimateError> {
        let largest = self.modes.iter().map(|m| m.size()).max().unwrap_or(0);
        let key = |k: &usize| (self.modes[*k].size() == largest, self.log_probabilities[*k]);
        let pad = (0..self.modes.len()).max_by(|a, b| {
            let (a, b) = (key(a), key(b));
            a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
        });
        let Some(pad) = pad else { return Ok(()) };
        let pad = self.modes[pad].lift(&self.combined);
        self.mixed.clear();
        self.mixed.extend(self.modes.iter().map(|m| m.lift(&pad)));
        let weights = self.log_probabilities.iter().map(|l| math::exp(*l));
        self.combined = moments(&self.mixed, weights, pad.mean)?;
        Ok(())
    }

    /// Takes over the probabilities `next`; after an error all is as before the step.
    fn settle(&mut self) -> Result<(), EstimateError> {
        core::mem::swap(&mut self.log_probabilities, &mut self.next);
        let combined = self.combine();
        if combined.is_err() {
            core::mem::swap(&mut self.log_probabilities, &mut self.next);
            self.restore();
        }
        combined
    }

    /// Puts all models back to the beliefs before a step that failed.
    fn restore(&mut self) {
        for (mode, belief) in self.modes.iter_mut().zip(&self.before) {
            // A belief that the model had is one that it takes.
            let _ = mode.adopt(belief);
        }
    }

    fn remember(&mut self) {
        self.before.clear();
        let combined = &self.combined;
        self.before.extend(self.modes.iter().map(|m| m.lift(combined)));
    }
}

/// Mean and covariance of a mixture, from a point near the mean.
fn moments<C: Manifold>(
    parts: &[Gaussian<C>],
    weights: impl Iterator<Item = f64> + Clone,
    near: C,
) -> Result<Gaussian<C>, EstimateError>
where
    DefaultAllocator: Alloc<C::D>,
{
    let mut mean = near;
    for _ in 0..50 {
        let mut step = mean.zero();
        for (part, w) in parts.iter().zip(weights.clone()) {
            step.axpy(w, &mean.local(&part.mean), 1.0);
        }
        let length = step.norm();
        if !length.is_finite() {
            return Err(EstimateError::NotFinite("a model's mean"));
        }
        mean = mean.retract(&step);
        if C::FLAT || length < 1e-13 {
            break;
        }
    }
    let n = mean.dim();
    let mut covariance = Square::<C>::zeros_generic(n, n);
    for (part, w) in parts.iter().zip(weights) {
        let d = mean.local(&part.mean);
        covariance.ger(w, &d, &d, 1.0);
        if C::FLAT {
            covariance += &part.covariance * w;
        } else {
            // part ⊞ ε = mean ⊞ (d + J⁻¹ ε) to first order.
            let back = mean.retract_jacobian(&d).try_inverse();
            let back = back.ok_or(EstimateError::NotFinite("a model's chart"))?;
            covariance += &back * &part.covariance * back.transpose() * w;
        }
    }
    symmetrize(&mut covariance);
    Ok(Gaussian { mean, covariance })
}

impl<P, C> Estimator<P> for Imm<P, C>
where
    P: Manifold,
    C: State<P>,
    DefaultAllocator: Alloc<P::D> + Alloc<C::D>,
{
    fn predict(&mut self, dt: Seconds) -> Result<(), EstimateError> {
        if let Switching::Rate(m) = &self.switching
            && self.span != Some(dt.0)
        {
            self.transition = (m * dt.0.abs()).exp();
            self.span = Some(dt.0);
        }
        let models = self.modes.len();
        self.next.clear();
        self.mixed.clear();
        for j in 0..models {
            self.terms.clear();
            self.terms.extend(
                (0..models).map(|i| math::ln(self.transition[(i, j)].max(0.0)) + self.log_probabilities[i]),
            );
            let total = math::log_sum_exp(&self.terms);
            self.next.push(total);
            let own = self.modes[j].lift(&self.combined);
            // A model that cannot be reached keeps its belief.
            if total.is_finite() {
                self.before.clear();
                self.before.extend(self.modes.iter().map(|m| m.lift(&own)));
                let weights = self.terms.iter().map(|l| math::exp(*l - total));
                self.mixed.push(moments(&self.before, weights, own.mean)?);
            } else {
                self.mixed.push(own);
            }
        }
        self.remember();
        for (mode, belief) in self.modes.iter_mut().zip(&self.mixed) {
            if let Err(e) = mode.adopt(belief).and_then(|()| mode.predict(dt)) {
                self.restore();
                return Err(e);
            }
        }
        self.settle()
    }

    /// NIS is the mean over the models by their probabilities before; the evidence is that of the mixture.
    fn correct(&mut self, z: &dyn Measurement<P>) -> Result<Innovation, EstimateError> {
        self.remember();
        self.next.clear();
        let mut innovation = Innovation::default();
        for (k, mode) in self.modes.iter_mut().enumerate() {
            match mode.correct(z) {
                Ok(one) => {
                    let probability = math::exp(self.log_probabilities[k]);
                    innovation = Innovation { nis: innovation.nis + probability * one.nis, ..one };
                    self.next.push(self.log_probabilities[k] + one.log_evidence);
                }
                Err(e) => {
                    self.restore();
                    return Err(e);
                }
            }
        }
        innovation.log_evidence = math::log_sum_exp(&self.next);
        if !innovation.log_evidence.is_finite() {
            self.restore();
            return Err(EstimateError::ZeroLikelihood);
        }
        self.next.iter_mut().for_each(|l| *l -= innovation.log_evidence);
        self.settle()?;
        Ok(innovation)
    }

    fn pose(&self) -> Gaussian<P> {
        pose_marginal(&self.combined)
    }

    fn reset(&mut self, prior: &Gaussian<P>) -> Result<(), EstimateError> {
        self.remember();
        for mode in &mut self.modes {
            if let Err(e) = mode.reset(prior) {
                self.restore();
                return Err(e);
            }
        }
        self.next.clone_from(&self.start);
        self.settle()
    }
}
