//! The gain of a linear(ised) measurement and the covariance after it, in Joseph's form.
//!
//! For `y = H δ + v` with `δ ~ N(0, P)`, `v ~ N(0, R)` and `H` acting on the leading coordinates of `δ`:
//!
//! ```text
//! S = H P Hᵀ + R,   K = P Hᵀ S⁻¹,   P⁺ = (1 − KH) P (1 − KH)ᵀ + K R Kᵀ
//! ```
//!
//! Joseph's form is symmetric and positive semi-definite in spite of rounding.

use nalgebra::{Cholesky, DefaultAllocator, Dim, OMatrix, OVector};
use vt_core::error::EstimateError;
use vt_core::manifold::AllocPair;
use vt_core::math;

use crate::congruence::{add_product, cholesky, divide_columns, mirror, symmetric_product, times_transpose};

/// Gain of a measurement with `M` rows for a state with `N` coordinates.
pub(crate) struct Gain<N: Dim, M: Dim>
where
    DefaultAllocator: AllocPair<N, M>,
{
    /// `K`.
    pub gain: OMatrix<f64, N, M>,
    /// `P Hᵀ`.
    across: OMatrix<f64, N, M>,
    /// Factor of `S`.
    factor: Cholesky<f64, M>,
}

impl<N: Dim, M: Dim> Gain<N, M>
where
    DefaultAllocator: AllocPair<N, M>,
{
    /// The optimal gain; `noise` is `R`, one where absent.
    ///
    /// # Errors
    /// When numbers overflow.
    #[inline]
    pub fn new<A: Dim>(
        p: &OMatrix<f64, N, N>,
        h: &OMatrix<f64, M, A>,
        noise: Option<&OMatrix<f64, M, M>>,
    ) -> Result<Self, EstimateError>
    where
        DefaultAllocator: AllocPair<N, A> + AllocPair<M, A> + AllocPair<N, M>,
    {
        let across = times_transpose::<N, N, M, A>(p, h); // P Hᵀ
        let mut s = symmetric_product::<M, A>(&across.rows_generic(0, h.shape_generic().1).transpose(), h);
        match noise {
            Some(r) => s += r,
            None => (0..s.nrows()).for_each(|k| s[(k, k)] += 1.0),
        }
        let factor = cholesky(s).ok_or(EstimateError::NotPositiveDefinite("the innovation's covariance"))?;
        let mut gain = across.clone();
        divide_columns(&mut gain, factor.l_dirty());
        Ok(Self { gain, across, factor })
    }

    /// `S⁻¹ b`.
    pub fn solve<A: Dim>(&self, b: &OMatrix<f64, M, A>) -> OMatrix<f64, M, A>
    where
        DefaultAllocator: AllocPair<M, A>,
    {
        self.factor.solve(b)
    }

    /// `νᵀ S⁻¹ ν` and `ln det S`.
    #[inline]
    pub fn surprise(&self, nu: &OVector<f64, M>) -> (f64, f64) {
        let l = self.factor.l_dirty();
        let mut w = nu.clone();
        l.solve_lower_triangular_mut(&mut w);
        (w.norm_squared(), log_det(l))
    }

    /// `P⁺` for this gain, from the `P` and `H` that it was made of: with `A = (1 − KH) P` it is `A − (A Hᵀ − K R) Kᵀ`.
    #[inline]
    pub fn joseph<A: Dim>(
        &self,
        p: &OMatrix<f64, N, N>,
        h: &OMatrix<f64, M, A>,
        noise: Option<&OMatrix<f64, M, M>>,
    ) -> OMatrix<f64, N, N>
    where
        DefaultAllocator: AllocPair<N, A> + AllocPair<M, A> + AllocPair<N, M>,
    {
        let mut a = p.clone();
        add_product::<N, M, N, M>(&mut a, -1.0, &self.gain, &self.across, false);
        let mut rest = times_transpose::<N, N, M, A>(&a, h);
        match noise {
            Some(r) => add_product::<N, M, M, M>(&mut rest, -1.0, &self.gain, r, false),
            None => rest -= &self.gain,
        }
        add_product::<N, M, N, M>(&mut a, -1.0, &rest, &self.gain, true);
        mirror(&mut a);
        a
    }
}

/// `ln det L Lᵀ` of a lower triangular `L`.
pub(crate) fn log_det<M: Dim>(l: &OMatrix<f64, M, M>) -> f64
where
    DefaultAllocator: AllocPair<M, M>,
{
    // One logarithm, unless the product leaves the range of numbers.
    let product: f64 = (0..l.nrows()).map(|k| l[(k, k)]).product();
    if product.is_normal() {
        return 2.0 * math::ln(product);
    }
    (0..l.nrows()).map(|k| 2.0 * math::ln(l[(k, k)])).sum()
}
