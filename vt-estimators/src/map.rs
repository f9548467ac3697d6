//! One Bayesian correction of a Gaussian belief: the maximum a posteriori of prior and measurement with its
//! covariance (paper Eq. 6). One iteration is the extended Kalman filter, several are the iterated one (equal to
//! Gauss–Newton on prior and data, Bell and Cathey 1993).

use nalgebra::DefaultAllocator;
use vt_core::belief::{Gaussian, State};
use vt_core::dynamics::PivotedFactor;
use vt_core::error::EstimateError;
use vt_core::manifold::{Alloc, AllocPair, Manifold, Square, Tangent};
use vt_core::measurement::{Measurement, NormalEquations};
use vt_core::report::{Innovation, StopReason};

use crate::gain::Gain;

/// Largest step, in deviations of the posterior, after which the iteration counts as converged.
const CONVERGED: f64 = 1e-3;

/// Deviation, as a part of the largest one, below which a coordinate counts as locked.
const LOCKED: f64 = 1e-12;

/// Combines `prior` with the measurement `z` of its pose in at most `iterations` Gauss–Newton steps.
///
/// In the chart at the iterate `x` the prior is `N(μ, P)` and the data say `A δ = b`. With `A = R Rᵀ`, which exists
/// for singular `A` too, the measurement is `y = R⁺b` with unit noise and `H = Rᵀ[1 0]`, which
/// gives `δ = μ + K (y − Hμ)` with the gain and the covariance of `crate::gain`.
///
/// The cost is that of data and prior together, `-ln P(z|x) + ½ ‖x ⊟ prior‖²`. Of several iterations none may raise
/// it: a step that does is halved, and a last step that is not yet small counts only if it does not (one evaluation
/// more). A single iteration is the full step. Coordinates without variance stay where the prior has them.
///
/// # Errors
/// [`EstimateError::NotFinite`] when prior, measurement or result hold NaN or infinity;
/// [`EstimateError::NotPositiveDefinite`] when numbers overflow in between.
pub fn maximum_a_posteriori<P, S>(
    prior: &Gaussian<S>,
    z: &dyn Measurement<P>,
    iterations: u32,
) -> Result<(Gaussian<S>, Innovation), EstimateError>
where
    P: Manifold,
    S: State<P>,
    DefaultAllocator: AllocPair<S::D, P::D>,
{
    if !prior.is_finite() {
        return Err(EstimateError::NotFinite("the prior"));
    }
    z.fits(prior.mean.pose())?;
    let mut equations = NormalEquations::empty(prior.mean.pose());
    let mut innovation = Innovation::default();
    let spread = (iterations > 1).then(|| PivotedFactor::new(&prior.covariance));
    let cost_at = |x: &S, equations: &mut NormalEquations<P>| {
        z.normal_equations(x.pose(), equations);
        if !equations.gradient.iter().chain(equations.information.iter()).all(|v| v.is_finite()) {
            return Err(EstimateError::NotFinite("the measurement"));
        }
        let cost = equations.cost + spread.as_ref().map_or(0.0, |root| departure(prior, root, x));
        if cost.is_finite() { Ok(cost) } else { Err(EstimateError::NotFinite("the cost")) }
    };
    let mut x = prior.mean.clone();
    let mut best: Option<Step<S>> = None;
    for iteration in 1..=iterations.max(1) {
        innovation.iterations = iteration;
        let cost = cost_at(&x, &mut equations)?;
        if let Some(last) = &mut best
            && cost > last.cost
        {
            // The step was too long: go half of it from where the cost was lowest.
            last.delta *= 0.5;
            innovation.stop = StopReason::Iterations;
            if last.settled() {
                last.delta.fill(0.0);
                innovation.stop = StopReason::SmallDecrease;
                break;
            }
            x = last.from.retract(&last.delta);
            continue;
        }
        let (delta, covariance) = Chart::new(prior, &x).correct(&equations, &mut innovation)?;
        let next = x.retract(&delta);
        if !(next.is_finite() && covariance.iter().all(|v| v.is_finite())) {
            return Err(EstimateError::NotFinite("the corrected state"));
        }
        let step = Step { from: x, delta, covariance, cost };
        let settled = step.settled();
        best = Some(step);
        x = next;
        innovation.stop = match (iterations, settled) {
            (0 | 1, _) => StopReason::Direct,
            (_, true) => StopReason::SmallStep,
            _ => StopReason::Iterations,
        };
        if settled {
            break;
        }
    }
    let Some(mut last) = best else { return Err(EstimateError::NotFinite("the measurement")) };
    if innovation.stop == StopReason::Iterations && cost_at(&x, &mut equations)? > last.cost {
        last.delta.fill(0.0);
    }
    Ok((Gaussian::from_chart(&last.from, &last.delta, last.covariance), innovation))
}

/// A Gauss–Newton step from the best point so far.
struct Step<S: Manifold>
where
    DefaultAllocator: Alloc<S::D>,
{
    from: S,
    delta: Tangent<S>,
    /// Posterior covariance in the chart at `from`.
    covariance: Square<S>,
    /// `−ln P(z|x) + ½ ‖x ⊟ prior‖²` at `from`.
    cost: f64,
}

impl<S: Manifold> Step<S>
where
    DefaultAllocator: Alloc<S::D>,
{
    /// True when the step is negligible against the posterior deviation. Locked coordinates do not count: rounding
    /// moves them too.
    fn settled(&self) -> bool {
        let deviation = |k: usize| self.covariance[(k, k)].max(0.0).sqrt();
        let floor = LOCKED * (0..self.delta.len()).map(deviation).fold(0.0, f64::max);
        (0..self.delta.len())
            .all(|k| deviation(k) <= floor || self.delta[k].abs() <= CONVERGED * deviation(k))
    }
}

/// The prior as seen from the iterate: mean and covariance in the chart there.
struct Chart<S: Manifold>
where
    DefaultAllocator: Alloc<S::D>,
{
    mean: Tangent<S>,
    covariance: Square<S>,
}

impl<S: Manifold> Chart<S>
where
    DefaultAllocator: Alloc<S::D>,
{
    fn new(prior: &Gaussian<S>, x: &S) -> Self {
        let (mean, covariance) = prior.in_chart(x);
        Self { mean, covariance }
    }

    fn correct<P: Manifold>(
        &self,
        data: &NormalEquations<P>,
        innovation: &mut Innovation,
    ) -> Result<(Tangent<S>, Square<S>), EstimateError>
    where
        DefaultAllocator: AllocPair<S::D, P::D>,
    {
        let np = data.gradient.shape_generic().0;
        let factor = PivotedFactor::new(&data.information);
        let (root, y) = (&factor.root, factor.solve(&data.gradient));
        let nu = &y - root.tr_mul(&self.mean.rows_generic(0, np));
        let gain = Gain::new(&self.covariance, &root.transpose(), None)?;
        let delta = &self.mean + &gain.gain * &nu;
        let covariance = gain.joseph(&self.covariance, &root.transpose(), None);
        let (nis, log_det) = gain.surprise(&nu);
        innovation.nis = nis;
        // Never more than rows, whatever rounding leaves.
        innovation.dof = factor.rank.min(data.rows);
        innovation.log_evidence = -data.cost + 0.5 * (y.norm_squared() - nis - log_det);
        Ok((delta, covariance))
    }
}

/// `½ ‖x ⊟ prior‖²`, with the factor of the prior's covariance; nothing along coordinates without variance.
fn departure<S: Manifold>(prior: &Gaussian<S>, factor: &PivotedFactor<S::D>, x: &S) -> f64
where
    DefaultAllocator: Alloc<S::D>,
{
    0.5 * factor.solve(&prior.mean.local(x)).norm_squared()
}
