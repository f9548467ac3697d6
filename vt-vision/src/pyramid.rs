//! Image pyramid: every level halves the one before by averaging blocks of 2 × 2 pixels, so that pixel centres map
//! by `x_l = (x_0 + 0.5) / 2^l − 0.5`.

use image::GrayImage;
use vt_core::error::MeasureError;
use vt_core::evidence::{EvidenceKey, Processing, Slot};
use vt_core::frame::{Frame, Roi, SensorId};

/// Levels above the full picture: `levels[0]` has half its size.
#[derive(Clone, Debug, Default)]
pub struct Pyramid {
    /// Halved pictures, finest first; shorter than asked for where the picture is too small.
    pub levels: Vec<GrayImage>,
}

impl Pyramid {
    /// Computes `count` levels above `image`; an odd last row or column is left out.
    pub fn compute(&mut self, image: &GrayImage, count: usize) {
        self.levels.truncate(count);
        for level in 0..count {
            let (finer, rest) = self.levels.split_at_mut(level);
            let source = finer.last().unwrap_or(image);
            let size = (source.width() / 2, source.height() / 2);
            if size.0 < 8 || size.1 < 8 {
                self.levels.truncate(level);
                return;
            }
            match rest.first_mut() {
                Some(target) if target.dimensions() == size => halve(source, target),
                _ => {
                    let mut target = GrayImage::new(size.0, size.1);
                    halve(source, &mut target);
                    self.levels.truncate(level);
                    self.levels.push(target);
                }
            }
        }
    }
}

fn halve(source: &GrayImage, target: &mut GrayImage) {
    let (from, to) = (source.width() as usize, target.width() as usize);
    let pixels = source.as_raw();
    for (y, row) in target.chunks_exact_mut(to).enumerate() {
        let above = &pixels[2 * y * from..][..2 * to];
        let below = &pixels[(2 * y + 1) * from..][..2 * to];
        for ((out, a), b) in row.iter_mut().zip(above.chunks_exact(2)).zip(below.chunks_exact(2)) {
            let sum = u16::from(a[0]) + u16::from(a[1]) + u16::from(b[0]) + u16::from(b[1]);
            *out = ((sum + 2) / 4) as u8;
        }
    }
}

/// A pixel coordinate of the full picture on level `l` (0 = full picture).
pub fn to_level(x: f64, l: u32) -> f64 {
    (x + 0.5) / f64::from(1u32 << l) - 0.5
}

/// A pixel coordinate of level `l` in the full picture.
pub fn from_level(x: f64, l: u32) -> f64 {
    (x + 0.5) * f64::from(1u32 << l) - 0.5
}

/// Makes a [`Pyramid`] of every grey frame of a sensor.
pub struct PyramidProcessing {
    key: EvidenceKey,
    levels: usize,
}

impl PyramidProcessing {
    /// `levels` levels above the pictures of `sensor`.
    pub fn new(sensor: SensorId, levels: u32) -> Self {
        Self { key: Self::key_for(sensor, levels), levels: levels as usize }
    }

    /// Key under which the pyramid is found.
    pub fn key_for(sensor: SensorId, levels: u32) -> EvidenceKey {
        EvidenceKey { sensor, name: format!("pyramid/levels={levels}").into() }
    }
}

impl Processing for PyramidProcessing {
    fn key(&self) -> &EvidenceKey {
        &self.key
    }

    fn run(&self, frame: &Frame, _: Option<Roi>, slot: &mut Slot) -> Result<(), MeasureError> {
        slot.buffer::<Pyramid>().compute(frame.grey()?, self.levels);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Luma;

    #[test]
    fn coordinates_go_round_and_agree_with_the_pixels() {
        for l in 0..5 {
            for x in [-0.5, 0.0, 17.25, 639.0] {
                assert!((from_level(to_level(x, l), l) - x).abs() < 1e-12);
            }
        }
        // A linear ramp keeps its value at corresponding coordinates.
        let ramp = GrayImage::from_fn(64, 32, |x, _| Luma([4 * x as u8]));
        let mut pyramid = Pyramid::default();
        for _ in 0..2 {
            pyramid.compute(&ramp, 4);
            assert_eq!(pyramid.levels.len(), 2);
            let value = |l: usize, x: u32| f64::from(pyramid.levels[l - 1].get_pixel(x, 3)[0]);
            for x in 1..8 {
                assert!((value(2, x) - 4.0 * from_level(f64::from(x), 2)).abs() <= 0.5);
                assert!((value(1, x) - 4.0 * from_level(f64::from(x), 1)).abs() <= 0.5);
            }
        }
    }
}
