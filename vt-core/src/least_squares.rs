//! Gauss–Newton and Levenberg–Marquardt on any manifold, with an optional Gaussian prior.
//!
//! The problem is `min ½ Σ w r(x)² + ½ ‖x ⊟ m‖²_P`, its data given as [`NormalEquations`] by a closure or by a
//! [`Measurement`]. Without a prior, steps go only where the data have information: along unobservable directions
//! the start stays, and they are reported. With a prior the problem is solved in coordinates whitened by it,
//! `x = m ⊞ L a`, `P = L Lᵀ`; hence a prior may be singular (a locked coordinate stays at the prior's), and the
//! result is the posterior mode with its covariance in the tangent space at the mode (an iterated Kalman update).
//!
//! Damping: H. B. Nielsen, "Damping parameter in Marquardt's method", 1999.
//!
//! ```
//! use vt_core::{least_squares::LeastSquares, lie::Vector, nalgebra::Vector2};
//! // The point whose distances from (0, 0) and (4, 0) are 5 and 3.
//! let anchors = [(Vector2::new(0.0, 0.0), 5.0), (Vector2::new(4.0, 0.0), 3.0)];
//! let start = Vector(Vector2::new(1.0, 1.0));
//! let found = LeastSquares::levenberg_marquardt().minimize(&start, None, |x, out| {
//!     for (anchor, distance) in anchors {
//!         let d = x.0 - anchor;
//!         out.add(distance - d.norm(), &d.normalize(), 1.0);
//!     }
//! })?;
//! assert!((found.pose.0 - Vector2::new(4.0, 3.0)).norm() < 1e-6);
//! # Ok::<(), vt_core::error::EstimateError>(())
//! ```

use nalgebra::{DefaultAllocator, Dim};

use crate::belief::Gaussian;
use crate::dynamics::PivotedFactor;
use crate::error::EstimateError;
use crate::manifold::{Alloc, Manifold, Square, Tangent};
use crate::measurement::{Measurement, NormalEquations};
use crate::report::StopReason;

mod spectrum;

pub use spectrum::{Spectrum, symmetric_eigen};

/// How steps are taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Method {
    /// Full steps, whatever the cost does: for good starts, and for costs whose data change from step to step.
    GaussNewton,
    /// Damped steps that lower the cost.
    LevenbergMarquardt {
        /// First damping relative to the diagonal of the information matrix.
        damping: f64,
    },
}

/// A solver by its parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct LeastSquares {
    /// How steps are taken.
    pub method: Method,
    /// Most evaluations after the first one.
    pub max_iterations: u32,
    /// Ends when the full step is below this many posterior standard deviations.
    pub step_tolerance: f64,
    /// Ends when a step lowers the cost by less than this part (Levenberg–Marquardt).
    pub decrease_tolerance: f64,
    /// Smallest eigenvalue of the information, scaled to a unit diagonal, of an observable direction.
    pub rank_tolerance: f64,
}

impl LeastSquares {
    /// Gauss–Newton, at most ten steps.
    pub fn gauss_newton() -> Self {
        Self {
            method: Method::GaussNewton,
            max_iterations: 10,
            step_tolerance: 1e-6,
            decrease_tolerance: 1e-14,
            rank_tolerance: 1e-10,
        }
    }

    /// Levenberg–Marquardt, at most 50 steps.
    pub fn levenberg_marquardt() -> Self {
        let method = Method::LevenbergMarquardt { damping: 1e-3 };
        Self { method, max_iterations: 50, ..Self::gauss_newton() }
    }

    /// Fits the pose to a measurement; see [`LeastSquares::minimize`].
    ///
    /// # Errors
    /// As [`LeastSquares::minimize`].
    pub fn fit<P: Manifold>(
        &self,
        z: &dyn Measurement<P>,
        start: &P,
        prior: Option<&Gaussian<P>>,
    ) -> Result<Solution<P>, EstimateError>
    where
        DefaultAllocator: Alloc<P::D>,
    {
        self.minimize(start, prior, |at, out| z.normal_equations(at, out))
    }

    /// Minimises from `start`. `fill` receives cleared equations and adds all data linearised at the pose given.
    ///
    /// # Errors
    /// When the start, the prior or the equations at the start are not finite, or when their sizes differ.
    pub fn minimize<P: Manifold>(
        &self,
        start: &P,
        prior: Option<&Gaussian<P>>,
        mut fill: impl FnMut(&P, &mut NormalEquations<P>),
    ) -> Result<Solution<P>, EstimateError>
    where
        DefaultAllocator: Alloc<P::D>,
    {
        if !start.is_finite() {
            return Err(EstimateError::NotFinite("start"));
        }
        let (mut x, mut whitened) = match prior {
            None => (start.clone(), None),
            Some(prior) => {
                let w = Whitened::new(prior, start)?;
                (w.pose(&w.at), Some(w))
            }
        };
        let mut data = NormalEquations::empty(&x);
        let mut trial = data.clone();
        fill(&x, &mut data);
        if !finite(&data) {
            return Err(EstimateError::NotFinite("normal equations"));
        }
        let (mut damping, mut growth) = match self.method {
            Method::GaussNewton => (0.0, 2.0),
            Method::LevenbergMarquardt { damping } => (damping, 2.0),
        };
        let mut iterations = 0;
        let stop = 'steps: loop {
            let (h, g, tolerance) = match &whitened {
                None => (data.information.clone(), data.gradient.clone(), self.rank_tolerance),
                // The prior's information is at least one in every direction.
                Some(w) => {
                    let (h, g) = w.pull_back(&data);
                    (h, g, 0.0)
                }
            };
            let spectrum = Spectrum::new(&h, tolerance);
            if spectrum.rank() == 0 {
                break StopReason::Singular;
            }
            if spectrum.decrement(&g) <= self.step_tolerance * self.step_tolerance {
                break StopReason::SmallStep;
            }
            let cost = data.cost + whitened.as_ref().map_or(0.0, Whitened::cost);
            loop {
                if iterations == self.max_iterations {
                    break 'steps StopReason::Iterations;
                }
                iterations += 1;
                let (step, promised) = spectrum.step(&g, damping);
                let moved = whitened.as_ref().map(|w| &w.at + &step);
                let candidate = match (&whitened, &moved) {
                    (Some(w), Some(at)) => w.pose(at),
                    _ => x.retract(&step),
                };
                trial.clear();
                fill(&candidate, &mut trial);
                let valid = finite(&trial) && candidate.is_finite();
                let decrease = cost - trial.cost - moved.as_ref().map_or(0.0, |a| 0.5 * a.norm_squared());
                if self.method == Method::GaussNewton {
                    if !valid {
                        break 'steps StopReason::Singular;
                    }
                } else if valid && decrease > 0.0 {
                    let gain = 2.0 * decrease / promised - 1.0;
                    damping *= (1.0 - gain * gain * gain).max(1.0 / 3.0);
                    growth = 2.0;
                } else {
                    damping *= growth;
                    growth *= 2.0;
                    if promised <= f64::EPSILON * cost.abs() || !damping.is_finite() {
                        break 'steps StopReason::SmallDecrease;
                    }
                    continue;
                }
                x = candidate;
                if let (Some(w), Some(at)) = (&mut whitened, moved) {
                    w.at = at;
                }
                core::mem::swap(&mut data, &mut trial);
                if self.method != Method::GaussNewton && decrease <= self.decrease_tolerance * cost {
                    break 'steps StopReason::SmallDecrease;
                }
                break;
            }
        };
        Ok(self.solution(x, whitened.as_ref(), data, iterations, stop))
    }

    fn solution<P: Manifold>(
        &self,
        pose: P,
        whitened: Option<&Whitened<'_, P>>,
        data: NormalEquations<P>,
        iterations: u32,
        stop: StopReason,
    ) -> Solution<P>
    where
        DefaultAllocator: Alloc<P::D>,
    {
        let spectrum = Spectrum::new(&data.information, self.rank_tolerance);
        let all = spectrum.unobservable().len() == 0;
        let information = if all { data.information.clone() } else { spectrum.information() };
        let (covariance, posterior_information) = match whitened {
            None => (spectrum.covariance(), Some(information.clone())),
            Some(w) => (w.covariance(&data), w.information().map(|prior| prior + &information)),
        };
        Solution {
            pose,
            covariance,
            information,
            posterior_information,
            unobservable: spectrum.unobservable().collect(),
            cost: data.cost,
            prior_cost: whitened.map_or(0.0, Whitened::cost),
            rows: data.rows,
            iterations,
            stop,
        }
    }
}

/// What a minimisation found.
#[derive(Clone, Debug)]
pub struct Solution<P: Manifold>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// The minimum; without a prior, unmoved along [`Solution::unobservable`].
    pub pose: P,
    /// Covariance in the tangent space at `pose`: with a prior that of the posterior; without, that of the data in
    /// the observable directions and **zero along the others** (read it with [`Solution::unobservable`]).
    pub covariance: Square<P>,
    /// Information of the data alone at `pose`, exactly zero along unobservable directions.
    pub information: Square<P>,
    /// Information of data and prior at `pose`; `None` when the prior is singular, which has infinite information.
    pub posterior_information: Option<Square<P>>,
    /// Directions that the data alone do not determine: unit tangent vectors, orthogonal to each other.
    pub unobservable: Vec<Tangent<P>>,
    /// Cost of the data at `pose`.
    pub cost: f64,
    /// `½ ‖pose ⊟ mean‖²` in the prior's deviations; zero without a prior.
    pub prior_cost: f64,
    /// Rows of data that entered at `pose`.
    pub rows: usize,
    /// Evaluations after the first one.
    pub iterations: u32,
    /// Why it ended.
    pub stop: StopReason,
}

impl<P: Manifold> Solution<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// Pose and covariance as a belief.
    pub fn belief(&self) -> Gaussian<P> {
        Gaussian { mean: self.pose.clone(), covariance: self.covariance.clone() }
    }
}

fn finite<P: Manifold>(e: &NormalEquations<P>) -> bool
where
    DefaultAllocator: Alloc<P::D>,
{
    e.cost.is_finite() && e.gradient.iter().chain(e.information.iter()).all(|v| v.is_finite())
}

/// The coordinates `a` of `x = m ⊞ L a`, in which the prior is standard normal.
struct Whitened<'a, P: Manifold>
where
    DefaultAllocator: Alloc<P::D>,
{
    prior: &'a Gaussian<P>,
    root: Square<P>,
    at: Tangent<P>,
}

impl<'a, P: Manifold> Whitened<'a, P>
where
    DefaultAllocator: Alloc<P::D>,
{
    fn new(prior: &'a Gaussian<P>, start: &P) -> Result<Self, EstimateError> {
        let expected = start.dim().value();
        for found in [prior.mean.dim().value(), prior.covariance.nrows()] {
            if found != expected {
                return Err(EstimateError::Dimension { what: "prior", found, expected });
            }
        }
        if !prior.is_finite() {
            return Err(EstimateError::NotFinite("prior"));
        }
        let factor = PivotedFactor::new(&prior.covariance);
        // L a = start ⊟ m, as far as the prior allows.
        let at = factor.solve(&prior.mean.local(start));
        Ok(Self { prior, root: factor.root, at })
    }

    fn pose(&self, at: &Tangent<P>) -> P {
        self.prior.mean.retract(&(&self.root * at))
    }

    fn cost(&self) -> f64 {
        0.5 * self.at.norm_squared()
    }

    /// `∂δ/∂a` in the chart at the pose.
    fn chart(&self) -> Square<P> {
        self.prior.mean.retract_jacobian(&(&self.root * &self.at)) * &self.root
    }

    /// Equations of data and prior for a step in `a`.
    fn pull_back(&self, data: &NormalEquations<P>) -> (Square<P>, Tangent<P>) {
        let b = self.chart();
        let mut h = b.tr_mul(&(&data.information * &b));
        for k in 0..h.nrows() {
            h[(k, k)] += 1.0;
        }
        (h, b.tr_mul(&data.gradient) - &self.at)
    }

    /// Covariance of the posterior in the chart at the pose.
    fn covariance(&self, data: &NormalEquations<P>) -> Square<P> {
        let (h, _) = self.pull_back(data);
        let b = self.chart();
        &b * Spectrum::new(&h, 0.0).covariance() * b.transpose()
    }

    /// Information of the prior in the chart at the pose, unless it is singular.
    fn information(&self) -> Option<Square<P>> {
        let whitening = self.chart().try_inverse()?;
        Some(whitening.tr_mul(&whitening))
    }
}

#[cfg(test)]
mod tests;
