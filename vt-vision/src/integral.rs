//! Sums over upright rectangles, four look-ups each (Crow, "Summed-area tables for texture mapping", 1984).

use image::GrayImage;
use vt_core::error::MeasureError;
use vt_core::evidence::{EvidenceKey, Processing, Slot};
use vt_core::frame::{Frame, Roi, SensorId};

use crate::color::grey_of;
use crate::plane::{Plane, intersection};

/// Sums of values, and of their squares, over everything above and left of a pixel.
#[derive(Clone, Debug, Default)]
pub struct IntegralImage {
    region: Option<Roi>,
    /// One column and one row more than the region, which are zero.
    sums: Vec<u64>,
    squares: Vec<u64>,
}

/// Sums over a rectangle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sums {
    /// Number of pixels.
    pub count: u64,
    /// Sum of their values.
    pub sum: u64,
    /// Sum of the squares of their values.
    pub squares: u64,
}

impl Sums {
    /// Mean of the values; zero for no pixels.
    pub fn mean(&self) -> f64 {
        self.sum as f64 / self.count.max(1) as f64
    }

    /// Variance of the values; zero for no pixels.
    pub fn variance(&self) -> f64 {
        // In whole numbers there is no cancellation.
        let n = u128::from(self.count.max(1));
        let scaled = n * u128::from(self.squares) - u128::from(self.sum) * u128::from(self.sum);
        scaled as f64 / (n * n) as f64
    }
}

impl IntegralImage {
    /// Sums of a plane of bytes.
    pub fn compute(&mut self, plane: &Plane<u8>) {
        self.fill(plane.region(), |y| plane.row(y, plane.region()));
    }

    /// Sums of a grey picture.
    pub fn of_picture(&mut self, image: &GrayImage) {
        let (width, height) = image.dimensions();
        let pixels = image.as_raw();
        self.fill(Roi { x: 0, y: 0, width, height }, |y| {
            &pixels[y as usize * width as usize..][..width as usize]
        });
    }

    fn fill<'a>(&mut self, region: Roi, row: impl Fn(u32) -> &'a [u8]) {
        let stride = region.width as usize + 1;
        self.region = Some(region);
        for table in [&mut self.sums, &mut self.squares] {
            table.resize(stride * (region.height as usize + 1), 0);
            table[..stride].fill(0);
        }
        for k in 0..region.height as usize {
            let (above, here) = self.sums[k * stride..][..2 * stride].split_at_mut(stride);
            let (above2, here2) = self.squares[k * stride..][..2 * stride].split_at_mut(stride);
            let (mut sum, mut squares) = (0, 0);
            (here[0], here2[0]) = (0, 0);
            for (x, &value) in (1..).zip(row(region.y + k as u32)) {
                let value = u64::from(value);
                sum += value;
                squares += value * value;
                here[x] = above[x] + sum;
                here2[x] = above2[x] + squares;
            }
        }
    }

    /// Sums over the part of a rectangle of the picture that lies in the region.
    pub fn sums(&self, rectangle: Roi) -> Sums {
        let Some(region) = self.region else { return Sums::default() };
        let part = intersection(region, rectangle);
        if part.width == 0 {
            return Sums::default();
        }
        let stride = region.width as usize + 1;
        let (left, top) = ((part.x - region.x) as usize, (part.y - region.y) as usize);
        let (right, bottom) = (left + part.width as usize, top + part.height as usize);
        let over = |table: &[u64]| {
            let at = |x: usize, y: usize| table[y * stride + x];
            at(right, bottom) + at(left, top) - at(left, bottom) - at(right, top)
        };
        let count = u64::from(part.width) * u64::from(part.height);
        Sums { count, sum: over(&self.sums), squares: over(&self.squares) }
    }
}

/// Makes an [`IntegralImage`] of the grey levels of every frame of a sensor.
pub struct IntegralProcessing {
    key: EvidenceKey,
}

/// What [`IntegralProcessing`] leaves as evidence.
#[derive(Default)]
pub struct IntegralEvidence {
    /// Sums of the grey levels of the frame.
    pub integral: IntegralImage,
    grey: GrayImage,
}

impl IntegralProcessing {
    /// Sums of the pictures of `sensor`.
    pub fn new(sensor: SensorId) -> Self {
        Self { key: Self::key_for(sensor) }
    }

    /// Key under which the [`IntegralEvidence`] is found.
    pub fn key_for(sensor: SensorId) -> EvidenceKey {
        EvidenceKey { sensor, name: "integral".into() }
    }
}

impl Processing for IntegralProcessing {
    fn key(&self) -> &EvidenceKey {
        &self.key
    }

    fn run(&self, frame: &Frame, _: Option<Roi>, slot: &mut Slot) -> Result<(), MeasureError> {
        let evidence = slot.buffer::<IntegralEvidence>();
        evidence.integral.of_picture(grey_of(frame, &mut evidence.grey)?);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn sums_are_those_of_the_pixels(
            (width, height) in (0u32..20, 0u32..20), values in prop::collection::vec(any::<u8>(), 400),
            (x, y, w, h) in (0u32..24, 0u32..24, 0u32..30, 0u32..30),
        ) {
            let mut plane = Plane::default();
            let region = Roi { x: 2, y: 3, width, height };
            let count = (width * height) as usize;
            plane.reshape(region).copy_from_slice(&values[..count]);
            let mut integral = IntegralImage::default();
            integral.compute(&plane);
            let rectangle = Roi { x, y, width: w, height: h };
            let pixels: Vec<f64> = (y..y + h).flat_map(|v| (x..x + w).map(move |u| (u, v)))
                .filter_map(|(u, v)| plane.get(u, v)).map(f64::from).collect();
            let sums = integral.sums(rectangle);
            let n = pixels.len().max(1) as f64;
            let mean = pixels.iter().sum::<f64>() / n;
            prop_assert_eq!(sums.count, pixels.len() as u64);
            prop_assert!((sums.mean() - mean).abs() < 1e-9);
            prop_assert!((sums.variance() - pixels.iter().map(|p| (p - mean).powi(2)).sum::<f64>() / n).abs() < 1e-6);
        }
    }
}
