//! Outlines drawn with other programs.

use kurbo::{BezPath, ParamCurve, PathSeg};
use nalgebra::Point2;
use vt_core::error::ConfigError;

use super::Outline;

/// Straight pieces of a Bézier curve.
const PIECES: usize = 32;

impl Outline {
    /// The shape of SVG path data (the attribute `d`); open subpaths are closed.
    ///
    /// # Errors
    /// Where the data is no path or a subpath encloses no area.
    pub fn from_svg(path: &str) -> Result<Self, ConfigError> {
        let path = BezPath::from_svg(path)
            .map_err(|e| ConfigError::parameter("path", e, "SVG path data, such as `M0,0 H10 V5 Z`"))?;
        let mut loops: Vec<Vec<Point2<f64>>> = vec![];
        for segment in path.segments() {
            let pieces = if matches!(segment, PathSeg::Line(_)) { 1 } else { PIECES };
            let point = |k: usize| {
                let p = segment.eval(k as f64 / pieces as f64);
                Point2::new(p.x, p.y)
            };
            // A segment that does not start where the last one ended opens a new subpath.
            if loops.last().and_then(|l| l.last()) != Some(&point(0)) {
                loops.push(vec![point(0)]);
            }
            loops.iter_mut().next_back().into_iter().for_each(|l| l.extend((1..=pieces).map(point)));
        }
        Self::new(loops)
    }
}
