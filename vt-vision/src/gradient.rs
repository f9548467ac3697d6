//! Intensity gradients of a picture or of a region of it.

use image::GrayImage;
use vt_core::batch::vectorized;
use vt_core::error::MeasureError;
use vt_core::evidence::{EvidenceKey, Processing, Slot};
use vt_core::frame::{Frame, Roi, SensorId};

use crate::plane::{area, clip, reserve};

/// Sobel gradients over a region; a step of `h` grey levels along an axis answers with `4 h`.
#[derive(Clone, Debug, Default)]
pub struct Gradient {
    /// Pixels for which the gradient is known.
    pub region: Option<Roi>,
    /// `∂I/∂x`, by rows of the region.
    pub x: Vec<i16>,
    /// `∂I/∂y`, by rows of the region.
    pub y: Vec<i16>,
}

impl Gradient {
    /// Sobel response to a step of one grey level.
    pub const STEP: f64 = 4.0;

    /// Computes the gradient of `image` inside `roi`, or everywhere; the outermost pixels of the picture have none.
    pub fn compute(&mut self, image: &GrayImage, roi: Option<Roi>) {
        let region = clip(roi, image.dimensions(), 1);
        self.resize(region, image.dimensions());
        let Some(r) = self.region else { return };
        let (stride, width) = (image.width() as usize, r.width as usize);
        let pixels = image.as_raw();
        let planes = self.x.chunks_exact_mut(width).zip(self.y.chunks_exact_mut(width));
        for (row, (x, y)) in (r.y as usize..).zip(planes) {
            let line = |v: usize| &pixels[v * stride + r.x as usize - 1..][..width + 2];
            sobel(line(row - 1), line(row), line(row + 1), x, y);
        }
    }

    /// Makes room for a region of a picture of `size`; the values are whatever they are.
    pub(crate) fn resize(&mut self, region: Roi, size: (u32, u32)) {
        reserve(&mut self.x, area(size));
        reserve(&mut self.y, area(size));
        let count = region.width as usize * region.height as usize;
        self.region = (count > 0).then_some(region);
        self.x.resize(count, 0);
        self.y.resize(count, 0);
    }
}

/// Sobel's masks along a row of pixels; the rows of the picture have one more on either side.
fn sobel(above: &[u8], here: &[u8], below: &[u8], x: &mut [i16], y: &mut [i16]) {
    vectorized(
        #[inline(always)]
        move || {
            let n = x.len().min(y.len());
            let [a0, a1, a2] = [0, 1, 2].map(|k| &above[k..][..n]);
            let [b0, b2] = [0, 2].map(|k| &here[k..][..n]);
            let [c0, c1, c2] = [0, 1, 2].map(|k| &below[k..][..n]);
            let (x, y) = (&mut x[..n], &mut y[..n]);
            for i in 0..n {
                let at = |row: &[u8]| i16::from(row[i]);
                x[i] = at(a2) - at(a0) + 2 * (at(b2) - at(b0)) + at(c2) - at(c0);
                y[i] = at(c0) - at(a0) + 2 * (at(c1) - at(a1)) + at(c2) - at(a2);
            }
        },
    );
}

/// Makes a [`Gradient`] of every grey frame of a sensor.
pub struct GradientProcessing {
    key: EvidenceKey,
}

impl GradientProcessing {
    /// Gradients of the pictures of `sensor`.
    pub fn new(sensor: SensorId) -> Self {
        Self { key: Self::key_for(sensor) }
    }

    /// Key under which the gradient is found.
    pub fn key_for(sensor: SensorId) -> EvidenceKey {
        EvidenceKey { sensor, name: "gradient".into() }
    }
}

impl Processing for GradientProcessing {
    fn key(&self) -> &EvidenceKey {
        &self.key
    }

    fn run(&self, frame: &Frame, roi: Option<Roi>, slot: &mut Slot) -> Result<(), MeasureError> {
        slot.buffer::<Gradient>().compute(frame.grey()?, roi);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Luma;

    #[test]
    fn ramps_have_their_slope_and_regions_agree_with_the_whole() {
        let ramp = GrayImage::from_fn(20, 14, |x, y| Luma([(3 * x + 5 * y) as u8]));
        let mut whole = Gradient::default();
        whole.compute(&ramp, None);
        assert_eq!(whole.region, Some(Roi { x: 1, y: 1, width: 18, height: 12 }));
        assert!(whole.x.iter().all(|&g| g == 8 * 3) && whole.y.iter().all(|&g| g == 8 * 5));
        let mut part = Gradient::default();
        part.compute(&ramp, Some(Roi { x: 15, y: 0, width: 100, height: 4 }));
        assert_eq!(part.region, Some(Roi { x: 15, y: 1, width: 4, height: 3 }));
        assert_eq!(part.x, [24; 12]);
        part.compute(&ramp, Some(Roi { x: 40, y: 0, width: 5, height: 4 }));
        assert_eq!(part.region, None);
        part.compute(&GrayImage::new(2, 1), None);
        assert_eq!(part.region, None);
    }
}
