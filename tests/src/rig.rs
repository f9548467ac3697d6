//! The edge task on the sequences that ViSP ships, without the task language.




use nalgebra::{Point3, Vector3};
use vt_core::agent::{Posed, Warp};
use vt_core::lie::SE3;
use vt_models::camera::Camera;

/// temporary
#[derive(Clone)]
pub struct TempWarp(pub Camera);
/// temporary
pub struct TempPosed<'a>(&'a Camera, nalgebra::Matrix3<f64>, Vector3<f64>);
impl Warp<SE3> for TempWarp {
    type Body = Point3<f64>;
    type Posed<'a> = TempPosed<'a>;
    fn at<'a>(&'a self, pose: &SE3) -> TempPosed<'a> {
        TempPosed(&self.0, *pose.rotation.to_rotation_matrix().matrix(), pose.translation)
    }
}
impl Posed<SE3> for TempPosed<'_> {
    type Body = Point3<f64>;
    fn locate(&self, p: &Point3<f64>) -> Option<nalgebra::Point2<f64>> {
        self.0.project(&(self.1 * p + self.2))
    }
    fn linearize(&self, p: &Point3<f64>) -> Option<(nalgebra::Point2<f64>, nalgebra::Matrix2x6<f64>)> {
        let (y, j) = self.0.project_with_jacobian(&(self.1 * p + self.2))?;
        let jr = j * self.1;
        let mut out = nalgebra::Matrix2x6::zeros();
        out.fixed_view_mut::<2, 3>(0, 0).copy_from(&jr);
        for r in 0..2 {
            let a = Vector3::new(jr[(r, 0)], jr[(r, 1)], jr[(r, 2)]);
            let w = p.coords.cross(&a);
            out.fixed_view_mut::<1, 3>(r, 3).copy_from(&w.transpose());
        }
        Some((y, out))
    }
}
