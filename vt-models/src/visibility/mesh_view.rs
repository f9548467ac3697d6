//! A mesh as a camera sees it, frame after frame.

use std::sync::Arc;

use vt_core::agent::Visibility;
use vt_core::lie::SE3;

use super::{EdgeSite, ViewCache};
use crate::camera::Camera;
use crate::edges::EdgeModel;
use crate::mesh::Mesh;

/// Visible edge sites of one rigid mesh in one camera.
#[derive(Clone, Debug)]
pub struct MeshView {
    mesh: Arc<Mesh>,
    edges: Arc<EdgeModel>,
    camera: Camera,
    cache: ViewCache,
}

impl MeshView {
    /// The view of `mesh` with its edge model in `camera`; `cache` says how sites are placed and kept.
    #[must_use]
    pub fn new(mesh: Arc<Mesh>, edges: Arc<EdgeModel>, camera: Camera, cache: ViewCache) -> Self {
        Self { mesh, edges, camera, cache }
    }
}

impl Visibility<SE3> for MeshView {
    type Feature = EdgeSite;

    fn visible(&mut self, pose: &SE3) -> &[EdgeSite] {
        self.cache.update(&self.mesh, &self.edges, &self.camera, pose);
        self.cache.sites()
    }
}
