//! Rigid motions of the plane.

use nalgebra::{Const, Matrix2, Matrix3, Point2, RealField, UnitComplex, Vector2, Vector3};

use super::{LieGroup, manifold_of_group, series};

/// A rigid motion of the plane, `p ↦ R p + t`. Tangent: translation `ρ` (the unit of the plane), angle `θ` (radians).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SE2<T: RealField + Copy = f64> {
    /// Rotation `R`.
    pub rotation: UnitComplex<T>,
    /// Translation `t`.
    pub translation: Vector2<T>,
}

impl<T: RealField + Copy> SE2<T> {
    /// The motion with this translation and this angle in radians.
    pub fn new(x: T, y: T, angle: T) -> Self {
        Self { rotation: super::SO2::from_angle(angle).rotation, translation: Vector2::new(x, y) }
    }

    /// The angle in `(-π, π]`.
    pub fn angle(&self) -> T {
        series::angle(self.rotation.im, self.rotation.re)
    }
}

/// `V(θ) = ∫₀¹ R(sθ) ds`.
fn v<T: RealField + Copy>(angle: T) -> Matrix2<T> {
    let [_, c1, c2, _] = series::stumpff(angle * angle);
    Matrix2::new(c1, -angle * c2, angle * c2, c1)
}

/// `V(θ)⁻¹`; `det V = 2 c_2`.
fn v_inverse<T: RealField + Copy>(angle: T) -> Matrix2<T> {
    let [_, c1, c2, _] = series::stumpff(angle * angle);
    let half: T = series::real(0.5);
    Matrix2::new(c1 / c2, angle, -angle, c1 / c2) * half
}

/// Derivative of the translation part by the angle, `∫₀¹ t(s) ds` turned by -90°.
fn column<T: RealField + Copy>(d: &Vector3<T>) -> Vector2<T> {
    let [_, _, c2, c3] = series::stumpff(d.z * d.z);
    let s = d.z * c3;
    Vector2::new(s * d.x + c2 * d.y, s * d.y - c2 * d.x)
}

impl<T: RealField + Copy> LieGroup<T> for SE2<T> {
    type Dim = Const<3>;
    type Point = Point2<T>;
    type Over<U: RealField + Copy> = SE2<U>;

    fn identity() -> Self {
        Self { rotation: UnitComplex::identity(), translation: Vector2::zeros() }
    }
    fn compose(&self, other: &Self) -> Self {
        Self {
            rotation: series::plane_product(&self.rotation, &other.rotation),
            translation: self.rotation * other.translation + self.translation,
        }
    }
    fn inverse(&self) -> Self {
        let rotation = self.rotation.conjugate();
        Self { rotation, translation: -(rotation * self.translation) }
    }
    fn exp(d: &Vector3<T>) -> Self {
        let t = v(d.z) * d.xy();
        Self::new(t.x, t.y, d.z)
    }
    fn log(&self) -> Vector3<T> {
        let angle = self.angle();
        let rho = v_inverse(angle) * self.translation;
        Vector3::new(rho.x, rho.y, angle)
    }
    fn act(&self, p: &Point2<T>) -> Point2<T> {
        self.rotation * p + self.translation
    }
    fn adjoint(&self) -> Matrix3<T> {
        let (c, s, t) = (self.rotation.re, self.rotation.im, self.translation);
        Matrix3::new(c, -s, t.y, s, c, -t.x, T::zero(), T::zero(), T::one())
    }
    fn left_jacobian(d: &Vector3<T>) -> Matrix3<T> {
        let mut j = Matrix3::identity();
        j.fixed_view_mut::<2, 2>(0, 0).copy_from(&v(d.z));
        j.fixed_view_mut::<2, 1>(0, 2).copy_from(&column(d));
        j
    }
    fn left_jacobian_inverse(d: &Vector3<T>) -> Matrix3<T> {
        let inverse = v_inverse(d.z);
        let mut j = Matrix3::identity();
        j.fixed_view_mut::<2, 2>(0, 0).copy_from(&inverse);
        j.fixed_view_mut::<2, 1>(0, 2).copy_from(&-(inverse * column(d)));
        j
    }
}

manifold_of_group!([] SE2, Const<3>, |_x| Const, [("translation", 2), ("rotation", 1)]);
