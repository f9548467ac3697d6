//! Drawing on pictures: anti-aliased lines, discs, ellipses and text of a bitmap font.

use font8x8::UnicodeFonts;
use image::{GrayImage, Rgb, RgbImage};
use vt_core::math;

/// A colour picture that is drawn on. Coordinates are pixels with centres at integers.
pub struct Canvas {
    /// The picture.
    pub picture: RgbImage,
}

impl Canvas {
    /// A copy of a grey picture.
    pub fn of_grey(picture: &GrayImage) -> Self {
        let copy = RgbImage::from_fn(picture.width(), picture.height(), |x, y| {
            Rgb([picture.get_pixel(x, y).0[0]; 3])
        });
        Self { picture: copy }
    }

    /// A copy of a colour picture.
    pub fn of_rgb(picture: &RgbImage) -> Self {
        Self { picture: picture.clone() }
    }

    /// Mixes `colour` into a pixel; places outside are ignored.
    pub(crate) fn blend(&mut self, x: i64, y: i64, colour: [u8; 3], alpha: f64) {
        let (w, h) = self.picture.dimensions();
        if alpha <= 0.0 || x < 0 || y < 0 || x >= i64::from(w) || y >= i64::from(h) {
            return;
        }
        let pixel = self.picture.get_pixel_mut(x as u32, y as u32);
        for (p, c) in pixel.0.iter_mut().zip(colour) {
            *p = (f64::from(*p) + (f64::from(c) - f64::from(*p)) * alpha.min(1.0)).round() as u8;
        }
    }

    /// A line of `width` pixels with round ends; coverage of a pixel falls linearly over one pixel at the border.
    pub fn line(&mut self, from: [f64; 2], to: [f64; 2], width: f64, colour: [u8; 3], opacity: f64) {
        let Some((a, b)) = self.clipped(from, to, width) else { return };
        let d = [b[0] - a[0], b[1] - a[1]];
        let length2 = d[0] * d[0] + d[1] * d[1];
        let reach = 0.5 * width + 0.5;
        // Walk along the longer axis and look at the pixels across.
        let major = usize::from(d[1].abs() > d[0].abs());
        let (lo, hi) = (a[major].min(b[major]) - reach, a[major].max(b[major]) + reach);
        let slope = if d[major] == 0.0 { 0.0 } else { d[1 - major] / d[major] };
        for m in lo.floor() as i64..=hi.ceil() as i64 {
            let t = (m as f64).clamp(a[major].min(b[major]), a[major].max(b[major]));
            let middle = a[1 - major] + slope * (t - a[major]);
            let across = reach * 1.5 + 1.0;
            for n in (middle - across).floor() as i64..=(middle + across).ceil() as i64 {
                let p = if major == 0 { [m as f64, n as f64] } else { [n as f64, m as f64] };
                let v = [p[0] - a[0], p[1] - a[1]];
                let s =
                    if length2 > 0.0 { ((v[0] * d[0] + v[1] * d[1]) / length2).clamp(0.0, 1.0) } else { 0.0 };
                let e = [v[0] - s * d[0], v[1] - s * d[1]];
                let distance = (e[0] * e[0] + e[1] * e[1]).sqrt();
                self.blend(p[0] as i64, p[1] as i64, colour, opacity * (reach - distance));
            }
        }
    }

    /// The part of a segment that can touch the picture; `None` when there is none or a coordinate is not finite.
    fn clipped(&self, from: [f64; 2], to: [f64; 2], margin: f64) -> Option<([f64; 2], [f64; 2])> {
        if from.iter().chain(&to).any(|v| !v.is_finite()) {
            return None;
        }
        let size = [f64::from(self.picture.width()), f64::from(self.picture.height())];
        let (mut t0, mut t1) = (0.0_f64, 1.0_f64);
        for k in 0..2 {
            let (lo, hi) = (-margin - 1.0, size[k] + margin);
            let d = to[k] - from[k];
            if d == 0.0 {
                if from[k] < lo || from[k] > hi {
                    return None;
                }
                continue;
            }
            let (u, v) = ((lo - from[k]) / d, (hi - from[k]) / d);
            t0 = t0.max(u.min(v));
            t1 = t1.min(u.max(v));
        }
        let at = |t: f64| [from[0] + t * (to[0] - from[0]), from[1] + t * (to[1] - from[1])];
        (t0 <= t1).then(|| (at(t0), at(t1)))
    }

    /// A filled disc.
    pub fn disc(&mut self, at: [f64; 2], radius: f64, colour: [u8; 3], opacity: f64) {
        self.line(at, at, 2.0 * radius, colour, opacity);
    }

    /// The ellipse `{c + S u : |u| = 1}` with `S` the symmetric root of `[xx, xy, yy]`, as a line.
    pub fn ellipse(&mut self, center: [f64; 2], shape: [f64; 3], width: f64, colour: [u8; 3], opacity: f64) {
        let [xx, xy, yy] = shape;
        // Root of a symmetric 2x2 matrix: (M + √det I) / √(tr + 2 √det).
        let det = (xx * yy - xy * xy).max(0.0).sqrt();
        let trace = (xx + yy + 2.0 * det).sqrt();
        if !(trace > 0.0 && trace.is_finite()) {
            return;
        }
        let s = [(xx + det) / trace, xy / trace, (yy + det) / trace];
        let point = |k: usize| {
            let (sin, cos) = math::sin_cos(k as f64 * core::f64::consts::TAU / 64.0);
            [center[0] + s[0] * cos + s[1] * sin, center[1] + s[1] * cos + s[2] * sin]
        };
        for k in 0..64 {
            self.line(point(k), point(k + 1), width, colour, opacity);
        }
    }

    /// A filled rectangle with its top left corner at a pixel.
    pub fn bar(&mut self, x: i64, y: i64, width: i64, height: i64, colour: [u8; 3], opacity: f64) {
        for py in y..y + height {
            for px in x..x + width {
                self.blend(px, py, colour, opacity);
            }
        }
    }

    /// Text in letters of 8 × 8 pixels, the first with its top left corner at a pixel. Letters that the font does not
    /// have are shown as `?`. Returns the column after the text.
    pub fn text(&mut self, x: i64, y: i64, text: &str, colour: [u8; 3]) -> i64 {
        let mut column = x;
        for c in text.chars() {
            let glyph = font8x8::BASIC_FONTS.get(c).or_else(|| font8x8::LATIN_FONTS.get(c));
            let glyph = glyph.or_else(|| font8x8::BASIC_FONTS.get('?')).unwrap_or([0; 8]);
            for (row, bits) in glyph.iter().enumerate() {
                for bit in 0..8 {
                    if bits >> bit & 1 == 1 {
                        self.blend(column + bit, y + row as i64, colour, 1.0);
                    }
                }
            }
            column += 8;
        }
        column
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn black(w: u32, h: u32) -> Canvas {
        Canvas { picture: RgbImage::new(w, h) }
    }

    #[test]
    fn a_line_has_the_ink_of_its_area_and_its_centre_where_it_should() {
        let mut c = black(40, 40);
        c.line([5.3, 7.1], [30.8, 22.6], 2.0, [255; 3], 1.0);
        let (mut ink, mut mx, mut my) = (0.0, 0.0, 0.0);
        for (x, y, p) in c.picture.enumerate_pixels() {
            let v = f64::from(p.0[0]) / 255.0;
            ink += v;
            mx += v * f64::from(x);
            my += v * f64::from(y);
        }
        let length = (25.5_f64 * 25.5 + 15.5 * 15.5).sqrt();
        let area = 2.0 * length + core::f64::consts::PI;
        assert!((ink - area).abs() < 0.05 * area, "{ink} {area}");
        assert!((mx / ink - 18.05).abs() < 0.1 && (my / ink - 14.85).abs() < 0.1);
    }

    #[test]
    fn drawing_far_outside_or_at_nowhere_changes_nothing() {
        let mut c = black(10, 10);
        c.line([-1e9, -1e9], [-5e8, 3.0], 1.0, [255; 3], 1.0);
        c.line([f64::NAN, 0.0], [5.0, 5.0], 1.0, [255; 3], 1.0);
        c.disc([50.0, 50.0], 3.0, [255; 3], 1.0);
        c.text(-100, 4, "hello", [255; 3]);
        c.ellipse([5.0, 5.0], [f64::INFINITY, 0.0, 1.0], 1.0, [255; 3], 1.0);
        assert!(c.picture.pixels().all(|p| p.0 == [0; 3]));
        c.line([-1e12, 5.0], [1e12, 5.0], 1.0, [255; 3], 1.0);
        assert_eq!((0..10).map(|x| c.picture.get_pixel(x, 5).0[0]).collect::<Vec<_>>(), [255; 10]);
    }

    #[test]
    fn an_ellipse_passes_through_its_axes() {
        let mut c = black(60, 60);
        c.ellipse([30.0, 30.0], [400.0, 0.0, 100.0], 1.0, [255; 3], 1.0);
        for (x, y) in [(50, 30), (10, 30), (30, 40), (30, 20)] {
            assert!(c.picture.get_pixel(x, y).0[0] > 200, "{x} {y}");
        }
        assert_eq!(c.picture.get_pixel(30, 30).0[0], 0);
    }
}
