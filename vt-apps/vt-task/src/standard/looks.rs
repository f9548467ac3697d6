//! Modalities that know what a flat object looked like: `color`, histograms under a kernel that is warped with the object, and
//! `template`, correlation of its grey levels; and the re-initialiser `back-projection`, which looks for its colours.

use image::RgbImage;
use nalgebra::DefaultAllocator;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use vt_core::error::ConfigError;
use vt_core::lie::Sim2;
use vt_core::manifold::Alloc;
use vt_models::warp::PlanarWarp;
use vt_vision::adaptation::AdaptationParams;
use vt_vision::color_likelihood::{ColorModality, ColorParams, ColorSearch, ColorSearchParams};
use vt_vision::template::{TemplateModality, TemplateParams};

use super::init::last_trusted;
use super::planar::{PlanarSpace, fit};
use crate::language::FilePath;
use crate::quantity::Span;
use crate::registry::Params;
use crate::roles::{Ground, ModalityContext, ModalityProduct, ReinitContext, ReinitProduct};

/// How what is known of the looks follows what is seen, in steps whose estimate is trusted.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Adapt {
    /// Time constant.
    pub time: Span,
    /// Share that stays as it was at the start, from 0 to 1.
    pub anchor: f64,
}

impl Adapt {
    fn params(self) -> AdaptationParams {
        AdaptationParams { time: self.time.si(), anchor: self.anchor }
    }
}

/// Parameters of the modality `color`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Color {
    /// Inverse temperature: the likelihood is `exp(−lambda D²)` with Bhattacharyya's distance.
    pub lambda: f64,
    /// Parts side by side.
    pub columns: u32,
    /// Parts one above the other.
    pub rows: u32,
    /// Outer radius, in radii of the object, of the ring whose colours count less; plain histograms when absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub background: Option<f64>,
    /// About how many pixels of a part are looked at.
    pub samples: usize,
    /// Share of the whole that every bin has without a pixel.
    pub floor: f64,
    /// How the colours follow what is seen; not at all when absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub adapt: Option<Adapt>,
    /// Picture of the object alone, which fills it; the object at the start when absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reference: Option<FilePath>,
}

impl Default for Color {
    fn default() -> Self {
        let ColorParams { lambda, columns, rows, background, samples, floor, .. } = ColorParams::default();
        Self { lambda, columns, rows, background, samples, floor, adapt: None, reference: None }
    }
}

impl Color {
    fn params(&self) -> Result<ColorParams, ConfigError> {
        let Self { lambda, columns, rows, background, samples, floor, .. } = *self;
        let adapt = self.adapt.map(Adapt::params);
        let params =
            ColorParams { lambda, columns, rows, background, samples, floor, adapt, ..Default::default() };
        params.check()
    }
}

impl Params for Color {
    fn check(&self) -> Result<(), ConfigError> {
        self.params().map(drop)
    }
    fn files(&self) -> Vec<(String, FilePath)> {
        self.reference.iter().map(|f| ("reference".to_owned(), f.clone())).collect()
    }
}

pub(super) fn color<P: PlanarSpace>(
    p: Color,
    context: ModalityContext<'_>,
) -> Result<ModalityProduct<P>, ConfigError>
where
    DefaultAllocator: Alloc<P::D>,
{
    let size = size(context.shape)?;
    let mut modality = ColorModality::new(p.params()?, context.sensor, PlanarWarp::<P>::default(), size)?;
    if let Some(file) = &p.reference {
        let (picture, pose) = reference(file, &context)?;
        modality = modality.with_reference(&picture, &P::of(&pose))?;
    }
    let processing = Box::new(modality.processing());
    Ok(ModalityProduct { modality: Box::new(modality), processing: vec![processing] })
}

/// Width and height of the rectangle about the origin that holds the shape.
pub(super) fn size(shape: &Ground) -> Result<[f64; 2], ConfigError> {
    let [low, high] = shape.outline()?.bounds();
    Ok([2.0 * high.x.max(-low.x), 2.0 * high.y.max(-low.y)])
}

/// A picture that the shape fills, and the pose at which it does.
pub(super) fn reference(
    file: &FilePath,
    context: &ModalityContext<'_>,
) -> Result<(RgbImage, Sim2), ConfigError> {
    let picture = vt_io::picture::read_rgb(&context.place.resolve(file))
        .map_err(|e| ConfigError::Mismatch { found: e.to_string(), expected: "a readable picture".into() })?;
    let (width, height) = picture.dimensions();
    let pose = fit(context.shape.outline()?, [0.0, 0.0, f64::from(width), f64::from(height)], true);
    Ok((picture, pose))
}

/// Parameters of the modality `template`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Template {
    /// Inverse temperature: the likelihood of no correlation is `e^-lambda`.
    pub lambda: f64,
    /// About how many points of the patch are compared.
    pub samples: usize,
    /// Least share of the points that must be in the picture; below it nothing correlates.
    pub least_inside: f64,
    /// Width of the smoothing of picture and template, as a deviation, in predicted deviations of the corners; 0 for none.
    pub smoothing: f64,
    /// How the template follows what is seen; not at all when absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub adapt: Option<Adapt>,
    /// Picture of the object alone, which fills it; the object at the start when absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reference: Option<FilePath>,
}

impl Default for Template {
    fn default() -> Self {
        let TemplateParams { lambda, samples, least_inside, smoothing, .. } = TemplateParams::default();
        Self { lambda, samples, least_inside, smoothing, adapt: None, reference: None }
    }
}

impl Template {
    fn params(&self) -> Result<TemplateParams, ConfigError> {
        let Self { lambda, samples, least_inside, smoothing, .. } = *self;
        TemplateParams { lambda, samples, least_inside, smoothing, adapt: self.adapt.map(Adapt::params) }
            .check()
    }
}

impl Params for Template {
    fn check(&self) -> Result<(), ConfigError> {
        self.params().map(drop)
    }
    fn files(&self) -> Vec<(String, FilePath)> {
        self.reference.iter().map(|f| ("reference".to_owned(), f.clone())).collect()
    }
}

pub(super) fn template<P: PlanarSpace>(
    p: Template,
    context: ModalityContext<'_>,
) -> Result<ModalityProduct<P>, ConfigError>
where
    DefaultAllocator: Alloc<P::D>,
{
    let warp = PlanarWarp::<P>::default();
    let mut modality = TemplateModality::new(p.params()?, context.sensor, warp, size(context.shape)?)?;
    if let Some(file) = &p.reference {
        let (picture, pose) = reference(file, &context)?;
        modality = modality.with_reference(&image::imageops::grayscale(&picture), &P::of(&pose))?;
    }
    Ok(ModalityProduct { modality: Box::new(modality), processing: vec![] })
}

/// Parameters of the re-initialiser `back-projection`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct BackProjection {
    /// Peaks that are tried at most.
    pub proposals: usize,
    /// Least contrast of a peak, from 0 to 1.
    pub least_contrast: f64,
    /// How the colours follow what is seen; not at all when absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub adapt: Option<Adapt>,
    /// Factor on the deviations of the last trusted pose, which is tried first; 0 leaves it out.
    pub last_trusted: f64,
}

impl Default for BackProjection {
    fn default() -> Self {
        let ColorSearchParams { proposals, least_contrast, .. } = ColorSearchParams::default();
        Self { proposals, least_contrast, adapt: None, last_trusted: 3.0 }
    }
}

impl BackProjection {
    fn params(&self) -> ColorSearchParams {
        let Self { proposals, least_contrast, adapt, .. } = *self;
        ColorSearchParams { proposals, least_contrast, adapt: adapt.map(Adapt::params), ..Default::default() }
    }
}

impl Params for BackProjection {
    fn check(&self) -> Result<(), ConfigError> {
        last_trusted(self.last_trusted)?;
        self.params().check().map(drop)
    }
}

pub(super) fn back_projection<P: PlanarSpace>(
    p: BackProjection,
    context: ReinitContext<'_, P>,
) -> Result<ReinitProduct<P>, ConfigError>
where
    DefaultAllocator: Alloc<P::D>,
{
    let search = ColorSearch::new(p.params(), context.body.sensor, size(context.body.shape)?)?;
    Ok(ReinitProduct::of_frames(match last_trusted(p.last_trusted)? {
        Some(factor) => search.with_last_trusted(factor),
        None => search,
    }))
}
