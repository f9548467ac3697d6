//! What a window sees of a mass.

use nalgebra::{Matrix2, Point2, SymmetricEigen, Vector2};
use vt_core::frame::Roi;

use crate::moments::Moments;
use crate::plane::{Plane, intersection};

/// Steps of the window at most, and the step below which it stays.
const STEPS: usize = 10;
const STILL: f64 = 0.05;

/// Part of the clutter that is not the same inside and outside of the window.
const UNEVEN: f64 = 0.2;

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

    /// Covariance of places anywhere in it.
    pub fn spread(&self) -> Matrix2<f64> {
        Matrix2::from_diagonal(&self.half.map(|h| h * h / 3.0))
    }
}

/// The mass in a window, less the clutter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sight {
    /// Mean place of the mass.
    pub centre: Point2<f64>,
    /// Pixels of full weight, less those that the ring around it leads to expect.
    pub mass: f64,
    /// Weight of a pixel of the ring, 0 to 1.
    pub clutter: f64,
    /// Covariance of the places of the mass about their mean.
    pub spread: Matrix2<f64>,
    /// Covariance of the mean if pixels had independent errors as large as their weights.
    pub noise: Matrix2<f64>,
}

impl Sight {
    /// What a fixed window sees. `None` without mass beyond clutter.
    pub fn at(plane: &Plane<u8>, window: &Window) -> Option<Self> {
        let inner = intersection(plane.region(), window.pixels());
        let clutter = clutter(plane, window, inner);
        let (mass, centre) = less_clutter(plane, inner, clutter)?;
        let (mut noise, mut spread) = (Matrix2::zeros(), Matrix2::zeros());
        for y in inner.y..inner.y + inner.height {
            for (x, &w) in (inner.x..).zip(plane.row(y, inner)) {
                let w = f64::from(w) / 255.0 - clutter;
                let d = Vector2::new(f64::from(x) - centre.x, f64::from(y) - centre.y);
                let square = d * d.transpose();
                spread += square * w;
                noise += square * (w * w);
            }
        }
        Some(Self { centre, mass, clutter, spread: spread / mass, noise: noise / (mass * mass) })
    }

    /// Slides a window from `window` to where its centre is that of the mass in it. Where less than `least` lies in it at first, the first
    /// step looks at all of `wide`. `None` without mass beyond clutter.
    pub fn slide(plane: &Plane<u8>, window: &Window, wide: &Window, least: f64) -> Option<Self> {
        let near = Self::at(plane, window).is_some_and(|s| s.mass >= least);
        let mut looked = if near { *window } else { *wide };
        for _ in 0..STEPS {
            let inner = intersection(plane.region(), looked.pixels());
            let (_, centre) = less_clutter(plane, inner, clutter(plane, &looked, inner))?;
            let step = (centre - looked.centre).norm();
            looked = window.about(centre, 1.0);
            if step < STILL {
                break;
            }
        }
        Self::at(plane, &looked)
    }

    /// Share of a box full of weight 255 that the mass is.
    pub fn share(&self, object: &Window) -> f64 {
        self.mass / object.area()
    }

    /// Covariance of the mass centre of an object with the box `object`, as the sum of what errs independently:
    ///
    /// - pixels, in patches of `patch` square pixels: `patch · Σ w² d dᵀ / (Σ w)²`;
    /// - the object, whose mass is not where it was: `wobble` times its size;
    /// - what is missing of the expected mass, `share` of the box: a part `m` of it that may be anywhere in the box: `m²` of the box's spread;
    /// - clutter, which is not the same all over: with `q` times the mass, `(q / 5)²` of the box's spread;
    /// - what is too much. A share `ε` of strange mass at the distance `d` adds `ε (1 − ε) d dᵀ` to the spread and moves the centre by `ε d`; with
    ///   ε = ½ that is as much. So all of the spread beyond that of the box counts.
    pub fn covariance(&self, object: &Window, share: f64, patch: f64, wobble: f64) -> Matrix2<f64> {
        let missing = (1.0 - self.share(object) / share).max(0.0);
        let clutter = UNEVEN * self.clutter * object.area() / self.mass;
        let box_spread = object.spread();
        let swing = Matrix2::from_diagonal(&object.half.map(|h| (2.0 * wobble * h).powi(2)));
        let mut too_much = SymmetricEigen::new(self.spread - box_spread);
        too_much.eigenvalues.apply(|v| *v = v.max(0.0));
        self.noise * patch
            + swing
            + box_spread * (missing * missing + clutter * clutter)
            + too_much.recompose()
    }
}

/// Mean weight, 0 to 1, of the pixels of the ring around a window that has about its area; zero where there is none.
fn clutter(plane: &Plane<u8>, window: &Window, inner: Roi) -> f64 {
    let outer = intersection(plane.region(), window.about(window.centre, core::f64::consts::SQRT_2).pixels());
    let area = |r: Roi| f64::from(r.width) * f64::from(r.height);
    let ring = area(outer) - area(inner);
    let mass = |r| Moments::of_plane(plane, r).mass();
    if ring > 0.0 { ((mass(outer) - mass(inner)) / (255.0 * ring)).max(0.0) } else { 0.0 }
}

/// Mass and centre of the pixels of a region when each has `clutter` less; `None` without mass.
fn less_clutter(plane: &Plane<u8>, region: Roi, clutter: f64) -> Option<(f64, Point2<f64>)> {
    let seen = Moments::of_plane(plane, region);
    let area = f64::from(region.width) * f64::from(region.height);
    let middle = Point2::new(
        f64::from(region.x) + 0.5 * (f64::from(region.width) - 1.0),
        f64::from(region.y) + 0.5 * (f64::from(region.height) - 1.0),
    );
    let (whole, taken) = (seen.mass() / 255.0, clutter * area);
    let mass = whole - taken;
    if mass <= 0.0 {
        return None;
    }
    let from_middle = seen.centroid()? - middle;
    Some((mass, middle + from_middle * (whole / mass)))
}
