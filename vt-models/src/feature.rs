//! Features of the model (paper §4.5): points in object space with descriptors, and which of them a view shows.

use crate::camera::Camera;
use crate::mesh::Mesh;
use crate::raster::{RasterOptions, Rasterizer};
use crate::visibility::{ViewKey, ViewThresholds};
use nalgebra::{Point3, Vector3};
use vt_core::lie::SE3;

/// Where a feature comes from; combining both sorts makes a tracker stable (Vacchetti and Lepetit).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Origin {
    /// Prepared from the model or from reference images.
    Offline,
    /// Found while tracking, in the frame with this number.
    Online {
        /// Frame number.
        frame: u64,
    },
}

/// One feature with a descriptor of any kind: keypoint descriptor, histogram, template patch.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelFeature<D> {
    /// Position, object frame, metres.
    pub p_in_object: Point3<f64>,
    /// Outward unit normal of the surface, object frame; without one the feature is seen from all sides.
    pub normal: Option<Vector3<f64>>,
    /// What it looks like.
    pub descriptor: D,
    /// Where it comes from.
    pub origin: Origin,
}

/// Features of one model with the list of those visible in the last view.
#[derive(Clone, Debug)]
pub struct ModelFeatures<D> {
    features: Vec<ModelFeature<D>>,
    thresholds: ViewThresholds,
    visible: Vec<u32>,
    raster: Rasterizer,
    view: Option<ViewKey>,
}

/// Largest angle between normal and viewing direction, as a cosine (75°): beyond it descriptors mean nothing.
const GRAZING: f64 = 0.258_819;
/// A feature is hidden where the mesh is nearer by more than this part of the depth.
const DEPTH_BIAS: f64 = 0.01;

impl<D> ModelFeatures<D> {
    /// Features whose visible list is kept while the view changes less than the thresholds.
    #[must_use]
    pub fn new(features: Vec<ModelFeature<D>>, thresholds: ViewThresholds) -> Self {
        Self { features, thresholds, visible: Vec::new(), raster: Rasterizer::default(), view: None }
    }

    /// All features.
    #[must_use]
    pub fn features(&self) -> &[ModelFeature<D>] {
        &self.features
    }

    /// Adds a feature; the next view is computed anew.
    pub fn push(&mut self, feature: ModelFeature<D>) {
        self.features.push(feature);
        self.view = None;
    }

    /// Drops on-line features found before this frame; off-line features stay.
    pub fn forget_before(&mut self, frame: u64) {
        self.features.retain(|f| match f.origin {
            Origin::Offline => true,
            Origin::Online { frame: found } => found >= frame,
        });
        self.view = None;
    }

    /// Indices of the features that face the camera, lie in the image and are not hidden by the mesh.
    pub fn visible(&mut self, mesh: &Mesh, camera: &Camera, camera_from_object: &SE3) -> &[u32] {
        let now = ViewKey::new(mesh, camera, camera_from_object);
        // Features near the image border come and go with any shift, so the list always counts as cut.
        if self.view.as_ref().is_some_and(|v| v.is_near(&now, &self.thresholds, true)) {
            return &self.visible;
        }
        self.view = Some(now);
        self.visible.clear();
        let options = RasterOptions { scale: 0.5, ..Default::default() };
        self.raster.render(mesh, camera, camera_from_object, &options);
        let ideal = camera.without_lens();
        let eye = Point3::from(camera_from_object.rotation.inverse() * -camera_from_object.translation);
        for (i, feature) in self.features.iter().enumerate() {
            let p = camera_from_object.act(&feature.p_in_object);
            let to_camera = eye - feature.p_in_object;
            let faces = feature.normal.is_none_or(|n| n.dot(&to_camera) > GRAZING * to_camera.norm());
            let inside = camera.project(&p).is_some_and(|q| camera.contains(&q, 0.0));
            let Some(pixel) = ideal.project(&p).filter(|_| faces && inside) else { continue };
            let at = self.raster.viewport().buffer_from_image(&pixel);
            if f64::from(self.raster.inverse_depth_at(&at)) * p.z <= 1.0 + DEPTH_BIAS {
                self.visible.push(i as u32);
            }
        }
        &self.visible
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{MeshData, Polygon};
    use nalgebra::UnitQuaternion;

    fn scene() -> (Mesh, Camera) {
        // A square of 0.2 m in the plane z = 0.
        let vertices =
            [[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]].map(|[x, y]| Point3::new(x, y, 0.0));
        let polygons = vec![Polygon { corners: vec![0, 1, 2, 3], ..Default::default() }];
        let mesh = Mesh::new(MeshData { vertices: vertices.into(), polygons, ..Default::default() }).unwrap();
        (mesh, Camera::new(500.0, 500.0, 319.5, 239.5, 640, 480).unwrap())
    }

    fn feature(x: f64, z: f64, normal: f64, origin: Origin) -> ModelFeature<&'static str> {
        let normal = Some(Vector3::new(0.0, 0.0, normal));
        ModelFeature { p_in_object: Point3::new(x, 0.0, z), normal, descriptor: "corner", origin }
    }

    fn view(x: f64, angle: f64) -> SE3 {
        SE3::new(UnitQuaternion::from_scaled_axis(Vector3::y() * angle), Vector3::new(x, 0.0, 1.0))
    }

    #[test]
    fn facing_hidden_and_outside() {
        let (mesh, camera) = scene();
        let list = vec![
            feature(0.0, 0.0, -1.0, Origin::Offline),
            feature(0.05, 0.0, 1.0, Origin::Offline),
            feature(0.0, 0.1, -1.0, Origin::Offline),
            feature(0.9, 0.0, -1.0, Origin::Offline),
        ];
        let mut features = ModelFeatures::new(list, ViewThresholds::default());
        assert_eq!(
            features.visible(&mesh, &camera, &view(0.0, 0.0)),
            [0],
            "facing, averted, behind, outside"
        );
        assert_eq!(features.visible(&mesh, &camera, &view(0.0, 3.0)), [1], "from behind");
        assert!(features.visible(&mesh, &camera, &view(3.0, 0.0)).is_empty());
    }

    #[test]
    fn the_list_is_kept_until_view_or_features_change() {
        let (mesh, camera) = scene();
        let mut features =
            ModelFeatures::new(vec![feature(0.0, 0.0, -1.0, Origin::Offline)], ViewThresholds::default());
        assert_eq!(features.visible(&mesh, &camera, &view(0.0, 0.0)).len(), 1);
        features.push(feature(0.02, 0.0, -1.0, Origin::Online { frame: 7 }));
        assert_eq!(features.visible(&mesh, &camera, &view(0.001, 0.0)), [0, 1]);
        features.forget_before(7);
        assert_eq!(features.features().len(), 2);
        features.forget_before(8);
        assert_eq!(features.visible(&mesh, &camera, &view(0.001, 0.0)), [0]);
        assert_eq!(features.features()[0].origin, Origin::Offline);
    }
}
