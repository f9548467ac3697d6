//! Rigid motions of space.
use nalgebra::{Point3, RealField, UnitQuaternion, Vector3};

/// A rigid motion `p ↦ R p + t`. Tangent order: translation `v` (metres), rotation `ω` (radians).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SE3<T: RealField + Copy = f64> {
    /// Rotation `R`.
    pub rotation: UnitQuaternion<T>,
    /// Translation `t` in metres.
    pub translation: Vector3<T>,
}

impl<T: RealField + Copy> SE3<T> {
    /// The image of a point.
    pub fn act(&self, p: &Point3<T>) -> Point3<T> {
        self.rotation * p + self.translation
    }
}
