//! Dead leaves: opaque polygons on top of each other.

use core::f64::consts::TAU;

use nalgebra::Point2;
use vt_core::math;
use vt_core::random::{Random, Stream};

use super::Settings;
use super::polygon::{self, Brush};
use crate::texture::Colour;

/// Grey levels of the background.
pub(super) const LEVELS: usize = 4;

/// Light of a plain shape and of the darkest level of the background.
pub(super) const BRIGHT: f32 = 225.0 / 255.0;
const DARK: f64 = 30.0 / 255.0;

/// Corners that leaves have.
const CORNERS: [u32; 5] = [3, 4, 5, 6, 16];

/// How often a place is covered in the mean.
const LAYERS: f64 = 10.0;

/// Saturation of the background's colours at most.
const WEAK: f64 = 0.12;

/// Levels from dark to bright, the brightest below a plain shape by `contrast` of 255.
pub(super) fn levels(contrast: f64) -> [f64; LEVELS] {
    let bright = f64::from(BRIGHT) - contrast / 255.0;
    core::array::from_fn(|k| DARK + (bright - DARK) * k as f64 / (LEVELS - 1) as f64)
}

/// A grey level with a tint: hue in turns and strength 0 to 1.
pub(super) fn tinted(level: f64, hue: f64, strength: f64) -> Colour {
    let chroma = [0.0, 1.0, 2.0].map(|k| math::cos(TAU * (hue - k / 3.0)));
    let luma = 0.2126 * chroma[0] + 0.7152 * chroma[1] + 0.0722 * chroma[2];
    chroma.map(|c| (level + strength * (c - luma)).clamp(0.0, 1.0) as f32)
}

/// Mean radius of leaves that give `density` edges per pixel of a line.
///
/// Boundaries are `E[L] / E[A]` long per area: each new leaf adds `L`, and each of its points is covered at the rate of
/// `A`. A line crosses `2/π` times as many per length, and one in [`LEVELS`] has the same level on both sides.
/// Radii are uniform from half to one and a half of the mean.
fn radius(density: f64) -> (f64, f64) {
    let n = CORNERS.len() as f64;
    let of = |f: fn(f64) -> f64| CORNERS.iter().map(|c| f(f64::from(*c))).sum::<f64>() / n;
    let length = of(|c| 2.0 * c * math::sin(0.5 * TAU / c));
    let area = 13.0 / 12.0 * of(|c| 0.5 * c * math::sin(TAU / c));
    let seen = 1.0 - 1.0 / LEVELS as f64;
    let radius = 4.0 / TAU * seen * length / (area * density);
    (radius, area * radius * radius)
}

/// A picture of leaves; those of other layers are independent.
pub(super) fn dead_leaves([w, h]: [usize; 2], s: &Settings, layer: u64) -> Vec<Colour> {
    let levels = levels(s.contrast);
    let colour = |random: &mut Random| {
        let level = levels[random.index(LEVELS)];
        if s.colour { tinted(level, random.uniform(), WEAK * random.uniform()) } else { [level as f32; 3] }
    };
    let random = &mut Random::new(s.seed, Stream::Sim, (6 << 32) + layer, 0, 0);
    let mut out = vec![colour(random); w * h];
    if s.clutter <= 0.0 {
        return out;
    }
    let (radius, area) = radius(s.clutter);
    let reach = 1.5 * radius;
    let (width, height) = (w as f64 + 2.0 * reach, h as f64 + 2.0 * reach);
    let count = (LAYERS * width * height / area).ceil() as u64;
    let (mut brush, mut leaf_corners) = (Brush::default(), vec![]);
    for _ in 0..count {
        let (x, y) = (width * random.uniform() - reach, height * random.uniform() - reach);
        let size = radius * (0.5 + random.uniform());
        let corners = CORNERS[random.index(CORNERS.len())];
        let turn = random.uniform();
        let corner = |k: u32| {
            let angle = TAU * (turn + f64::from(k) / f64::from(corners));
            Point2::new(x + size * math::cos(angle), y + size * math::sin(angle))
        };
        let leaf = colour(random);
        leaf_corners.clear();
        leaf_corners.extend((0..corners).map(corner));
        brush.fill(&[&leaf_corners], [w, h], |x, y, share| {
            polygon::blend(&mut out[y * w + x], &leaf, share);
        });
    }
    out
}
