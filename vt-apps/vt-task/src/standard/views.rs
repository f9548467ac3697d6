//! Search of views: the init `auto` and the re-initialiser `views`.

use std::sync::Arc;

use nalgebra::{DefaultAllocator, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use vt_core::error::ConfigError;
use vt_core::lie::SE3;
use vt_core::manifold::{Alloc, Manifold};
use vt_models::edges::{EdgeModel, EdgeOptions};
use vt_vision::view_search::{TRUSTED, ViewReinitializer, ViewSearchParams};

use super::init::{Sigma, around, last_trusted};
use crate::quantity::{Angle, Length, Pixels};
use crate::registry::{NoParams, Params};
use crate::roles::{Body, InitContext, ReinitContext, ReinitProduct, Start};

fn default_size() -> [Pixels; 2] {
    // A finite number of a known unit always is a quantity.
    ViewSearchParams::default().sizes.map(|s| Pixels::new(s, "px").unwrap_or_default())
}

/// Parameters of the init `auto`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct InitAuto {
    /// Smallest and largest size of the body in the picture: diameter of its bounding sphere.
    pub size: [Pixels; 2],
    /// Uncertainty of a target that is not found; a pose that is found brings its own.
    pub sigma: Sigma,
}

impl Default for InitAuto {
    fn default() -> Self {
        let translation = Length::new(5.0, "mm").unwrap_or_default();
        let rotation = Angle::new(1.0, "deg").unwrap_or_default();
        Self { size: default_size(), sigma: Sigma { translation, rotation } }
    }
}

impl Params for InitAuto {
    fn check(&self) -> Result<(), ConfigError> {
        params(self.size)?;
        self.sigma.check()
    }
}

/// Parameters of the re-initialiser `views`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ReinitViews {
    /// Smallest and largest size of the body in the picture: diameter of its bounding sphere.
    pub size: [Pixels; 2],
    /// Sizes that are searched in one frame; all of them take several frames.
    pub sizes_per_frame: usize,
    /// Factor on the deviations of the last trusted pose, which is tried first; 0 leaves it out.
    pub last_trusted: f64,
    /// How much the picture must say for a pose, in nats, before it is tried: the default leaves one in twenty
    /// pictures without the body with a wrong proposal. Bodies with few edges need less.
    pub least_trust: f64,
}

impl Default for ReinitViews {
    fn default() -> Self {
        Self { size: default_size(), sizes_per_frame: 3, last_trusted: 3.0, least_trust: TRUSTED }
    }
}

impl Params for ReinitViews {
    fn check(&self) -> Result<(), ConfigError> {
        if self.sizes_per_frame == 0 {
            return Err(ConfigError::parameter("sizes_per_frame", 0, "at least 1"));
        }
        last_trusted(self.last_trusted)?;
        self.search().check().map(drop)
    }
}

impl ReinitViews {
    fn search(&self) -> ViewSearchParams {
        let sizes = self.size.map(|s| s.si());
        ViewSearchParams { sizes, least_trust: self.least_trust, ..ViewSearchParams::default() }
    }
}

fn params(size: [Pixels; 2]) -> Result<ViewSearchParams, ConfigError> {
    ViewSearchParams { sizes: size.map(|s| s.si()), ..ViewSearchParams::default() }.check()
}

fn reinitializer(
    body: &Body<'_>,
    params: ViewSearchParams,
    sizes_per_frame: usize,
) -> Result<ViewReinitializer, ConfigError> {
    let mismatch = |found: String, expected: &str| ConfigError::Mismatch { found, expected: expected.into() };
    if !body.freedom.0.iter().all(|free| *free) {
        return Err(mismatch("a body with locked degrees of freedom".into(), "a body that is free to move"));
    }
    let camera = *body.camera.ok_or_else(|| mismatch("an uncalibrated sensor".into(), "a calibrated one"))?;
    let mesh = body
        .shape
        .body()?
        .flatten()
        .map_err(|e| mismatch(e.to_string(), "a shape with surfaces or lines"))?;
    let edges = EdgeModel::new(&mesh, &EdgeOptions::default())
        .map_err(|e| mismatch(e.to_string(), "options of an edge model"))?;
    ViewReinitializer::new(body.sensor, Arc::new(mesh), Arc::new(edges), camera, params, sizes_per_frame)
}

/// Searches the first frame; where nothing is found, the target begins as lost and the re-initialiser goes on.
pub(super) fn auto(p: InitAuto, context: InitContext<'_>) -> Result<Start<SE3>, ConfigError> {
    let search = reinitializer(&context.body, params(p.size)?, 1)?.prepare()?;
    let all: Vec<usize> = (0..search.sizes()).collect();
    let frame = context.frames.iter().find(|f| f.sensor == context.body.sensor);
    let found = match frame {
        Some(frame) => search.search(frame, &all).map_err(|e| ConfigError::Mismatch {
            found: e.to_string(),
            expected: "a first frame that can be searched".into(),
        })?,
        None => vec![],
    };
    // Somewhere in front of the camera, not to be believed.
    let anywhere = SE3::from_rotation_vector(&Vector3::zeros(), Vector3::z());
    Ok(match found.into_iter().next() {
        Some(f) => f.pose.into(),
        None => Start { known: false, ..around(anywhere, &p.sigma, &context)?.into() },
    })
}

pub(super) fn views(
    p: ReinitViews,
    context: ReinitContext<'_, SE3>,
) -> Result<ReinitProduct<SE3>, ConfigError> {
    // What was never known is not tried.
    let last_trusted = last_trusted(p.last_trusted)?.filter(|_| context.prior.is_some());
    let priors = context.prior.cloned().into_iter().collect();
    let search = reinitializer(&context.body, p.search(), p.sizes_per_frame)?;
    Ok(ReinitProduct::of_frames(search.with_priors(last_trusted, priors)))
}

/// Never proposes anything.
pub(super) fn none<P: Manifold>(_: NoParams, _: ReinitContext<'_, P>) -> Result<ReinitProduct<P>, ConfigError>
where
    DefaultAllocator: Alloc<P::D>,
{
    Ok(ReinitProduct::none())
}
