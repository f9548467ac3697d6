//! Covariance intersection.

use nalgebra::DefaultAllocator;
use vt_core::belief::{Gaussian, cholesky};
use vt_core::error::EstimateError;
use vt_core::least_squares::Spectrum;
use vt_core::manifold::{Alloc, Manifold, Square, Tangent};

use super::{NO_TRACK, RANK, checked, inverse, settle};

/// What weights of [`Intersection`] make smallest.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Criterion {
    /// Determinant of the covariance: the volume, whatever the units.
    #[default]
    Determinant,
    /// Trace of the covariance: the mean square error, for tangents of one unit.
    Trace,
}

/// Halvings of an interval of weights: to rounding.
const HALVINGS: usize = 60;

/// Rounds over all pairs of more than two tracks, and the change of a weight that ends them.
const ROUNDS: usize = 100;
const SETTLED: f64 = 1e-9;

/// Fusion of beliefs whose errors may be correlated in any way (S. Julier and J. Uhlmann, "A non-divergent estimation
/// algorithm in the presence of unknown correlations", 1997):
///
/// ```text
/// P⁻¹ = Σ ω_i P_i⁻¹,   P⁻¹ x = Σ ω_i P_i⁻¹ x_i,   ω_i ≥ 0,   Σ ω_i = 1
/// ```
///
/// The result is never over-confident if the beliefs are not. The weights minimise a convex [`Criterion`]: for two beliefs by
/// bisection of its slope, for more by going round the pairs. Equal beliefs have equal weights.
pub struct Intersection<P: Manifold>
where
    DefaultAllocator: Alloc<P::D>,
{
    criterion: Criterion,
    weights: Vec<f64>,
    /// Mean and information of each belief in the chart at the common point.
    parts: Vec<(Tangent<P>, Square<P>)>,
}

impl<P: Manifold> Intersection<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// Fusion with the weights that this criterion likes best.
    pub fn new(criterion: Criterion) -> Self {
        Self { criterion, weights: vec![], parts: vec![] }
    }

    /// Fuses beliefs.
    ///
    /// # Errors
    /// Without a belief, and when one is not finite.
    pub fn combine<'a>(
        &mut self,
        beliefs: impl IntoIterator<Item = &'a Gaussian<P>, IntoIter: Clone>,
    ) -> Result<Gaussian<P>, EstimateError> {
        let beliefs = beliefs.into_iter();
        let start = checked(beliefs.clone())?.ok_or(NO_TRACK)?;
        settle(start, |x| {
            self.parts.clear();
            self.parts.extend(beliefs.clone().map(|belief| {
                let (mean, covariance) = belief.in_chart(x);
                (mean, inverse::<P>(&covariance))
            }));
            self.weigh(x);
            let covariance = inverse::<P>(&self.sum(x, |_| true));
            let mut vector = x.zero();
            for (weight, (mean, information)) in self.weights.iter().zip(&self.parts) {
                vector += information * mean * *weight;
            }
            (&covariance * vector, covariance)
        })
    }

    /// Weights of the beliefs that were fused last.
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// Weighted sum of the information of some parts.
    fn sum(&self, x: &P, which: impl Fn(usize) -> bool) -> Square<P> {
        let mut sum = Square::<P>::zeros_generic(x.dim(), x.dim());
        for (k, (weight, (_, information))) in self.weights.iter().zip(&self.parts).enumerate() {
            if which(k) {
                sum += information * *weight;
            }
        }
        sum
    }

    /// Finds the weights.
    fn weigh(&mut self, x: &P) {
        let n = self.parts.len();
        self.weights.clear();
        self.weights.resize(n, 1.0 / n as f64);
        // A unit of information in directions that are locked in all parts makes inverses exist and changes no optimum.
        let mut locked = Square::<P>::zeros_generic(x.dim(), x.dim());
        for null in Spectrum::new(&self.sum(x, |_| true), RANK).unobservable() {
            locked.ger(1.0, &null, &null, 1.0);
        }
        for _ in 0..ROUNDS {
            let mut change = 0.0_f64;
            for i in 0..n {
                for j in i + 1..n {
                    let both = self.weights[i] + self.weights[j];
                    let others = self.sum(x, |k| k != i && k != j) + &locked;
                    let [a, b] = [i, j].map(|k| &self.parts[k].1 * both);
                    let share = share(self.criterion, &others, &a, &b);
                    change = change.max((both * share - self.weights[i]).abs());
                    (self.weights[i], self.weights[j]) = (both * share, both * (1.0 - share));
                }
            }
            if n < 3 || change < SETTLED {
                break;
            }
        }
    }
}

/// The `t` in `[0, 1]` for which the inverse of `others + t a + (1 − t) b` is smallest.
fn share<D: nalgebra::Dim>(
    criterion: Criterion,
    others: &nalgebra::OMatrix<f64, D, D>,
    a: &nalgebra::OMatrix<f64, D, D>,
    b: &nalgebra::OMatrix<f64, D, D>,
) -> f64
where
    DefaultAllocator: Alloc<D>,
{
    let across = a - b;
    // −tr(P (a − b)) or −tr(P (a − b) P), which grow with t. No inverse, where a belief alone says nothing of a
    // direction: away from there.
    let slope = |t: f64| {
        let covariance = cholesky(others + a * t + b * (1.0 - t))?.inverse();
        let turned = &covariance * &across;
        let by = match criterion {
            Criterion::Determinant => turned.trace(),
            Criterion::Trace => turned.component_mul(&covariance).sum(),
        };
        let size = match criterion {
            Criterion::Determinant => turned.norm(),
            Criterion::Trace => turned.norm() * covariance.norm(),
        };
        // Zero up to rounding is neither up nor down.
        Some(if by.abs() <= 1e-14 * size.max(f64::MIN_POSITIVE) { 0.0 } else { -by })
    };
    let (first, last) = (slope(0.0).unwrap_or(-1.0), slope(1.0).unwrap_or(1.0));
    if first == 0.0 && last == 0.0 {
        return 0.5;
    }
    if first >= 0.0 {
        return 0.0;
    }
    if last <= 0.0 {
        return 1.0;
    }
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        match slope(middle) {
            Some(s) if s < 0.0 => low = middle,
            Some(s) if s > 0.0 => high = middle,
            _ => return middle,
        }
    }
    0.5 * (low + high)
}
