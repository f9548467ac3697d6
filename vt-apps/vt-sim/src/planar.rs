//! A flat shape that wanders over a cluttered background: the simulated scene of planar targets.
//!
//! The background is a "dead leaves" picture (G. Matheron, 1968): opaque polygons on top of each other, in a few grey
//! levels, as many as give the wanted number of edges per pixel of a straight line. The shape is brighter than all of them by a given contrast, or a
//! patchwork of strong colours. What is true of a frame is exact.

mod leaves;
mod polygon;

use std::collections::BTreeMap;

use image::{Luma, Rgb};
use nalgebra::Point2;
use rayon::prelude::*;
use vt_core::agent::Sensor;
use vt_core::error::{ConfigError, DeviceError};
use vt_core::frame::{Frame, Payload, SensorId};
use vt_core::lie::{LieGroup, Sim2};
use vt_core::math;
use vt_core::metrics::Rectangle;
use vt_core::picture_pool::PicturePool;
use vt_core::random::{Random, Source, Stream};
use vt_core::time::Timestamp;
use vt_models::outline::Outline;

use crate::camera::luma;
use crate::noise::{Converter, Noise};
use crate::texture::Colour;
use leaves::{BRIGHT, LEVELS, dead_leaves, tinted};
use polygon::Brush;

/// Deviations of the steps of a random walk from frame to frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Walk {
    /// Of each coordinate of the position, pixels.
    pub translation: f64,
    /// Of the angle, radians.
    pub rotation: f64,
    /// Of the logarithm of the scale.
    pub scale: f64,
}

/// What the inside of the shape looks like.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fill {
    /// One grey level, above that of the whole background.
    Plain,
    /// Patches of so many strong colours, at hues that lie equally far apart.
    Patches(u32),
}

/// Settings of a planar scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Columns and rows.
    pub size: [u32; 2],
    /// Number of frames.
    pub frames: u64,
    /// Frames per second.
    pub rate: f64,
    /// Motion.
    pub walk: Walk,
    /// Inside of the shape.
    pub fill: Fill,
    /// Least difference of a plain shape to the background in grey levels of 255, up to 180.
    pub contrast: f64,
    /// Edges of the background per pixel of a straight line, up to 0.5.
    pub clutter: f64,
    /// First and last number of runs of frames in which the shape is hidden behind another piece of background.
    pub occlusions: Vec<[u64; 2]>,
    /// What the sensor makes of light.
    pub noise: Noise,
    /// Whether frames are colour pictures and the background has weak colours.
    pub colour: bool,
    /// Seed of everything.
    pub seed: u64,
}

impl Default for Settings {
    /// 300 grey frames of 640 × 480 pixels at 25 Hz; steps of 4 px, 2°, 1 %; contrast 25; 0.02 edges per pixel.
    fn default() -> Self {
        Self {
            size: [640, 480],
            frames: 300,
            rate: 25.0,
            walk: Walk { translation: 4.0, rotation: 2_f64.to_radians(), scale: 0.01 },
            fill: Fill::Plain,
            contrast: 25.0,
            clutter: 0.02,
            occlusions: vec![],
            noise: Noise::default(),
            colour: false,
            seed: 0,
        }
    }
}

/// Scales that the walk keeps within.
const SCALES: [f64; 2] = [0.6, 1.6];

/// Steps that are drawn until one keeps the shape in the picture; then it stays.
const TRIES: usize = 1000;

/// Pixels that the shape keeps from the border.
const BORDER: f64 = 2.0;

/// Most frames and most pixels.
const MOST_FRAMES: u64 = 1_000_000;
const MOST_PIXELS: u64 = 1 << 26;

/// The scene as a sensor; frames count from 0.
pub struct PlanarCamera {
    id: SensorId,
    outline: Outline,
    settings: Settings,
    poses: Vec<Sim2>,
    background: Vec<Colour>,
    cover: Vec<Colour>,
    /// Places in the shape with the colour that all points nearest to them have.
    patches: Vec<(Point2<f64>, Colour)>,
    converter: Converter,
    source: Source,
    light: Vec<Colour>,
    brush: Brush,
    /// The outline's image.
    image: Vec<Vec<Point2<f64>>>,
    grey: PicturePool<Luma<u8>>,
    rgb: PicturePool<Rgb<u8>>,
    next: u64,
}

impl PlanarCamera {
    /// A shape, in pixels at scale 1, that starts in the middle of the picture, upright.
    ///
    /// # Errors
    /// [`ConfigError`] when a setting is out of its range, or the shape does not fit into the picture.
    pub fn new(id: SensorId, outline: Outline, settings: Settings) -> Result<Self, ConfigError> {
        check(&settings)?;
        let poses = wander(&outline, &settings)?;
        let [w, h] = settings.size.map(|n| n as usize);
        let picture = |layer| dead_leaves([w, h], &settings, layer);
        let (background, cover) = (picture(0), picture(1));
        let patches = patches(&outline, &settings);
        let converter = Converter::new(settings.noise);
        let source = Source::new(settings.seed, Stream::Sim, (3 << 32) + u64::from(id.0));
        let (light, brush) = (Vec::with_capacity(w * h), Brush::default());
        let (image, grey, rgb) = (outline.loops().to_vec(), PicturePool::default(), PicturePool::default());
        Ok(Self {
            id,
            outline,
            settings,
            poses,
            background,
            cover,
            patches,
            converter,
            source,
            light,
            brush,
            image,
            grey,
            rgb,
            next: 0,
        })
    }

    /// The settings.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The shape.
    pub fn outline(&self) -> &Outline {
        &self.outline
    }

    /// True poses by the frame's number: points of the shape to pixels, whole numbers at pixel centres.
    pub fn truth(&self) -> BTreeMap<u64, Sim2> {
        (0..).zip(self.poses.iter().copied()).collect()
    }

    /// Images of the corners of the shape's own bounds in a frame, in order around them.
    pub fn corners(&self, number: u64) -> Option<[Point2<f64>; 4]> {
        let [a, b] = self.outline.bounds();
        let pose = self.poses.get(usize::try_from(number).ok()?)?;
        Some([a, Point2::new(b.x, a.y), b, Point2::new(a.x, b.y)].map(|p| pose.act(&p)))
    }

    /// The upright box around the shape's image in a frame, in coordinates of pixel centres.
    pub fn bounds(&self, number: u64) -> Option<Rectangle> {
        let pose = self.poses.get(usize::try_from(number).ok()?)?;
        let mut points = self.outline.loops().iter().flatten().map(|p| pose.act(p));
        let first = points.next()?;
        let (low, high) = points.fold((first, first), |(a, b), p| (a.inf(&p), b.sup(&p)));
        Some(Rectangle { x: low.x, y: low.y, width: high.x - low.x, height: high.y - low.y })
    }

    /// Whether the shape is seen in a frame.
    pub fn visible(&self, number: u64) -> bool {
        !self.settings.occlusions.iter().any(|[first, last]| (*first..=*last).contains(&number))
    }

    fn draw(&mut self, number: u64) {
        let Some(pose) = self.poses.get(number as usize).copied() else { return };
        let [w, h] = self.settings.size.map(|n| n as usize);
        self.light.clone_from(&self.background);
        let hidden = self.bounds(number).filter(|_| !self.visible(number));
        let Self { outline, light, brush, image, patches, cover, .. } = self;
        for (image, points) in image.iter_mut().zip(outline.loops()) {
            image.clear();
            image.extend(points.iter().map(|p| pose.act(p)));
        }
        let inverse = pose.inverse();
        brush.fill(image, [w, h], |x, y, share| {
            let at = inverse.act(&Point2::new(x as f64, y as f64));
            let squared = |p: &(Point2<f64>, Colour)| (p.0 - at).norm_squared();
            let nearest = patches.iter().min_by(|a, b| squared(a).total_cmp(&squared(b)));
            let colour = nearest.map_or([BRIGHT; 3], |p| p.1);
            polygon::blend(&mut light[y * w + x], &colour, share);
        });
        if let Some(hidden) = hidden {
            let margin = 0.1 * hidden.width.max(hidden.height);
            let (left, right) = (hidden.x - margin, hidden.x + hidden.width + margin);
            let (top, bottom) = (hidden.y - margin, hidden.y + hidden.height + margin);
            let corners = [(left, top), (right, top), (right, bottom), (left, bottom)];
            brush.fill(&[corners.map(|(x, y)| Point2::new(x, y))], [w, h], |x, y, share| {
                polygon::blend(&mut light[y * w + x], &cover[y * w + x], share);
            });
        }
    }
}

impl Sensor for PlanarCamera {
    fn next(&mut self) -> Result<Option<Frame>, DeviceError> {
        if self.next >= self.settings.frames {
            return Ok(None);
        }
        let number = self.next;
        self.next += 1;
        self.draw(number);
        let Self { settings, light, converter, source, grey, rgb, .. } = self;
        let view = Light { converter, light, width: settings.size[0] as usize, source, number };
        let payload = if settings.colour {
            Payload::Rgb(rgb.picture(settings.size, |bytes| view.develop::<3>(bytes, |c, k| c[k])))
        } else {
            Payload::Grey(grey.picture(settings.size, |bytes| view.develop::<1>(bytes, |c, _| luma(c))))
        };
        let time = Timestamp::from_seconds(number as f64 / self.settings.rate);
        Ok(Some(Frame { sensor: self.id, number, time, payload }))
    }

    fn remaining(&self) -> Option<usize> {
        Some((self.settings.frames - self.next) as usize)
    }
}

/// What was drawn of a frame, before it becomes bytes.
struct Light<'a> {
    converter: &'a Converter,
    light: &'a [Colour],
    width: usize,
    source: &'a Source,
    number: u64,
}

impl Light<'_> {
    fn develop<const CHANNELS: usize>(&self, bytes: &mut [u8], channel: fn(&Colour, usize) -> f32) {
        let rows = bytes.par_chunks_mut(self.width * CHANNELS).zip(self.light.par_chunks(self.width));
        rows.enumerate().for_each(|(y, (out, row))| {
            let light = |k: usize| channel(&row[k / CHANNELS], k % CHANNELS);
            self.converter.convert(light, out, &mut self.source.at(self.number, y as u32));
        });
    }
}

fn check(s: &Settings) -> Result<(), ConfigError> {
    let range = |key, value: f64, low: f64, high: f64| match value >= low && value <= high {
        true => Ok(()),
        false => Err(ConfigError::parameter(key, value, format!("a number from {low} to {high}"))),
    };
    let pixels = u64::from(s.size[0]) * u64::from(s.size[1]);
    if pixels == 0 || pixels > MOST_PIXELS {
        return Err(ConfigError::parameter(
            "size",
            format!("{:?}", s.size),
            "columns and rows, up to 64 megapixels",
        ));
    }
    range("frames", s.frames as f64, 1.0, MOST_FRAMES as f64)?;
    range("rate", s.rate, 1e-6, 1e6)?;
    range("walk.translation", s.walk.translation, 0.0, 1e4)?;
    range("walk.rotation", s.walk.rotation, 0.0, 10.0)?;
    range("walk.scale", s.walk.scale, 0.0, 1.0)?;
    range("contrast", s.contrast, 0.0, 180.0)?;
    range("clutter", s.clutter, 0.0, 0.5)?;
    if let Fill::Patches(n) = s.fill {
        range("patches", f64::from(n), 1.0, 100.0)?;
    }
    Ok(())
}

/// A random walk that keeps the shape in the picture: steps that would not are drawn again.
fn wander(outline: &Outline, s: &Settings) -> Result<Vec<Sim2>, ConfigError> {
    let [w, h] = s.size.map(f64::from);
    let within = |pose: &Sim2| {
        let inside = |p: Point2<f64>| {
            p.x >= BORDER && p.y >= BORDER && p.x <= w - 1.0 - BORDER && p.y <= h - 1.0 - BORDER
        };
        let scaled = pose.scale >= SCALES[0] && pose.scale <= SCALES[1];
        scaled && outline.loops().iter().flatten().all(|p| inside(pose.act(p)))
    };
    let mut pose = Sim2::new(0.5 * (w - 1.0), 0.5 * (h - 1.0), 0.0, 1.0);
    if !within(&pose) {
        let [a, b] = outline.bounds();
        let found = format!("a shape from ({:.0}, {:.0}) to ({:.0}, {:.0})", a.x, a.y, b.x, b.y);
        let expected = format!("one about its origin that fits into {w}x{h} pixels");
        return Err(ConfigError::Mismatch { found, expected });
    }
    let mut poses = vec![pose];
    for number in 1..s.frames {
        let random = &mut Random::new(s.seed, Stream::Sim, 4 << 32, number, 0);
        let mut step = || {
            let position = [0, 1].map(|k| pose.translation[k] + s.walk.translation * random.normal());
            let angle = pose.angle() + s.walk.rotation * random.normal();
            let scale = pose.scale * math::exp(s.walk.scale * random.normal());
            Sim2::new(position[0], position[1], angle, scale)
        };
        pose = (0..TRIES).map(|_| step()).find(within).unwrap_or(pose);
        poses.push(pose);
    }
    Ok(poses)
}

/// Four patches a colour, anywhere in the shape's bounds.
fn patches(outline: &Outline, s: &Settings) -> Vec<(Point2<f64>, Colour)> {
    let Fill::Patches(count) = s.fill else { return vec![] };
    let random = &mut Random::new(s.seed, Stream::Sim, 5 << 32, 0, 0);
    let first = random.uniform();
    let [a, b] = outline.bounds();
    let place = |k: u32| {
        let at = Point2::new(a.x + (b.x - a.x) * random.uniform(), a.y + (b.y - a.y) * random.uniform());
        (at, tinted(0.5, first + f64::from(k % count) / f64::from(count), 0.45))
    };
    (0..4 * count).map(place).collect()
}

/// Levels of the background of these settings, from dark to bright, 0 to 1.
pub fn background_levels(settings: &Settings) -> [f64; LEVELS] {
    leaves::levels(settings.contrast)
}

#[cfg(test)]
mod tests;
