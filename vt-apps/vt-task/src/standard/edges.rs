//! The modality `edges`: model contour against image edges.

use std::sync::Arc;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use vt_core::error::ConfigError;
use vt_core::evidence::Processing;
use vt_core::lie::SE3;
use vt_models::edges::{EdgeModel, EdgeOptions};
use vt_models::visibility::{MeshView, ViewCache, ViewThresholds, VisibilityOptions};
use vt_models::warp::Se3Warp;
use vt_vision::edge::{self, EdgeModality, EdgeParams, EdgePixelModality};
use vt_vision::pyramid::PyramidProcessing;

use crate::quantity::{Angle, Pixels};
use crate::registry::Params;
use crate::roles::{ModalityContext, ModalityProduct};

/// How many edges on a search line may compete.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Hypotheses {
    /// The edge nearest to the prediction.
    Single,
    /// All edges on the line, weighted softly.
    Multiple,
}

impl Hypotheses {
    pub(super) fn of(method: edge::Hypotheses) -> Self {
        match method {
            edge::Hypotheses::Single => Self::Single,
            edge::Hypotheses::Multiple => Self::Multiple,
        }
    }

    pub(super) fn method(self) -> edge::Hypotheses {
        match self {
            Self::Single => edge::Hypotheses::Single,
            Self::Multiple => edge::Hypotheses::Multiple,
        }
    }
}

/// Parameters of the modality `edges`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Edges {
    /// Competing edges on a search line.
    pub hypotheses: Hypotheses,
    /// Smallest step in grey levels that counts as an edge.
    pub min_contrast: f64,
    /// Most edges kept on a search line.
    pub max_candidates: usize,
    /// Shortest and longest half range of the search along a normal; between them the predicted uncertainty decides.
    pub range: [Pixels; 2],
    /// Distance from the contour at which an edge point still counts as the contour's, as a standard deviation.
    pub sigma: Pixels,
    /// Expected standard deviation of the localisation of an edge point; the residuals of the picture correct it.
    pub localization: Pixels,
    /// Probability that a visible contour point gives no edge.
    pub miss_probability: f64,
    /// Clutter edges per pixel of search line.
    pub clutter_density: f64,
    /// Distance along a contour over which errors are correlated.
    pub correlation_length: Pixels,
    /// Most searches per frame.
    pub searches: usize,
    /// Gauss–Newton steps after each search.
    pub iterations: usize,
    /// Most pyramid levels above the full picture.
    pub coarse_levels: u32,
    /// Most starts where the prediction is uncertain by more than the longest range.
    pub starts: u32,
    /// Divisor of the log-likelihood at pixel level.
    pub temperature: f64,
    /// Distance of sites along a visible edge.
    pub step: Pixels,
    /// Shortest projected edge that gets a site; the outline of a finely divided surface is made of very short ones.
    pub min_length: Pixels,
    /// Most sites.
    pub max_sites: usize,
    /// Smallest angle between two faces whose edge is looked for.
    pub crease_angle: Angle,
}

pub(super) fn pixels(v: f64) -> Pixels {
    // A finite number of a known unit always is a quantity.
    Pixels::new(v, "px").unwrap_or_default()
}

impl Default for Edges {
    fn default() -> Self {
        let (p, v) = (EdgeParams::default(), VisibilityOptions::default());
        Self {
            hypotheses: Hypotheses::of(p.hypotheses),
            min_contrast: p.min_contrast,
            max_candidates: p.max_candidates,
            range: p.range.map(pixels),
            sigma: pixels(p.sigma),
            localization: pixels(p.localization),
            miss_probability: p.miss_probability,
            clutter_density: p.clutter_density,
            correlation_length: pixels(p.correlation_length),
            searches: p.searches,
            iterations: p.iterations,
            coarse_levels: p.coarse_levels,
            starts: p.starts,
            temperature: p.temperature,
            step: pixels(v.step),
            min_length: pixels(v.min_length),
            max_sites: v.max_sites,
            crease_angle: Angle::new(EdgeOptions::default().crease_angle, "rad").unwrap_or_default(),
        }
    }
}

impl Edges {
    fn params(&self, level: vt_core::measurement::Level) -> Result<EdgeParams, ConfigError> {
        EdgeParams {
            level,
            hypotheses: self.hypotheses.method(),
            min_contrast: self.min_contrast,
            max_candidates: self.max_candidates,
            range: self.range.map(|r| r.si()),
            sigma: self.sigma.si(),
            localization: self.localization.si(),
            miss_probability: self.miss_probability,
            clutter_density: self.clutter_density,
            correlation_length: self.correlation_length.si(),
            searches: self.searches,
            iterations: self.iterations,
            coarse_levels: self.coarse_levels,
            starts: self.starts,
            temperature: self.temperature,
        }
        .check()
    }
}

/// More sites than this are refused.
const MOST_SITES: usize = 100_000;

impl Params for Edges {
    fn check(&self) -> Result<(), ConfigError> {
        if self.step.si() < 1.0 {
            return Err(ConfigError::parameter("step", self.step, "at least 1 px"));
        }
        if self.min_length.si() <= 0.0 {
            return Err(ConfigError::parameter("min_length", self.min_length, "a positive number of pixels"));
        }
        if !(1..=MOST_SITES).contains(&self.max_sites) {
            let expected = format!("at least 1 site, at most {MOST_SITES}");
            return Err(ConfigError::parameter("max_sites", self.max_sites, expected));
        }
        if !(self.crease_angle.si() > 0.0 && self.crease_angle.si() < core::f64::consts::PI) {
            return Err(ConfigError::parameter(
                "crease_angle",
                self.crease_angle,
                "an angle between 0 and 180 deg",
            ));
        }
        self.params(vt_core::measurement::Level::Feature).map(drop)
    }
}

pub(super) fn edges(p: Edges, context: ModalityContext<'_>) -> Result<ModalityProduct<SE3>, ConfigError> {
    let mismatch = |found: String, expected: &str| ConfigError::Mismatch { found, expected: expected.into() };
    let camera =
        *context.camera.ok_or_else(|| mismatch("an uncalibrated sensor".into(), "a calibrated one"))?;
    let mesh = context
        .shape
        .body()?
        .flatten()
        .map_err(|e| mismatch(e.to_string(), "a shape with surfaces or lines"))?;
    let options = EdgeOptions { crease_angle: p.crease_angle.si(), ..EdgeOptions::default() };
    let model =
        EdgeModel::new(&mesh, &options).map_err(|e| mismatch(e.to_string(), "options of an edge model"))?;
    let visibility = VisibilityOptions {
        step: p.step.si(),
        min_length: p.min_length.si(),
        max_sites: p.max_sites,
        ..VisibilityOptions::default()
    };
    let diameter = mesh.diameter();
    let cache = ViewCache::new(visibility, ViewThresholds::default());
    let view = MeshView::new(Arc::new(mesh), Arc::new(model), camera, cache);
    let free = core::array::from_fn(|k| context.freedom.0.get(k).copied().unwrap_or(true));
    let warp = Se3Warp::new(camera).with_free(free);
    let params = p.params(context.level.into())?;
    let sensor = context.sensor;
    if params.level == vt_core::measurement::Level::Pixel {
        let modality = EdgePixelModality::new(params, sensor, warp, view, diameter);
        let processing = Box::new(modality.processing());
        return Ok(ModalityProduct { modality: Box::new(modality), processing: vec![processing] });
    }
    let mut processing: Vec<Box<dyn Processing>> = vec![];
    if params.coarse_levels > 0 {
        processing.push(Box::new(PyramidProcessing::new(sensor, params.coarse_levels)));
    }
    let modality = EdgeModality::new(params, sensor, warp, view, diameter);
    Ok(ModalityProduct { modality: Box::new(modality), processing })
}
