//! Rotations of the plane.

use nalgebra::{Const, Matrix1, Point2, RealField, UnitComplex, Vector1};

use super::{LieGroup, manifold_of_group, series};

/// A rotation of the plane, counter-clockwise from x to y. Tangent: the angle in radians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SO2<T: RealField + Copy = f64> {
    /// Cosine and sine of the angle.
    pub rotation: UnitComplex<T>,
}

impl<T: RealField + Copy> SO2<T> {
    /// The rotation by `angle` radians.
    pub fn from_angle(angle: T) -> Self {
        let (s, c) = angle.sin_cos();
        Self { rotation: UnitComplex::new_unchecked(nalgebra::Complex::new(c, s)) }
    }

    /// The angle in `(-π, π]`.
    pub fn angle(&self) -> T {
        series::angle(self.rotation.im, self.rotation.re)
    }
}

impl<T: RealField + Copy> LieGroup<T> for SO2<T> {
    type Dim = Const<1>;
    type Point = Point2<T>;
    type Over<U: RealField + Copy> = SO2<U>;

    fn identity() -> Self {
        Self { rotation: UnitComplex::identity() }
    }
    fn compose(&self, other: &Self) -> Self {
        Self { rotation: series::plane_product(&self.rotation, &other.rotation) }
    }
    fn inverse(&self) -> Self {
        Self { rotation: self.rotation.conjugate() }
    }
    fn exp(d: &Vector1<T>) -> Self {
        Self::from_angle(d.x)
    }
    fn log(&self) -> Vector1<T> {
        Vector1::new(self.angle())
    }
    fn act(&self, p: &Point2<T>) -> Point2<T> {
        self.rotation * p
    }
    fn adjoint(&self) -> Matrix1<T> {
        Matrix1::identity()
    }
    fn left_jacobian(_: &Vector1<T>) -> Matrix1<T> {
        Matrix1::identity()
    }
    fn left_jacobian_inverse(_: &Vector1<T>) -> Matrix1<T> {
        Matrix1::identity()
    }
}

manifold_of_group!([] SO2, Const<1>, |_x| Const, [("rotation", 1)]);
