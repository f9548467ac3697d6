//! Colour pictures in grey and in hue, saturation and value.

use image::{GrayImage, RgbImage};
use vt_core::batch::vectorized;
use vt_core::error::MeasureError;
use vt_core::evidence::{EvidenceKey, Processing, Slot};
use vt_core::frame::{Frame, Payload, Roi, SensorId};

use crate::plane::{Plane, area, clip};

/// Adding this to a number below 2^22 leaves the nearest integer in the lowest bits of the sum.
const ROUND: f32 = 8_388_608.0;

/// Moves halves up, and no other quotient by an integer up to 6 · 255 across a half.
const HALVES_UP: f32 = 1.0 / 4096.0;

/// Steps of the full circle of hues.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum HueRange {
    /// 0 to 179, two degrees a step; OpenCV's `COLOR_RGB2HSV`.
    #[default]
    Half,
    /// 0 to 255; OpenCV's `COLOR_RGB2HSV_FULL`.
    Full,
}

impl HueRange {
    /// Number of steps.
    pub fn steps(self) -> u16 {
        match self {
            Self::Half => 180,
            Self::Full => 256,
        }
    }
}

/// Grey levels `0.299 R + 0.587 G + 0.114 B`, rounded to the nearest, halves up. `rgb` has three bytes for each of `grey`;
/// what has no partner is left alone.
pub fn rgb_to_grey(rgb: &[u8], grey: &mut [u8]) {
    vectorized(
        #[inline(always)]
        move || {
            for (p, out) in rgb.chunks_exact(3).zip(grey) {
                let sum = 299 * i32::from(p[0]) + 587 * i32::from(p[1]) + 114 * i32::from(p[2]);
                // A quarter of a thousandth moves halves up and nothing else across one.
                *out = (((sum as f32 + 0.25) * 1e-3) + ROUND).to_bits() as u8;
            }
        },
    );
}

/// Hue, saturation and value of a row of pixels: `V = max`, `S = 255 (max − min) / max`, `H` the angle in the colour hexagon,
/// each rounded to the nearest, halves up; black has S = 0, grey has H = 0. `rgb` has three bytes for each of the
/// others; what has no partner is left alone.
pub fn rgb_to_hsv(rgb: &[u8], range: HueRange, hue: &mut [u8], saturation: &mut [u8], value: &mut [u8]) {
    let steps = f32::from(range.steps());
    vectorized(
        #[inline(always)]
        move || {
            for (((p, h), s), v) in rgb.chunks_exact(3).zip(hue).zip(saturation).zip(value) {
                let (r, g, b) = (i32::from(p[0]), i32::from(p[1]), i32::from(p[2]));
                let max = r.max(g).max(b);
                let span = max - r.min(g).min(b);
                let (opposite, sextant) = if max == r {
                    (g - b, 0)
                } else if max == g {
                    (b - r, 2)
                } else {
                    (r - g, 4)
                };
                let turned = (opposite + sextant * span) as f32 * steps / (6 * span.max(1)) as f32;
                let angle = (turned + (steps + HALVES_UP) + ROUND).to_bits() as i32 & 0x3ff;
                let steps = steps as i32;
                *h = (if angle >= steps { angle - steps } else { angle }) as u8;
                let share = (255 * span) as f32 / max.max(1) as f32;
                *s = (share + HALVES_UP + ROUND).to_bits() as u8;
                *v = max as u8;
            }
        },
    );
}

/// A region of a picture in three planes.
#[derive(Clone, Debug, Default)]
pub struct Hsv {
    /// Hue in the steps of the range asked for; 0 for grey.
    pub hue: Plane<u8>,
    /// Saturation, 0 to 255.
    pub saturation: Plane<u8>,
    /// Value, 0 to 255.
    pub value: Plane<u8>,
}

impl Hsv {
    /// Converts `image` inside `roi`, or everywhere.
    pub fn compute(&mut self, image: &RgbImage, roi: Option<Roi>, range: HueRange) {
        let region = clip(roi, image.dimensions(), 0);
        let width = region.width as usize;
        let planes = [&mut self.hue, &mut self.saturation, &mut self.value].map(|p| {
            p.reserve(area(image.dimensions()));
            p.reshape(region)
        });
        if width == 0 {
            return;
        }
        let [hue, saturation, value] = planes.map(|p| p.chunks_exact_mut(width));
        for ((rgb, h), (s, v)) in rows(image, region).zip(hue).zip(saturation.zip(value)) {
            rgb_to_hsv(rgb, range, h, s, v);
        }
    }
}

/// Bytes of the rows of a region inside the picture.
pub(crate) fn rows(image: &RgbImage, region: Roi) -> impl Iterator<Item = &[u8]> {
    let (stride, start) = (3 * image.width() as usize, 3 * region.x as usize);
    let picture = image.as_raw();
    (region.y as usize..(region.y + region.height) as usize)
        .map(move |y| &picture[y * stride + start..][..3 * region.width as usize])
}

/// The grey picture of a frame: its own, or that of its colours, made in `buffer`.
///
/// # Errors
/// [`MeasureError::Payload`] for frames that are no picture.
pub fn grey_of<'a>(frame: &'a Frame, buffer: &'a mut GrayImage) -> Result<&'a GrayImage, MeasureError> {
    if matches!(frame.payload, Payload::Grey(_)) {
        return frame.grey();
    }
    copy_grey(frame, buffer)?;
    Ok(buffer)
}

/// Makes `copy` the grey picture of a frame.
///
/// # Errors
/// [`MeasureError::Payload`] for frames that are no picture.
pub fn copy_grey(frame: &Frame, copy: &mut GrayImage) -> Result<(), MeasureError> {
    let mut sized = |(width, height): (u32, u32)| {
        if copy.dimensions() != (width, height) {
            *copy = GrayImage::new(width, height);
        }
    };
    if let Payload::Rgb(image) = &frame.payload {
        sized(image.dimensions());
        rgb_to_grey(image.as_raw(), copy);
    } else {
        let image = frame.grey()?;
        sized(image.dimensions());
        copy.copy_from_slice(image);
    }
    Ok(())
}

/// Makes an [`Hsv`] of every colour frame of a sensor.
pub struct HsvProcessing {
    key: EvidenceKey,
    range: HueRange,
}

impl HsvProcessing {
    /// Hue, saturation and value of the pictures of `sensor`.
    pub fn new(sensor: SensorId, range: HueRange) -> Self {
        Self { key: Self::key_for(sensor, range), range }
    }

    /// Key under which the planes are found.
    pub fn key_for(sensor: SensorId, range: HueRange) -> EvidenceKey {
        EvidenceKey { sensor, name: format!("hsv/hue={}", range.steps()).into() }
    }
}

impl Processing for HsvProcessing {
    fn key(&self) -> &EvidenceKey {
        &self.key
    }

    fn run(&self, frame: &Frame, roi: Option<Roi>, slot: &mut Slot) -> Result<(), MeasureError> {
        slot.buffer::<Hsv>().compute(frame.rgb()?, roi, self.range);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `n / d` to the nearest integer, halves up, in whole numbers.
    fn nearest(n: i64, d: i64) -> i64 {
        (2 * n + d).div_euclid(2 * d)
    }

    fn colours() -> Vec<u8> {
        let levels = || (0..256).step_by(5).chain([1, 2, 3, 127, 253, 254]).map(|k| k as u8);
        levels().flat_map(|r| levels().flat_map(move |g| levels().flat_map(move |b| [r, g, b]))).collect()
    }

    #[test]
    fn grey_levels_are_the_nearest() {
        let rgb = colours();
        let mut grey = vec![0; rgb.len() / 3];
        rgb_to_grey(&rgb, &mut grey);
        for (p, g) in rgb.chunks_exact(3).zip(grey) {
            let sum: i64 = p.iter().zip([299, 587, 114]).map(|(&c, w)| i64::from(c) * w).sum();
            assert_eq!(i64::from(g), nearest(sum, 1000), "{p:?}");
        }
    }

    #[test]
    fn hue_saturation_and_value_are_the_nearest() {
        let rgb = colours();
        let n = rgb.len() / 3;
        for range in [HueRange::Half, HueRange::Full] {
            let (mut h, mut s, mut v) = (vec![0; n], vec![0; n], vec![0; n]);
            rgb_to_hsv(&rgb, range, &mut h, &mut s, &mut v);
            let steps = i64::from(range.steps());
            for (k, p) in rgb.chunks_exact(3).enumerate() {
                let [r, g, b] = [p[0], p[1], p[2]].map(i64::from);
                let (max, min) = (r.max(g).max(b), r.min(g).min(b));
                let (n, span) = if max == min {
                    (0, 1)
                } else if max == r {
                    (g - b, max - min)
                } else if max == g {
                    (b - r + 2 * (max - min), max - min)
                } else {
                    (r - g + 4 * (max - min), max - min)
                };
                let hue = nearest(n * steps, 6 * span).rem_euclid(steps);
                let saturation = if max == 0 { 0 } else { nearest(255 * (max - min), max) };
                assert_eq!([h[k], s[k], v[k]].map(i64::from), [hue, saturation, max], "{p:?}");
            }
        }
    }

    #[test]
    fn a_region_has_the_values_of_the_whole() {
        let image =
            RgbImage::from_fn(23, 11, |x, y| image::Rgb([7 * x as u8, 20 * y as u8, (3 * x * y) as u8]));
        let (mut whole, mut part) = (Hsv::default(), Hsv::default());
        whole.compute(&image, None, HueRange::Half);
        part.compute(&image, Some(Roi { x: 20, y: 3, width: 9, height: 2 }), HueRange::Half);
        assert_eq!(part.hue.region(), Roi { x: 20, y: 3, width: 3, height: 2 });
        for (x, y) in [(20, 3), (22, 4)] {
            assert_eq!(part.hue.get(x, y), whole.hue.get(x, y));
            assert_eq!(part.saturation.get(x, y), whole.saturation.get(x, y));
            assert_eq!(part.value.get(x, y), Some(image.get_pixel(x, y).0.into_iter().max().unwrap()));
        }
        part.compute(&image, Some(Roi { x: 23, y: 0, width: 1, height: 1 }), HueRange::Half);
        assert!(part.value.values().is_empty());
    }
}
