//! temporary
use nalgebra::{Point3, Vector3};
#[derive(Clone, Copy, Debug)]
pub struct EdgeSite {
    pub p_in_object: Point3<f64>,
    pub tangent: Vector3<f64>,
    pub edge: u32,
}
