//! Real vectors, of a size known at compile time or at run time.

use nalgebra::{Const, DVector, Dyn, RealField, SMatrix, SVector};

use super::{LieGroup, manifold_of_group};
use crate::batch::Row;
use crate::manifold::{Manifold, Square, Tangent};

/// `R^N`: the group of translations of itself. Tangent: the components, in their own units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vector<const N: usize, T: RealField + Copy = f64>(pub SVector<T, N>);

impl<const N: usize, T: RealField + Copy> LieGroup<T> for Vector<N, T> {
    type Dim = Const<N>;
    type Point = SVector<T, N>;
    type Over<U: RealField + Copy> = Vector<N, U>;

    fn identity() -> Self {
        Self(SVector::zeros())
    }
    fn compose(&self, other: &Self) -> Self {
        Self(self.0 + other.0)
    }
    fn inverse(&self) -> Self {
        Self(-self.0)
    }
    fn exp(d: &SVector<T, N>) -> Self {
        Self(*d)
    }
    fn log(&self) -> SVector<T, N> {
        self.0
    }
    fn act(&self, p: &SVector<T, N>) -> SVector<T, N> {
        self.0 + p
    }
    fn adjoint(&self) -> SMatrix<T, N, N> {
        SMatrix::identity()
    }
    fn left_jacobian(_: &SVector<T, N>) -> SMatrix<T, N, N> {
        SMatrix::identity()
    }
    fn left_jacobian_inverse(_: &SVector<T, N>) -> SMatrix<T, N, N> {
        SMatrix::identity()
    }
}

manifold_of_group!([const N: usize] Vector<N>, Const<N>, |_x| Const, [("vector", N)],
    const FLAT: bool = true;
    fn is_finite(&self) -> bool {
        self.0.iter().all(|v| v.is_finite())
    }
    fn retract_each<S>(states: &mut [S], point: impl Fn(&mut S) -> &mut Self, d: &[Row]) {
        for (k, state) in states.iter_mut().enumerate() {
            for d in d.chunks_exact(N.max(1)) {
                point(state).0.iter_mut().zip(d).for_each(|(v, row)| *v += row[k]);
            }
        }
    }
    fn local_each(&self, points: &[Self], out: &mut [Row]) {
        for (k, point) in points.iter().enumerate() {
            for r in 0..N {
                out[r][k] = point.0[r] - self.0[r];
            }
        }
        out.iter_mut().for_each(|row| row[points.len()..].fill(0.0));
    }
    fn centre(points: &[Self], weights: &[f64]) -> Option<Self> {
        let (mut sum, mut total) = (SVector::<f64, N>::zeros(), 0.0);
        for (point, w) in points.iter().zip(weights) {
            sum.axpy(*w, &point.0, 1.0);
            total += w;
        }
        (total > 0.0).then(|| Self(sum / total))
    }
);

/// `R^n` with `n` known at run time, such as the joint angles of a skeleton. Tangent: the components.
#[derive(Clone, Debug, PartialEq)]
pub struct DynVector(pub DVector<f64>);

impl Manifold for DynVector {
    type D = Dyn;
    const FLAT: bool = true;

    fn dim(&self) -> Dyn {
        Dyn(self.0.len())
    }
    fn retract(&self, d: &Tangent<Self>) -> Self {
        Self(&self.0 + d)
    }
    fn local(&self, other: &Self) -> Tangent<Self> {
        &other.0 - &self.0
    }
    fn retract_jacobian(&self, _: &Tangent<Self>) -> Square<Self> {
        Square::<Self>::identity_generic(self.dim(), self.dim())
    }
    fn transport(&self, _: &Tangent<Self>) -> Square<Self> {
        Square::<Self>::identity_generic(self.dim(), self.dim())
    }
    fn blocks(&self) -> Vec<(String, usize)> {
        vec![("vector".into(), self.0.len())]
    }
}

/// Spaces that are their own tangent space, for models written with matrices.
pub trait VectorSpace: Manifold
where
    nalgebra::DefaultAllocator: crate::manifold::Alloc<Self::D>,
{
    /// The components.
    fn components(&self) -> &Tangent<Self>;

    /// The point with these components.
    fn from_components(components: Tangent<Self>) -> Self;
}

impl<const N: usize> VectorSpace for Vector<N> {
    fn components(&self) -> &Tangent<Self> {
        &self.0
    }
    fn from_components(components: Tangent<Self>) -> Self {
        Self(components)
    }
}

impl VectorSpace for DynVector {
    fn components(&self) -> &Tangent<Self> {
        &self.0
    }
    fn from_components(components: Tangent<Self>) -> Self {
        Self(components)
    }
}
