//! Targets known by a rectangle about the origin of their plane.

use nalgebra::{DefaultAllocator, Point2};
use vt_core::agent::{Posed, Warp};
use vt_core::error::ConfigError;
use vt_core::lie::PlanarMotion;
use vt_core::manifold::Alloc;
use vt_core::sketch::{Mark, Role};
use vt_models::warp::PlanarWarp;

/// A rectangle of a checked size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Rectangle {
    /// Half of width and height.
    half: [f64; 2],
}

impl Rectangle {
    /// # Errors
    /// Where a side is not positive.
    pub fn new([width, height]: [f64; 2]) -> Result<Self, ConfigError> {
        if width > 0.0 && height > 0.0 && width.is_finite() && height.is_finite() {
            return Ok(Self { half: [0.5 * width, 0.5 * height] });
        }
        Err(ConfigError::parameter("size", format!("{width} x {height}"), "positive and finite"))
    }

    pub fn corners(&self) -> [Point2<f64>; 4] {
        let [x, y] = self.half;
        [[-x, -y], [x, -y], [x, y], [-x, y]].map(Point2::from)
    }

    /// Draws its sides.
    pub fn sketch<P: PlanarMotion>(&self, warp: &PlanarWarp<P>, pose: &P, out: &mut Vec<Mark>)
    where
        DefaultAllocator: Alloc<P::D>,
    {
        let posed = warp.at(pose);
        let corners = self.corners().map(|corner| posed.locate(&corner));
        for k in 0..4 {
            if let (Some(from), Some(to)) = (corners[k], corners[(k + 1) % 4]) {
                out.push(Mark::Segment { from: from.into(), to: to.into(), role: Role::Model });
            }
        }
    }
}
