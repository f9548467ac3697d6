//! Trigonometric quotients without cancellation, for any real scalar.

use nalgebra::{Matrix3, RealField, UnitComplex, UnitQuaternion, Vector3, convert};

/// A constant of the scalar `T`.
#[inline]
pub(super) fn real<T: RealField + Copy>(x: f64) -> T {
    convert(x)
}

/// Stumpff functions `c_n(x) = Σ_k (-x)^k / (2k + n)!` for `n = 0 … 3`, `x ≥ 0`.
///
/// With `x = θ²`: `cos θ`, `sin θ / θ`, `(1 - cos θ) / θ²`, `(θ - sin θ) / θ³`. Below 1 they are polynomials in `x`:
/// no root, no cancellation, and derivatives that dual numbers can carry through zero.
#[inline]
pub(super) fn stumpff<T: RealField + Copy>(x: T) -> [T; 4] {
    if x < T::one() {
        stumpff_small(x)
    } else {
        let angle = x.sqrt();
        let (s, c) = angle.sin_cos();
        let s = s / angle;
        [c, s, (T::one() - c) / x, (T::one() - s) / x]
    }
}

/// [`stumpff`] for `x < 1`, without a branch.
#[inline(always)]
fn stumpff_small<T: RealField + Copy>(x: T) -> [T; 4] {
    let (c2, c3) = (horner(x, &TAIL2) * real(1.0 / 2.0), horner(x, &TAIL3) * real(1.0 / 6.0));
    [T::one() - x * c2, T::one() - x * c3, c2, c3]
}

/// The Stumpff functions `c_4(x)` and `c_5(x)`.
pub(super) fn stumpff_high<T: RealField + Copy>(x: T) -> [T; 2] {
    if x < T::one() {
        [horner(x, &TAIL4) * real(1.0 / 24.0), horner(x, &TAIL5) * real(1.0 / 120.0)]
    } else {
        let [_, _, c2, c3] = stumpff(x);
        [(real::<T>(1.0 / 2.0) - c2) / x, (real::<T>(1.0 / 6.0) - c3) / x]
    }
}

/// Ratios of neighbouring coefficients of `n! c_n`: `1 / ((n + 2k + 1)(n + 2k + 2))`.
const fn tail(n: usize) -> [f64; 8] {
    let mut ratios = [0.0; 8];
    let mut k = 0;
    while k < 8 {
        ratios[k] = 1.0 / ((n + 2 * k + 1) * (n + 2 * k + 2)) as f64;
        k += 1;
    }
    ratios
}
const TAIL2: [f64; 8] = tail(2);
const TAIL3: [f64; 8] = tail(3);
const TAIL4: [f64; 8] = tail(4);
const TAIL5: [f64; 8] = tail(5);

/// `1 - r_0 x (1 - r_1 x (1 - …))`.
#[inline(always)]
fn horner<T: RealField + Copy>(x: T, ratios: &[f64; 8]) -> T {
    let mut sum = T::one();
    for &r in ratios.iter().rev() {
        sum = T::one() - x * real(r) * sum;
    }
    sum
}

/// Angle of the vector `(x, y)` in `(-π, π]`, with finite derivatives away from the origin.
pub(super) fn angle<T: RealField + Copy>(y: T, x: T) -> T {
    if x.abs() >= y.abs() {
        y.atan2(x)
    } else if y > T::zero() {
        T::frac_pi_2() - (x / y).atan()
    } else {
        -T::frac_pi_2() - (x / y).atan()
    }
}

/// The matrix of the cross product, `[a]× b = a × b`.
#[inline]
pub(super) fn cross<T: RealField + Copy>(a: &Vector3<T>) -> Matrix3<T> {
    let o = T::zero();
    Matrix3::new(o, -a.z, a.y, a.z, o, -a.x, -a.y, a.x, o)
}

/// Rotation by the rotation vector `w`, and the coefficients `c_2`, `c_3` of `V = I + c_2 [w]× + c_3 [w]×²`.
///
/// All from functions of a quarter of `|w|²`, hence polynomials up to an angle of two radians.
#[inline]
pub(super) fn rotation_exp<T: RealField + Copy>(w: &Vector3<T>) -> (UnitQuaternion<T>, T, T) {
    let y = w.norm_squared() * real(0.25);
    let (q, a, b) = rotation_from((*w).into(), y, stumpff(y));
    (UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(q[3], q[0], q[1], q[2])), a, b)
}

/// Quaternion `i j k w` and coefficients of [`rotation_exp`] from a quarter `y` of `|w|²` and its Stumpff functions.
#[inline(always)]
fn rotation_from<T: RealField + Copy>(w: [T; 3], y: T, [c0, c1, c2, c3]: [T; 4]) -> ([T; 4], T, T) {
    let half: T = real(0.5);
    let s = c1 * half;
    ([w[0] * s, w[1] * s, w[2] * s, c0], c1 * c1 * half, (c2 + c3 - y * c2 * c3) * real(0.25))
}

/// Squared tangent of half a rotation angle up to which [`arc_tangent_quotient`] is exact: 0.2 radians.
const SMALL_TANGENT: f64 = 0.01;

/// `atan(√t) / √t` for `t` up to [`SMALL_TANGENT`].
#[inline(always)]
fn arc_tangent_quotient<T: RealField + Copy>(t: T) -> T {
    let mut sum = T::zero();
    for k in (0..9).rev() {
        sum = real::<T>(1.0 / (2 * k + 1) as f64) - t * sum;
    }
    sum
}

/// Rotation vector of `q`, with an angle in `[0, π]`.
#[inline]
pub(super) fn rotation_log<T: RealField + Copy>(q: &UnitQuaternion<T>) -> Vector3<T> {
    let (mut w, mut v) = (q.w, Vector3::new(q.i, q.j, q.k));
    if w < T::zero() {
        w = -w;
        v = -v;
    }
    let squared = v.norm_squared();
    let t = squared / (w * w);
    if t < real(SMALL_TANGENT) {
        // 2 atan(√t) / (√t w)
        return v * (real::<T>(2.0) * arc_tangent_quotient(t) / w);
    }
    let n = squared.sqrt();
    v * (real::<T>(2.0) * angle(n, w) / n)
}

/// Coefficient `e` of `V⁻¹ = I - ½ [w]× + e [w]×²` for a rotation vector of this squared length.
#[inline]
pub(super) fn inverse_coefficient<T: RealField + Copy>(squared: T) -> T {
    let [_, c1, c2, c3] = stumpff(squared * real(0.25));
    (c2 - c3) / (real::<T>(4.0) * c1)
}

/// `I + a K + b K²` with `K = [w]×`.
#[inline]
pub(super) fn polynomial<T: RealField + Copy>(w: &Vector3<T>, a: T, b: T) -> Matrix3<T> {
    let k = cross(w);
    Matrix3::identity() + k * a + k * k * b
}

/// Product of two rotations, brought back to unit length to first order: repeated products do not drift.
#[inline]
pub(super) fn product<T: RealField + Copy>(
    a: &UnitQuaternion<T>,
    b: &UnitQuaternion<T>,
) -> UnitQuaternion<T> {
    let q = a.into_inner() * b.into_inner();
    UnitQuaternion::new_unchecked(q * (real::<T>(1.5) - q.norm_squared() * real(0.5)))
}

/// Product of two rotations of the plane, brought back to unit length to first order.
#[inline]
pub(super) fn plane_product<T: RealField + Copy>(a: &UnitComplex<T>, b: &UnitComplex<T>) -> UnitComplex<T> {
    let (re, im) = (a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re);
    let s = real::<T>(1.5) - (re * re + im * im) * real(0.5);
    UnitComplex::new_unchecked(nalgebra::Complex::new(re * s, im * s))
}

/// True where [`small_rotation_exp`] holds: an angle below two radians.
#[inline(always)]
pub(super) fn is_small_rotation([x, y, z]: [f64; 3]) -> bool {
    (x * x + y * y + z * z) * 0.25 < 1.0
}

/// [`rotation_exp`] for small angles without a branch; the quaternion as `i j k w`.
#[inline(always)]
pub(super) fn small_rotation_exp(w: [f64; 3]) -> ([f64; 4], f64, f64) {
    let y = (w[0] * w[0] + w[1] * w[1] + w[2] * w[2]) * 0.25;
    rotation_from(w, y, stumpff_small(y))
}

/// Product of two unit quaternions `i j k w`, as [`product`].
#[inline(always)]
pub(super) fn quaternion_product(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    let [ai, aj, ak, aw] = a;
    let [bi, bj, bk, bw] = b;
    let q = [
        aw * bi + ai * bw + aj * bk - ak * bj,
        aw * bj - ai * bk + aj * bw + ak * bi,
        aw * bk + ai * bj - aj * bi + ak * bw,
        aw * bw - ai * bi - aj * bj - ak * bk,
    ];
    let s = 1.5 - ((q[0] * q[0] + q[2] * q[2]) + (q[1] * q[1] + q[3] * q[3])) * 0.5;
    q.map(|v| v * s)
}

/// The vector `x` turned by the unit quaternion `i j k w`.
#[inline(always)]
pub(super) fn rotate([i, j, k, w]: [f64; 4], x: [f64; 3]) -> [f64; 3] {
    let t = [(j * x[2] - k * x[1]) * 2.0, (k * x[0] - i * x[2]) * 2.0, (i * x[1] - j * x[0]) * 2.0];
    let c = [j * t[2] - k * t[1], k * t[0] - i * t[2], i * t[1] - j * t[0]];
    [t[0] * w + c[0] + x[0], t[1] * w + c[1] + x[1], t[2] * w + c[2] + x[2]]
}

/// Squared sine of half a rotation angle up to which [`small_rotation_log`] is exact: 0.2 radians.
pub(super) const SMALL_SINE: f64 = 0.01;

/// [`rotation_log`] of a small unit quaternion `i j k w` without a branch or division, and the squared sine of half its
/// angle: from [`SMALL_SINE`] on the result is void.
#[inline(always)]
pub(super) fn small_rotation_log([i, j, k, w]: [f64; 4]) -> ([f64; 3], f64) {
    let x = i * i + j * j + k * k;
    // 2 asin(√x) / √x: the ratios of neighbouring coefficients are (2n - 1)² / (2n (2n + 1)).
    let mut sum = 1.0;
    for n in (1..9).rev() {
        let odd = f64::from(2 * n - 1);
        sum = 1.0 + x * (odd * odd / f64::from(2 * n * (2 * n + 1))) * sum;
    }
    let s = (2.0 * sum).copysign(w);
    ([i * s, j * s, k * s], x)
}

/// [`inverse_coefficient`] of a rotation below 0.25 radians, `1/12 + x/720 + …`.
#[inline(always)]
pub(super) fn small_inverse_coefficient(x: f64) -> f64 {
    const SERIES: [f64; 6] = [
        1.0 / 12.0,
        1.0 / 720.0,
        1.0 / 30_240.0,
        1.0 / 1_209_600.0,
        1.0 / 47_900_160.0,
        691.0 / 1_307_674_368_000.0,
    ];
    SERIES.iter().rev().fold(0.0, |sum, c| sum * x + c)
}
