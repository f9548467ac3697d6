//! One Bayesian correction of a Gaussian belief: the maximum a posteriori of prior and measurement with its
//! covariance (paper Eq. 6). One iteration is the extended Kalman filter, several are the iterated one (equal to
//! Gauss–Newton on prior and data, Bell and Cathey 1993).

use nalgebra::{DefaultAllocator, Dim, OMatrix, OVector, U1};
use vt_core::belief::{Gaussian, State, cholesky, symmetrize};
use vt_core::dynamics::semidefinite_root;
use vt_core::error::EstimateError;
use vt_core::manifold::{Alloc, AllocPair, Manifold, Square, Tangent};
use vt_core::math;
use vt_core::measurement::{Measurement, NormalEquations};
use vt_core::report::{Innovation, StopReason};

/// Largest step, in deviations of the posterior, after which the iteration counts as converged.
const CONVERGED: f64 = 1e-3;

/// Deviation, as a part of the largest one, below which a coordinate counts as locked.
const LOCKED: f64 = 1e-12;

/// Combines `prior` with the measurement `z` of its pose in at most `iterations` Gauss–Newton steps.
///
/// In the chart at the iterate `x` the prior is `N(μ, P)` and the data say `A δ = b`. With `A = R Rᵀ`, which exists
/// for singular `A` too, the measurement is `y = R⁺b` with unit noise and `H = Rᵀ[1 0]`, and
///
/// ```text
/// S = 1 + H P Hᵀ,   K = P Hᵀ S⁻¹,   δ = μ + K (y − Hμ),   P⁺ = (1 − KH) P (1 − KH)ᵀ + K Kᵀ   (Joseph)
/// ```
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
    let mut equations = NormalEquations::empty(prior.mean.pose());
    let mut innovation = Innovation::default();
    let spread = (iterations > 1).then(|| semidefinite_root(&prior.covariance));
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
    let covariance = reset(&last.from, &last.delta, last.covariance);
    Ok((Gaussian { mean: last.from.retract(&last.delta), covariance }, innovation))
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
        // x ⊞ δ = prior ⊞ (away + J⁻¹ δ) to first order: the prior's mean lies at δ = −J away.
        let away = prior.mean.local(x);
        let moved = prior.mean.retract_jacobian(&away);
        let mut covariance = &moved * &prior.covariance * moved.transpose();
        symmetrize(&mut covariance);
        Self { mean: -(moved * away), covariance }
    }

    fn correct<P: Manifold>(
        &self,
        data: &NormalEquations<P>,
        innovation: &mut Innovation,
    ) -> Result<(Tangent<S>, Square<S>), EstimateError>
    where
        DefaultAllocator: AllocPair<S::D, P::D>,
    {
        let (n, np) = (self.mean.shape_generic().0, data.gradient.shape_generic().0);
        let root = semidefinite_root(&data.information);
        let gain_side = self.covariance.columns_generic(0, np) * &root; // P Hᵀ
        let mut s = root.tr_mul(&gain_side.rows_generic(0, np)); // H P Hᵀ
        symmetrize(&mut s);
        for k in 0..s.nrows() {
            s[(k, k)] += 1.0;
        }
        let y = pseudo_solve(&root, &data.gradient);
        let nu = &y - root.tr_mul(&self.mean.rows_generic(0, np));
        // S = 1 + a positive semi-definite matrix is positive definite unless it overflowed.
        let factor = cholesky(s).ok_or(EstimateError::NotPositiveDefinite("the innovation's covariance"))?;
        let weighted = factor.solve(&nu);
        let gain = factor.solve(&gain_side.transpose()).transpose(); // K = P Hᵀ S⁻¹
        let delta = &self.mean + &gain * &nu;
        let mut keep = Square::<S>::identity_generic(n, n);
        let kh = &gain * root.transpose();
        {
            let mut block = keep.columns_generic_mut(0, np);
            block -= kh;
        }
        let mut covariance = &keep * &self.covariance * keep.transpose() + &gain * gain.transpose();
        symmetrize(&mut covariance);
        innovation.nis = nu.dot(&weighted);
        innovation.dof = (0..root.ncols()).filter(|&k| root[(k, k)] > 0.0).count();
        let l = factor.l_dirty();
        let log_det: f64 = (0..l.nrows()).map(|k| 2.0 * math::ln(l[(k, k)])).sum();
        innovation.log_evidence = -data.cost + 0.5 * (y.norm_squared() - innovation.nis - log_det);
        Ok((delta, covariance))
    }
}

/// `R⁺ b` for a lower-trapezoidal `R` as [`semidefinite_root`] makes it: forward substitution, zero where a column is.
fn pseudo_solve<D: Dim>(root: &OMatrix<f64, D, D>, b: &OVector<f64, D>) -> OVector<f64, D>
where
    DefaultAllocator: Alloc<D>,
{
    let mut rest = b.clone();
    let mut y = OVector::zeros_generic(b.shape_generic().0, U1);
    for k in 0..root.ncols() {
        let pivot = root[(k, k)];
        if pivot > 0.0 {
            y[k] = rest[k] / pivot;
            for r in k..root.nrows() {
                rest[r] -= root[(r, k)] * y[k];
            }
        }
    }
    y
}

/// Covariance moved from the chart at `x` to the chart at `x ⊞ δ` (reset of an error-state filter).
fn reset<S: Manifold>(x: &S, delta: &Tangent<S>, covariance: Square<S>) -> Square<S>
where
    DefaultAllocator: Alloc<S::D>,
{
    let g = x.retract_jacobian(delta);
    let mut moved = &g * covariance * g.transpose();
    symmetrize(&mut moved);
    moved
}

/// `½ ‖x ⊟ prior‖²`, with `root` that of the prior's covariance; nothing along coordinates without variance.
fn departure<S: Manifold>(prior: &Gaussian<S>, root: &Square<S>, x: &S) -> f64
where
    DefaultAllocator: Alloc<S::D>,
{
    0.5 * pseudo_solve(root, &prior.mean.local(x)).norm_squared()
}
