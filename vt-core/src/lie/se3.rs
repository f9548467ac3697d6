//! Rigid motions of space.

use core::ops::Mul;

use nalgebra::{
    Const, Isometry3, Matrix3, Matrix4, Matrix6, Point3, RealField, Rotation3, Translation3, UnitQuaternion,
    Vector3, Vector6,
};

use super::{LieGroup, SO3, manifold_of_group, series};
use crate::batch::Row;
use crate::error::ConfigError;

mod batch;

/// A rigid motion `p ↦ R p + t`. Tangent order: translation `v` (metres), rotation `ω` (radians).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SE3<T: RealField + Copy = f64> {
    /// Rotation `R`.
    pub rotation: UnitQuaternion<T>,
    /// Translation `t` in metres.
    pub translation: Vector3<T>,
}

impl<T: RealField + Copy> SE3<T> {
    /// The motion `p ↦ R p + t`.
    pub fn new(rotation: UnitQuaternion<T>, translation: Vector3<T>) -> Self {
        Self { rotation, translation }
    }

    /// The motion that turns about the rotation vector `w` (radians), then moves by `t`.
    pub fn from_rotation_vector(w: &Vector3<T>, t: Vector3<T>) -> Self {
        Self { rotation: series::rotation_exp(w).0, translation: t }
    }

    /// The rotation vector of `R`, with an angle in `[0, π]`.
    pub fn rotation_vector(&self) -> Vector3<T> {
        series::rotation_log(&self.rotation)
    }

    /// The image of a point.
    #[inline]
    pub fn act(&self, p: &Point3<T>) -> Point3<T> {
        self.rotation * p + self.translation
    }

    /// The homogeneous matrix `[R t; 0 1]`.
    pub fn to_matrix(&self) -> Matrix4<T> {
        let mut m = Matrix4::identity();
        m.fixed_view_mut::<3, 3>(0, 0).copy_from(self.rotation.to_rotation_matrix().matrix());
        m.fixed_view_mut::<3, 1>(0, 3).copy_from(&self.translation);
        m
    }
}

impl SE3 {
    /// The motion of a homogeneous matrix `[M t; 0 1]`, with `M` replaced by the nearest rotation.
    ///
    /// # Errors
    /// When an entry is not finite, when the last row is not `0 0 0 1`, or when `M` is farther than `tolerance`
    /// from the nearest rotation in any entry (1e-6 suits matrices written with seven digits).
    pub fn from_matrix(m: &Matrix4<f64>, tolerance: f64) -> Result<Self, ConfigError> {
        if let Some(bad) = m.iter().find(|v| !v.is_finite()) {
            return Err(ConfigError::parameter("matrix", bad, "finite entries"));
        }
        let last = m.row(3);
        let off = (last - nalgebra::RowVector4::new(0.0, 0.0, 0.0, 1.0)).amax();
        if off > tolerance {
            let found = format!("{} {} {} {}", last[0], last[1], last[2], last[3]);
            return Err(ConfigError::parameter("last row", found, format!("0 0 0 1 within {tolerance}")));
        }
        let given: Matrix3<f64> = m.fixed_view::<3, 3>(0, 0).into_owned();
        let svd = given.svd(true, true);
        let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else {
            return Err(ConfigError::parameter(
                "rotation",
                given,
                "a matrix with a singular value decomposition",
            ));
        };
        // The nearest proper rotation turns the weakest direction when the nearest orthogonal matrix reflects.
        let reflects = (u * v_t).determinant() < 0.0;
        let sign = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, if reflects { -1.0 } else { 1.0 }));
        let nearest = u * sign * v_t;
        let distance = (nearest - given).amax();
        if distance > tolerance {
            let found = format!("{distance:.3e} away from the nearest rotation");
            return Err(ConfigError::parameter("rotation", found, format!("at most {tolerance:.3e}")));
        }
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(nearest));
        let rotation = UnitQuaternion::new_normalize(rotation.into_inner());
        Ok(Self { rotation, translation: m.fixed_view::<3, 1>(0, 3).into_owned() })
    }
}

impl<T: RealField + Copy> From<Isometry3<T>> for SE3<T> {
    fn from(m: Isometry3<T>) -> Self {
        Self { rotation: m.rotation, translation: m.translation.vector }
    }
}

impl<T: RealField + Copy> From<SE3<T>> for Isometry3<T> {
    fn from(m: SE3<T>) -> Self {
        Self::from_parts(Translation3::from(m.translation), m.rotation)
    }
}

impl<T: RealField + Copy> Mul for SE3<T> {
    type Output = Self;
    #[inline]
    fn mul(self, other: Self) -> Self {
        self.compose(&other)
    }
}

impl<T: RealField + Copy> Mul<Point3<T>> for SE3<T> {
    type Output = Point3<T>;
    #[inline]
    fn mul(self, p: Point3<T>) -> Point3<T> {
        SE3::act(&self, &p)
    }
}

/// `[A B; 0 A]`.
fn blocks<T: RealField + Copy>(a: &Matrix3<T>, b: &Matrix3<T>) -> Matrix6<T> {
    let mut m = Matrix6::zeros();
    m.fixed_view_mut::<3, 3>(0, 0).copy_from(a);
    m.fixed_view_mut::<3, 3>(0, 3).copy_from(b);
    m.fixed_view_mut::<3, 3>(3, 3).copy_from(a);
    m
}

fn split<T: RealField + Copy>(d: &Vector6<T>) -> (Vector3<T>, Vector3<T>) {
    (Vector3::new(d[0], d[1], d[2]), Vector3::new(d[3], d[4], d[5]))
}

/// The off-diagonal block of `J_l` (Barfoot, Eq. 7.86).
fn coupling<T: RealField + Copy>(v: &Vector3<T>, w: &Vector3<T>) -> Matrix3<T> {
    let x = w.norm_squared();
    let [_, _, _, c3] = series::stumpff(x);
    let [c4, c5] = series::stumpff_high(x);
    let half: T = series::real(0.5);
    let three: T = series::real(3.0);
    let (v, w) = (series::cross(v), series::cross(w));
    let (wv, vw) = (w * v, v * w);
    let wvw = wv * w;
    v * half
        + (wv + vw + wvw) * c3
        + (w * wv + vw * w - wvw * three) * c4
        + (wvw * w + w * wvw) * ((c4 - c5 * three) * half)
}

impl<T: RealField + Copy> LieGroup<T> for SE3<T> {
    type Dim = Const<6>;
    type Point = Point3<T>;
    type Over<U: RealField + Copy> = SE3<U>;

    fn identity() -> Self {
        Self { rotation: UnitQuaternion::identity(), translation: Vector3::zeros() }
    }
    #[inline]
    fn compose(&self, other: &Self) -> Self {
        Self {
            rotation: series::product(&self.rotation, &other.rotation),
            translation: self.rotation * other.translation + self.translation,
        }
    }
    #[inline]
    fn inverse(&self) -> Self {
        let rotation = self.rotation.conjugate();
        Self { rotation, translation: -(rotation * self.translation) }
    }
    #[inline]
    fn exp(d: &Vector6<T>) -> Self {
        let (v, w) = split(d);
        let (rotation, a, b) = series::rotation_exp(&w);
        let wv = w.cross(&v);
        Self { rotation, translation: v + wv * a + w.cross(&wv) * b }
    }
    #[inline]
    fn log(&self) -> Vector6<T> {
        let w = series::rotation_log(&self.rotation);
        let t = &self.translation;
        let wt = w.cross(t);
        let half: T = series::real(0.5);
        let v = t - wt * half + w.cross(&wt) * series::inverse_coefficient(w.norm_squared());
        Vector6::new(v.x, v.y, v.z, w.x, w.y, w.z)
    }
    #[inline]
    fn act(&self, p: &Point3<T>) -> Point3<T> {
        SE3::act(self, p)
    }
    fn adjoint(&self) -> Matrix6<T> {
        let r = self.rotation.to_rotation_matrix().into_inner();
        blocks(&r, &(series::cross(&self.translation) * r))
    }
    fn left_jacobian(d: &Vector6<T>) -> Matrix6<T> {
        let (v, w) = split(d);
        blocks(&SO3::left_jacobian(&w), &coupling(&v, &w))
    }
    fn left_jacobian_inverse(d: &Vector6<T>) -> Matrix6<T> {
        let (v, w) = split(d);
        let inverse = SO3::left_jacobian_inverse(&w);
        blocks(&inverse, &-(inverse * coupling(&v, &w) * inverse))
    }
}

manifold_of_group!([] SE3, Const<6>, |_x| Const, [("translation", 3), ("rotation", 3)],
    fn is_finite(&self) -> bool {
        let (t, q) = (&self.translation, &self.rotation.coords);
        // Not finite times zero is not a number, and no branch.
        (t.x * 0.0 + t.y * 0.0 + t.z * 0.0) + (q.x * 0.0 + q.y * 0.0 + q.z * 0.0 + q.w * 0.0) == 0.0
    }
    fn retract_each<S>(states: &mut [S], point: impl Fn(&mut S) -> &mut Self, d: &[Row]) {
        batch::retract(states, point, d);
    }
    fn local_each(&self, points: &[Self], out: &mut [Row]) {
        batch::local(self, points, out);
    }
    fn centre(points: &[Self], weights: &[f64]) -> Option<Self> {
        batch::centre(points, weights)
    }
);
