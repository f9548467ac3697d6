//! Kalman filters.

use std::sync::Arc;

use nalgebra::{DefaultAllocator, DimAdd, DimSum};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use vt_core::agent::{Dynamics, Estimator};
use vt_core::belief::{Gaussian, State};
use vt_core::error::{ConfigError, EstimateError};
use vt_core::manifold::{Alloc, AllocPair, Coordinates, Manifold, Square, Tangent};
use vt_core::time::Seconds;
use vt_estimators::imm::{Imm, Switching, mode};
use vt_estimators::information::InformationFilter;
use vt_estimators::kalman::KalmanFilter;
use vt_estimators::sigma_point::{Rule, SigmaPointFilter};
use vt_estimators::square_root::SquareRootFilter;

use crate::quantity::Span;
use crate::registry::{NoParams, Params};
use crate::roles::{Chosen, EstimatorContext, Motion, StateAlloc};

/// Parameters of the estimator `kalman`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Kalman {
    /// Linearisations a correction: 1 is the extended filter (loose mode), more the iterated one (tight mode).
    pub iterations: u32,
}

impl Default for Kalman {
    fn default() -> Self {
        Self { iterations: 1 }
    }
}

impl Params for Kalman {
    fn check(&self) -> Result<(), ConfigError> {
        if !(1..=100).contains(&self.iterations) {
            return Err(ConfigError::parameter("iterations", self.iterations, "1 to 100"));
        }
        Ok(())
    }
}

pub(super) fn unfit(e: EstimateError) -> ConfigError {
    ConfigError::Mismatch {
        found: e.to_string(),
        expected: "a prior that an estimator can start from".into(),
    }
}

/// Makes an estimator for the state of whichever kind of motion the task chose.
macro_rules! over_states {
    ($context:ident, |$motion:ident, $rest:ident| $filter:expr) => {
        match $context.motion {
            Motion::Pose($motion) => {
                let $rest = vec![];
                Box::new($filter.map_err(unfit)?) as Box<dyn Estimator<P>>
            }
            Motion::Moving($motion, $rest) => Box::new($filter.map_err(unfit)?),
            Motion::Accelerating($motion, $rest) => Box::new($filter.map_err(unfit)?),
        }
    };
}
pub(super) use over_states;

pub(super) fn kalman<P: Coordinates>(
    p: Kalman,
    c: EstimatorContext<P>,
) -> Result<Box<dyn Estimator<P>>, ConfigError>
where
    P::D: DimAdd<P::D>,
    DimSum<P::D, P::D>: DimAdd<P::D>,
    DefaultAllocator: StateAlloc<P::D>,
{
    let prior = c.prior;
    Ok(over_states!(c, |m, rest| KalmanFilter::<P, _, _>::new(&prior, rest, m, p.iterations)))
}

pub(super) fn square_root<P: Coordinates>(
    _: NoParams,
    c: EstimatorContext<P>,
) -> Result<Box<dyn Estimator<P>>, ConfigError>
where
    P::D: DimAdd<P::D>,
    DimSum<P::D, P::D>: DimAdd<P::D>,
    DefaultAllocator: StateAlloc<P::D>,
{
    let prior = c.prior;
    Ok(over_states!(c, |m, rest| SquareRootFilter::<P, _, _>::new(&prior, rest, m)))
}

pub(super) fn information<P: Coordinates>(
    _: NoParams,
    c: EstimatorContext<P>,
) -> Result<Box<dyn Estimator<P>>, ConfigError>
where
    P::D: DimAdd<P::D>,
    DimSum<P::D, P::D>: DimAdd<P::D>,
    DefaultAllocator: StateAlloc<P::D>,
{
    let prior = c.prior;
    Ok(over_states!(c, |m, rest| InformationFilter::<P, _, _>::new(&prior, rest, m)))
}

/// Parameters of the estimator `unscented`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Unscented {
    /// Spread of the points, above 0, at most 1.
    pub alpha: f64,
    /// What is known of the fourth moment; 2 for Gaussians.
    pub beta: f64,
    /// Second spread.
    pub kappa: f64,
    /// Linearisations a correction by measurements whose rows depend on the pose.
    pub iterations: u32,
}

impl Default for Unscented {
    fn default() -> Self {
        Self { alpha: 1.0, beta: 2.0, kappa: 0.0, iterations: 5 }
    }
}

impl Params for Unscented {
    fn check(&self) -> Result<(), ConfigError> {
        if !(self.alpha > 0.0 && self.alpha <= 1.0) {
            return Err(ConfigError::parameter("alpha", self.alpha, "a number above 0, at most 1"));
        }
        if !(self.beta >= 0.0 && self.beta.is_finite()) {
            return Err(ConfigError::parameter("beta", self.beta, "zero or a positive number"));
        }
        // A pose has six coordinates, a state no fewer.
        if !(self.kappa > -6.0 && self.kappa.is_finite()) {
            return Err(ConfigError::parameter("kappa", self.kappa, "a number above -6"));
        }
        Kalman { iterations: self.iterations }.check()
    }
}

pub(super) fn unscented<P: Coordinates>(
    p: Unscented,
    c: EstimatorContext<P>,
) -> Result<Box<dyn Estimator<P>>, ConfigError>
where
    P::D: DimAdd<P::D>,
    DimSum<P::D, P::D>: DimAdd<P::D>,
    DefaultAllocator: StateAlloc<P::D>,
{
    let Unscented { alpha, beta, kappa, iterations } = p;
    sigma_points(Rule::Unscented { alpha, beta, kappa }, iterations, c)
}

/// Parameters of the estimator `cubature`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Cubature {
    /// Linearisations a correction by measurements whose rows depend on the pose.
    pub iterations: u32,
}

impl Default for Cubature {
    fn default() -> Self {
        Self { iterations: 5 }
    }
}

impl Params for Cubature {
    fn check(&self) -> Result<(), ConfigError> {
        Kalman { iterations: self.iterations }.check()
    }
}

pub(super) fn cubature<P: Coordinates>(
    p: Cubature,
    c: EstimatorContext<P>,
) -> Result<Box<dyn Estimator<P>>, ConfigError>
where
    P::D: DimAdd<P::D>,
    DimSum<P::D, P::D>: DimAdd<P::D>,
    DefaultAllocator: StateAlloc<P::D>,
{
    sigma_points(Rule::Cubature, p.iterations, c)
}

fn sigma_points<P: Coordinates>(
    rule: Rule,
    iterations: u32,
    c: EstimatorContext<P>,
) -> Result<Box<dyn Estimator<P>>, ConfigError>
where
    P::D: DimAdd<P::D>,
    DimSum<P::D, P::D>: DimAdd<P::D>,
    DefaultAllocator: StateAlloc<P::D>,
{
    let prior = c.prior;
    Ok(over_states!(c, |m, rest| {
        SigmaPointFilter::<P, _, _>::new(&prior, rest, m, rule).map(|f| f.iterated(iterations))
    }))
}

/// Parameters of the estimator `imm`: the motion of the model in several strengths.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Models {
    /// Strength of each model's noise: factors of its deviation.
    pub strengths: Vec<f64>,
    /// Mean time that a model lasts; 1 s when absent.
    pub sojourn: Option<Span>,
    /// Linearisations a correction.
    pub iterations: u32,
}

impl Default for Models {
    fn default() -> Self {
        Self { strengths: vec![0.3, 2.0], sojourn: None, iterations: 5 }
    }
}

impl Params for Models {
    fn check(&self) -> Result<(), ConfigError> {
        if !(1..=8).contains(&self.strengths.len()) {
            return Err(ConfigError::parameter("strengths", self.strengths.len(), "1 to 8 numbers"));
        }
        if let Some(bad) = self.strengths.iter().find(|s| !(**s > 0.0 && s.is_finite())) {
            return Err(ConfigError::parameter("strengths", bad, "positive numbers"));
        }
        if let Some(sojourn) = self.sojourn.filter(|t| t.si() <= 0.0) {
            return Err(ConfigError::parameter("sojourn", sojourn, "a positive time"));
        }
        Kalman { iterations: self.iterations }.check()
    }
}

pub(super) fn models<P: Coordinates>(
    p: Models,
    c: EstimatorContext<P>,
) -> Result<Box<dyn Estimator<P>>, ConfigError>
where
    P::D: DimAdd<P::D>,
    DimSum<P::D, P::D>: DimAdd<P::D>,
    DefaultAllocator: StateAlloc<P::D>,
{
    let prior = c.prior;
    Ok(match c.motion {
        Motion::Pose(m) => mixture(&p, &prior, &[], m)?,
        Motion::Moving(m, rest) => mixture(&p, &prior, &rest, m)?,
        Motion::Accelerating(m, rest) => mixture(&p, &prior, &rest, m)?,
    })
}

/// One motion in several strengths, shared.
fn mixture<P, S>(
    p: &Models,
    prior: &Gaussian<P>,
    rest: &[Tangent<P>],
    motion: Chosen<S>,
) -> Result<Box<dyn Estimator<P>>, ConfigError>
where
    P: Manifold,
    S: State<P>,
    DefaultAllocator: AllocPair<S::D, P::D>,
{
    let motion = Arc::new(motion);
    let mut modes = vec![];
    for strength in &p.strengths {
        let shared = Strong { motion: motion.clone(), strength: *strength };
        let filter = KalmanFilter::<P, S, _>::new(prior, rest.to_vec(), shared, p.iterations);
        modes.push(mode::<P, S, S, _>(filter.map_err(unfit)?));
    }
    let n = modes.len();
    let switching = Switching::every(Seconds(p.sojourn.map_or(1.0, |t| t.si())), n);
    let belief = S::spread(prior, rest);
    Ok(Box::new(Imm::new(modes, &vec![1.0 / n as f64; n], switching, &belief)?))
}

/// A motion model with the deviation of its noise multiplied by a factor.
struct Strong<S: Manifold>
where
    DefaultAllocator: Alloc<S::D>,
{
    motion: Arc<Chosen<S>>,
    strength: f64,
}

impl<S: Manifold> Clone for Strong<S>
where
    DefaultAllocator: Alloc<S::D>,
{
    fn clone(&self) -> Self {
        Self { motion: self.motion.clone(), strength: self.strength }
    }
}

impl<S: Manifold> Dynamics<S> for Strong<S>
where
    DefaultAllocator: Alloc<S::D>,
{
    fn propagate(&self, state: &S, dt: Seconds) -> S {
        self.motion.propagate(state, dt)
    }
    fn jacobian(&self, state: &S, dt: Seconds) -> Square<S> {
        self.motion.jacobian(state, dt)
    }
    fn noise(&self, state: &S, dt: Seconds) -> Square<S> {
        self.motion.noise(state, dt) * (self.strength * self.strength)
    }
    fn fits(&self, state: &S) -> Result<(), EstimateError> {
        self.motion.fits(state)
    }
}
