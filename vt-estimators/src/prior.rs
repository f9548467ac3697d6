//! The belief with which an estimator starts, checked.

use nalgebra::{DefaultAllocator, Dim, OMatrix};
use vt_core::belief::{Gaussian, State};
use vt_core::dynamics::pivoted_root;
use vt_core::error::EstimateError;
use vt_core::manifold::{Alloc, Manifold, Tangent};

/// Most that an entry of a covariance may differ from its positive semi-definite part, as a correlation.
const ROUNDING: f64 = 1e-7;

/// The state at rest at `prior`, derivatives with the deviations `rest`.
///
/// # Errors
/// When sizes differ, numbers are not finite or the covariance has a negative eigenvalue.
pub(crate) fn at_rest<P, S>(prior: &Gaussian<P>, rest: &[Tangent<P>]) -> Result<Gaussian<S>, EstimateError>
where
    P: Manifold,
    S: State<P>,
    DefaultAllocator: Alloc<P::D> + Alloc<S::D>,
{
    let expected = prior.mean.dim().value();
    let sizes = rest.iter().map(|r| ("the deviation of a derivative", r.len()));
    for (what, found) in sizes.chain([("the prior's covariance", prior.covariance.nrows())]) {
        if found != expected {
            return Err(EstimateError::Dimension { what, found, expected });
        }
    }
    let state = S::spread(prior, rest);
    if !state.is_finite() {
        return Err(EstimateError::NotFinite("the prior"));
    }
    semidefinite(&prior.covariance)?;
    Ok(state)
}

/// A belief over a whole state, checked in the same way.
///
/// # Errors
/// When sizes differ, numbers are not finite or the covariance has a negative eigenvalue.
pub(crate) fn checked<S: Manifold>(belief: Gaussian<S>) -> Result<Gaussian<S>, EstimateError>
where
    DefaultAllocator: Alloc<S::D>,
{
    let (found, expected) = (belief.covariance.nrows(), belief.mean.dim().value());
    if found != expected {
        return Err(EstimateError::Dimension { what: "the prior's covariance", found, expected });
    }
    if !belief.is_finite() {
        return Err(EstimateError::NotFinite("the prior"));
    }
    semidefinite(&belief.covariance)?;
    Ok(belief)
}

fn semidefinite<D: Dim>(p: &OMatrix<f64, D, D>) -> Result<(), EstimateError>
where
    DefaultAllocator: Alloc<D>,
{
    let root = pivoted_root(p);
    let excess = &root * root.transpose() - p;
    for r in 0..p.nrows() {
        for c in 0..p.ncols() {
            // Not a number where a variance is negative.
            let fits = excess[(r, c)].abs() <= ROUNDING * (p[(r, r)] * p[(c, c)]).sqrt();
            if !fits || p[(r, r)] < 0.0 {
                return Err(EstimateError::NotPositiveDefinite("the prior's covariance"));
            }
        }
    }
    Ok(())
}
