//! Pixel-level evidence: a map of edge pixels with direction and sub-pixel position.

use image::GrayImage;
use nalgebra::{Point2, Vector2};
use vt_core::error::MeasureError;
use vt_core::evidence::{EvidenceKey, Processing, Slot};
use vt_core::frame::{Frame, Roi, SensorId};

use crate::gradient::Gradient;
use crate::noise::noise_deviation;
use crate::plane::{area, reserve};
use crate::turns::Turns;

/// An edge pixel must exceed the noise by this factor; Sobel's mask answers to noise of one grey level with 0.87.
const NOISE_FACTOR: f64 = 4.0 * 0.87;

/// Directions of the gradient are kept in this many sectors of the full circle.
const SECTORS: usize = 64;

/// One pixel of the map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Cell {
    /// 0 without an edge, otherwise 1 + sector of the gradient's direction.
    sector: u8,
    /// Offset of the edge from the pixel's centre along the axis nearer to the gradient, 1/200 px.
    offset: i8,
}

/// Edge pixels of a region: local maxima of the gradient along its nearer axis, as in Canny's method without
/// hysteresis.
#[derive(Clone, Debug, Default)]
pub struct EdgeMap {
    region: Option<Roi>,
    cells: Vec<Cell>,
    gradient: Gradient,
    directions: Vec<Vector2<f64>>,
    noise: Vec<u16>,
}

/// An edge pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgePixel {
    /// Sub-pixel position of the edge.
    pub at: Point2<f64>,
    /// Unit direction of the gradient, to a few degrees.
    pub direction: Vector2<f64>,
}

impl EdgeMap {
    /// Finds the edge pixels of `image` with steps of at least `min_contrast` grey levels inside `roi`.
    pub fn compute(&mut self, image: &GrayImage, roi: Option<Roi>, min_contrast: f64) {
        if self.directions.is_empty() {
            self.directions.extend((0..SECTORS).map(|k| {
                let (s, c) =
                    vt_core::math::sin_cos((k as f64 + 0.5) * core::f64::consts::TAU / SECTORS as f64);
                Vector2::new(c, s)
            }));
        }
        self.gradient.compute(image, roi);
        self.region = self.gradient.region;
        self.cells.clear();
        reserve(&mut self.cells, area(image.dimensions()));
        let Some(r) = self.region else { return };
        let (width, height) = (r.width as usize, r.height as usize);
        self.cells.resize(width * height, Cell::default());
        let noise = noise_deviation(image, &mut self.noise);
        let threshold = (min_contrast.max(NOISE_FACTOR * noise) * Gradient::STEP) as i32;
        let (gx, gy) = (&self.gradient.x, &self.gradient.y);
        for y in 1..height.saturating_sub(1) {
            for x in 1..width.saturating_sub(1) {
                let k = y * width + x;
                let (dx, dy) = (i32::from(gx[k]), i32::from(gy[k]));
                let along_row = dx.abs() >= dy.abs();
                let (plane, step) = if along_row { (gx, 1) } else { (gy, width) };
                let here = i32::from(plane[k]);
                if here.abs() < threshold {
                    continue;
                }
                let sign = here.signum();
                let (size, before, after) =
                    (here * sign, i32::from(plane[k - step]) * sign, i32::from(plane[k + step]) * sign);
                if size < before || size <= after {
                    continue;
                }
                let curvature = 2 * size - before - after;
                let fraction = 0.5 * f64::from(after - before) / f64::from(curvature.max(1));
                let angle = vt_core::math::atan2(f64::from(dy), f64::from(dx));
                let turn = (angle / core::f64::consts::TAU).rem_euclid(1.0);
                self.cells[k] = Cell {
                    sector: 1 + ((turn * SECTORS as f64) as usize).min(SECTORS - 1) as u8,
                    offset: (fraction.clamp(-0.5, 0.5) * 200.0).round() as i8,
                };
            }
        }
    }

    /// The edge at the pixel nearest to `at`, if there is one.
    #[inline]
    pub fn get(&self, at: Point2<f64>) -> Option<EdgePixel> {
        let r = self.region?;
        let (x, y) = (at.x.round(), at.y.round());
        let (u, v) = (x - f64::from(r.x), y - f64::from(r.y));
        if !(u >= 0.0 && v >= 0.0 && u < f64::from(r.width) && v < f64::from(r.height)) {
            return None;
        }
        let cell = self.cells[v as usize * r.width as usize + u as usize];
        if cell.sector == 0 {
            return None;
        }
        let direction = self.directions[usize::from(cell.sector - 1)];
        let offset = f64::from(cell.offset) / 200.0;
        let at = if direction.x.abs() >= direction.y.abs() {
            Point2::new(x + offset, y)
        } else {
            Point2::new(x, y + offset)
        };
        Some(EdgePixel { at, direction })
    }

    /// Column, row and orientation of the gradient's line in half turns, 0 to 1, of every edge pixel, by rows.
    pub fn orientations(&self) -> impl Iterator<Item = (usize, usize, f64)> {
        let region = self.region.unwrap_or(Roi { x: 0, y: 0, width: 1, height: 0 });
        let (left, top, width) = (region.x as usize, region.y as usize, region.width as usize);
        self.cells.iter().enumerate().filter(|(_, c)| c.sector != 0).map(move |(k, c)| {
            let turn = (f64::from(c.sector) - 0.5) * 2.0 / SECTORS as f64;
            (left + k % width, top + k / width, turn % 1.0)
        })
    }

    /// Region that was searched.
    pub fn region(&self) -> Option<Roi> {
        self.region
    }

    /// Number of edge pixels.
    pub fn count(&self) -> usize {
        self.cells.iter().filter(|c| c.sector != 0).count()
    }
}

/// Makes an [`EdgeMap`] of every grey frame of a sensor, in [`Turns`].
pub struct EdgeMapProcessing {
    key: EvidenceKey,
    min_contrast: f64,
}

impl EdgeMapProcessing {
    /// Edges of at least `min_contrast` grey levels in the pictures of `sensor`.
    pub fn new(sensor: SensorId, min_contrast: f64) -> Self {
        Self { key: Self::key_for(sensor, min_contrast), min_contrast }
    }

    /// Key under which the [`Turns`] of [`EdgeMap`] are found.
    pub fn key_for(sensor: SensorId, min_contrast: f64) -> EvidenceKey {
        EvidenceKey { sensor, name: format!("edge-map/min_contrast={min_contrast}").into() }
    }
}

impl Processing for EdgeMapProcessing {
    fn key(&self) -> &EvidenceKey {
        &self.key
    }

    fn run(&self, frame: &Frame, roi: Option<Roi>, slot: &mut Slot) -> Result<(), MeasureError> {
        let image = frame.grey()?;
        slot.buffer::<Turns<EdgeMap>>().turn().compute(image, roi, self.min_contrast);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Luma;

    #[test]
    fn a_disc_has_edges_on_its_rim_with_outward_gradients() {
        let (centre, radius) = (Point2::new(30.3, 29.6), 15.2);
        let image = GrayImage::from_fn(60, 60, |x, y| {
            let mut inside = 0;
            for i in 0..64 {
                let (u, v) = (f64::from(i % 8) / 8.0 - 0.4375, f64::from(i / 8) / 8.0 - 0.4375);
                inside +=
                    u32::from((Point2::new(f64::from(x) + u, f64::from(y) + v) - centre).norm() < radius);
            }
            Luma([(200 - 150 * inside / 64) as u8])
        });
        let mut map = EdgeMap::default();
        map.compute(&image, None, 20.0);
        let mut seen = 0;
        for y in 0..60 {
            for x in 0..60 {
                let Some(edge) = map.get(Point2::new(f64::from(x), f64::from(y))) else { continue };
                let d = edge.at - centre;
                seen += 1;
                assert!((d.norm() - radius).abs() < 0.15, "{edge:?}");
                assert!(d.normalize().dot(&edge.direction) > 0.99, "{edge:?}");
            }
        }
        assert!(seen > 60 && seen == map.count(), "{seen}");
        map.compute(&image, Some(Roi { x: 0, y: 0, width: 10, height: 10 }), 20.0);
        assert_eq!(map.count(), 0);
        assert_eq!(map.get(Point2::new(f64::NAN, 3.0)), None);
    }
}
