//! Two spaces side by side.

use nalgebra::{DefaultAllocator, Dim, DimAdd, DimName, DimSum, OMatrix, OVector, RealField, U1};

use super::LieGroup;
use crate::manifold::{Alloc, Manifold, Square, Tangent};

/// A point of `A` and a point of `B`. Tangent: the coordinates of the first, then those of the second.
///
/// A manifold when both are (one may have a run-time dimension: a floating base and its joints), a Lie group when
/// both are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Product<A, B> {
    /// Point of the first space.
    pub first: A,
    /// Point of the second space.
    pub second: B,
}

/// `[A 0; 0 B]`.
fn diagonal<T: RealField, A, B>(
    a: &OMatrix<T, A, A>,
    b: &OMatrix<T, B, B>,
) -> OMatrix<T, DimSum<A, B>, DimSum<A, B>>
where
    A: DimAdd<B>,
    B: Dim,
    DefaultAllocator: Alloc<A> + Alloc<B> + Alloc<DimSum<A, B>>,
{
    let (n, m) = (a.shape_generic().0, b.shape_generic().0);
    let mut out = OMatrix::zeros_generic(n.add(m), n.add(m));
    out.generic_view_mut((0, 0), (n, n)).copy_from(a);
    out.generic_view_mut((n.value(), n.value()), (m, m)).copy_from(b);
    out
}

fn stack<T: RealField, A, B>(a: &OVector<T, A>, b: &OVector<T, B>) -> OVector<T, DimSum<A, B>>
where
    A: DimAdd<B>,
    B: Dim,
    DefaultAllocator: Alloc<A> + Alloc<B> + Alloc<DimSum<A, B>>,
{
    let (n, m) = (a.shape_generic().0, b.shape_generic().0);
    let mut out = OVector::zeros_generic(n.add(m), U1);
    out.rows_generic_mut(0, n).copy_from(a);
    out.rows_generic_mut(n.value(), m).copy_from(b);
    out
}

fn split<T: RealField, A, B>(d: &OVector<T, DimSum<A, B>>, n: A, m: B) -> (OVector<T, A>, OVector<T, B>)
where
    A: DimAdd<B>,
    B: Dim,
    DefaultAllocator: Alloc<A> + Alloc<B> + Alloc<DimSum<A, B>>,
{
    (d.rows_generic(0, n).into_owned(), d.rows_generic(n.value(), m).into_owned())
}

impl<A: Manifold, B: Manifold> Manifold for Product<A, B>
where
    A::D: DimAdd<B::D>,
    DefaultAllocator: Alloc<A::D> + Alloc<B::D> + Alloc<DimSum<A::D, B::D>>,
{
    type D = DimSum<A::D, B::D>;
    const FLAT: bool = A::FLAT && B::FLAT;

    fn dim(&self) -> Self::D {
        self.first.dim().add(self.second.dim())
    }
    fn retract(&self, d: &Tangent<Self>) -> Self {
        let (a, b) = split(d, self.first.dim(), self.second.dim());
        Self { first: self.first.retract(&a), second: self.second.retract(&b) }
    }
    fn local(&self, other: &Self) -> Tangent<Self> {
        stack(&self.first.local(&other.first), &self.second.local(&other.second))
    }
    fn retract_jacobian(&self, d: &Tangent<Self>) -> Square<Self> {
        let (a, b) = split(d, self.first.dim(), self.second.dim());
        diagonal(&self.first.retract_jacobian(&a), &self.second.retract_jacobian(&b))
    }
    fn transport(&self, d: &Tangent<Self>) -> Square<Self> {
        let (a, b) = split(d, self.first.dim(), self.second.dim());
        diagonal(&self.first.transport(&a), &self.second.transport(&b))
    }
    fn blocks(&self) -> Vec<(String, usize)> {
        [self.first.blocks(), self.second.blocks()].concat()
    }
}

impl<T: RealField + Copy, A: LieGroup<T>, B: LieGroup<T>> LieGroup<T> for Product<A, B>
where
    A::Dim: DimName + DimAdd<B::Dim>,
    B::Dim: DimName,
    DimSum<A::Dim, B::Dim>: DimName,
    DefaultAllocator: Alloc<A::Dim> + Alloc<B::Dim> + Alloc<DimSum<A::Dim, B::Dim>>,
{
    type Dim = DimSum<A::Dim, B::Dim>;
    type Point = (A::Point, B::Point);
    type Over<U: RealField + Copy> = Product<A::Over<U>, B::Over<U>>;

    fn identity() -> Self {
        Self { first: A::identity(), second: B::identity() }
    }
    fn compose(&self, other: &Self) -> Self {
        Self { first: self.first.compose(&other.first), second: self.second.compose(&other.second) }
    }
    fn inverse(&self) -> Self {
        Self { first: self.first.inverse(), second: self.second.inverse() }
    }
    fn exp(d: &OVector<T, Self::Dim>) -> Self {
        let (a, b) = split(d, A::Dim::name(), B::Dim::name());
        Self { first: A::exp(&a), second: B::exp(&b) }
    }
    fn log(&self) -> OVector<T, Self::Dim> {
        stack(&self.first.log(), &self.second.log())
    }
    fn act(&self, p: &Self::Point) -> Self::Point {
        (self.first.act(&p.0), self.second.act(&p.1))
    }
    fn adjoint(&self) -> OMatrix<T, Self::Dim, Self::Dim> {
        diagonal(&self.first.adjoint(), &self.second.adjoint())
    }
    fn left_jacobian(d: &OVector<T, Self::Dim>) -> OMatrix<T, Self::Dim, Self::Dim> {
        let (a, b) = split(d, A::Dim::name(), B::Dim::name());
        diagonal(&A::left_jacobian(&a), &B::left_jacobian(&b))
    }
    fn left_jacobian_inverse(d: &OVector<T, Self::Dim>) -> OMatrix<T, Self::Dim, Self::Dim> {
        let (a, b) = split(d, A::Dim::name(), B::Dim::name());
        diagonal(&A::left_jacobian_inverse(&a), &B::left_jacobian_inverse(&b))
    }
}
