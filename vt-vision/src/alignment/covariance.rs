//! Covariance of an alignment.

use nalgebra::DefaultAllocator;
use vt_core::belief::cholesky;
use vt_core::manifold::{Alloc, Manifold, Square};

/// `H⁻¹ V H⁻¹`, the covariance of the minimum of a cost with curvature `H` whose gradient has the covariance `V` (P. Huber,
/// 1967; H. White, 1980, so that the noise of points may differ).
///
/// `noise` is `V` as if the points were independent. After smoothing they are not: `correlated` is the `V` of noise of one
/// size with its correlations, `squares` that without, `A Aᵀ`. With `noise = B Bᵀ` the correlations are carried over as
/// `V = B A⁻¹ · correlated · A⁻ᵀ Bᵀ`, exact where the noise has one size. `rounding` is the variance of what is noise even
/// where template and picture are the same. Of the curvatures the first that is positive definite counts; `None` without one.
pub(super) fn covariance<P: Manifold>(
    curvatures: [Square<P>; 2],
    noise: Square<P>,
    squares: Square<P>,
    correlated: &Square<P>,
    rounding: f64,
) -> Option<Square<P>>
where
    DefaultAllocator: Alloc<P::D>,
{
    let h = curvatures.into_iter().find_map(cholesky)?;
    let a = cholesky(squares)?;
    let least = a.solve(&a.solve(correlated).transpose());
    let a = a.unpack();
    let half = a.solve_lower_triangular(correlated)?;
    let whitened = a.solve_lower_triangular(&half.transpose())?;
    let mut c = least * rounding;
    if let Some(b) = cholesky(noise) {
        let b = b.unpack();
        let v = &b * whitened * b.transpose();
        c += h.solve(&h.solve(&v).transpose());
    }
    Some((&c + c.transpose()) * 0.5)
}
