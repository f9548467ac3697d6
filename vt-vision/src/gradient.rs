//! Intensity gradients of a picture or of a region of it.

use image::GrayImage;
use vt_core::error::MeasureError;
use vt_core::evidence::{EvidenceKey, Processing, Slot};
use vt_core::frame::{Frame, Roi, SensorId};

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
        self.x.clear();
        self.y.clear();
        self.region = inner(image, roi);
        let Some(r) = self.region else { return };
        let width = image.width() as usize;
        let pixels = image.as_raw();
        self.x.reserve((r.width * r.height) as usize);
        self.y.reserve((r.width * r.height) as usize);
        for row in r.y as usize..(r.y + r.height) as usize {
            let start = r.x as usize - 1;
            let span = r.width as usize + 2;
            let [above, here, below] = [row - 1, row, row + 1].map(|v| &pixels[v * width + start..][..span]);
            for k in 0..r.width as usize {
                let at = |line: &[u8], d: usize| i16::from(line[k + d]);
                let (a0, a1, a2) = (at(above, 0), at(above, 1), at(above, 2));
                let (b0, b2) = (at(here, 0), at(here, 2));
                let (c0, c1, c2) = (at(below, 0), at(below, 1), at(below, 2));
                self.x.push(a2 - a0 + 2 * (b2 - b0) + c2 - c0);
                self.y.push(c0 - a0 + 2 * (c1 - a1) + c2 - a2);
            }
        }
    }
}

/// The part of `roi` that has a neighbour on every side.
fn inner(image: &GrayImage, roi: Option<Roi>) -> Option<Roi> {
    let (width, height) = image.dimensions();
    let roi = roi.unwrap_or(Roi { x: 0, y: 0, width, height });
    let (left, top) = (roi.x.max(1), roi.y.max(1));
    let right = roi.x.saturating_add(roi.width).min(width.saturating_sub(1));
    let bottom = roi.y.saturating_add(roi.height).min(height.saturating_sub(1));
    (left < right && top < bottom).then(|| Roi { x: left, y: top, width: right - left, height: bottom - top })
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
