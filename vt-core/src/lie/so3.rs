//! Rotations of space.

use nalgebra::{Const, Matrix3, Point3, RealField, UnitQuaternion, Vector3};

use super::{LieGroup, manifold_of_group, series};

/// A rotation of space. Tangent: the rotation vector `ω` (radians).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SO3<T: RealField + Copy = f64> {
    /// The rotation as a unit quaternion.
    pub rotation: UnitQuaternion<T>,
}

impl<T: RealField + Copy> LieGroup<T> for SO3<T> {
    type Dim = Const<3>;
    type Point = Point3<T>;
    type Over<U: RealField + Copy> = SO3<U>;

    fn identity() -> Self {
        Self { rotation: UnitQuaternion::identity() }
    }
    #[inline]
    fn compose(&self, other: &Self) -> Self {
        Self { rotation: series::product(&self.rotation, &other.rotation) }
    }
    fn inverse(&self) -> Self {
        Self { rotation: self.rotation.conjugate() }
    }
    #[inline]
    fn exp(d: &Vector3<T>) -> Self {
        Self { rotation: series::rotation_exp(d).0 }
    }
    #[inline]
    fn log(&self) -> Vector3<T> {
        series::rotation_log(&self.rotation)
    }
    #[inline]
    fn act(&self, p: &Point3<T>) -> Point3<T> {
        self.rotation * p
    }
    fn adjoint(&self) -> Matrix3<T> {
        self.rotation.to_rotation_matrix().into_inner()
    }
    fn left_jacobian(d: &Vector3<T>) -> Matrix3<T> {
        let (_, a, b) = series::rotation_exp(d);
        series::polynomial(d, a, b)
    }
    fn left_jacobian_inverse(d: &Vector3<T>) -> Matrix3<T> {
        series::polynomial(d, series::real(-0.5), series::inverse_coefficient(d.norm_squared()))
    }
}

manifold_of_group!([] SO3, Const<3>, |_x| Const, [("rotation", 3)]);
