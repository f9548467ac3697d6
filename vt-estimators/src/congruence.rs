//! `F P Fᵀ`, where most of a filter's time goes.
//!
//! Transitions and sensors are mostly zeros; products go column by column and leave these out, and of a symmetric
//! result only the lower half is computed.

use nalgebra::{DefaultAllocator, Dim, OMatrix};
use vt_core::manifold::{Alloc, AllocPair};

/// `F P Fᵀ` for a symmetric `P`, exactly symmetric.
pub(crate) fn congruence<N: Dim, C: Dim>(f: &OMatrix<f64, N, C>, p: &OMatrix<f64, C, C>) -> OMatrix<f64, N, N>
where
    DefaultAllocator: AllocPair<N, C>,
{
    symmetric_product::<N, C>(&times_transpose::<C, C, N, C>(p, f).transpose(), f)
}

/// `P Fᵀ`; where `F` has fewer columns than `P`, with its first columns.
pub(crate) fn times_transpose<R: Dim, C: Dim, N: Dim, A: Dim>(
    p: &OMatrix<f64, R, C>,
    f: &OMatrix<f64, N, A>,
) -> OMatrix<f64, R, N>
where
    DefaultAllocator: AllocPair<R, C> + AllocPair<N, A> + AllocPair<R, N>,
{
    let (rows, columns) = (p.nrows(), f.ncols());
    #[cfg(feature = "faer")]
    if R::is::<nalgebra::Dyn>() && rows > crate::large::LARGE {
        let mut out = OMatrix::<f64, R, N>::zeros_generic(p.shape_generic().0, f.shape_generic().0);
        crate::large::times_transpose(
            p.as_slice(),
            f.as_slice(),
            [rows, columns, f.nrows()],
            out.as_mut_slice(),
        );
        return out;
    }
    let mut out = OMatrix::<f64, R, N>::zeros_generic(p.shape_generic().0, f.shape_generic().0);
    let from = p.as_slice();
    for (n, into) in out.as_mut_slice().chunks_exact_mut(rows.max(1)).enumerate() {
        for k in 0..columns {
            let factor = f[(n, k)];
            if factor != 0.0 {
                for (o, v) in into.iter_mut().zip(&from[k * rows..(k + 1) * rows]) {
                    *o += factor * v;
                }
            }
        }
    }
    out
}

/// `B Fᵀ` where that is known to be symmetric.
pub(crate) fn symmetric_product<N: Dim, C: Dim>(
    b: &OMatrix<f64, N, C>,
    f: &OMatrix<f64, N, C>,
) -> OMatrix<f64, N, N>
where
    DefaultAllocator: AllocPair<N, C>,
{
    let n = f.nrows();
    let dim = f.shape_generic().0;
    #[cfg(feature = "faer")]
    if N::is::<nalgebra::Dyn>() && n > crate::large::LARGE {
        let mut out = OMatrix::<f64, N, N>::zeros_generic(dim, dim);
        crate::large::times_transpose(b.as_slice(), f.as_slice(), [n, f.ncols(), n], out.as_mut_slice());
        mirror(&mut out);
        return out;
    }
    let mut out = OMatrix::<f64, N, N>::zeros_generic(dim, dim);
    let from = b.as_slice();
    for (c, into) in out.as_mut_slice().chunks_exact_mut(n.max(1)).enumerate() {
        for k in 0..f.ncols() {
            let factor = f[(c, k)];
            if factor != 0.0 {
                for (o, v) in into[c..].iter_mut().zip(&from[k * n + c..(k + 1) * n]) {
                    *o += factor * v;
                }
            }
        }
    }
    mirror(&mut out);
    out
}

/// Copies the lower half to the upper one.
fn mirror<D: Dim>(m: &mut OMatrix<f64, D, D>)
where
    DefaultAllocator: Alloc<D>,
{
    for c in 0..m.ncols() {
        for r in c + 1..m.nrows() {
            m[(c, r)] = m[(r, c)];
        }
    }
}
