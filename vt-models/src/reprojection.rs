//! Poses from points and where they were seen: robust least squares over distances in the picture, for any warp.
//!
//! A wrong pair counts by the influence of its distance, in deviations, under an M-estimator; the deviations may be known or known
//! but for a common factor. The covariance is `c σ² (Jᵀ W J)⁻¹`: the constant `c` of the estimator makes it that of its asymptotic
//! law for normal errors (P. Huber, E. Ronchetti, "Robust Statistics", 2009, §7.6, here for errors of two coordinates), so that it
//! is neither too small nor too large for the weights.

use nalgebra::{DefaultAllocator, Dim, Point2};
use vt_core::agent::{Posed, Warp};
use vt_core::belief::Gaussian;
use vt_core::error::{ConfigError, EstimateError};
use vt_core::least_squares::{LeastSquares, Solution};
use vt_core::manifold::{Alloc, Manifold, Tangent};
use vt_core::math;
use vt_core::measurement::NormalEquations;
use vt_core::robust::Robust;

/// Distance that stands for a point that cannot be projected, deviations.
const UNSEEN: f64 = 1e3;

/// Median length of a vector of two standard normal coordinates.
const MEDIAN_LENGTH: f64 = 1.177_410_022_515_474_7;

/// Solutions under ever better scales; then the scale is frozen, since weights that follow it may go in circles.
const PASSES: usize = 3;

/// A point of a body and where it was seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair<B> {
    /// Place on the body, in its units.
    pub body: B,
    /// Place in the picture, pixels.
    pub seen: Point2<f64>,
    /// Deviation of `seen` in each coordinate, pixels, or in proportion to it.
    pub deviation: f64,
}

/// What is known about deviations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scale {
    /// They are as given.
    Known,
    /// All have an unknown factor in common, at least this one.
    Estimated {
        /// Keeps a perfect fit of a few pairs from a perfect certainty.
        least: f64,
    },
}

/// How pairs are weighted.
#[derive(Clone, Debug, PartialEq)]
pub struct RefinementParams {
    /// Estimator of the distance in deviations. One that is not convex begins after a pass with Huber's.
    pub robust: Robust,
    /// What is known about deviations.
    pub scale: Scale,
    /// Solver of each pass.
    pub solver: LeastSquares,
}

impl Default for RefinementParams {
    fn default() -> Self {
        let solver = LeastSquares {
            max_iterations: 20,
            step_tolerance: 1e-4,
            decrease_tolerance: 1e-10,
            ..LeastSquares::levenberg_marquardt()
        };
        Self { robust: Robust::TUKEY, scale: Scale::Estimated { least: 0.3 }, solver }
    }
}

impl RefinementParams {
    /// Checks the parameters.
    ///
    /// # Errors
    /// [`ConfigError::Parameter`] with the first that is out of its range.
    pub fn check(self) -> Result<Self, ConfigError> {
        self.robust.checked()?;
        match self.scale {
            Scale::Estimated { least } if !(least > 0.0 && least.is_finite()) => {
                Err(ConfigError::parameter("least", least, "a positive number"))
            }
            _ => Ok(self),
        }
    }
}

/// A pose from pairs.
#[derive(Clone, Debug)]
pub struct Refined<P: Manifold>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// Pose and covariance; zero along [`Solution::unobservable`].
    pub belief: Gaussian<P>,
    /// Common factor of the deviations.
    pub scale: f64,
    /// Number of pairs with a weight.
    pub pairs: usize,
    /// Of the last pass; its covariance is without the constant of the estimator.
    pub solution: Solution<P>,
}

/// Fits a pose to pairs.
///
/// # Errors
/// [`EstimateError`] when the start or the equations are not finite. Too few pairs leave directions unobservable.
pub fn refine<P, W>(
    warp: &W,
    pairs: &[Pair<W::Body>],
    start: &P,
    params: &RefinementParams,
) -> Result<Refined<P>, EstimateError>
where
    P: Manifold,
    W: Warp<P>,
    DefaultAllocator: Alloc<P::D>,
{
    let mut lengths = vec![];
    let (mut scale, passes) = match params.scale {
        Scale::Known => (1.0, 2),
        Scale::Estimated { least } => (median_scale(warp, pairs, start, &mut lengths).max(least), PASSES),
    };
    let solve = |start: &P, robust: Robust, scale: f64| {
        params.solver.minimize(start, None, |at, out| fill(warp, pairs, at, robust, scale, out))
    };
    let first = if params.robust == Robust::Square { Robust::Square } else { Robust::HUBER };
    let mut solution = solve(start, first, scale)?;
    for _ in 1..passes {
        if let Scale::Estimated { least } = params.scale {
            scale = median_scale(warp, pairs, &solution.pose, &mut lengths).max(least);
        }
        solution = solve(&solution.pose, params.robust, scale)?;
    }
    // Each pair has two rows.
    let posed = warp.at(&solution.pose);
    let (mut count, mut weights, mut squares) = (0, 0.0, 0.0);
    for pair in pairs {
        let Some(y) = posed.locate(&pair.body) else { continue };
        let length = (pair.seen - y).norm() / (scale * pair.deviation);
        let weight = params.robust.weight(length);
        count += usize::from(weight > 0.0);
        weights += weight;
        squares += weight * length * length;
    }
    let unknowns = start.dim().value() - solution.unobservable.len();
    let constants = Constants::new(params.robust);
    // Weights, and with them the solver's covariance, belong to this one.
    let solved = scale;
    if let Scale::Estimated { least } = params.scale {
        // The weighted mean square, in which all pairs have a say.
        let rows = 2.0 * count as f64;
        let free = (rows - unknowns as f64).max(1.0);
        let mean = squares / weights * constants.weight / (2.0 * constants.slope) * (rows / free);
        scale = (scale * mean.sqrt()).max(least);
    }
    let factor = constants.covariance() * (scale / solved) * (scale / solved);
    let belief = Gaussian { mean: solution.pose.clone(), covariance: &solution.covariance * factor };
    Ok(Refined { belief, scale, pairs: count, solution })
}

/// Adds both rows of every pair.
fn fill<P, W>(
    warp: &W,
    pairs: &[Pair<W::Body>],
    at: &P,
    robust: Robust,
    scale: f64,
    out: &mut NormalEquations<P>,
) where
    P: Manifold,
    W: Warp<P>,
    DefaultAllocator: Alloc<P::D>,
{
    let posed = warp.at(at);
    let dim = at.dim();
    for pair in pairs {
        let Some((y, jacobian)) = posed.linearize(&pair.body) else {
            // As dear as a wrong pair: a step that loses a point from view pays for it.
            out.cost += robust.rho(UNSEEN);
            continue;
        };
        let inverse = 1.0 / (scale * pair.deviation);
        let error = pair.seen - y;
        let length = error.norm() * inverse;
        let weight = robust.weight(length) * inverse * inverse;
        let cost = out.cost + robust.rho(length);
        for k in 0..2 {
            let row = Tangent::<P>::from_fn_generic(dim, nalgebra::U1, |c, _| jacobian[(k, c)]);
            out.add(error[k], &row, weight);
        }
        // That of the estimator, not of the weights.
        out.cost = cost;
    }
}

/// Robust common factor of the deviations.
fn median_scale<P, W>(warp: &W, pairs: &[Pair<W::Body>], at: &P, lengths: &mut Vec<f64>) -> f64
where
    P: Manifold,
    W: Warp<P>,
    DefaultAllocator: Alloc<P::D>,
{
    let posed = warp.at(at);
    lengths.clear();
    lengths.extend(pairs.iter().filter_map(|p| Some((p.seen - posed.locate(&p.body)?).norm() / p.deviation)));
    if lengths.is_empty() {
        return 0.0;
    }
    let middle = lengths.len() / 2;
    *lengths.select_nth_unstable_by(middle, f64::total_cmp).1 / MEDIAN_LENGTH
}

/// Means of an estimator over the length `r` of an error of two standard normal coordinates, whose density is `r exp(-r²/2)`.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Constants {
    /// `E w`.
    weight: f64,
    /// `E (w + ψ') / 2 = ½ E w r²`, the slope of the influence along any direction.
    slope: f64,
    /// `½ E w² r²`, the variance of the influence along any direction.
    power: f64,
}

impl Constants {
    fn new(robust: Robust) -> Self {
        const STEP: f64 = 0.02;
        let mut sums = Self { weight: 0.0, slope: 0.0, power: 0.0 };
        for k in 0..450 {
            let r = STEP * (f64::from(k) + 0.5);
            let (share, weight) = (STEP * r * math::exp(-0.5 * r * r), robust.weight(r));
            sums.weight += share * weight;
            sums.slope += 0.5 * share * weight * r * r;
            sums.power += 0.5 * share * weight * weight * r * r;
        }
        sums
    }

    /// Asymptotic covariance as a multiple of `(Jᵀ W J)⁻¹`.
    fn covariance(&self) -> f64 {
        self.weight * self.power / (self.slope * self.slope)
    }
}

#[cfg(test)]
mod tests;
