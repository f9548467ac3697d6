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

    /// About `count` places at equal distances all over it, by rows.
    pub fn lattice(&self, count: usize) -> Vec<Point2<f64>> {
        let [x, y] = self.half;
        let across = (count as f64 * x / y).sqrt().round().clamp(2.0, count as f64 / 2.0);
        let down = (count as f64 / across).round().max(2.0);
        let place = |k: usize, n: f64, half: f64| half * ((2 * k + 1) as f64 / n - 1.0);
        let row =
            |j: usize| (0..across as usize).map(move |i| Point2::new(place(i, across, x), place(j, down, y)));
        (0..down as usize).flat_map(row).collect()
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
