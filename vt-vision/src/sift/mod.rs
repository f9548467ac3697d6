//! Scale-invariant keypoints with descriptors: D. Lowe, "Distinctive image features from scale-invariant keypoints", 2004.
//!
//! Extrema of differences of Gaussians over place and scale, each with one or more directions and a descriptor that turns and
//! grows with it. Pixel centres lie at integer coordinates, in octaves of any resolution.

mod descriptor;
mod extrema;
mod orientation;
mod polar;
mod scale_space;

pub use descriptor::{Descriptor, SIZE};

use image::GrayImage;
use nalgebra::Point2;
use rayon::prelude::*;
use vt_core::error::ConfigError;
use vt_core::frame::Roi;
use vt_core::math;

use crate::plane::{clip, grown};
use descriptor::Pooling;
use extrema::{Band, Extremum, Limits};
use orientation::Directions;
use scale_space::ScaleSpace;

/// What is a keypoint, and how it is described.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SiftParams {
    /// Scales of an octave in which extrema are looked for.
    pub layers: usize,
    /// Deviation of the first level of an octave, pixels of the octave. Lowe has 1.6.
    pub sigma: f64,
    /// Deviation of the smoothing that the picture has from its camera, pixels. Lowe assumes 0.5. With 0 the levels are a little
    /// smoother than they say, and on the six pairs of `sift_pairs`, on which the default was chosen, a quarter more matches are right.
    pub input_blur: f64,
    /// Whether the first octave has twice the resolution of the picture: four times the work and memory (with three layers about 130
    /// bytes a pixel of the region), and the small keypoints.
    pub doubled: bool,
    /// Most octaves.
    pub octaves: usize,
    /// Least contrast, as a part of the range of grey levels; for one scale of an octave it is divided by their number.
    pub contrast: f64,
    /// Largest ratio of the principal curvatures: what is longer is an edge.
    pub edge: f64,
    /// Most keypoints, the ones with the strongest contrast.
    pub budget: usize,
    /// Takes the root of the descriptor (RootSIFT): Euclidean distances then compare histograms as such.
    pub root: bool,
    /// Pixels around the region of interest from which smoothing and descriptors may take.
    pub margin: u32,
}

impl Default for SiftParams {
    fn default() -> Self {
        Self {
            layers: 3,
            sigma: 1.5,
            input_blur: 0.0,
            doubled: true,
            octaves: 16,
            contrast: 0.04,
            edge: 10.0,
            budget: 2000,
            root: true,
            margin: 32,
        }
    }
}

/// A place with a scale and a direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Keypoint {
    /// Place in the picture, pixels.
    pub at: Point2<f64>,
    /// Deviation of the Gaussian at which it stands out, pixels of the picture.
    pub scale: f64,
    /// Direction of its gradients, radians from x towards y.
    pub angle: f64,
    /// Contrast: absolute difference of Gaussians, grey levels.
    pub response: f64,
    /// Distance of the pixels in which it was found, pixels of the picture: errors of its place grow with it.
    pub spacing: f64,
}

/// Detector and descriptor with buffers that are used again.
#[derive(Clone, Debug)]
pub struct Sift {
    params: SiftParams,
    limits: Limits,
    space: ScaleSpace,
    pooling: Pooling,
    bands: Vec<Band>,
    extrema: Vec<Extremum>,
    directions: Vec<Directions>,
    /// Extremum and direction of each keypoint.
    chosen: Vec<(u32, f32)>,
    keypoints: Vec<Keypoint>,
    descriptors: Vec<Descriptor>,
}

impl Sift {
    /// A detector with these parameters.
    ///
    /// # Errors
    /// [`ConfigError::Parameter`] with the first that is out of its range.
    pub fn new(params: SiftParams) -> Result<Self, ConfigError> {
        let within = |key, v: f64, low: f64, high: f64| {
            if (low..=high).contains(&v) {
                return Ok(());
            }
            Err(ConfigError::parameter(key, v, format!("{low} to {high}")))
        };
        within("layers", params.layers as f64, 1.0, 8.0)?;
        within("sigma", params.sigma, 0.8, 4.0)?;
        within("input_blur", params.input_blur, 0.0, 4.0)?;
        within("octaves", params.octaves as f64, 1.0, 16.0)?;
        within("contrast", params.contrast, 1e-4, 1.0)?;
        within("edge", params.edge, 1.0, 1000.0)?;
        within("budget", params.budget as f64, 1.0, 1e6)?;
        let space =
            ScaleSpace::new(params.sigma, params.input_blur, params.layers, params.doubled, params.octaves)?;
        let limits = Limits {
            response: (255.0 * params.contrast / params.layers as f64) as f32,
            edge: params.edge as f32,
        };
        Ok(Self {
            params,
            limits,
            space,
            pooling: Pooling::default(),
            bands: vec![],
            extrema: vec![],
            directions: vec![],
            chosen: vec![],
            keypoints: vec![],
            descriptors: vec![],
        })
    }

    /// The parameters.
    pub fn params(&self) -> &SiftParams {
        &self.params
    }

    /// Keypoints of the last picture, in the order of octaves, scales, rows and columns.
    pub fn keypoints(&self) -> &[Keypoint] {
        &self.keypoints
    }

    /// Their descriptors, in the same order.
    pub fn descriptors(&self) -> &[Descriptor] {
        &self.descriptors
    }

    /// Finds and describes the keypoints of `image` inside `roi`, or everywhere.
    pub fn compute(&mut self, image: &GrayImage, roi: Option<Roi>) {
        self.detect(image, roi);
        self.orient();
        self.describe();
    }

    /// The strongest extrema inside the region.
    fn detect(&mut self, image: &GrayImage, roi: Option<Roi>) {
        let region = clip(roi, image.dimensions(), 0);
        let mut around = grown(region, self.params.margin, image.dimensions());
        // Octaves sample the same pixels as those of the whole picture, as far as they are not coarser than this.
        const GRID: u32 = 16;
        around.width += around.x % GRID;
        around.height += around.y % GRID;
        (around.x, around.y) = (around.x - around.x % GRID, around.y - around.y % GRID);
        self.space.compute(image, around);
        extrema::find(&self.space, &self.limits, &mut self.bands, &mut self.extrema);
        if region != around {
            let space = &self.space;
            let [left, top, right, bottom] =
                [region.x, region.y, region.x + region.width, region.y + region.height].map(f64::from);
            self.extrema.retain(|e| {
                let [x, y] = space.in_picture(e.octave as usize, e.at);
                (left..right).contains(&x) && (top..bottom).contains(&y)
            });
        }
        // The order of places decides between equals.
        self.extrema
            .sort_unstable_by(|a, b| b.response.total_cmp(&a.response).then(a.place().cmp(&b.place())));
        self.extrema.truncate(self.params.budget);
        // Neighbours one after the other, since they read the same pixels.
        self.extrema.sort_unstable_by_key(Extremum::place);
    }

    /// Deviation of an extremum, pixels of its octave.
    fn sigma(&self, e: &Extremum) -> f64 {
        self.params.sigma * math::pow(2.0, f64::from(e.scale) / self.params.layers as f64)
    }

    fn orient(&mut self) {
        let mut directions = core::mem::take(&mut self.directions);
        directions.resize(self.extrema.len(), Directions::default());
        directions.par_iter_mut().zip(&self.extrema).with_min_len(16).for_each(|(directions, e)| {
            let level = &self.space.octaves()[e.octave as usize].levels[e.level as usize];
            *directions = orientation::directions(level, e.pixel, self.sigma(e));
        });
        self.directions = directions;
        self.chosen.clear();
        for (k, found) in (0..).zip(&self.directions) {
            self.chosen.extend(found.radians[..found.count].iter().map(|&angle| (k, angle)));
        }
        let strength = |k: u32| self.extrema[k as usize].response;
        let place = |a: &(u32, f32), b: &(u32, f32)| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1));
        self.chosen.sort_unstable_by(|a, b| strength(b.0).total_cmp(&strength(a.0)).then(place(a, b)));
        self.chosen.truncate(self.params.budget);
        self.chosen.sort_unstable_by(place);
    }

    fn describe(&mut self) {
        self.keypoints.clear();
        for &(k, angle) in &self.chosen {
            let e = &self.extrema[k as usize];
            let spacing = f64::from(self.space.octaves()[e.octave as usize].spacing);
            self.keypoints.push(Keypoint {
                at: self.space.in_picture(e.octave as usize, e.at).into(),
                scale: self.sigma(e) * spacing,
                angle: f64::from(angle),
                response: f64::from(e.response),
                spacing,
            });
        }
        let mut descriptors = core::mem::take(&mut self.descriptors);
        descriptors.resize(self.chosen.len(), Descriptor::default());
        descriptors.par_iter_mut().zip(&self.chosen).with_min_len(16).for_each(
            |(descriptor, &(k, angle))| {
                let e = &self.extrema[k as usize];
                let level = &self.space.octaves()[e.octave as usize].levels[e.level as usize];
                *descriptor = self.pooling.describe(level, e.at, self.sigma(e), angle, self.params.root);
            },
        );
        self.descriptors = descriptors;
    }
}

#[cfg(test)]
mod tests;
