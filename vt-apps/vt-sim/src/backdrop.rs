//! What is behind all bodies: a picture that stands still.

use std::sync::Arc;

use image::imageops::{FilterType, resize};
use image::{RgbImage, imageops::crop_imm};
use vt_core::math;
use vt_core::random::{Random, Stream};

use crate::texture::{Colour, tinted, uniform};

/// What is behind all bodies.
#[derive(Clone, Debug, PartialEq)]
pub enum Background {
    /// One brightness everywhere.
    Plain(f32),
    /// Smooth random brightness with turned rectangles and discs in front.
    Clutter(Clutter),
    /// A picture, scaled so that it fills the view and cropped in the middle.
    Picture(Arc<RgbImage>),
}

/// Random rectangles and discs before smooth random brightness.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clutter {
    /// Mean size of the shapes in pixels.
    pub size: f64,
    /// Shapes by area: their number times `size²` in parts of the picture. 0 is none, 1 covers about half.
    pub density: f64,
    /// Mean brightness, 0 to 1.
    pub brightness: f32,
    /// Range of brightness, 0 to 1.
    pub contrast: f32,
}

/// More shapes than this are not drawn.
const MOST: f64 = 100_000.0;

impl Background {
    /// The picture by rows.
    pub(crate) fn paint(&self, seed: u64, width: u32, height: u32) -> Vec<Colour> {
        let count = width as usize * height as usize;
        match self {
            Self::Plain(brightness) => vec![[*brightness; 3]; count],
            Self::Clutter(clutter) => clutter.paint(seed, width, height),
            Self::Picture(picture) if picture.width() == 0 || picture.height() == 0 => vec![[0.0; 3]; count],
            Self::Picture(picture) => {
                // The widest part of the picture that has the shape of the view.
                let (w, h) = (u64::from(picture.width()), u64::from(picture.height()));
                let (vw, vh) = (u64::from(width), u64::from(height));
                let (w, h) =
                    if w * vh > h * vw { ((h * vw / vh).max(1), h) } else { (w, (w * vh / vw).max(1)) };
                let (w, h) = (w as u32, h as u32);
                let part =
                    crop_imm(picture.as_ref(), (picture.width() - w) / 2, (picture.height() - h) / 2, w, h);
                let scaled = resize(&part.to_image(), width, height, FilterType::Triangle);
                scaled.pixels().map(|p| p.0.map(|v| f32::from(v) / 255.0)).collect()
            }
        }
    }
}

impl Clutter {
    fn paint(&self, seed: u64, width: u32, height: u32) -> Vec<Colour> {
        let columns = width as usize;
        let mut out: Vec<Colour> = (0..columns * height as usize)
            .map(|k| [self.smooth(seed, (k % columns) as f64, (k / columns) as f64); 3])
            .collect();
        let mut random = Random::new(seed, Stream::Sim, 1, 0, 0);
        let [w, h] = [width, height].map(f64::from);
        let count = (self.density * w * h / (self.size * self.size)).clamp(0.0, MOST) as usize;
        for _ in 0..count {
            let center = [random.uniform() * w, random.uniform() * h];
            let half = [0; 2].map(|_| self.size * (0.2 + 0.6 * random.uniform()));
            let (sin, cos) = math::sin_cos(core::f64::consts::TAU * random.uniform());
            let disc = random.uniform() < 0.25;
            let hue = [0; 3].map(|_| random.uniform() as f32);
            let colour = tinted(self.brightness + self.contrast * (random.uniform() as f32 - 0.5), &hue);
            let reach = if disc { half[0] } else { half[0] + half[1] } + 1.0;
            let range = |c: f64, n: u32| {
                (c - reach).floor().max(0.0) as usize..(c + reach).ceil().min(f64::from(n)) as usize
            };
            for y in range(center[1], height) {
                for x in range(center[0], width) {
                    let d = [x as f64 - center[0], y as f64 - center[1]];
                    // Share of the pixel, as if the border were straight within it.
                    let cover = if disc {
                        (half[0] - (d[0] * d[0] + d[1] * d[1]).sqrt() + 0.5).clamp(0.0, 1.0)
                    } else {
                        let along = [cos * d[0] + sin * d[1], cos * d[1] - sin * d[0]];
                        [0, 1].map(|k| (half[k] - along[k].abs() + 0.5).clamp(0.0, 1.0)).iter().product()
                    } as f32;
                    let pixel = &mut out[y * columns + x];
                    *pixel = [0, 1, 2].map(|k| pixel[k] + cover * (colour[k] - pixel[k]));
                }
            }
        }
        out
    }

    /// Bilinear interpolation of random numbers at the nodes of a grid.
    fn smooth(&self, seed: u64, x: f64, y: f64) -> f32 {
        let (gx, gy) = (x / (4.0 * self.size), y / (4.0 * self.size));
        let (ix, iy) = (gx.floor(), gy.floor());
        let (fx, fy) = ((gx - ix) as f32, (gy - iy) as f32);
        let node = |dx: i64, dy: i64| uniform(seed, [-1, ix as i64 + dx, iy as i64 + dy])[0];
        let top = node(0, 0) * (1.0 - fx) + node(1, 0) * fx;
        let bottom = node(0, 1) * (1.0 - fx) + node(1, 1) * fx;
        (self.brightness + self.contrast * (top * (1.0 - fy) + bottom * fy - 0.5)).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clutter(density: f64) -> Vec<Colour> {
        let c = Clutter { size: 20.0, density, brightness: 0.5, contrast: 0.6 };
        Background::Clutter(c).paint(3, 160, 120)
    }

    /// Share of neighbours that differ clearly.
    fn edges(picture: &[Colour]) -> f64 {
        let differ = picture.windows(2).filter(|w| (w[0][1] - w[1][1]).abs() > 0.05).count();
        differ as f64 / picture.len() as f64
    }

    #[test]
    fn density_makes_clutter() {
        let shares = [0.0, 0.5, 2.0].map(|d| edges(&clutter(d)));
        assert!(
            shares[0] < 0.01 && shares[1] > shares[0] + 0.01 && shares[2] > 1.5 * shares[1],
            "{shares:?}"
        );
        assert_eq!(clutter(1.0), clutter(1.0));
    }

    #[test]
    fn a_picture_fills_the_view_from_its_middle() {
        // Left third red, middle third green, right third blue; the view shows the middle third.
        let stripes = RgbImage::from_fn(30, 10, |x, _| {
            let mut p = [0; 3];
            p[x as usize / 10] = 255;
            image::Rgb(p)
        });
        let view = Background::Picture(Arc::new(stripes)).paint(0, 40, 40);
        assert!(view.iter().all(|c| c[1] > 0.99 && c[0] < 0.01), "green alone");
    }
}
