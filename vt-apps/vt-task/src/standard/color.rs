//! The modality `color`: histograms of hue, saturation and value under a kernel that is warped with the object.

use nalgebra::DefaultAllocator;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use vt_core::error::ConfigError;
use vt_core::lie::Sim2;
use vt_core::manifold::Alloc;
use vt_models::warp::PlanarWarp;
use vt_vision::color_likelihood::{ColorModality, ColorParams};

use super::planar::{PlanarSpace, fit};
use crate::language::FilePath;
use crate::registry::Params;
use crate::roles::{ModalityContext, ModalityProduct};

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
    /// Picture of the object alone, which fills it; the object at the start when absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reference: Option<FilePath>,
}

impl Default for Color {
    fn default() -> Self {
        let ColorParams { lambda, columns, rows, background, samples, floor, .. } = ColorParams::default();
        Self { lambda, columns, rows, background, samples, floor, reference: None }
    }
}

impl Color {
    fn params(&self) -> Result<ColorParams, ConfigError> {
        let Self { lambda, columns, rows, background, samples, floor, .. } = *self;
        let params = ColorParams { lambda, columns, rows, background, samples, floor, ..Default::default() };
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
    let outline = context.shape.outline()?;
    // The object's rectangle is about the origin.
    let [low, high] = outline.bounds();
    let size = [2.0 * high.x.max(-low.x), 2.0 * high.y.max(-low.y)];
    let mut modality = ColorModality::new(p.params()?, context.sensor, PlanarWarp::<P>::default(), size)?;
    if let Some(file) = &p.reference {
        let path = context.place.resolve(file);
        let picture = vt_io::picture::read_rgb(&path).map_err(|e| ConfigError::Mismatch {
            found: e.to_string(),
            expected: "a readable picture".into(),
        })?;
        let (width, height) = picture.dimensions();
        let pose: Sim2 = fit(outline, [0.0, 0.0, f64::from(width), f64::from(height)], true);
        modality = modality.with_reference(&picture, &P::of(&pose))?;
    }
    let processing = Box::new(modality.processing());
    Ok(ModalityProduct { modality: Box::new(modality), processing: vec![processing] })
}
