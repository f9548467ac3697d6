//! Translations of the plane with a scale.

use nalgebra::{Const, Matrix2, Matrix3, Point2, RealField, Vector2, Vector3};

use super::spiral::Spiral;
use super::{LieGroup, manifold_of_group};

/// A growth and a shift of the plane, `x ↦ a x + b`. Tangent order: translation `v`, logarithm of the scale `σ`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TranslationScale<T: RealField + Copy = f64> {
    /// Translation `b` (the unit of the plane, in pictures pixels).
    pub translation: Vector2<T>,
    /// Scale `a > 0`.
    pub scale: T,
}

impl<T: RealField + Copy> TranslationScale<T> {
    /// The motion with this translation and this positive scale.
    pub fn new(x: T, y: T, scale: T) -> Self {
        Self { translation: Vector2::new(x, y), scale }
    }
}

/// `φ(σ)` and `ψ(σ)`.
fn integrals<T: RealField + Copy>(sigma: T) -> [T; 2] {
    Spiral { re: sigma, im: T::zero() }.integrals().map(|z| z.re)
}

/// `[a | b; 0 | 1]`.
fn blocks<T: RealField + Copy>(a: T, b: Vector2<T>) -> Matrix3<T> {
    let mut m = Matrix3::identity();
    m.fixed_view_mut::<2, 2>(0, 0).copy_from(&(Matrix2::identity() * a));
    m.fixed_view_mut::<2, 1>(0, 2).copy_from(&b);
    m
}

impl<T: RealField + Copy> LieGroup<T> for TranslationScale<T> {
    type Dim = Const<3>;
    type Point = Point2<T>;
    type Over<U: RealField + Copy> = TranslationScale<U>;

    fn identity() -> Self {
        Self { translation: Vector2::zeros(), scale: T::one() }
    }
    fn compose(&self, other: &Self) -> Self {
        Self {
            translation: other.translation * self.scale + self.translation,
            scale: self.scale * other.scale,
        }
    }
    fn inverse(&self) -> Self {
        let scale = T::one() / self.scale;
        Self { translation: -self.translation * scale, scale }
    }
    fn exp(d: &Vector3<T>) -> Self {
        Self { translation: d.xy() * integrals(d.z)[0], scale: d.z.exp() }
    }
    fn log(&self) -> Vector3<T> {
        let sigma = self.scale.ln();
        let v = self.translation / integrals(sigma)[0];
        Vector3::new(v.x, v.y, sigma)
    }
    fn act(&self, p: &Point2<T>) -> Point2<T> {
        p * self.scale + self.translation
    }
    fn adjoint(&self) -> Matrix3<T> {
        blocks(self.scale, -self.translation)
    }
    fn left_jacobian(d: &Vector3<T>) -> Matrix3<T> {
        let [phi, psi] = integrals(d.z);
        blocks(phi, -d.xy() * psi)
    }
    fn left_jacobian_inverse(d: &Vector3<T>) -> Matrix3<T> {
        let [phi, psi] = integrals(d.z);
        blocks(T::one() / phi, d.xy() * (psi / phi))
    }
}

manifold_of_group!([] TranslationScale, Const<3>, |_x| Const, [("translation", 2), ("log scale", 1)]);
