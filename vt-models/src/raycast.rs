//! Ray casts against a mesh, through a bounding volume hierarchy of `parry3d` (in f32).
//!
//! It also tells how far points are from the surface. The rasteriser answers "what is at every pixel"; this answers "what is along this one ray", and is its oracle.

use crate::mesh::Mesh;
use nalgebra::{Point3, Vector3};
use parry3d::math::Vector;
use parry3d::query::{PointQuery, Ray, RayCast};
use parry3d::shape::{FeatureId, TriMesh};

/// What a ray meets first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Multiple of the ray's direction vector.
    pub distance: f64,
    /// Index of the triangle.
    pub triangle: u32,
}

/// Spatial index of a mesh's triangles, both sides of which are solid.
pub struct RayCaster {
    /// `None` for a mesh of lines only.
    shape: Option<TriMesh>,
    triangles: u32,
}

impl RayCaster {
    /// Builds the index; a mesh without triangles is never hit.
    #[must_use]
    pub fn new(mesh: &Mesh) -> Self {
        let indices: Vec<[u32; 3]> = mesh.triangles().iter().map(|t| t.vertices).collect();
        let triangles = indices.len() as u32;
        let points = mesh.vertices().iter().map(|p| vector(&p.coords)).collect();
        Self { shape: TriMesh::new(points, indices).ok(), triangles }
    }

    /// First triangle along `origin + distance · direction`, object frame, metres.
    #[must_use]
    pub fn cast(&self, origin: &Point3<f64>, direction: &Vector3<f64>) -> Option<Hit> {
        let ray = Ray::new(vector(&origin.coords), vector(direction));
        let hit = self.shape.as_ref()?.cast_local_ray_and_get_normal(&ray, f32::MAX, true)?;
        let FeatureId::Face(face) = hit.feature else { return None };
        // Hits from behind count on from the number of triangles.
        Some(Hit { distance: f64::from(hit.time_of_impact), triangle: face % self.triangles })
    }

    /// Distance of a point to the nearest triangle, metres; `None` for a mesh without triangles.
    #[must_use]
    pub fn distance(&self, p: &Point3<f64>) -> Option<f64> {
        let projected = self.shape.as_ref()?.project_local_point(vector(&p.coords), false);
        Some(f64::from((projected.point - vector(&p.coords)).length()))
    }
}

fn vector(v: &Vector3<f64>) -> Vector {
    Vector::new(v.x as f32, v.y as f32, v.z as f32)
}
