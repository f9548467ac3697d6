use super::polynomial::first_nonpositive;
use super::{CameraError, Scalar};
use nalgebra::{Matrix2, Point2, Vector2};

/// Brown–Conrady distortion of normalised image coordinates, with the region in which it is monotone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    k: [f64; 3],
    p: [f64; 2],
    /// Squared radius at which `r d(r²)` stops growing; infinite where it never does.
    limit: f64,
}

/// Squared radius (89.94° off the axis) beyond which the search for the limit ends.
const FAR: f64 = 1e6;

impl Lens {
    /// No distortion.
    pub const NONE: Self = Self { k: [0.0; 3], p: [0.0; 2], limit: f64::INFINITY };

    /// Radial `k1, k2, k3` and tangential `p1, p2`.
    ///
    /// # Errors
    /// [`CameraError::Parameter`] for a coefficient that is not finite.
    pub fn new(k1: f64, k2: f64, p1: f64, p2: f64, k3: f64) -> Result<Self, CameraError> {
        for (name, found) in [("k1", k1), ("k2", k2), ("p1", p1), ("p2", p2), ("k3", k3)] {
            if !found.is_finite() {
                return Err(CameraError::Parameter { name, found, expected: "a finite coefficient" });
            }
        }
        Ok(Self { k: [k1, k2, k3], p: [p1, p2], limit: monotone_limit([k1, k2, k3]) })
    }

    /// Coefficients `[k1, k2, p1, p2, k3]`, the order of `OpenCV` and ROS.
    #[must_use]
    pub fn coefficients(&self) -> [f64; 5] {
        [self.k[0], self.k[1], self.p[0], self.p[1], self.k[2]]
    }

    /// Squared normalised radius up to which the model may be used.
    #[must_use]
    pub fn limit(&self) -> f64 {
        self.limit
    }

    /// Whether an ideal point lies inside the monotone region.
    #[must_use]
    pub fn is_valid(&self, x: f64, y: f64) -> bool {
        x * x + y * y < self.limit
    }

    /// Ideal to distorted coordinates, for any scalar and without validity test.
    pub fn distort_generic<T: Scalar>(&self, [x, y]: [T; 2]) -> [T; 2] {
        let [k1, k2, k3] = self.k.map(T::from);
        let [p1, p2] = self.p.map(T::from);
        let (xx, yy, xy) = (x * x, y * y, x * y);
        let s = xx + yy;
        let d = T::from(1.0) + s * (k1 + s * (k2 + s * k3));
        let two = T::from(2.0);
        [x * d + two * p1 * xy + p2 * (s + two * xx), y * d + p1 * (s + two * yy) + two * p2 * xy]
    }

    /// Distorted point and `∂(x', y')/∂(x, y)`.
    #[must_use]
    pub fn distort_with_jacobian(&self, x: f64, y: f64) -> (Point2<f64>, Matrix2<f64>) {
        let ([k1, k2, k3], [p1, p2]) = (self.k, self.p);
        let s = x * x + y * y;
        let d = 1.0 + s * (k1 + s * (k2 + s * k3));
        // Derivative of d by s, times two.
        let g = 2.0 * (k1 + s * (2.0 * k2 + s * 3.0 * k3));
        let mixed = x * y * g + 2.0 * (p1 * x + p2 * y);
        let jacobian = Matrix2::new(
            d + x * x * g + 2.0 * p1 * y + 6.0 * p2 * x,
            mixed,
            mixed,
            d + y * y * g + 6.0 * p1 * y + 2.0 * p2 * x,
        );
        (self.distort_generic([x, y]).into(), jacobian)
    }

    /// Distorted to ideal coordinates by Newton's method; `None` where it finds no solution in the valid region.
    #[must_use]
    pub fn undistort(&self, distorted: &Point2<f64>) -> Option<Point2<f64>> {
        if !(distorted.x.is_finite() && distorted.y.is_finite()) {
            return None;
        }
        if *self == Self::NONE {
            return Some(*distorted);
        }
        let mut at = self.undistort_radial(distorted)?;
        let scale = 1.0 + distorted.coords.norm();
        for _ in 0..20 {
            let (image, jacobian) = self.distort_with_jacobian(at.x, at.y);
            let error: Vector2<f64> = distorted - image;
            if error.norm() <= 1e-14 * scale {
                break;
            }
            at += jacobian.try_inverse()? * error;
        }
        let (image, jacobian) = self.distort_with_jacobian(at.x, at.y);
        let solved = (distorted - image).norm() <= 1e-10 * scale;
        (solved && self.is_valid(at.x, at.y) && jacobian.determinant() > 0.0).then_some(at)
    }

    /// Solves `r d(r²) = r'` by bisection, the start for Newton's method.
    fn undistort_radial(&self, distorted: &Point2<f64>) -> Option<Point2<f64>> {
        let target = distorted.coords.norm();
        if target == 0.0 {
            return Some(*distorted);
        }
        let radius = |r: f64| {
            let s = r * r;
            r * (1.0 + s * (self.k[0] + s * (self.k[1] + s * self.k[2])))
        };
        let (mut low, mut high) = (0.0, self.limit.min(FAR).sqrt());
        // Tangential distortion may reach a little over the radial range.
        if radius(high) < target * 0.9 {
            return None;
        }
        for _ in 0..40 {
            let middle = f64::midpoint(low, high);
            if radius(middle) < target { low = middle } else { high = middle }
        }
        Some(Point2::from(distorted.coords * (low / target)))
    }
}

/// First positive `s = r²` with `d(r d)/dr = 1 + 3 k1 s + 5 k2 s² + 7 k3 s³ = 0`.
fn monotone_limit([k1, k2, k3]: [f64; 3]) -> f64 {
    first_nonpositive(&[1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3], FAR).unwrap_or(f64::INFINITY)
}
