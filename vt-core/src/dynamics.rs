//! Motion models for any manifold.

use nalgebra::{DefaultAllocator, Dim, OMatrix};

use crate::manifold::Alloc;

/// A matrix `L` with `L Lᵀ = m` for a symmetric positive semi-definite `m`; negative eigenvalues from rounding
/// count as zero.
pub fn semidefinite_root<D: Dim>(m: &OMatrix<f64, D, D>) -> OMatrix<f64, D, D>
where
    DefaultAllocator: Alloc<D>,
{
    // Cholesky with zero columns for zero pivots: exact for semi-definite matrices, and lower triangular.
    let n = m.nrows();
    let mut l = OMatrix::zeros_generic(m.shape_generic().0, m.shape_generic().1);
    let scale = (0..n).map(|k| m[(k, k)].abs()).fold(0.0, f64::max);
    for c in 0..n {
        let mut pivot = m[(c, c)];
        for k in 0..c {
            pivot -= l[(c, k)] * l[(c, k)];
        }
        if pivot <= 1e-14 * scale {
            continue;
        }
        let root = pivot.sqrt();
        l[(c, c)] = root;
        for r in c + 1..n {
            let mut v = m[(r, c)];
            for k in 0..c {
                v -= l[(r, k)] * l[(c, k)];
            }
            l[(r, c)] = v / root;
        }
    }
    l
}
