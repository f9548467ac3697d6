//! Similarities of space: rigid motions with a scale.

use nalgebra::{Const, Matrix3, Point3, RealField, SMatrix, SVector, UnitQuaternion, Vector3};

use super::{LieGroup, SE3, SO3, manifold_of_group, series};

/// A similarity `p ↦ s R p + t`. Tangent order: translation `v` (metres), rotation `ω` (radians), logarithm of the
/// scale `σ`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sim3<T: RealField + Copy = f64> {
    /// Rotation `R`.
    pub rotation: UnitQuaternion<T>,
    /// Translation `t` in metres.
    pub translation: Vector3<T>,
    /// Scale `s > 0`.
    pub scale: T,
}

impl<T: RealField + Copy> From<SE3<T>> for Sim3<T> {
    fn from(m: SE3<T>) -> Self {
        Self { rotation: m.rotation, translation: m.translation, scale: T::one() }
    }
}

/// A polynomial `a + b K + c K²` in `K = [ω]×`, which obeys `K³ = -θ² K`. Functions of `ω× + σ` stay in this algebra,
/// so they need no division by the angle or by the logarithm of the scale.
#[derive(Clone, Copy)]
struct Spin<T> {
    a: T,
    b: T,
    c: T,
}

impl<T: RealField + Copy> Spin<T> {
    fn one() -> Self {
        Self { a: T::one(), b: T::zero(), c: T::zero() }
    }
    fn times(self, o: Self, squared: T) -> Self {
        Self {
            a: self.a * o.a,
            b: self.a * o.b + self.b * o.a - squared * (self.b * o.c + self.c * o.b),
            c: self.a * o.c + self.c * o.a + self.b * o.b - squared * self.c * o.c,
        }
    }
    fn plus_one(self) -> Self {
        Self { a: self.a + T::one(), ..self }
    }
    fn scaled(self, f: T) -> Self {
        Self { a: self.a * f, b: self.b * f, c: self.c * f }
    }
    /// `φ(ω× + σ)` with `φ(z) = (e^z - 1) / z = ∫₀¹ e^{sz} ds`: Taylor series of a halved argument, then doublings
    /// `φ(2z) = ½ φ(z) (e^z + 1)`.
    fn phi(squared: T, sigma: T) -> Self {
        let (mut x, mut s, mut doublings) = (squared, sigma, 0);
        while x + s * s > series::real(0.25) && doublings < 64 {
            x *= series::real(0.25);
            s *= series::real(0.5);
            doublings += 1;
        }
        let z = Self { a: s, b: T::one(), c: T::zero() };
        let mut phi = Self::one();
        for k in (2..16).rev() {
            phi = phi.times(z, x).scaled(series::real(1.0 / f64::from(k))).plus_one();
        }
        for _ in 0..doublings {
            // In units of the halved K, e^z = 1 + z φ(z); the next K is twice as long.
            let z = Self { a: s, b: T::one(), c: T::zero() };
            let grown = z.times(phi, x).plus_one();
            phi = phi.times(grown.plus_one(), x).scaled(series::real(0.5));
            phi = Self { a: phi.a, b: phi.b * series::real(0.5), c: phi.c * series::real(0.25) };
            x *= series::real(4.0);
            s *= series::real(2.0);
        }
        phi
    }
    fn inverse(self, squared: T) -> Self {
        let a = T::one() / self.a;
        let (p, q) = (self.a - squared * self.c, self.b);
        let det = p * p + squared * q * q;
        let (f, g) = (-self.b * a, -self.c * a);
        Self { a, b: (p * f + squared * q * g) / det, c: (p * g - q * f) / det }
    }
    fn matrix(self, w: &Vector3<T>) -> Matrix3<T> {
        let k = series::cross(w);
        Matrix3::identity() * self.a + k * self.b + k * k * self.c
    }
    fn apply(self, w: &Vector3<T>, v: &Vector3<T>) -> Vector3<T> {
        let wv = w.cross(v);
        v * self.a + wv * self.b + w.cross(&wv) * self.c
    }
}

fn split<T: RealField + Copy>(d: &SVector<T, 7>) -> (Vector3<T>, Vector3<T>, T) {
    (Vector3::new(d[0], d[1], d[2]), Vector3::new(d[3], d[4], d[5]), d[6])
}

/// `φ(A)` of a square matrix, by the series and doublings of [`Spin::phi`]: the left Jacobian when `A = ad`.
pub(super) fn phi<T: RealField + Copy, const N: usize>(a: &SMatrix<T, N, N>) -> SMatrix<T, N, N> {
    let one = SMatrix::<T, N, N>::identity();
    let (mut z, mut doublings) = (*a, 0);
    while z.norm_squared() > series::real(0.25) && doublings < 64 {
        z *= series::real::<T>(0.5);
        doublings += 1;
    }
    let mut phi = one;
    for k in (2..16).rev() {
        phi = one + z * phi * series::real::<T>(1.0 / f64::from(k));
    }
    for _ in 0..doublings {
        phi = phi * (z * phi + one + one) * series::real::<T>(0.5);
        z *= series::real::<T>(2.0);
    }
    phi
}

/// `ad(d)`: the bracket `[d, ·]`.
fn bracket<T: RealField + Copy>(d: &SVector<T, 7>) -> SMatrix<T, 7, 7> {
    let (v, w, sigma) = split(d);
    let turn = series::cross(&w);
    let mut m = SMatrix::<T, 7, 7>::zeros();
    m.fixed_view_mut::<3, 3>(0, 0).copy_from(&(turn + Matrix3::identity() * sigma));
    m.fixed_view_mut::<3, 3>(0, 3).copy_from(&series::cross(&v));
    m.fixed_view_mut::<3, 1>(0, 6).copy_from(&-v);
    m.fixed_view_mut::<3, 3>(3, 3).copy_from(&turn);
    m
}

impl<T: RealField + Copy> LieGroup<T> for Sim3<T> {
    type Dim = Const<7>;
    type Point = Point3<T>;
    type Over<U: RealField + Copy> = Sim3<U>;

    fn identity() -> Self {
        SE3::identity().into()
    }
    fn compose(&self, other: &Self) -> Self {
        Self {
            rotation: series::product(&self.rotation, &other.rotation),
            translation: self.rotation * other.translation * self.scale + self.translation,
            scale: self.scale * other.scale,
        }
    }
    fn inverse(&self) -> Self {
        let rotation = self.rotation.conjugate();
        let scale = T::one() / self.scale;
        Self { rotation, translation: -(rotation * self.translation) * scale, scale }
    }
    fn exp(d: &SVector<T, 7>) -> Self {
        let (v, w, sigma) = split(d);
        let translation = Spin::phi(w.norm_squared(), sigma).apply(&w, &v);
        Self { rotation: series::rotation_exp(&w).0, translation, scale: sigma.exp() }
    }
    fn log(&self) -> SVector<T, 7> {
        let (w, sigma) = (series::rotation_log(&self.rotation), self.scale.ln());
        let x = w.norm_squared();
        let v = Spin::phi(x, sigma).inverse(x).apply(&w, &self.translation);
        SVector::from([v.x, v.y, v.z, w.x, w.y, w.z, sigma])
    }
    fn act(&self, p: &Point3<T>) -> Point3<T> {
        Point3::from(self.rotation * p.coords * self.scale + self.translation)
    }
    fn adjoint(&self) -> SMatrix<T, 7, 7> {
        let r = self.rotation.to_rotation_matrix().into_inner();
        let mut m = SMatrix::<T, 7, 7>::identity();
        m.fixed_view_mut::<3, 3>(0, 0).copy_from(&(r * self.scale));
        m.fixed_view_mut::<3, 3>(0, 3).copy_from(&(series::cross(&self.translation) * r));
        m.fixed_view_mut::<3, 1>(0, 6).copy_from(&-self.translation);
        m.fixed_view_mut::<3, 3>(3, 3).copy_from(&r);
        m
    }
    fn left_jacobian(d: &SVector<T, 7>) -> SMatrix<T, 7, 7> {
        phi(&bracket(d))
    }
    fn left_jacobian_inverse(d: &SVector<T, 7>) -> SMatrix<T, 7, 7> {
        let (_, w, sigma) = split(d);
        let x = w.norm_squared();
        let j = Self::left_jacobian(d);
        let (outer, inner) = (Spin::phi(x, sigma).inverse(x).matrix(&w), SO3::left_jacobian_inverse(&w));
        let mut m = SMatrix::<T, 7, 7>::identity();
        m.fixed_view_mut::<3, 3>(0, 0).copy_from(&outer);
        m.fixed_view_mut::<3, 3>(0, 3).copy_from(&-(outer * j.fixed_view::<3, 3>(0, 3) * inner));
        m.fixed_view_mut::<3, 1>(0, 6).copy_from(&-(outer * j.fixed_view::<3, 1>(0, 6)));
        m.fixed_view_mut::<3, 3>(3, 3).copy_from(&inner);
        m
    }
}

manifold_of_group!([] Sim3, Const<7>, |_x| Const, [("translation", 3), ("rotation", 3), ("log scale", 1)]);
