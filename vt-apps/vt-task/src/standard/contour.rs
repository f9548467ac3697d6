//! The modalities `contour` and `chamfer`: a flat outline against the edges of the picture.

use nalgebra::DefaultAllocator;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use vt_core::error::ConfigError;
use vt_core::manifold::Alloc;
use vt_models::warp::PlanarWarp;
use vt_vision::canny::{CannyParams, Norm, Thresholds};
use vt_vision::contour::{
    ChamferModality, ChamferParams, ChamferSearch, ChamferSearchParams, ContourModality, ContourParams,
    MOST_SAMPLES,
};
use vt_vision::gaussian::Gaussian;

use super::edges::{Hypotheses, pixels};
use super::planar::PlanarSpace;
use crate::language::Picture;
use crate::quantity::{Angle, Pixels};
use crate::registry::Params;
use crate::roles::{ModalityContext, ModalityProduct, ReinitContext, ReinitProduct};

/// Parameters of the modality `contour`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Contour {
    /// Points along the outline.
    pub samples: usize,
    /// Edges on a normal that may be the contour's: all of them, or the nearest one.
    pub hypotheses: Hypotheses,
    /// Half range of the search along a normal.
    pub range: Pixels,
    /// Distance of the contour's edge from its prediction, as a standard deviation.
    pub sigma: Pixels,
    /// Probability that a contour point gives no edge.
    pub miss_probability: f64,
    /// Clutter edges per pixel of normal.
    pub clutter_density: f64,
    /// Divisor of the log-likelihood; an eighth of the number of samples when absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub temperature: Option<f64>,
    /// Edges of the picture.
    pub canny: Canny,
}

/// Parameters of Canny's edges.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Canny {
    /// Deviation of the smoothing before, at least 0.3 px; none for zero.
    pub blur: Pixels,
    /// Steps in grey levels: one with which an edge goes on, one with which it begins.
    pub thresholds: [f64; 2],
}

impl Default for Canny {
    fn default() -> Self {
        Self { blur: pixels(1.1), thresholds: [8.0, 20.0] }
    }
}

impl Canny {
    /// Edges of grey pictures, or of the colours of others.
    pub(super) fn params(&self, picture: Picture) -> Result<CannyParams, ConfigError> {
        let [low, high] = self.thresholds;
        let blur = (self.blur.si() > 0.0).then(|| Gaussian::new(self.blur.si())).transpose()?;
        let color = picture == Picture::Colour;
        CannyParams { blur, norm: Norm::L2, thresholds: Thresholds::Fixed { low, high }, color }.check()
    }
}

impl Default for Contour {
    fn default() -> Self {
        let p = ContourParams::default();
        Self {
            samples: 60,
            hypotheses: Hypotheses::of(p.hypotheses),
            range: pixels(p.range),
            sigma: pixels(p.sigma),
            miss_probability: p.miss_probability,
            clutter_density: p.clutter_density,
            temperature: p.temperature,
            canny: Canny::default(),
        }
    }
}

impl Contour {
    fn params(&self) -> Result<ContourParams, ConfigError> {
        ContourParams {
            hypotheses: self.hypotheses.method(),
            range: self.range.si(),
            sigma: self.sigma.si(),
            miss_probability: self.miss_probability,
            clutter_density: self.clutter_density,
            temperature: self.temperature,
        }
        .check()
    }
}

fn samples(count: usize) -> Result<(), ConfigError> {
    if (3..=MOST_SAMPLES).contains(&count) {
        return Ok(());
    }
    Err(ConfigError::parameter("samples", count, format!("3 to {MOST_SAMPLES} points")))
}

impl Params for Contour {
    fn check(&self) -> Result<(), ConfigError> {
        samples(self.samples)?;
        self.canny.params(Picture::Grey)?;
        self.params().map(drop)
    }
}

pub(super) fn contour<P: PlanarSpace>(
    p: Contour,
    context: ModalityContext<'_>,
) -> Result<ModalityProduct<P>, ConfigError>
where
    DefaultAllocator: Alloc<P::D>,
{
    let contour = context.shape.outline()?.sample(p.samples);
    let canny = p.canny.params(context.picture)?;
    let warp = PlanarWarp::<P>::default();
    let modality = ContourModality::new(p.params()?, canny, context.sensor, warp, contour)?;
    let processing = Box::new(modality.processing());
    Ok(ModalityProduct { modality: Box::new(modality), processing: vec![processing] })
}

/// Parameters of the modality `chamfer`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Chamfer {
    /// Points along the outline.
    pub samples: usize,
    /// Distance of an edge from the contour, as a standard deviation.
    pub sigma: Pixels,
    /// Sine of the angle between contour and edge, as a standard deviation.
    pub angle: f64,
    /// Deviations at which a point counts as without an edge.
    pub truncation: f64,
    /// Divisor of the log-likelihood; an eighth of the number of samples when absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub temperature: Option<f64>,
    /// Edges of the picture.
    pub canny: Canny,
}

impl Default for Chamfer {
    fn default() -> Self {
        let ChamferParams { sigma, angle, truncation, temperature } = ChamferParams::default();
        Self { samples: 60, sigma: pixels(sigma), angle, truncation, temperature, canny: Canny::default() }
    }
}

impl Chamfer {
    fn params(&self) -> Result<ChamferParams, ConfigError> {
        let Self { angle, truncation, temperature, .. } = *self;
        ChamferParams { sigma: self.sigma.si(), angle, truncation, temperature }.check()
    }
}

impl Params for Chamfer {
    fn check(&self) -> Result<(), ConfigError> {
        samples(self.samples)?;
        self.canny.params(Picture::Grey)?;
        self.params().map(drop)
    }
}

pub(super) fn chamfer<P: PlanarSpace>(
    p: Chamfer,
    context: ModalityContext<'_>,
) -> Result<ModalityProduct<P>, ConfigError>
where
    DefaultAllocator: Alloc<P::D>,
{
    let contour = context.shape.outline()?.sample(p.samples);
    let canny = p.canny.params(context.picture)?;
    let warp = PlanarWarp::<P>::default();
    let modality = ChamferModality::new(p.params()?, canny, context.sensor, warp, contour)?;
    let processing = Box::new(modality.processing());
    Ok(ModalityProduct { modality: Box::new(modality), processing: vec![processing] })
}

/// Parameters of the re-initialiser `chamfer`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ReinitChamfer {
    /// Angles that are searched: as far from the last trusted one, up to half a turn.
    pub turn: Angle,
    /// Scales that are searched: the largest factor between them and the last trusted one, either way.
    pub magnification: f64,
    /// Most poses that are tried in a picture.
    pub proposals: usize,
    /// Factor on the deviations of the last trusted pose, which is tried first; 0 leaves it out.
    pub last_trusted: f64,
    /// How outline and edges are compared.
    pub chamfer: Chamfer,
}

impl Default for ReinitChamfer {
    fn default() -> Self {
        let ChamferSearchParams { turn, magnification, proposals, .. } = ChamferSearchParams::default();
        // A finite number of a known unit always is a quantity.
        let turn = Angle::new(turn.to_degrees(), "deg").unwrap_or_default();
        Self { turn, magnification, proposals, last_trusted: 3.0, chamfer: Chamfer::default() }
    }
}

impl ReinitChamfer {
    fn params(&self) -> Result<ChamferSearchParams, ConfigError> {
        let Self { turn, magnification, proposals, .. } = *self;
        let chamfer = self.chamfer.params()?;
        ChamferSearchParams { turn: turn.si(), magnification, proposals, chamfer }.check()
    }
}

impl Params for ReinitChamfer {
    fn check(&self) -> Result<(), ConfigError> {
        self.chamfer.check()?;
        super::init::last_trusted(self.last_trusted)?;
        self.params().map(drop)
    }
}

pub(super) fn search<P: PlanarSpace>(
    p: ReinitChamfer,
    context: ReinitContext<'_, P>,
) -> Result<ReinitProduct<P>, ConfigError>
where
    DefaultAllocator: Alloc<P::D>,
{
    let contour = context.body.shape.outline()?.sample(p.chamfer.samples);
    let canny = p.chamfer.canny.params(context.picture)?;
    let search = ChamferSearch::new(p.params()?, canny, context.body.sensor, contour)?
        .with_last_trusted(super::init::last_trusted(p.last_trusted)?);
    let processing = Box::new(search.processing());
    Ok(ReinitProduct { reinitializer: Some(Box::new(search)), processing: vec![processing] })
}
