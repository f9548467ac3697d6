//! Poses and cameras in task files.

use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use vt_core::error::ConfigError;
use vt_core::lie::SE3;
use vt_models::camera::{Camera, CameraError, Fisheye, Lens};

use crate::quantity::{Angle, Length, Pixels};

/// A rigid motion; the key it is given for says between which frames.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PoseText {
    /// Translation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub translation: Option<[Length; 3]>,
    /// Rotation vector: axis times angle.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rotation: Option<[Angle; 3]>,
    /// Rotation as quaternion `x y z w`, instead of `rotation`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub quaternion: Option<[f64; 4]>,
    /// Rotation as matrix by rows, instead of `rotation`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub matrix: Option<[[f64; 3]; 3]>,
}

impl PoseText {
    /// The motion.
    ///
    /// # Errors
    /// When more than one rotation is given, or numbers that are no rotation.
    pub fn pose(&self) -> Result<SE3, ConfigError> {
        let translation = self.translation.map_or_else(Vector3::zeros, |t| Vector3::from(t.map(|v| v.si())));
        let rotation = match (self.rotation, self.quaternion, self.matrix) {
            (None, None, None) => UnitQuaternion::identity(),
            (Some(r), None, None) => UnitQuaternion::from_scaled_axis(Vector3::from(r.map(|v| v.si()))),
            (None, Some([x, y, z, w]), None) => {
                let q = Quaternion::new(w, x, y, z);
                if (q.norm() - 1.0).abs() > 1e-3 {
                    let expected = "a quaternion x y z w of length 1";
                    return Err(ConfigError::parameter(
                        "quaternion",
                        format!("of length {}", q.norm()),
                        expected,
                    ));
                }
                UnitQuaternion::from_quaternion(q)
            }
            (None, None, Some(rows)) => {
                rotation_of(&Matrix3::from_fn(|r, c| rows[r][c])).ok_or_else(|| {
                    ConfigError::parameter(
                        "matrix",
                        "not orthonormal",
                        "a rotation matrix by rows, determinant +1",
                    )
                })?
            }
            _ => {
                let expected = "one of `rotation`, `quaternion` and `matrix`";
                return Err(ConfigError::parameter("rotation", "given more than once", expected));
            }
        };
        Ok(SE3 { rotation, translation })
    }
}

/// The rotation nearest to a matrix that is one up to rounding.
pub(crate) fn rotation_of(m: &Matrix3<f64>) -> Option<UnitQuaternion<f64>> {
    let defect = (m.transpose() * m - Matrix3::identity()).norm();
    if !(defect < 1e-3 && m.determinant() > 0.0) {
        return None;
    }
    let svd = m.svd(true, true);
    Some(UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(svd.u? * svd.v_t?)))
}

/// Distance of the principal point in sizes of the picture; that of a piece of a picture may lie outside.
const FARTHEST_CENTER: f64 = 100.0;

/// Largest coefficient of a lens; those of lenses that exist are below 100.
const LARGEST_COEFFICIENT: f64 = 1e4;

/// Most pixels of a picture.
const MOST_PIXELS: u32 = 1 << 27;

/// Pinhole camera with lens distortion, or a fisheye camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CameraSection {
    /// Columns and rows of the picture.
    pub size: [u32; 2],
    /// Focal lengths along x and y.
    pub focal: [Pixels; 2],
    /// Principal point; pixel centres lie at integers.
    pub center: [Pixels; 2],
    /// Lens distortion.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distortion: Option<Distortion>,
}

impl CameraSection {
    /// The camera.
    ///
    /// # Errors
    /// [`ConfigError`] for a value out of its range.
    pub fn camera(&self) -> Result<Camera, ConfigError> {
        let ([fx, fy], [cx, cy]) = (self.focal.map(|v| v.si()), self.center.map(|v| v.si()));
        let wrong = |e: CameraError| ConfigError::parameter("camera", e, "a camera");
        let camera = Camera::new(fx, fy, cx, cy, self.size[0], self.size[1]).map_err(wrong)?;
        match &self.distortion {
            None => Ok(camera),
            Some(Distortion::BrownConrady(d)) => {
                Ok(camera.with_lens(Lens::new(d.k1, d.k2, d.p1, d.p2, d.k3).map_err(wrong)?))
            }
            Some(Distortion::KannalaBrandt(d)) => {
                Ok(camera.with_fisheye(Fisheye::new(d.k1, d.k2, d.k3, d.k4).map_err(wrong)?))
            }
        }
    }

    /// Checks ranges; the error names the key.
    ///
    /// # Errors
    /// [`ConfigError`].
    pub fn check(&self) -> Result<(), ConfigError> {
        if self.size.iter().any(|&n| n == 0 || n > 1 << 15) {
            let found = format!("{:?}", self.size);
            return Err(ConfigError::parameter("size", found, "columns and rows from 1 to 32768"));
        }
        if self.size[0] * self.size[1] > MOST_PIXELS {
            let expected = format!("at most {MOST_PIXELS} pixels");
            return Err(ConfigError::parameter("size", format!("{:?}", self.size), expected));
        }
        if self.focal.iter().any(|f| f.si() <= 0.0) {
            return Err(ConfigError::parameter(
                "focal",
                format!("{:?}", self.focal),
                "positive focal lengths",
            ));
        }
        let sides = self.size.map(f64::from);
        if self.center.iter().zip(sides).any(|(c, side)| c.si().abs() > FARTHEST_CENTER * side) {
            let expected = format!("a point at most {FARTHEST_CENTER} pictures away");
            return Err(ConfigError::parameter("center", format!("{:?}", self.center), expected));
        }
        for (key, found) in self.distortion.iter().flat_map(Distortion::coefficients) {
            if found.abs() > LARGEST_COEFFICIENT {
                let expected = format!("a coefficient of at most {LARGEST_COEFFICIENT}");
                return Err(ConfigError::parameter(key, found, expected));
            }
        }
        self.camera().map(drop)
    }
}

/// Lens distortion of a camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", content = "params", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Distortion {
    /// Radial and tangential polynomial of Brown and Conrady, as in OpenCV.
    BrownConrady(BrownConrady),
    /// Fisheye lens of Kannala and Brandt, as in OpenCV's `fisheye`; edges are seen up to 75° off the axis.
    KannalaBrandt(KannalaBrandt),
}

impl Distortion {
    /// The coefficients with the places where they are written.
    fn coefficients(&self) -> Vec<(&'static str, f64)> {
        macro_rules! listed {
            ($d:ident: $($k:ident)+) => { vec![$((concat!("distortion.params.", stringify!($k)), $d.$k)),+] };
        }
        match self {
            Self::BrownConrady(d) => listed!(d: k1 k2 p1 p2 k3),
            Self::KannalaBrandt(d) => listed!(d: k1 k2 k3 k4),
        }
    }
}

/// Coefficients of the Brown–Conrady model, without unit.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct BrownConrady {
    /// Radial, order r².
    pub k1: f64,
    /// Radial, order r⁴.
    pub k2: f64,
    /// Tangential.
    pub p1: f64,
    /// Tangential.
    pub p2: f64,
    /// Radial, order r⁶.
    pub k3: f64,
}

/// Coefficients of the Kannala–Brandt model, without unit.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct KannalaBrandt {
    /// Order θ³.
    pub k1: f64,
    /// Order θ⁵.
    pub k2: f64,
    /// Order θ⁷.
    pub k3: f64,
    /// Order θ⁹.
    pub k4: f64,
}
