//! Covariance of an alignment.

use nalgebra::DefaultAllocator;
use vt_core::belief::cholesky;
use vt_core::manifold::{Alloc, Manifold, Square};

/// `H⁻¹ V H⁻¹`, the covariance of the minimum of a cost with curvature `H` whose gradient has the covariance `V` (P. Huber,
/// 1967; H. White, 1980, so that the noise of points may differ).
///
/// `noise` is `V` as if the points were independent. After smoothing they are not: `correlated` is the `V` of noise of one
/// size with its correlations, `squares` that without, `A Aᵀ`. With `noise = B Bᵀ` the correlations are carried over as
/// `V = B A⁻¹ · correlated · A⁻ᵀ Bᵀ`, exact where the noise has one size. `None` unless all are positive definite.
pub(super) fn covariance<P: Manifold>(
    curvature: Square<P>,
    noise: Square<P>,
    squares: Square<P>,
    correlated: &Square<P>,
) -> Option<Square<P>>
where
    DefaultAllocator: Alloc<P::D>,
{
    let h = cholesky(curvature)?;
    let whitened = {
        let a = cholesky(squares)?.unpack();
        let half = a.solve_lower_triangular(correlated)?;
        a.solve_lower_triangular(&half.transpose())?
    };
    // A picture without noise leaves nothing.
    let v = match cholesky(noise) {
        Some(b) => {
            let b = b.unpack();
            &b * whitened * b.transpose()
        }
        None => return None,
    };
    let half = h.solve(&v);
    let c = h.solve(&half.transpose());
    Some((&c + c.transpose()) * 0.5)
}
