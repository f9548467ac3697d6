use super::{NONE, Viewport};
use crate::camera::Camera;
use crate::mesh::Mesh;
use nalgebra::{Matrix3, Point3};

/// Per triangle, the matrix from buffer pixel `(i, j, 1)` to unnormalised barycentric weights.
#[derive(Clone, Debug, Default)]
pub(super) struct Cache {
    weights_from_pixel: Vec<Option<Matrix3<f32>>>,
}

impl Cache {
    pub fn fill(
        &mut self,
        mesh: &Mesh,
        p_in_camera: &[Point3<f64>],
        ideal: &Camera,
        viewport: &Viewport,
        ids: &[u32],
        out: &mut Vec<[f32; 2]>,
    ) {
        let ((fx, fy), (cx, cy)) = (ideal.focal(), ideal.principal_point());
        let ray_from_pixel = Matrix3::new(
            1.0 / fx,
            0.0,
            (f64::from(viewport.x) - cx) / fx,
            0.0,
            1.0 / fy,
            (f64::from(viewport.y) - cy) / fy,
            0.0,
            0.0,
            1.0,
        );
        self.weights_from_pixel.clear();
        self.weights_from_pixel.resize(mesh.triangles().len(), None);
        out.clear();
        for (i, &id) in ids.iter().enumerate() {
            let Some(triangle) = (id != NONE).then(|| mesh.triangles().get(id as usize)).flatten() else {
                out.push([f32::NAN; 2]);
                continue;
            };
            let weights = self.weights_from_pixel[id as usize].get_or_insert_with(|| {
                // P = λ0 A + λ1 B + λ2 C along the ray r: λ ∝ [A B C]⁻¹ r.
                let corners = triangle.vertices.map(|v| p_in_camera[v as usize].coords);
                let inverse = Matrix3::from_columns(&corners).try_inverse().unwrap_or_else(Matrix3::zeros);
                let m = inverse * ray_from_pixel;
                let scale = m.amax().max(f64::MIN_POSITIVE);
                (m / scale).cast()
            });
            let (x, y) = ((i % viewport.width) as f32, (i / viewport.width) as f32);
            let w = weights.column(0) * x + weights.column(1) * y + weights.column(2);
            let sum = w.x + w.y + w.z;
            out.push([w.y / sum, w.z / sum]);
        }
    }
}
