//! Flat shapes.

use nalgebra::Point2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use vt_core::error::ConfigError;
use vt_models::outline::Outline;

use super::shape::PartFile;
use crate::geometry::{CameraSection, PoseText};
use crate::language::FilePath;
use crate::quantity::Pixels;
use crate::registry::Params;
use crate::roles::{Ground, Place};

/// Parameters of the shapes `rectangle` and `ellipse`, about the origin.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Extent {
    /// Width and height.
    pub size: [Pixels; 2],
}

impl Params for Extent {
    fn check(&self) -> Result<(), ConfigError> {
        match self.size.iter().find(|s| s.si() <= 0.0) {
            Some(side) => Err(ConfigError::parameter("size", side, "a positive number of pixels")),
            None => Ok(()),
        }
    }
}

/// Parameters of the shapes `polygon` and `spline`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Corners {
    /// Corners or control points in order.
    pub points: Vec<[Pixels; 2]>,
}

impl Params for Corners {
    fn check(&self) -> Result<(), ConfigError> {
        if !(3..=MOST_CORNERS).contains(&self.points.len()) {
            let expected = format!("3 to {MOST_CORNERS} points");
            return Err(ConfigError::parameter("points", self.points.len(), expected));
        }
        Ok(())
    }
}

/// More corners than this are refused.
const MOST_CORNERS: usize = 10_000;

impl Corners {
    fn points(&self) -> Vec<Point2<f64>> {
        self.points.iter().map(|p| Point2::new(p[0].si(), p[1].si())).collect()
    }
}

/// Parameters of the shape `svg`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SvgPath {
    /// Path data, as in the attribute `d` of an SVG file; one unit is a pixel.
    pub path: String,
    /// Width of the shape; that of the path when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub width: Option<Pixels>,
}

impl Params for SvgPath {
    fn check(&self) -> Result<(), ConfigError> {
        Outline::from_svg(&self.path).map(drop)?;
        width(self.width)
    }
}

/// Parameters of the shape `silhouette`: the outline of a body in space, about its centre of area.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Silhouette {
    /// The body.
    pub mesh: PartFile,
    /// Camera that sees it.
    pub camera: CameraSection,
    /// Where the body is seen from.
    pub camera_from_object: PoseText,
    /// Width of the shape; that in the camera's picture when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub width: Option<Pixels>,
}

impl Params for Silhouette {
    fn check(&self) -> Result<(), ConfigError> {
        self.camera.camera().map(drop)?;
        self.camera_from_object.pose().map(drop)?;
        width(self.width)
    }
    fn files(&self) -> Vec<(String, FilePath)> {
        vec![("mesh.file".into(), self.mesh.file.clone())]
    }
}

fn width(width: Option<Pixels>) -> Result<(), ConfigError> {
    match width.filter(|w| w.si() <= 0.0) {
        Some(w) => Err(ConfigError::parameter("width", w, "a positive number of pixels")),
        None => Ok(()),
    }
}

/// The shape about its centre of area, scaled to `width`.
fn sized(outline: &Outline, width: Option<Pixels>) -> Result<Ground, ConfigError> {
    let centred = outline.centred();
    let [low, high] = centred.bounds();
    Ok(Ground::Flat(match width {
        Some(width) => centred.scaled(width.si() / (high.x - low.x))?,
        None => centred,
    }))
}

pub(super) fn rectangle(p: Extent, _: Place<'_>) -> Result<Ground, ConfigError> {
    Ok(Ground::Flat(Outline::rectangle(p.size[0].si(), p.size[1].si())?))
}

pub(super) fn ellipse(p: Extent, _: Place<'_>) -> Result<Ground, ConfigError> {
    Ok(Ground::Flat(Outline::ellipse(p.size[0].si(), p.size[1].si())?))
}

pub(super) fn polygon(p: Corners, _: Place<'_>) -> Result<Ground, ConfigError> {
    Ok(Ground::Flat(Outline::polygon(p.points())?))
}

pub(super) fn spline(p: Corners, _: Place<'_>) -> Result<Ground, ConfigError> {
    Ok(Ground::Flat(Outline::spline(&p.points())?))
}

pub(super) fn svg(p: SvgPath, _: Place<'_>) -> Result<Ground, ConfigError> {
    sized(&Outline::from_svg(&p.path)?, p.width)
}

pub(super) fn silhouette(p: Silhouette, place: Place<'_>) -> Result<Ground, ConfigError> {
    let mesh = super::shape::load(&place.resolve(&p.mesh.file), p.mesh.unit)?;
    sized(&Outline::silhouette(&mesh, &p.camera.camera()?, &p.camera_from_object.pose()?)?, p.width)
}
