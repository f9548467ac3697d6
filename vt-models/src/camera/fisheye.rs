use super::polynomial::{evaluate, first_nonpositive};
use super::{CameraError, MIN_DEPTH};
use nalgebra::{Matrix2x3, Point2, Point3, RealField, Vector3};
use vt_core::math;

/// Fisheye lens of Kannala and Brandt (*A generic camera model and calibration method for conventional, wide-angle,
/// and fish-eye lenses*, PAMI 2006) with the four coefficients of `OpenCV`: a ray at the angle `θ` to the optical axis
/// meets the image plane at the normalised radius `θ' = θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸)`, on the side to which it
/// points. Angles may exceed 90°.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fisheye {
    k: [f64; 4],
    limit: f64,
    radius: f64,
}

/// Smallest range of angles that makes a camera, radians (20°).
const LEAST: f64 = 0.35;

impl Fisheye {
    /// A lens with the radial coefficients `k1` to `k4`.
    ///
    /// # Errors
    /// [`CameraError::Parameter`] for a coefficient that is not finite; [`CameraError::NotMonotone`] where the image
    /// radius ceases to grow within 20° of the axis, so that the picture folds back on itself.
    pub fn new(k1: f64, k2: f64, k3: f64, k4: f64) -> Result<Self, CameraError> {
        let k = [k1, k2, k3, k4];
        for (name, found) in ["k1", "k2", "k3", "k4"].into_iter().zip(k) {
            if !found.is_finite() {
                return Err(CameraError::Parameter { name, found, expected: "a finite coefficient" });
            }
        }
        // dθ'/dθ as a polynomial of θ².
        let slope = [1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3, 9.0 * k4];
        let half_turn = std::f64::consts::PI;
        let limit = first_nonpositive(&slope, half_turn * half_turn).map_or(half_turn, f64::sqrt);
        if limit < LEAST {
            return Err(CameraError::NotMonotone { limit });
        }
        let mut lens = Self { k, limit, radius: 0.0 };
        lens.radius = lens.bend(limit).0;
        Ok(lens)
    }

    /// Coefficients `k1` to `k4`.
    #[must_use]
    pub fn coefficients(&self) -> [f64; 4] {
        self.k
    }

    /// Angle to the optical axis up to which the model may be used, radians, at most π.
    #[must_use]
    pub fn limit(&self) -> f64 {
        self.limit
    }

    /// `θ'` and its derivative.
    fn bend(&self, angle: f64) -> (f64, f64) {
        let [k1, k2, k3, k4] = self.k;
        let s = angle * angle;
        let value = angle * evaluate(&[1.0, k1, k2, k3, k4], s);
        (value, evaluate(&[1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3, 9.0 * k4], s))
    }

    /// Normalised image coordinates for any scalar, without validity test and not on the axis.
    pub(super) fn project_generic<T: RealField + Copy + From<f64>>(&self, [x, y, z]: [T; 3]) -> [T; 2] {
        let r = (x * x + y * y).sqrt();
        let angle = r.atan2(z);
        let s = angle * angle;
        let [k1, k2, k3, k4] = self.k.map(T::from);
        let scale = angle * (T::from(1.0) + s * (k1 + s * (k2 + s * (k3 + s * k4)))) / r;
        [x * scale, y * scale]
    }

    /// Normalised image coordinates with `∂(x', y')/∂(X, Y, Z)`; `None` beyond the limit or at the centre.
    pub(super) fn project_with_jacobian(&self, p: &Point3<f64>) -> Option<(Point2<f64>, Matrix2x3<f64>)> {
        let square = p.coords.norm_squared();
        let r = math::hypot(p.x, p.y);
        let angle = math::atan2(r, p.z);
        if !(square > MIN_DEPTH * MIN_DEPTH && square.is_finite() && angle < self.limit) {
            return None;
        }
        let (bent, slope) = self.bend(angle);
        // Radial and tangential magnification; on the axis they are one.
        let (tangential, cx, cy) = if r > 0.0 { (bent / r, p.x / r, p.y / r) } else { (1.0 / p.z, 0.0, 0.0) };
        let radial = slope * p.z / square;
        let mixed = (radial - tangential) * cx * cy;
        let jacobian = Matrix2x3::new(
            tangential + (radial - tangential) * cx * cx,
            mixed,
            -slope * p.x / square,
            mixed,
            tangential + (radial - tangential) * cy * cy,
            -slope * p.y / square,
        );
        Some((Point2::new(p.x * tangential, p.y * tangential), jacobian))
    }

    /// Normalised image coordinates; `None` beyond the limit or at the centre.
    pub(super) fn project(&self, p: &Point3<f64>) -> Option<Point2<f64>> {
        self.project_with_jacobian(p).map(|q| q.0)
    }

    /// Unit vector of the ray seen at normalised image coordinates; `None` outside the picture of the lens.
    pub(super) fn ray(&self, q: &Point2<f64>) -> Option<Vector3<f64>> {
        let radius = math::hypot(q.x, q.y);
        if radius.is_nan() || radius >= self.radius {
            return None;
        }
        // Newton's method, kept between bounds by bisection: θ' grows with θ up to the limit.
        let (mut low, mut high) = (0.0, self.limit);
        let mut angle = radius.min(0.5 * self.limit);
        for _ in 0..100 {
            let (bent, slope) = self.bend(angle);
            if bent < radius {
                low = angle
            } else {
                high = angle
            }
            let newton = angle - (bent - radius) / slope;
            let next = if newton > low && newton < high { newton } else { f64::midpoint(low, high) };
            if (next - angle).abs() <= 1e-16 * self.limit {
                break;
            }
            angle = next;
        }
        let (sin, cos) = math::sin_cos(angle);
        let scale = if radius > 0.0 { sin / radius } else { 1.0 };
        Some(Vector3::new(q.x * scale, q.y * scale, cos))
    }
}
