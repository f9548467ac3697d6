//! A window, the mass centre in it and the clutter about it.

use nalgebra::{Point2, Vector2};
use vt_core::frame::Roi;

use crate::moments::Moments;
use crate::plane::{Plane, intersection};

/// A rectangle with borders between pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window {
    /// Its middle, pixels.
    pub centre: Point2<f64>,
    /// Half of width and height, pixels.
    pub half: Vector2<f64>,
}

impl Window {
    /// The same about another point, `factor` times as large.
    #[must_use]
    pub fn about(self, centre: Point2<f64>, factor: f64) -> Self {
        Self { centre, half: self.half * factor }
    }

    /// Pixels whose centres lie in it, inside the picture as far as coordinates are not negative.
    pub fn pixels(&self) -> Roi {
        let edge = |v: f64| v.ceil().clamp(0.0, f64::from(u16::MAX)) as u32;
        let (low, high) = (self.centre - self.half, self.centre + self.half);
        let [x, y] = [low.x, low.y].map(edge);
        // The first pixel beyond.
        let [right, bottom] = [high.x, high.y].map(|v| edge(v.floor() + 1.0));
        Roi { x, y, width: right.saturating_sub(x), height: bottom.saturating_sub(y) }
    }

    /// Square pixels.
    pub fn area(&self) -> f64 {
        4.0 * self.half.x * self.half.y
    }
}

/// Mean place of the mass in a window, less what the ring around it leads to expect. `None` without mass beyond that.
pub(super) fn centre(plane: &Plane<u8>, window: &Window) -> Option<Point2<f64>> {
    let inner = intersection(plane.region(), window.pixels());
    let seen = Moments::of_plane(plane, inner);
    let area = f64::from(inner.width) * f64::from(inner.height);
    let (whole, taken) = (seen.mass() / 255.0, around(plane, window, inner) * area);
    let middle = Point2::new(
        f64::from(inner.x) + 0.5 * (f64::from(inner.width) - 1.0),
        f64::from(inner.y) + 0.5 * (f64::from(inner.height) - 1.0),
    );
    (whole > taken).then_some(middle + (seen.centroid()? - middle) * (whole / (whole - taken)))
}

/// Mean weight, 0 to 1, on that side of a window which has least: others stand on some sides, clutter on all.
pub(super) fn clutter(plane: &Plane<u8>, window: &Window) -> f64 {
    let Window { centre, half } = *window;
    let beside = |k: usize, sign: f64| {
        let mut side = Window { centre, half };
        side.half[k] *= 0.2;
        side.centre[k] += sign * (half[k] + side.half[k]);
        let part = intersection(plane.region(), side.pixels());
        let area = f64::from(part.width) * f64::from(part.height);
        (area > 0.0).then(|| Moments::of_plane(plane, part).mass() / (255.0 * area))
    };
    let sides = [(0, -1.0), (0, 1.0), (1, -1.0), (1, 1.0)];
    let least = sides.into_iter().filter_map(|(k, sign)| beside(k, sign)).fold(1.0, f64::min);
    if least < 1.0 { least } else { 0.0 }
}

/// Mean weight, 0 to 1, of the pixels of the ring around a window that has about its area; zero where there is none.
fn around(plane: &Plane<u8>, window: &Window, inner: Roi) -> f64 {
    let outer = intersection(plane.region(), window.about(window.centre, core::f64::consts::SQRT_2).pixels());
    let area = |r: Roi| f64::from(r.width) * f64::from(r.height);
    let ring = area(outer) - area(inner);
    let mass = |r| Moments::of_plane(plane, r).mass();
    if ring > 0.0 { ((mass(outer) - mass(inner)) / (255.0 * ring)).max(0.0) } else { 0.0 }
}
