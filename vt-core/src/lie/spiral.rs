//! Turning and growing in the plane: the algebra of `σ + θ J`, `J` the quarter turn, which is that of complex numbers.

use nalgebra::{Matrix2, RealField, Vector2};

use super::series;

/// `re + im J`.
#[derive(Clone, Copy)]
pub(super) struct Spiral<T> {
    pub re: T,
    pub im: T,
}

impl<T: RealField + Copy> Spiral<T> {
    fn times(self, o: Self) -> Self {
        Self { re: self.re * o.re - self.im * o.im, im: self.re * o.im + self.im * o.re }
    }

    fn plus(self, real: T) -> Self {
        Self { re: self.re + real, ..self }
    }

    fn scaled(self, f: T) -> Self {
        Self { re: self.re * f, im: self.im * f }
    }

    pub fn inverse(self) -> Self {
        let squared = self.re * self.re + self.im * self.im;
        Self { re: self.re / squared, im: -self.im / squared }
    }

    pub fn apply(self, v: &Vector2<T>) -> Vector2<T> {
        Vector2::new(self.re * v.x - self.im * v.y, self.im * v.x + self.re * v.y)
    }

    pub fn matrix(self) -> Matrix2<T> {
        Matrix2::new(self.re, -self.im, self.im, self.re)
    }

    /// `φ(z) = (e^z − 1) / z` and `ψ(z) = (e^z − 1 − z) / z²` of this `z`, by their series below one.
    pub fn integrals(self) -> [Self; 2] {
        let one = Self { re: T::one(), im: T::zero() };
        if self.re * self.re + self.im * self.im < T::one() {
            let mut sum = one;
            for n in (3..20).rev() {
                sum = self.times(sum).scaled(series::real(1.0 / f64::from(n))).plus(T::one());
            }
            let psi = sum.scaled(series::real(0.5));
            return [self.times(psi).plus(T::one()), psi];
        }
        let (s, c) = self.im.sin_cos();
        let reciprocal = self.inverse();
        let phi = Self { re: c, im: s }.scaled(self.re.exp()).plus(-T::one()).times(reciprocal);
        [phi, phi.plus(-T::one()).times(reciprocal)]
    }
}
