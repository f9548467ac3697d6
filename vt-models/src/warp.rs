//! Warps: body points to pixels under a pose, with exact Jacobians (paper Eq. 1–4).

mod planar;

pub use planar::{PlanarWarp, PosedPlanar};

use crate::camera::Camera;
use nalgebra::{Matrix2x3, Matrix2x6, Matrix3, Point2, Point3, Vector3};
use vt_core::agent::{Posed, Warp};
use vt_core::lie::SE3;

/// Rigid body before a calibrated camera: `y = K(lens(π(T x)))`.
///
/// With `A = ∂y/∂(T x) · R` the Jacobian under `T · Exp(δ)`, translation first, is `[A | -A [x]×]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Se3Warp {
    camera: Camera,
    free: [bool; 6],
}

impl Se3Warp {
    /// All six degrees of freedom free.
    #[must_use]
    pub fn new(camera: Camera) -> Self {
        Self { camera, free: [true; 6] }
    }

    /// Frees some degrees of freedom, in tangent order (translation x y z, rotation x y z, in the body frame); the
    /// columns of the others are zero.
    #[must_use]
    pub fn with_free(self, free: [bool; 6]) -> Self {
        Self { free, ..self }
    }

    /// The camera.
    #[must_use]
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Which degrees of freedom are free.
    #[must_use]
    pub fn free(&self) -> [bool; 6] {
        self.free
    }
}

/// [`Se3Warp`] at one pose.
#[derive(Clone, Debug)]
pub struct PosedSe3<'a> {
    warp: &'a Se3Warp,
    rotation: Matrix3<f64>,
    translation: Vector3<f64>,
}

impl Warp<SE3> for Se3Warp {
    type Body = Point3<f64>;
    type Posed<'a> = PosedSe3<'a>;

    fn at<'a>(&'a self, pose: &SE3) -> PosedSe3<'a> {
        let rotation = pose.rotation.to_rotation_matrix().into_inner();
        PosedSe3 { warp: self, rotation, translation: pose.translation }
    }
}

impl PosedSe3<'_> {
    fn in_camera(&self, p_in_object: &Point3<f64>) -> Point3<f64> {
        Point3::from(self.rotation * p_in_object.coords + self.translation)
    }
}

impl Posed<SE3> for PosedSe3<'_> {
    type Body = Point3<f64>;

    fn locate(&self, point: &Point3<f64>) -> Option<Point2<f64>> {
        self.warp.camera.project(&self.in_camera(point))
    }

    fn linearize(&self, point: &Point3<f64>) -> Option<(Point2<f64>, Matrix2x6<f64>)> {
        let (pixel, by_camera) = self.warp.camera.project_with_jacobian(&self.in_camera(point))?;
        let by_translation: Matrix2x3<f64> = by_camera * self.rotation;
        let mut jacobian = Matrix2x6::zeros();
        for row in 0..2 {
            let a = by_translation.row(row).transpose();
            // -aᵀ [x]× = (x × a)ᵀ
            let turn = point.coords.cross(&a);
            for i in 0..3 {
                jacobian[(row, i)] = if self.warp.free[i] { a[i] } else { 0.0 };
                jacobian[(row, i + 3)] = if self.warp.free[i + 3] { turn[i] } else { 0.0 };
            }
        }
        Some((pixel, jacobian))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Lens;
    use nalgebra::{UnitQuaternion, Vector6};
    use num_dual::Dual64;
    use proptest::prelude::*;
    use vt_core::agent::Projected;
    use vt_core::lie::LieGroup;
    use vt_core::manifold::Manifold;

    fn warp() -> Se3Warp {
        let lens = Lens::new(-0.2, 0.05, 1e-3, -5e-4, 0.01).unwrap();
        Se3Warp::new(Camera::new(600.0, 590.0, 320.0, 240.0, 640, 480).unwrap().with_lens(lens))
    }

    fn dual(x: f64) -> Dual64 {
        Dual64::from(x)
    }

    #[test]
    fn batch_masks_points_behind_and_locked_columns_are_zero() {
        let free = [true, false, true, false, true, false];
        let w = warp().with_free(free);
        let pose = SE3::new(
            UnitQuaternion::from_scaled_axis(Vector3::new(0.3, 0.2, -0.4)),
            Vector3::new(0.0, 0.1, 0.5),
        );
        let points = [Point3::new(0.05, 0.02, 0.1), Point3::new(0.0, 0.0, -3.0)];
        let mut out = Projected::default();
        w.project(&pose, &points, &mut out);
        assert_eq!(out.valid, [true, false]);
        let whole = warp();
        let (y, j) = whole.at(&pose).linearize(&points[0]).unwrap();
        assert_eq!((out.points[0], whole.at(&pose).locate(&points[0])), (y, Some(y)));
        for i in 0..6 {
            let expected = if free[i] { j.column(i).into_owned() } else { nalgebra::Vector2::zeros() };
            assert_eq!(out.jacobians[0].column(i), expected, "column {i}");
            assert!(j.column(i).norm() > 1.0);
        }
    }

    proptest! {
        #[test]
        fn jacobian_agrees_with_dual_numbers_and_central_differences(
            p in prop::array::uniform3(-0.1..0.1_f64),
            // Identity, near-identity and general rotations.
            turn in prop_oneof![Just([0.0; 3]), prop::array::uniform3(-1e-8..1e-8_f64), prop::array::uniform3(-3.0..3.0_f64)],
            shift in (-0.2..0.2_f64, -0.2..0.2_f64, 0.4..2.0_f64),
        ) {
            let w = warp();
            let p = Point3::from(p);
            let pose = SE3::new(UnitQuaternion::from_scaled_axis(Vector3::from(turn)), Vector3::new(shift.0, shift.1, shift.2));
            let (y, j) = w.at(&pose).linearize(&p).unwrap();
            let exact: SE3<Dual64> =
                SE3::new(UnitQuaternion::new_unchecked(pose.rotation.coords.map(dual).into()), pose.translation.map(dual));
            for i in 0..6 {
                let mut d = Vector6::repeat(dual(0.0));
                d[i] = Dual64::new(0.0, 1.0);
                let moved = exact.compose(&SE3::exp(&d)).act(&p.map(dual));
                let image = w.camera().project_generic([moved.x, moved.y, moved.z]);
                let mut h = Vector6::zeros();
                h[i] = 1e-6;
                let at = |d: &Vector6<f64>| w.at(&pose.retract(d)).locate(&p).unwrap();
                let difference = (at(&h) - at(&-h)) / 2e-6;
                for row in 0..2 {
                    prop_assert!((image[row].re - y[row]).abs() < 1e-9);
                    prop_assert!((image[row].eps - j[(row, i)]).abs() < 1e-9 * j.norm(), "({row}, {i})");
                    prop_assert!((difference[row] - j[(row, i)]).abs() < 1e-6 * j.norm(), "({row}, {i})");
                }
            }
        }
    }
}
