//! `F P Fᵀ` and its kin, where most of a filter's time goes.
//!
//! Transitions and sensors are mostly zeros; products go column by column and leave these out, and of a symmetric
//! result only the lower half is computed. With the feature `faer`, more than 60 coordinates of run-time size go to that library.

use nalgebra::{Cholesky, DefaultAllocator, Dim, OMatrix};
use vt_core::belief;
use vt_core::manifold::{Alloc, AllocPair};

/// `A ← A + s B Fᵀ`, where `F` has no more columns than `B`, with as many of them; `half` says that only the lower half of
/// `A` is asked for. Sums run in the order of the columns.
#[inline]
pub(crate) fn add_product<R: Dim, C: Dim, N: Dim, A: Dim>(
    a: &mut OMatrix<f64, R, N>,
    s: f64,
    b: &OMatrix<f64, R, C>,
    f: &OMatrix<f64, N, A>,
    half: bool,
) where
    DefaultAllocator: AllocPair<R, C> + AllocPair<N, A> + AllocPair<R, N>,
{
    let rows = b.nrows();
    #[cfg(feature = "faer")]
    if R::is::<nalgebra::Dyn>() && rows > crate::large::LARGE {
        let sizes = [rows, f.ncols(), f.nrows()];
        return crate::large::add_product(a.as_mut_slice(), s, b.as_slice(), f.as_slice(), sizes);
    }
    for (n, into) in a.as_mut_slice().chunks_exact_mut(rows.max(1)).enumerate() {
        // Whole vectors.
        let first = if half { n / 4 * 4 } else { 0 };
        for (k, column) in b.as_slice().chunks_exact(rows.max(1)).take(f.ncols()).enumerate() {
            let factor = s * f[(n, k)];
            if factor != 0.0 {
                into[first..].iter_mut().zip(&column[first..]).for_each(|(o, v)| *o += factor * v);
            }
        }
    }
}

/// `F P Fᵀ` for a symmetric `P`, exactly symmetric.
pub(crate) fn congruence<N: Dim, C: Dim>(f: &OMatrix<f64, N, C>, p: &OMatrix<f64, C, C>) -> OMatrix<f64, N, N>
where
    DefaultAllocator: AllocPair<N, C>,
{
    symmetric_product::<N, C>(&times_transpose::<C, C, N, C>(p, f).transpose(), f)
}

/// `P Fᵀ`; where `F` has fewer columns than `P`, with its first columns.
#[inline]
pub(crate) fn times_transpose<R: Dim, C: Dim, N: Dim, A: Dim>(
    p: &OMatrix<f64, R, C>,
    f: &OMatrix<f64, N, A>,
) -> OMatrix<f64, R, N>
where
    DefaultAllocator: AllocPair<R, C> + AllocPair<N, A> + AllocPair<R, N>,
{
    let mut out = OMatrix::<f64, R, N>::zeros_generic(p.shape_generic().0, f.shape_generic().0);
    add_product::<R, C, N, A>(&mut out, 1.0, p, f, false);
    out
}

/// `B Fᵀ` where that is known to be symmetric.
#[inline]
pub(crate) fn symmetric_product<N: Dim, C: Dim>(
    b: &OMatrix<f64, N, C>,
    f: &OMatrix<f64, N, C>,
) -> OMatrix<f64, N, N>
where
    DefaultAllocator: AllocPair<N, C>,
{
    let n = f.shape_generic().0;
    let mut out = OMatrix::<f64, N, N>::zeros_generic(n, n);
    add_product::<N, C, N, C>(&mut out, 1.0, b, f, true);
    mirror(&mut out);
    out
}

/// Cholesky factor of a symmetric matrix given by its lower triangle; `None` unless positive definite and finite.
pub(crate) fn cholesky<D: Dim>(m: OMatrix<f64, D, D>) -> Option<Cholesky<f64, D>>
where
    DefaultAllocator: Alloc<D>,
{
    #[cfg(feature = "faer")]
    if D::is::<nalgebra::Dyn>() && m.nrows() > crate::large::LARGE {
        let mut root = m;
        let n = root.nrows();
        return crate::large::cholesky(root.as_mut_slice(), n).then(|| Cholesky::pack_dirty(root));
    }
    belief::cholesky(m)
}

/// `B ← B (L Lᵀ)⁻¹` for a lower triangular `L`, whose upper half is not read.
#[inline]
pub(crate) fn divide_columns<N: Dim, M: Dim>(b: &mut OMatrix<f64, N, M>, l: &OMatrix<f64, M, M>)
where
    DefaultAllocator: AllocPair<N, M>,
{
    #[inline(always)]
    fn subtract(to: &mut [f64], factor: f64, from: &[f64]) {
        to.iter_mut().zip(from).for_each(|(to, from)| *to -= factor * from);
    }
    let scale = |column: &mut [f64], factor: f64| column.iter_mut().for_each(|v| *v *= factor);
    let (n, m) = (b.nrows(), b.ncols());
    let columns = b.as_mut_slice();
    #[cfg(feature = "faer")]
    if N::is::<nalgebra::Dyn>() && n > crate::large::LARGE {
        return crate::large::divide_columns(columns, l.as_slice(), [n, m]);
    }
    for j in 0..m {
        let (before, rest) = columns.split_at_mut(j * n);
        for (k, column) in before.chunks_exact(n.max(1)).enumerate() {
            subtract(&mut rest[..n], l[(j, k)], column);
        }
        scale(&mut rest[..n], 1.0 / l[(j, j)]);
    }
    for j in (0..m).rev() {
        let (rest, after) = columns.split_at_mut((j + 1) * n);
        for (k, column) in (j + 1..m).zip(after.chunks_exact(n.max(1))) {
            subtract(&mut rest[j * n..], l[(k, j)], column);
        }
        scale(&mut rest[j * n..], 1.0 / l[(j, j)]);
    }
}

/// Copies the lower half to the upper one.
pub(crate) fn mirror<D: Dim>(m: &mut OMatrix<f64, D, D>)
where
    DefaultAllocator: Alloc<D>,
{
    for c in 0..m.ncols() {
        for r in c + 1..m.nrows() {
            m[(c, r)] = m[(r, c)];
        }
    }
}
