//! Proposals for a lost target from a search of views.

use std::sync::Arc;

use vt_core::agent::Reinitializer;
use vt_core::belief::Gaussian;
use vt_core::error::{ConfigError, MeasureError};
use vt_core::evidence::Evidence;
use vt_core::frame::SensorId;
use vt_core::lie::SE3;
use vt_models::camera::Camera;
use vt_models::edges::EdgeModel;
use vt_models::mesh::Mesh;

use super::params::ViewSearchParams;
use super::search::ViewSearch;

/// Proposes the last trusted pose, a prior, and then what a search of views finds and the picture leaves little doubt of.
///
/// The views are prepared when the target is lost for the first time. To bound the work of a frame only some sizes are
/// searched in it: those nearest to the last trusted size first, and from frame to frame the others in turn.
pub struct ViewReinitializer {
    sensor: SensorId,
    mesh: Arc<Mesh>,
    edges: Arc<EdgeModel>,
    camera: Camera,
    params: ViewSearchParams,
    /// Sizes that are searched in a frame.
    sizes_per_frame: usize,
    /// Factor on the deviations of the last trusted belief, which is tried first; `None` to leave it out.
    last_trusted: Option<f64>,
    priors: Vec<Gaussian<SE3>>,
    search: Option<Arc<ViewSearch>>,
    /// Time of the frame and pose that were trusted last, and how many sizes were searched since.
    since: Option<(SE3, usize)>,
}

impl ViewReinitializer {
    /// Searches the grey pictures of `sensor`, `sizes_per_frame` sizes of the object in each.
    ///
    /// # Errors
    /// [`ConfigError`] for parameters out of range.
    pub fn new(
        sensor: SensorId,
        mesh: Arc<Mesh>,
        edges: Arc<EdgeModel>,
        camera: Camera,
        params: ViewSearchParams,
        sizes_per_frame: usize,
    ) -> Result<Self, ConfigError> {
        let params = params.check()?;
        if sizes_per_frame == 0 {
            return Err(ConfigError::parameter("sizes_per_frame", 0, "at least 1"));
        }
        Ok(Self {
            sensor,
            mesh,
            edges,
            camera,
            params,
            sizes_per_frame,
            last_trusted: None,
            priors: vec![],
            search: None,
            since: None,
        })
    }

    /// Tries these first: the last trusted belief with its deviations multiplied by a factor, and priors.
    #[must_use]
    pub fn with_priors(self, last_trusted: Option<f64>, priors: Vec<Gaussian<SE3>>) -> Self {
        Self { last_trusted, priors, ..self }
    }

    /// The search, prepared now unless it is already.
    ///
    /// # Errors
    /// [`ConfigError`] for models without extent or edges.
    pub fn prepare(&mut self) -> Result<Arc<ViewSearch>, ConfigError> {
        if let Some(search) = &self.search {
            return Ok(search.clone());
        }
        let (mesh, edges) = (self.mesh.clone(), self.edges.clone());
        let search = Arc::new(ViewSearch::new(mesh, edges, self.camera, self.params)?);
        self.search = Some(search.clone());
        Ok(search)
    }
}

impl Reinitializer<SE3> for ViewReinitializer {
    fn propose(
        &mut self,
        evidence: &Evidence,
        last: &Gaussian<SE3>,
        out: &mut Vec<Gaussian<SE3>>,
    ) -> Result<(), MeasureError> {
        if let Some(factor) = self.last_trusted {
            out.push(Gaussian { mean: last.mean, covariance: last.covariance * (factor * factor) });
        }
        out.extend(self.priors.iter().cloned());
        let frame = evidence.frame(self.sensor)?;
        let search = self
            .prepare()
            .map_err(|_| MeasureError::Prediction("the model has no views that can be searched"))?;
        // The same pose is trusted as long as the target is lost.
        let searched = self.since.filter(|(pose, _)| *pose == last.mean).map_or(0, |(_, n)| n);
        let order = search.order(&last.mean);
        let chosen: Vec<usize> =
            (0..self.sizes_per_frame.min(order.len())).map(|k| order[(searched + k) % order.len()]).collect();
        self.since = Some((last.mean, (searched + chosen.len()) % order.len().max(1)));
        let found = search.search(frame, &chosen)?;
        let trusted = found.into_iter().filter(|f| f.support.trust() >= self.params.least_trust);
        out.extend(trusted.take(PROPOSED).map(|f| f.pose));
        Ok(())
    }
}

/// Poses found that are proposed at most.
const PROPOSED: usize = 4;
