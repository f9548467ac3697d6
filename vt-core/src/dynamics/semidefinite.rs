//! Roots of symmetric positive semi-definite matrices: covariances and information, singular or not.

use nalgebra::{DefaultAllocator, Dim, OMatrix, OVector, U1};

use crate::manifold::Alloc;

/// A lower triangular matrix `L` with `L Lᵀ = m` for a symmetric positive semi-definite `m`: `L_kk > 0`, or column `k`
/// is zero where coordinate `k` adds nothing to those before; negative eigenvalues from rounding count as zero.
///
/// Without pivoting, singular matrices with strong correlations lose digits; where the triangle is not needed, as
/// for sampling, [`pivoted_root`] keeps them.
pub fn semidefinite_root<D: Dim>(m: &OMatrix<f64, D, D>) -> OMatrix<f64, D, D>
where
    DefaultAllocator: Alloc<D>,
{
    // A pivot is zero against its own diagonal entry, so that coordinates of very different units do not hide each
    // other.
    let n = m.nrows();
    let mut l = OMatrix::zeros_generic(m.shape_generic().0, m.shape_generic().1);
    for c in 0..n {
        let explained: f64 = (0..c).map(|k| l[(c, k)] * l[(c, k)]).sum();
        let pivot = m[(c, c)] - explained;
        if pivot <= 1e-13 * m[(c, c)].abs() {
            continue;
        }
        let root = pivot.sqrt();
        l[(c, c)] = root;
        for r in c + 1..n {
            let explained: f64 = (0..c).map(|k| l[(r, k)] * l[(c, k)]).sum();
            l[(r, c)] = (m[(r, c)] - explained) / root;
        }
    }
    l
}

/// A matrix `L` with `L Lᵀ = m` to full precision for a symmetric positive semi-definite `m`. Not triangular; as many
/// columns as the rank are not zero, and a diagonal matrix gives its diagonal root.
pub fn pivoted_root<D: Dim>(m: &OMatrix<f64, D, D>) -> OMatrix<f64, D, D>
where
    DefaultAllocator: Alloc<D>,
{
    PivotedFactor::new(m).root
}

/// [`pivoted_root`] with what solving needs: row `order[k]` of `L` has entries in the columns `order[0] … order[k]` only.
#[derive(Clone, Debug)]
pub struct PivotedFactor<D: Dim>
where
    DefaultAllocator: Alloc<D>,
{
    /// `L`.
    pub root: OMatrix<f64, D, D>,
    /// Coordinates in the order in which their columns were found; after the first `rank` those that add nothing.
    pub order: OVector<usize, D>,
    /// Number of columns that are not zero.
    pub rank: usize,
}

impl<D: Dim> PivotedFactor<D>
where
    DefaultAllocator: Alloc<D>,
{
    /// Cholesky with diagonal pivoting, each pivot judged against its own diagonal entry.
    pub fn new(m: &OMatrix<f64, D, D>) -> Self {
        let size = m.shape_generic().0;
        let n = size.value();
        let mut l = OMatrix::zeros_generic(size, size);
        let mut order = OVector::<usize, D>::from_fn_generic(size, U1, |k, _| k);
        let mut pivots = m.diagonal();
        for rank in 0..n {
            // The coordinate that the columns so far explain least.
            let unexplained = |k: usize| if m[(k, k)] > 0.0 { pivots[k] / m[(k, k)] } else { 0.0 };
            let mut best = rank;
            for k in rank + 1..n {
                if unexplained(order[k]) > unexplained(order[best]) {
                    best = k;
                }
            }
            let p = order[best];
            if unexplained(p) <= 1e-14 {
                return Self { root: l, order, rank };
            }
            // Keeps the others in order.
            for k in (rank..best).rev() {
                order[k + 1] = order[k];
            }
            order[rank] = p;
            let root = pivots[p].sqrt();
            l[(p, p)] = root;
            for &r in order.iter().skip(rank + 1) {
                let explained: f64 = order.iter().take(rank).map(|&c| l[(r, c)] * l[(p, c)]).sum();
                let v = (m[(r, p)] - explained) / root;
                l[(r, p)] = v;
                pivots[r] -= v * v;
            }
        }
        Self { root: l, order, rank: n }
    }

    /// `y = L⁺ b` for a `b` in the range of `L`, zero where a column is.
    pub fn solve(&self, b: &OVector<f64, D>) -> OVector<f64, D> {
        let mut rest = b.clone();
        let mut y = OVector::zeros_generic(b.shape_generic().0, U1);
        for &c in self.order.iter().take(self.rank) {
            y[c] = rest[c] / self.root[(c, c)];
            rest.axpy(-y[c], &self.root.column(c), 1.0);
        }
        y
    }
}
