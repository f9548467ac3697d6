//! Edges of a picture after Canny ("A computational approach to edge detection", 1986): smoothing, gradient, thinning along the
//! gradient, two thresholds. Colour pictures by the structure tensor of their channels (Di Zenzo, "A note on the gradient of a
//! multi-image", 1986). Positions are sub-pixel: a parabola through the sizes of the gradient along the axis nearer to it (Devernay, 1995), which needs no
//! interpolated values.

mod color;
mod hysteresis;
mod params;
mod suppression;

pub use params::{CannyParams, Norm, Thresholds};

use image::{GrayImage, RgbImage};
use nalgebra::{Point2, Vector2};
use vt_core::error::MeasureError;
use vt_core::evidence::{EvidenceKey, Processing, Slot};
use vt_core::frame::{Frame, Payload, Roi, SensorId};

use crate::color::grey_of;
use crate::edge_map::EdgePixel;
use crate::gaussian::Blur;
use crate::gradient::Gradient;
use crate::plane::{Plane, area, clip, grown, reserve};
use crate::turns::Turns;
use hysteresis::Hysteresis;
use suppression::{magnitude, suppress};

/// A pixel that is no edge, one that is if its neighbours are, and one that is.
const WEAK: u8 = 1;
const STRONG: u8 = 2;

/// `tan 22.5°`: lines nearer to an axis than to a diagonal.
const OCTANT: f64 = core::f64::consts::SQRT_2 - 1.0;

/// Edge pixels of a region.
#[derive(Clone, Debug, Default)]
pub struct Canny {
    mask: Plane<u8>,
    gradient: Gradient,
    norm: Norm,
    blur: Blur,
    smooth: GrayImage,
    channels: color::Channels,
    /// Sizes of the gradient in three rows, in turn.
    rows: [Vec<f32>; 3],
    counts: Vec<u32>,
    hysteresis: Hysteresis,
}

impl Canny {
    /// Finds the edges of a grey picture inside `roi`, or everywhere. The two outermost rows and columns of the picture have none.
    pub fn compute(&mut self, image: &GrayImage, roi: Option<Roi>, params: &CannyParams) {
        let region = clip(roi, image.dimensions(), 2);
        let around = grown(region, 1, image.dimensions());
        let source = match &params.blur {
            Some(kernel) => {
                let wide = grown(region, 2, image.dimensions());
                self.blur.picture(image, Some(wide), kernel, &mut self.smooth);
                &self.smooth
            }
            None => image,
        };
        self.gradient.compute(source, Some(around));
        self.thin(region, image.dimensions(), params);
    }

    /// Finds the edges of a colour picture: the gradient is the direction in which its colours change most.
    pub fn compute_color(&mut self, image: &RgbImage, roi: Option<Roi>, params: &CannyParams) {
        let region = clip(roi, image.dimensions(), 2);
        self.channels.gradient(image, region, params.blur.as_ref(), &mut self.blur, &mut self.gradient);
        self.thin(region, image.dimensions(), params);
    }

    /// From the gradient of the region, which has one pixel more on every side, to its edges.
    fn thin(&mut self, region: Roi, size: (u32, u32), params: &CannyParams) {
        self.norm = params.norm;
        self.mask.reserve(area(size));
        self.hysteresis.reserve(area((size.0 + 2, size.1 + 2)));
        self.rows.iter_mut().for_each(|row| reserve(row, size.0 as usize + 2));
        let mask = self.mask.reshape(region);
        if region.width == 0 || region.height == 0 {
            return;
        }
        let (width, stride) = (region.width as usize, region.width as usize + 2);
        let thresholds = params.thresholds.raw(&self.gradient, params.norm, &mut self.counts);
        let (gx, gy) = (self.gradient.x.chunks_exact(stride), self.gradient.y.chunks_exact(stride));
        let classes = self.hysteresis.begin(width, region.height as usize);
        for (k, (gx, gy)) in gx.clone().zip(gy.clone()).enumerate() {
            let row = &mut self.rows[k % 3];
            row.resize(stride, 0.0);
            magnitude(gx, gy, params.norm, row);
            let Some(above) = k.checked_sub(2) else { continue };
            let at = above * stride + stride;
            let sizes = [above, above + 1, k].map(|k| &self.rows[k % 3][..]);
            let [gx, gy] = [&self.gradient.x, &self.gradient.y].map(|g| &g[at + 1..][..width]);
            suppress(sizes, gx, gy, thresholds, &mut classes[at + 1..][..width]);
        }
        self.hysteresis.spread();
        self.hysteresis.mask(mask);
    }

    /// 255 for edge pixels, 0 elsewhere, in the region that was searched.
    pub fn mask(&self) -> &Plane<u8> {
        &self.mask
    }

    /// Gradient of the smoothed picture: Sobel's, in the region and one pixel around it.
    pub fn gradient(&self) -> &Gradient {
        &self.gradient
    }

    /// The edge at a pixel, if it is one: where it crosses the axis nearer to the gradient, and the gradient's direction.
    #[inline]
    pub fn get(&self, x: u32, y: u32) -> Option<EdgePixel> {
        (self.mask.get(x, y)? != 0).then(|| self.locate(x, y))
    }

    /// All edge pixels by rows, with their column and row.
    pub fn edges(&self) -> impl Iterator<Item = (u32, u32, EdgePixel)> {
        let r = self.mask.region();
        let rows = (r.y..).zip(self.mask.values().chunks_exact(r.width.max(1) as usize));
        rows.flat_map(move |(y, row)| {
            let marked = (r.x..).zip(row).filter(|(_, m)| **m != 0);
            marked.map(move |(x, _)| (x, y, self.locate(x, y)))
        })
    }

    /// Step in grey levels to which the gradient of a pixel of the region answers.
    pub fn contrast(&self, x: u32, y: u32) -> Option<f64> {
        self.mask.get(x, y)?;
        let k = self.index(x, y);
        Some(f64::from(self.size(k)) / Gradient::STEP)
    }

    /// Place of a pixel of the region in the planes of the gradient.
    fn index(&self, x: u32, y: u32) -> usize {
        let r = self.mask.region();
        (y - r.y + 1) as usize * (r.width as usize + 2) + (x - r.x + 1) as usize
    }

    fn size(&self, k: usize) -> f32 {
        let mut size = [0.0];
        magnitude(&self.gradient.x[k..=k], &self.gradient.y[k..=k], self.norm, &mut size);
        size[0]
    }

    /// Sub-pixel position and direction at a pixel of the region.
    fn locate(&self, x: u32, y: u32) -> EdgePixel {
        let (k, stride) = (self.index(x, y), self.mask.region().width as usize + 2);
        let (gx, gy) = (self.gradient.x[k], self.gradient.y[k]);
        let size = |dx: isize, dy: isize| {
            let k = k.wrapping_add_signed(dx + dy * stride as isize);
            let [x, y] = [self.gradient.x[k], self.gradient.y[k]].map(f64::from);
            // Across a smoothed step the gradient is a Gaussian, whose logarithm is a parabola.
            vt_core::math::ln((x * x + y * y).max(1.0))
        };
        let (ax, ay) = (f64::from(gx).abs(), f64::from(gy).abs());
        let step = if ay < OCTANT * ax {
            (1, 0)
        } else if ax < OCTANT * ay {
            (0, 1)
        } else if (gx < 0) == (gy < 0) {
            (1, 1)
        } else {
            (1, -1)
        };
        let (before, here, after) = (size(-step.0, -step.1), size(0, 0), size(step.0, step.1));
        let curvature = 2.0 * here - before - after;
        let offset = if curvature > 0.0 { 0.5 * (after - before) / curvature } else { 0.0 };
        let offset = offset.clamp(-0.5, 0.5);
        let g = Vector2::new(f64::from(gx), f64::from(gy));
        let step = Vector2::new(step.0 as f64, step.1 as f64);
        EdgePixel {
            at: Point2::new(f64::from(x), f64::from(y)) + step * offset,
            direction: g.try_normalize(0.0).unwrap_or_else(Vector2::x),
        }
    }
}

/// Makes a [`Canny`] of every frame of a sensor, in [`Turns`].
pub struct CannyProcessing {
    key: EvidenceKey,
    params: CannyParams,
}

/// What [`CannyProcessing`] leaves as evidence.
#[derive(Default)]
pub struct CannyEvidence {
    /// Edges of the frames.
    pub edges: Turns<Canny>,
    grey: GrayImage,
}

impl CannyEvidence {
    /// Finds the edges of a frame: of a grey one, and of a colour one as `params` say.
    ///
    /// # Errors
    /// [`MeasureError::Payload`] for frames that are no picture.
    pub fn compute(
        &mut self,
        frame: &Frame,
        roi: Option<Roi>,
        params: &CannyParams,
    ) -> Result<(), MeasureError> {
        match &frame.payload {
            Payload::Rgb(image) if params.color => self.edges.turn().compute_color(image, roi, params),
            _ => self.edges.turn().compute(grey_of(frame, &mut self.grey)?, roi, params),
        }
        Ok(())
    }
}

impl CannyProcessing {
    /// Edges of the pictures of `sensor`.
    pub fn new(sensor: SensorId, params: CannyParams) -> Self {
        Self { key: Self::key_for(sensor, &params), params }
    }

    /// Key under which the [`CannyEvidence`] is found.
    pub fn key_for(sensor: SensorId, params: &CannyParams) -> EvidenceKey {
        EvidenceKey { sensor, name: format!("canny/{}", params.name()).into() }
    }
}

impl Processing for CannyProcessing {
    fn key(&self) -> &EvidenceKey {
        &self.key
    }

    fn run(&self, frame: &Frame, roi: Option<Roi>, slot: &mut Slot) -> Result<(), MeasureError> {
        slot.buffer::<CannyEvidence>().compute(frame, roi, &self.params)
    }
}

#[cfg(test)]
mod tests;
