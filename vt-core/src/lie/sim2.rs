//! Similarities of the plane.

use nalgebra::{Const, Matrix2, Matrix4, Point2, RealField, UnitComplex, Vector2, Vector4};

use super::spiral::Spiral;
use super::{LieGroup, SO2, manifold_of_group, series};

/// A similarity of the plane, `x ↦ a R(θ) x + b`. Tangent order: translation `v`, angle `θ` (radians), logarithm of
/// the scale `σ`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sim2<T: RealField + Copy = f64> {
    /// Rotation `R`.
    pub rotation: UnitComplex<T>,
    /// Translation `b` (the unit of the plane, in pictures pixels).
    pub translation: Vector2<T>,
    /// Scale `a > 0`.
    pub scale: T,
}

impl<T: RealField + Copy> Sim2<T> {
    /// The similarity with this translation, this angle in radians and this positive scale.
    pub fn new(x: T, y: T, angle: T, scale: T) -> Self {
        Self { rotation: SO2::from_angle(angle).rotation, translation: Vector2::new(x, y), scale }
    }

    /// The angle in `(-π, π]`.
    pub fn angle(&self) -> T {
        series::angle(self.rotation.im, self.rotation.re)
    }
}

/// `[a | J b  b; 0 | 1]`: what a change of angle and of the logarithm of the scale do lies a quarter turn apart.
fn blocks<T: RealField + Copy>(a: Matrix2<T>, b: Vector2<T>) -> Matrix4<T> {
    let mut m = Matrix4::identity();
    m.fixed_view_mut::<2, 2>(0, 0).copy_from(&a);
    m.fixed_view_mut::<2, 1>(0, 2).copy_from(&Vector2::new(-b.y, b.x));
    m.fixed_view_mut::<2, 1>(0, 3).copy_from(&b);
    m
}

fn spiral<T: RealField + Copy>(d: &Vector4<T>) -> Spiral<T> {
    Spiral { re: d.w, im: d.z }
}

impl<T: RealField + Copy> LieGroup<T> for Sim2<T> {
    type Dim = Const<4>;
    type Point = Point2<T>;
    type Over<U: RealField + Copy> = Sim2<U>;

    fn identity() -> Self {
        Self { rotation: UnitComplex::identity(), translation: Vector2::zeros(), scale: T::one() }
    }
    fn compose(&self, other: &Self) -> Self {
        Self {
            rotation: series::plane_product(&self.rotation, &other.rotation),
            translation: self.rotation * other.translation * self.scale + self.translation,
            scale: self.scale * other.scale,
        }
    }
    fn inverse(&self) -> Self {
        let (rotation, scale) = (self.rotation.conjugate(), T::one() / self.scale);
        Self { rotation, translation: -(rotation * self.translation) * scale, scale }
    }
    fn exp(d: &Vector4<T>) -> Self {
        let translation = spiral(d).integrals()[0].apply(&d.xy());
        Self { rotation: SO2::from_angle(d.z).rotation, translation, scale: d.w.exp() }
    }
    fn log(&self) -> Vector4<T> {
        let (angle, sigma) = (self.angle(), self.scale.ln());
        let phi = Spiral { re: sigma, im: angle }.integrals()[0];
        let v = phi.inverse().apply(&self.translation);
        Vector4::new(v.x, v.y, angle, sigma)
    }
    fn act(&self, p: &Point2<T>) -> Point2<T> {
        self.rotation * p * self.scale + self.translation
    }
    fn adjoint(&self) -> Matrix4<T> {
        let turn = Spiral { re: self.rotation.re * self.scale, im: self.rotation.im * self.scale };
        blocks(turn.matrix(), -self.translation)
    }
    fn left_jacobian(d: &Vector4<T>) -> Matrix4<T> {
        let [phi, psi] = spiral(d).integrals();
        blocks(phi.matrix(), -psi.apply(&d.xy()))
    }
    fn left_jacobian_inverse(d: &Vector4<T>) -> Matrix4<T> {
        let [phi, psi] = spiral(d).integrals();
        let inverse = phi.inverse();
        blocks(inverse.matrix(), inverse.apply(&psi.apply(&d.xy())))
    }
}

manifold_of_group!([] Sim2, Const<4>, |_x| Const, [("translation", 2), ("rotation", 1), ("log scale", 1)]);
