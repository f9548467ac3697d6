//! Pinhole camera with Brown–Conrady lens distortion.
//!
//! With `x = X/Z`, `y = Y/Z`, `s = x² + y²` and `d(s) = 1 + k1 s + k2 s² + k3 s³` (D. C. Brown, *Decentering
//! distortion of lenses*, 1966):
//! `x' = x d + 2 p1 x y + p2 (s + 2x²)`, `y' = y d + p1 (s + 2y²) + 2 p2 x y`, `u = fx x' + cx`, `v = fy y' + cy`.
//! Camera axes: x right, y down, z forward, metres. Pixel centres lie at integer coordinates.

mod lens;

pub use lens::Lens;

use nalgebra::{Matrix2, Matrix2x3, Point2, Point3, Vector3};
use std::ops::{Add, Div, Mul, Sub};

/// The arithmetic the projection needs: `f64`, `f32`, dual numbers.
pub trait Scalar:
    Copy + From<f64> + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
}
impl<T> Scalar for T where
    T: Copy + From<f64> + Add<Output = T> + Sub<Output = T> + Mul<Output = T> + Div<Output = T>
{
}

/// Points closer to the camera plane than this are not projected, metres.
pub const MIN_DEPTH: f64 = 1e-6;

/// Why parameters are no camera, or a pixel has no ray.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CameraError {
    /// A parameter is out of range.
    #[error("camera parameter {name}: found {found}, expected {expected}")]
    Parameter {
        /// Its name.
        name: &'static str,
        /// Its value.
        found: f64,
        /// Its range.
        expected: &'static str,
    },
    /// No direction within the valid part of the lens model is seen at the pixel.
    #[error("pixel ({u}, {v}): found no ray, expected one inside the valid region of the lens distortion")]
    NoRay {
        /// Column.
        u: f64,
        /// Row.
        v: f64,
    },
}

/// A calibrated camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    width: u32,
    height: u32,
    lens: Lens,
}

impl Camera {
    /// Camera without distortion: focal lengths and principal point in pixels, image size in pixels.
    ///
    /// # Errors
    /// [`CameraError::Parameter`] for a focal length that is not positive, a value not finite, or an empty image.
    pub fn new(fx: f64, fy: f64, cx: f64, cy: f64, width: u32, height: u32) -> Result<Self, CameraError> {
        for (name, found) in [("fx", fx), ("fy", fy)] {
            if !(found.is_finite() && found > 0.0) {
                return Err(CameraError::Parameter { name, found, expected: "a positive number of pixels" });
            }
        }
        for (name, found) in [("cx", cx), ("cy", cy)] {
            if !found.is_finite() {
                return Err(CameraError::Parameter { name, found, expected: "a finite number of pixels" });
            }
        }
        for (name, found) in [("width", width), ("height", height)] {
            if found == 0 {
                return Err(CameraError::Parameter { name, found: 0.0, expected: "at least 1 pixel" });
            }
        }
        Ok(Self { fx, fy, cx, cy, width, height, lens: Lens::NONE })
    }

    /// The same camera with a lens.
    #[must_use]
    pub fn with_lens(self, lens: Lens) -> Self {
        Self { lens, ..self }
    }

    /// Focal lengths `(fx, fy)`, pixels.
    #[must_use]
    pub fn focal(&self) -> (f64, f64) {
        (self.fx, self.fy)
    }

    /// Principal point `(cx, cy)`, pixels.
    #[must_use]
    pub fn principal_point(&self) -> (f64, f64) {
        (self.cx, self.cy)
    }

    /// Image size `(width, height)`, pixels.
    #[must_use]
    pub fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// The lens.
    #[must_use]
    pub fn lens(&self) -> &Lens {
        &self.lens
    }

    /// The same camera with an ideal lens: what the rasteriser draws.
    #[must_use]
    pub fn without_lens(self) -> Self {
        self.with_lens(Lens::NONE)
    }

    /// Whether a pixel lies in the image, grown by `margin` pixels on each side.
    #[must_use]
    pub fn contains(&self, pixel: &Point2<f64>, margin: f64) -> bool {
        let inside = |x: f64, n: u32| x >= -0.5 - margin && x <= f64::from(n) - 0.5 + margin;
        inside(pixel.x, self.width) && inside(pixel.y, self.height)
    }

    /// The formula alone, without validity tests, for any scalar.
    pub fn project_generic<T: Scalar>(&self, p_in_camera: [T; 3]) -> [T; 2] {
        let [x, y, z] = p_in_camera;
        let [x, y] = self.lens.distort_generic([x / z, y / z]);
        [x * T::from(self.fx) + T::from(self.cx), y * T::from(self.fy) + T::from(self.cy)]
    }

    /// Pixel of a point in camera coordinates; `None` behind the camera or outside the valid region of the lens.
    #[must_use]
    pub fn project(&self, p_in_camera: &Point3<f64>) -> Option<Point2<f64>> {
        let p = p_in_camera;
        if self.lens == Lens::NONE && p.z > MIN_DEPTH {
            return Some(Point2::new(p.x / p.z * self.fx + self.cx, p.y / p.z * self.fy + self.cy));
        }
        let valid = p.z > MIN_DEPTH && self.lens.is_valid(p.x / p.z, p.y / p.z);
        valid.then(|| self.project_generic([p.x, p.y, p.z]).into())
    }

    /// As [`Camera::project`], with `∂(u, v)/∂(X, Y, Z)` in pixels per metre.
    #[must_use]
    pub fn project_with_jacobian(&self, p_in_camera: &Point3<f64>) -> Option<(Point2<f64>, Matrix2x3<f64>)> {
        let p = p_in_camera;
        if p.z.is_nan() || p.z <= MIN_DEPTH {
            return None;
        }
        let inverse = 1.0 / p.z;
        let (x, y) = (p.x * inverse, p.y * inverse);
        if self.lens == Lens::NONE {
            let jacobian = Matrix2x3::new(
                self.fx * inverse,
                0.0,
                -self.fx * x * inverse,
                0.0,
                self.fy * inverse,
                -self.fy * y * inverse,
            );
            return Some((Point2::new(x * self.fx + self.cx, y * self.fy + self.cy), jacobian));
        }
        if !self.lens.is_valid(x, y) {
            return None;
        }
        let (q, lens) = self.lens.distort_with_jacobian(x, y);
        let perspective = Matrix2x3::new(inverse, 0.0, -x * inverse, 0.0, inverse, -y * inverse);
        let scale = Matrix2::new(self.fx, 0.0, 0.0, self.fy);
        Some((Point2::new(q.x * self.fx + self.cx, q.y * self.fy + self.cy), scale * lens * perspective))
    }

    /// The ray `(X, Y, 1)` seen at a pixel.
    ///
    /// # Errors
    /// [`CameraError::NoRay`] where the inverse of the distortion does not converge inside its valid region.
    pub fn unproject(&self, pixel: &Point2<f64>) -> Result<Vector3<f64>, CameraError> {
        let distorted = Point2::new((pixel.x - self.cx) / self.fx, (pixel.y - self.cy) / self.fy);
        let ideal = self.lens.undistort(&distorted).ok_or(CameraError::NoRay { u: pixel.x, v: pixel.y })?;
        Ok(Vector3::new(ideal.x, ideal.y, 1.0))
    }

    /// The camera of pyramid level `l`: `x_l = (x_0 + 0.5) / 2^l - 0.5`, sizes halved and rounded down.
    #[must_use]
    pub fn scaled_to_level(&self, level: u32) -> Self {
        let factor = 1.0 / f64::from(1_u32 << level.min(31));
        Self {
            width: (self.width >> level.min(31)).max(1),
            height: (self.height >> level.min(31)).max(1),
            ..self.scaled(factor)
        }
    }

    /// The camera of an image resized by `factor`, pixel areas covering each other; sizes rounded up.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        let size = |n: u32| (f64::from(n) * factor).ceil().max(1.0) as u32;
        Self {
            fx: self.fx * factor,
            fy: self.fy * factor,
            cx: (self.cx + 0.5) * factor - 0.5,
            cy: (self.cy + 0.5) * factor - 0.5,
            width: size(self.width),
            height: size(self.height),
            lens: self.lens,
        }
    }
}

#[cfg(test)]
mod tests;
