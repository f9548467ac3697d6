use super::{EdgeSite, ViewCache};
use crate::camera::Camera;
use crate::edges::EdgeModel;
use crate::mesh::Mesh;
use std::sync::Arc;
use vt_core::agent::Visibility;
use vt_core::lie::SE3;

/// Visible edge sites of one model in one camera, as the modalities ask for them.
///
/// Mesh and edges are shared, so that several cameras or targets may look at one model.
#[derive(Clone, Debug)]
pub struct EdgeVisibility {
    mesh: Arc<Mesh>,
    edges: Arc<EdgeModel>,
    camera: Camera,
    cache: ViewCache,
}

impl EdgeVisibility {
    /// Sites of `edges`, tested for occlusion by `mesh`, as `camera` sees them.
    #[must_use]
    pub fn new(mesh: Arc<Mesh>, edges: Arc<EdgeModel>, camera: Camera, cache: ViewCache) -> Self {
        Self { mesh, edges, camera, cache }
    }

    /// The mesh.
    #[must_use]
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// The edges.
    #[must_use]
    pub fn edges(&self) -> &EdgeModel {
        &self.edges
    }
}

impl Visibility<SE3> for EdgeVisibility {
    type Feature = EdgeSite;

    fn visible(&mut self, camera_from_object: &SE3) -> &[EdgeSite] {
        self.cache.update(&self.mesh, &self.edges, &self.camera, camera_from_object);
        self.cache.sites()
    }
}
