use super::{EdgeSite, VisibilityOptions, VisibleEdges};
use crate::camera::Camera;
use crate::edges::EdgeModel;
use crate::mesh::Mesh;
use nalgebra::{Point2, Point3, UnitQuaternion, Vector3};
use vt_core::lie::SE3;

/// Changes of view up to which the sites stay.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewThresholds {
    /// Turn of the direction to the camera in the object frame, radians.
    pub direction: f64,
    /// Change of the distance, relative.
    pub distance: f64,
    /// Turn about the optical axis, radians.
    pub roll: f64,
    /// Shift of the object in the image while parts of it lie outside, pixels.
    pub offset: f64,
}

impl Default for ViewThresholds {
    /// 1.5°, 3 %, 6° and 8 pixels.
    fn default() -> Self {
        Self { direction: 1.5_f64.to_radians(), distance: 0.03, roll: 6.0_f64.to_radians(), offset: 8.0 }
    }
}

/// The view a list was made for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ViewKey {
    camera: Camera,
    toward_camera: Vector3<f64>,
    distance: f64,
    rotation: UnitQuaternion<f64>,
    center: Option<Point2<f64>>,
}

impl ViewKey {
    pub(crate) fn new(mesh: &Mesh, camera: &Camera, camera_from_object: &SE3) -> Self {
        let center = camera_from_object.act(&mesh.bounds().center());
        let distance = center.coords.norm();
        let toward_camera = camera_from_object.rotation.inverse() * -center.coords;
        Self {
            camera: *camera,
            toward_camera: toward_camera.try_normalize(0.0).unwrap_or_else(Vector3::zeros),
            distance,
            rotation: camera_from_object.rotation,
            center: camera.without_lens().project(&Point3::from(center.coords)),
        }
    }

    pub(crate) fn is_near(&self, now: &Self, limits: &ViewThresholds, cut: bool) -> bool {
        // |a × b| is the sine of the angle, which the threshold bounds closely enough.
        let turned = self.toward_camera.cross(&now.toward_camera).norm();
        let roll = (now.rotation * self.rotation.inverse()).scaled_axis().z.abs();
        let shifted = || match (self.center, now.center) {
            (Some(a), Some(b)) => (a - b).norm(),
            _ => f64::INFINITY,
        };
        self.camera == now.camera
            && turned <= limits.direction
            && self.toward_camera.dot(&now.toward_camera) > 0.0
            && (now.distance - self.distance).abs() <= limits.distance * self.distance
            && roll <= limits.roll
            && (!cut || shifted() <= limits.offset)
    }
}

/// Keeps the visible sites until the view has changed enough.
///
/// One cache serves one mesh; [`ViewCache::invalidate`] it when the mesh changes.
#[derive(Clone, Debug, Default)]
pub struct ViewCache {
    /// How sites are found.
    pub options: VisibilityOptions,
    /// When they are found again.
    pub thresholds: ViewThresholds,
    visible: VisibleEdges,
    key: Option<ViewKey>,
}

impl ViewCache {
    /// An empty cache.
    #[must_use]
    pub fn new(options: VisibilityOptions, thresholds: ViewThresholds) -> Self {
        Self { options, thresholds, ..Self::default() }
    }

    /// Makes the sites fit the pose; returns whether they were computed again.
    pub fn update(
        &mut self,
        mesh: &Mesh,
        edges: &EdgeModel,
        camera: &Camera,
        camera_from_object: &SE3,
    ) -> bool {
        let now = ViewKey::new(mesh, camera, camera_from_object);
        if self.key.is_some_and(|k| k.is_near(&now, &self.thresholds, self.visible.is_cut())) {
            return false;
        }
        self.visible.update(mesh, edges, camera, camera_from_object, &self.options);
        self.key = Some(now);
        true
    }

    /// Forgets the view.
    pub fn invalidate(&mut self) {
        self.key = None;
    }

    /// Sites of the view last computed; their pixels belong to that view.
    #[must_use]
    pub fn sites(&self) -> &[EdgeSite] {
        self.visible.sites()
    }

    /// The underlying list.
    #[must_use]
    pub fn visible(&self) -> &VisibleEdges {
        &self.visible
    }
}
