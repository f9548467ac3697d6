//! How the object looks (paper §4.4): reference images with texture coordinates, and colour statistics.

mod colour;

pub use colour::{ColourError, ColourShare, ColourStatistics};

use crate::camera::Camera;
use nalgebra::{Point2, Point3, Vector3};
use vt_core::lie::SE3;

/// A picture of the object from a known pose.
#[derive(Clone, Debug)]
pub struct ReferenceImage {
    rgb: Vec<u8>,
    camera: Camera,
    camera_from_object: SE3,
}

/// The picture does not fit its camera.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("reference image: found {found} bytes, expected 3 x {width} x {height}")]
pub struct ReferenceSizeError {
    /// Bytes given.
    pub found: usize,
    /// Camera columns.
    pub width: u32,
    /// Camera rows.
    pub height: u32,
}

impl ReferenceImage {
    /// A picture as RGB bytes, row by row, with the camera and pose it was taken with.
    ///
    /// # Errors
    /// [`ReferenceSizeError`] where the number of bytes is not that of the camera's image.
    pub fn new(rgb: Vec<u8>, camera: Camera, camera_from_object: SE3) -> Result<Self, ReferenceSizeError> {
        let (width, height) = camera.size();
        if rgb.len() as u64 == 3 * u64::from(width) * u64::from(height) {
            Ok(Self { rgb, camera, camera_from_object })
        } else {
            Err(ReferenceSizeError { found: rgb.len(), width, height })
        }
    }

    /// RGB bytes, row by row.
    #[must_use]
    pub fn rgb(&self) -> &[u8] {
        &self.rgb
    }

    /// The camera it was taken with.
    #[must_use]
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// The pose it was taken from.
    #[must_use]
    pub fn camera_from_object(&self) -> &SE3 {
        &self.camera_from_object
    }

    /// Texture coordinates of an object point (u right, v up, the image's outline from 0 to 1); `None` where the
    /// picture does not show it. Occlusion is not considered.
    #[must_use]
    pub fn texture_coordinates(&self, p_in_object: &Point3<f64>) -> Option<[f64; 2]> {
        let pixel = self.camera.project(&self.camera_from_object.act(p_in_object))?;
        let (w, h) = self.camera.size();
        let inside = self.camera.contains(&pixel, 0.0);
        inside.then(|| [(pixel.x + 0.5) / f64::from(w), 1.0 - (pixel.y + 0.5) / f64::from(h)])
    }

    /// Pixel that texture coordinates mean.
    #[must_use]
    pub fn pixel(&self, [u, v]: [f64; 2]) -> Point2<f64> {
        let (w, h) = self.camera.size();
        Point2::new(u * f64::from(w) - 0.5, (1.0 - v) * f64::from(h) - 0.5)
    }

    fn toward_camera(&self) -> Vector3<f64> {
        toward_camera(&self.camera_from_object)
    }
}

/// Direction from the object's origin to the camera, object frame.
fn toward_camera(camera_from_object: &SE3) -> Vector3<f64> {
    let d = camera_from_object.rotation.inverse() * -camera_from_object.translation;
    d.try_normalize(0.0).unwrap_or_else(Vector3::zeros)
}

/// What is known of an object's looks.
#[derive(Clone, Debug, Default)]
pub struct Appearance {
    /// Pictures from known poses.
    pub references: Vec<ReferenceImage>,
    /// Colours and their shares.
    pub colours: Option<ColourStatistics>,
}

impl Appearance {
    /// The reference whose viewing direction is nearest to that of the pose; the first of equals.
    #[must_use]
    pub fn nearest_reference(&self, camera_from_object: &SE3) -> Option<&ReferenceImage> {
        let d = toward_camera(camera_from_object);
        let mut best: Option<(f64, &ReferenceImage)> = None;
        for reference in &self.references {
            let likeness = reference.toward_camera().dot(&d);
            if best.is_none_or(|(b, _)| likeness > b) {
                best = Some((likeness, reference));
            }
        }
        best.map(|b| b.1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;

    fn view(angle: f64) -> SE3 {
        SE3::new(UnitQuaternion::from_scaled_axis(Vector3::y() * angle), Vector3::new(0.0, 0.0, 1.0))
    }

    fn camera() -> Camera {
        Camera::new(20.0, 20.0, 9.5, 4.5, 20, 10).unwrap()
    }

    #[test]
    fn size_is_checked() {
        let e = ReferenceImage::new(vec![0; 7], camera(), view(0.0)).unwrap_err();
        assert_eq!(e.to_string(), "reference image: found 7 bytes, expected 3 x 20 x 10");
    }

    #[test]
    fn texture_coordinates_span_the_image() {
        let image = ReferenceImage::new(vec![0; 600], camera(), view(0.0)).unwrap();
        assert_eq!(image.texture_coordinates(&Point3::origin()), Some([0.5, 0.5]));
        // The upper left corner of the image, half a pixel outside the first pixel's centre.
        let [u, v] = image.texture_coordinates(&Point3::new(-0.499_999, -0.249_999, 0.0)).unwrap();
        assert!(u.abs() < 1e-5 && (v - 1.0).abs() < 1e-5, "{u} {v}");
        assert_eq!(image.texture_coordinates(&Point3::new(-0.51, 0.0, 0.0)), None);
        assert_eq!(image.pixel([0.5, 0.5]), Point2::new(9.5, 4.5));
    }

    #[test]
    fn nearest_reference_by_direction() {
        let references: Vec<_> =
            [0.0, 1.0, 2.0].map(|a| ReferenceImage::new(vec![0; 600], camera(), view(a)).unwrap()).into();
        let appearance = Appearance { references, colours: None };
        let nearest = appearance.nearest_reference(&view(1.3)).unwrap();
        assert_eq!(nearest.camera_from_object(), &view(1.0));
        assert!(Appearance::default().nearest_reference(&view(0.0)).is_none());
    }
}
