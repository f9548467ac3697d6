//! Pinhole camera with Brown–Conrady lens distortion, and fisheye camera of Kannala and Brandt.
//!
//! Pinhole: with `x = X/Z`, `y = Y/Z`, `s = x² + y²` and `d(s) = 1 + k1 s + k2 s² + k3 s³` (D. C. Brown, *Decentering
//! distortion of lenses*, 1966):
//! `x' = x d + 2 p1 x y + p2 (s + 2x²)`, `y' = y d + p1 (s + 2y²) + 2 p2 x y`, `u = fx x' + cx`, `v = fy y' + cy`.
//! Fisheye: see [`Fisheye`].
//! Camera axes: x right, y down, z forward, metres. Pixel centres lie at integer coordinates.

mod fisheye;
mod lens;
mod polynomial;

pub use fisheye::Fisheye;
pub use lens::Lens;

use nalgebra::{Matrix2, Matrix2x3, Point2, Point3, RealField, Vector3};
use vt_core::math;

/// The arithmetic the projection needs: `f64`, dual numbers.
pub trait Scalar: RealField + Copy + From<f64> {}
impl<T: RealField + Copy + From<f64>> Scalar for T {}

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
    /// The image radius of a fisheye lens ceases to grow close to the axis.
    #[error(
        "fisheye coefficients: found an image radius that grows up to {:.1}° off the axis only, expected at least 20°",
        limit.to_degrees()
    )]
    NotMonotone {
        /// Angle at which it ceases to grow, radians.
        limit: f64,
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

/// How rays become normalised image coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Optics {
    /// Central perspective and a lens that distorts its image.
    Perspective(Lens),
    /// A fisheye lens.
    Fisheye(Fisheye),
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
    optics: Optics,
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
        Ok(Self { fx, fy, cx, cy, width, height, optics: Optics::Perspective(Lens::NONE) })
    }

    /// The same camera with a lens.
    #[must_use]
    pub fn with_lens(self, lens: Lens) -> Self {
        Self { optics: Optics::Perspective(lens), ..self }
    }

    /// The same camera with a fisheye lens.
    #[must_use]
    pub fn with_fisheye(self, lens: Fisheye) -> Self {
        Self { optics: Optics::Fisheye(lens), ..self }
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

    /// The optics.
    #[must_use]
    pub fn optics(&self) -> &Optics {
        &self.optics
    }

    /// The pinhole camera with the same focal lengths: what the rasteriser draws.
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

    /// The formula alone, without validity tests, for any scalar; a fisheye's has no value on the axis.
    pub fn project_generic<T: Scalar>(&self, p_in_camera: [T; 3]) -> [T; 2] {
        let [x, y] = match &self.optics {
            Optics::Perspective(lens) => {
                let [x, y, z] = p_in_camera;
                lens.distort_generic([x / z, y / z])
            }
            Optics::Fisheye(lens) => lens.project_generic(p_in_camera),
        };
        [x * T::from(self.fx) + T::from(self.cx), y * T::from(self.fy) + T::from(self.cy)]
    }

    /// Pixel of a point in camera coordinates; `None` outside the valid region of the lens, and but for fisheyes behind
    /// the camera.
    #[must_use]
    pub fn project(&self, p_in_camera: &Point3<f64>) -> Option<Point2<f64>> {
        let p = p_in_camera;
        match &self.optics {
            Optics::Perspective(lens) => {
                if *lens == Lens::NONE && p.z > MIN_DEPTH {
                    return Some(Point2::new(p.x / p.z * self.fx + self.cx, p.y / p.z * self.fy + self.cy));
                }
                let valid = p.z > MIN_DEPTH && lens.is_valid(p.x / p.z, p.y / p.z);
                valid.then(|| self.project_generic([p.x, p.y, p.z]).into())
            }
            Optics::Fisheye(lens) => lens.project(p).map(|q| self.pixel(&q)),
        }
    }

    /// As [`Camera::project`], with `∂(u, v)/∂(X, Y, Z)` in pixels per metre.
    #[must_use]
    pub fn project_with_jacobian(&self, p_in_camera: &Point3<f64>) -> Option<(Point2<f64>, Matrix2x3<f64>)> {
        let p = p_in_camera;
        let lens = match &self.optics {
            Optics::Perspective(lens) => lens,
            Optics::Fisheye(lens) => {
                let (q, jacobian) = lens.project_with_jacobian(p)?;
                return Some((self.pixel(&q), Matrix2::new(self.fx, 0.0, 0.0, self.fy) * jacobian));
            }
        };
        if p.z.is_nan() || p.z <= MIN_DEPTH {
            return None;
        }
        let inverse = 1.0 / p.z;
        let (x, y) = (p.x * inverse, p.y * inverse);
        if *lens == Lens::NONE {
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
        if !lens.is_valid(x, y) {
            return None;
        }
        let (q, lens) = lens.distort_with_jacobian(x, y);
        let perspective = Matrix2x3::new(inverse, 0.0, -x * inverse, 0.0, inverse, -y * inverse);
        Some((self.pixel(&q), Matrix2::new(self.fx, 0.0, 0.0, self.fy) * lens * perspective))
    }

    /// Pixel of normalised image coordinates.
    fn pixel(&self, q: &Point2<f64>) -> Point2<f64> {
        Point2::new(q.x * self.fx + self.cx, q.y * self.fy + self.cy)
    }

    /// The ray `(X, Y, 1)` seen at a pixel.
    ///
    /// # Errors
    /// [`CameraError::NoRay`] where the inverse of the distortion does not converge inside its valid region, and where a
    /// fisheye sees 90° or more off the axis; [`Camera::ray`] has those.
    pub fn unproject(&self, pixel: &Point2<f64>) -> Result<Vector3<f64>, CameraError> {
        let ray = self.ray(pixel)?;
        if ray.z > MIN_DEPTH { Ok(ray / ray.z) } else { Err(CameraError::NoRay { u: pixel.x, v: pixel.y }) }
    }

    /// A vector along the ray seen at a pixel: of unit length for a fisheye, else `(X, Y, 1)`.
    ///
    /// # Errors
    /// [`CameraError::NoRay`] where no direction within the valid region of the lens is seen.
    pub fn ray(&self, pixel: &Point2<f64>) -> Result<Vector3<f64>, CameraError> {
        let distorted = Point2::new((pixel.x - self.cx) / self.fx, (pixel.y - self.cy) / self.fy);
        let ray = match &self.optics {
            Optics::Perspective(lens) => lens.undistort(&distorted).map(|q| Vector3::new(q.x, q.y, 1.0)),
            Optics::Fisheye(lens) => lens.ray(&distorted),
        };
        ray.ok_or(CameraError::NoRay { u: pixel.x, v: pixel.y })
    }

    /// Largest angle to the optical axis seen anywhere in the picture, radians; that of the lens where it does not
    /// fill the picture.
    #[must_use]
    pub fn widest_angle(&self) -> f64 {
        let (right, bottom) = (f64::from(self.width) - 0.5, f64::from(self.height) - 0.5);
        let corners = [[-0.5, -0.5], [right, -0.5], [-0.5, bottom], [right, bottom]].map(Point2::from);
        let limit = match &self.optics {
            Optics::Perspective(lens) => math::atan(lens.limit().sqrt()),
            Optics::Fisheye(lens) => lens.limit(),
        };
        let angle = |r: Vector3<f64>| math::atan2(math::hypot(r.x, r.y), r.z);
        corners.iter().map(|c| self.ray(c).map_or(limit, angle)).fold(0.0, f64::max)
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
            optics: self.optics,
        }
    }
}

#[cfg(test)]
mod tests;
