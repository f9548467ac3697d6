//! The belief with which an estimator starts, checked.

use nalgebra::{DefaultAllocator, Dim, OMatrix};
use vt_core::agent::Dynamics;
use vt_core::belief::{Gaussian, State};
use vt_core::dynamics::pivoted_root;
use vt_core::error::EstimateError;
use vt_core::manifold::{Alloc, Manifold, Tangent};

/// Most that an entry of a covariance may differ from its positive semi-definite part, as a correlation.
const ROUNDING: f64 = 1e-7;

/// The state at rest at `prior`, derivatives with the deviations `rest`, to be moved by `dynamics`.
///
/// # Errors
/// When sizes differ, numbers are not finite or the covariance has a negative eigenvalue.
pub(crate) fn at_rest<P, S>(
    prior: &Gaussian<P>,
    rest: &[Tangent<P>],
    dynamics: &impl Dynamics<S>,
) -> Result<Gaussian<S>, EstimateError>
where
    P: Manifold,
    S: State<P>,
    DefaultAllocator: Alloc<P::D> + Alloc<S::D>,
{
    let expected = prior.mean.dim().value();
    for deviation in rest {
        EstimateError::unless_equal("the deviation of a derivative", deviation.len(), expected)?;
    }
    square(prior)?;
    let state = S::spread(prior, rest);
    dynamics.fits(&state.mean)?;
    if !state.is_finite() {
        return Err(EstimateError::NotFinite("the prior"));
    }
    semidefinite(&prior.covariance)?;
    Ok(state)
}

/// A belief over a whole state, to be moved by `dynamics`, checked in the same way.
///
/// # Errors
/// When sizes differ, numbers are not finite or the covariance has a negative eigenvalue.
pub(crate) fn checked<S: Manifold>(
    belief: Gaussian<S>,
    dynamics: &impl Dynamics<S>,
) -> Result<Gaussian<S>, EstimateError>
where
    DefaultAllocator: Alloc<S::D>,
{
    square(&belief)?;
    dynamics.fits(&belief.mean)?;
    if !belief.is_finite() {
        return Err(EstimateError::NotFinite("the prior"));
    }
    semidefinite(&belief.covariance)?;
    Ok(belief)
}

/// A belief that takes the place of one with the mean `old`.
///
/// # Errors
/// When sizes differ or numbers are not finite.
pub(crate) fn replaces<S: Manifold>(belief: &Gaussian<S>, old: &S) -> Result<(), EstimateError>
where
    DefaultAllocator: Alloc<S::D>,
{
    EstimateError::unless_equal("the belief", belief.mean.dim().value(), old.dim().value())?;
    square(belief)?;
    if belief.is_finite() { Ok(()) } else { Err(EstimateError::NotFinite("the belief")) }
}

/// A covariance of the size of its mean.
fn square<S: Manifold>(belief: &Gaussian<S>) -> Result<(), EstimateError>
where
    DefaultAllocator: Alloc<S::D>,
{
    let (expected, (rows, columns)) = (belief.mean.dim().value(), belief.covariance.shape());
    let found = if rows == expected { columns } else { rows };
    EstimateError::unless_equal("the prior's covariance", found, expected)
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
