//! A flat shape that wanders over a background, as an uncalibrated camera sees it: the scene of the paper's
//! two-dimensional trackers.

use core::ops::Range;
use std::sync::Arc;

use image::{GrayImage, RgbImage};
use nalgebra::{Point2, Vector4};
use vt_core::agent::Sensor;
use vt_core::error::DeviceError;
use vt_core::frame::{Frame, Payload, SensorId};
use vt_core::lie::{LieGroup, Sim2};
use vt_core::random::{Random, Source, Stream};
use vt_core::time::Timestamp;

use crate::backdrop::Background;
use crate::camera::luma;
use crate::noise::{Converter, Noise};
use crate::texture::Colour;

/// What is seen and how.
#[derive(Clone, Debug)]
pub struct PlanarScene {
    /// Closed polygons in the units of the shape; what lies inside an odd number of them is filled.
    pub loops: Vec<Vec<Point2<f64>>>,
    /// Colours of the shape, 0 to 1, by rows of equal cells.
    pub colours: Vec<Colour>,
    /// Cells in a row, at least 1.
    pub columns: u32,
    /// Picture of the shape's start, `picture_from_shape`, pixels.
    pub start: Sim2,
    /// Deviations of its steps: x, y (pixels), angle (radians), logarithm of the scale.
    pub step: Vector4<f64>,
    /// The shape's origin stays so far from the picture's border, pixels, and its scale within a factor of 1.5 of that of the
    /// start: steps that would leave are reflected.
    pub margin: f64,
    /// What is behind it.
    pub background: Background,
    /// Width and height of the picture.
    pub size: [u32; 2],
    /// Number of frames.
    pub frames: u64,
    /// Frames per second.
    pub rate: f64,
    /// Frames in which the shape is behind the background.
    pub hidden: Vec<Range<u64>>,
    /// What the sensor makes of light.
    pub noise: Noise,
    /// Whether frames are colour pictures.
    pub colour: bool,
    /// Seed of motion, background and noise.
    pub seed: u64,
}

/// Largest factor between the scale and that of the start.
const GROWTH: f64 = 1.5;

/// Lines of sub-pixels a row.
const LINES: usize = 4;

impl PlanarScene {
    /// True poses of all frames.
    pub fn poses(&self) -> Vec<Sim2> {
        let mut random = Random::new(self.seed, Stream::Sim, 3 << 32, 0, 0);
        let mut pose = self.start;
        let borders = self.size.map(|n| [self.margin, f64::from(n) - 1.0 - self.margin]);
        let scales = [self.start.scale / GROWTH, self.start.scale * GROWTH].map(vt_core::math::ln);
        let mut out = Vec::with_capacity(self.frames as usize);
        for _ in 0..self.frames {
            out.push(pose);
            let d = self.step.map(|s| s * random.normal());
            let x = reflected(pose.translation.x + d.x, borders[0]);
            let y = reflected(pose.translation.y + d.y, borders[1]);
            let scale = reflected(vt_core::math::ln(pose.scale) + d.w, scales);
            pose = Sim2::new(x, y, pose.angle() + d.z, vt_core::math::exp(scale));
        }
        out
    }

    /// The scene as a sensor.
    pub fn sensor(self, id: SensorId) -> PlanarCamera {
        let [width, height] = self.size;
        let background = self.background.paint(self.seed, width, height);
        PlanarCamera {
            id,
            poses: self.poses(),
            light: background.clone(),
            background,
            converter: Converter::new(self.noise),
            cover: vec![0.0; width as usize],
            next: 0,
            scene: self,
        }
    }
}

/// A value that left an interval by less than its width, reflected at the border.
fn reflected(v: f64, [low, high]: [f64; 2]) -> f64 {
    let inside = if v < low { 2.0 * low - v } else { v };
    let inside = if inside > high { 2.0 * high - inside } else { inside };
    // An interval without width leaves one value.
    inside.clamp(low.min(high), high.max(low))
}

/// A [`PlanarScene`] that is filmed; frames count from 0.
pub struct PlanarCamera {
    id: SensorId,
    scene: PlanarScene,
    poses: Vec<Sim2>,
    background: Vec<Colour>,
    light: Vec<Colour>,
    converter: Converter,
    cover: Vec<f32>,
    next: u64,
}

impl PlanarCamera {
    /// True poses `picture_from_shape` by frame.
    pub fn poses(&self) -> &[Sim2] {
        &self.poses
    }

    /// Draws the shape at a pose over the background.
    fn draw(&mut self, pose: &Sim2) {
        let scene = &self.scene;
        let loops: Vec<Vec<Point2<f64>>> =
            scene.loops.iter().map(|l| l.iter().map(|p| pose.act(p)).collect()).collect();
        let none = Point2::new(f64::INFINITY, f64::INFINITY);
        let (low, high) = scene.loops.iter().flatten().fold((none, -none), |(a, b), p| (a.inf(p), b.sup(p)));
        let columns = (scene.columns.max(1) as usize).min(scene.colours.len().max(1));
        let rows = scene.colours.len() / columns;
        let inverse = pose.inverse();
        let width = scene.size[0] as usize;
        let mut crossings = vec![];
        for (y, row) in self.light.chunks_exact_mut(width).enumerate() {
            self.cover.fill(0.0);
            let mut any = false;
            for line in 0..LINES {
                let at = y as f64 - 0.5 + (line as f64 + 0.5) / LINES as f64;
                crossings.clear();
                for l in &loops {
                    let next = l.iter().cycle().skip(1);
                    let crossed = l.iter().zip(next).filter(|(a, b)| (a.y > at) != (b.y > at));
                    crossings.extend(crossed.map(|(a, b)| a.x + (b.x - a.x) * (at - a.y) / (b.y - a.y)));
                }
                crossings.sort_unstable_by(f64::total_cmp);
                for span in crossings.chunks_exact(2) {
                    any = true;
                    cover(&mut self.cover, [span[0] + 0.5, span[1] + 0.5], 1.0 / LINES as f32);
                }
            }
            if !any {
                continue;
            }
            for (x, (pixel, share)) in
                row.iter_mut().zip(&self.cover).enumerate().filter(|(_, (_, c))| **c > 0.0)
            {
                let in_shape = inverse.act(&Point2::new(x as f64, y as f64));
                let part = (in_shape - low).component_div(&(high - low));
                let cell =
                    |part: f64, n: usize| ((part.max(0.0) * n as f64) as usize).min(n.saturating_sub(1));
                let index = cell(part.y, rows) * columns + cell(part.x, columns);
                let Some(colour) = scene.colours.get(index) else { continue };
                *pixel = core::array::from_fn(|k| pixel[k] + share * (colour[k] - pixel[k]));
            }
        }
    }

    fn develop<const CHANNELS: usize>(
        &self,
        number: u64,
        channel: impl Fn(&Colour, usize) -> f32,
    ) -> Vec<u8> {
        let [width, height] = self.scene.size.map(|n| n as usize);
        let source = Source::new(self.scene.seed, Stream::Sim, 2 + u64::from(self.id.0));
        let mut bytes = vec![0; width * height * CHANNELS];
        let rows = bytes.chunks_exact_mut(width * CHANNELS).zip(self.light.chunks_exact(width));
        for (y, (out, row)) in rows.enumerate() {
            let light = |k: usize| channel(&row[k / CHANNELS], k % CHANNELS);
            self.converter.convert(light, out, &mut source.at(number, y as u32));
        }
        bytes
    }
}

/// Adds `weight` times the share of each pixel that an interval covers; pixel `k` is the interval from `k` to `k + 1`.
fn cover(pixels: &mut [f32], [from, to]: [f64; 2], weight: f32) {
    let (from, to) = (from.max(0.0), to.min(pixels.len() as f64));
    if !(from < to) {
        return;
    }
    let (first, last) = (from as usize, (to.ceil() as usize).min(pixels.len()));
    for (k, pixel) in pixels[..last].iter_mut().enumerate().skip(first) {
        let share = to.min(k as f64 + 1.0) - from.max(k as f64);
        *pixel += weight * share as f32;
    }
}

impl Sensor for PlanarCamera {
    fn next(&mut self) -> Result<Option<Frame>, DeviceError> {
        let number = self.next;
        let Some(pose) = self.poses.get(number as usize).copied() else { return Ok(None) };
        self.next += 1;
        self.light.copy_from_slice(&self.background);
        if !self.scene.hidden.iter().any(|range| range.contains(&number)) {
            self.draw(&pose);
        }
        let [width, height] = self.scene.size;
        let fail = || DeviceError::new("simulated picture", "its size does not fit its bytes");
        let payload = if self.scene.colour {
            let bytes = self.develop::<3>(number, |c, k| c[k]);
            Payload::Rgb(Arc::new(RgbImage::from_raw(width, height, bytes).ok_or_else(fail)?))
        } else {
            let bytes = self.develop::<1>(number, |c, _| luma(c));
            Payload::Grey(Arc::new(GrayImage::from_raw(width, height, bytes).ok_or_else(fail)?))
        };
        let time = Timestamp::from_seconds(number as f64 / self.scene.rate);
        Ok(Some(Frame { sensor: self.id, number, time, payload }))
    }

    fn remaining(&self) -> Option<usize> {
        Some((self.scene.frames - self.next) as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene() -> PlanarScene {
        let corners = [[-20.0, -10.0], [20.0, -10.0], [20.0, 10.0], [-20.0, 10.0]];
        PlanarScene {
            loops: vec![corners.map(Point2::from).to_vec()],
            colours: vec![[1.0; 3]],
            columns: 1,
            start: Sim2::new(60.25, 40.0, 0.3, 1.1),
            step: Vector4::new(4.0, 4.0, 0.03, 0.01),
            margin: 30.0,
            background: Background::Plain(0.0),
            size: [160, 120],
            frames: 40,
            rate: 25.0,
            hidden: vec![5..7],
            noise: Noise { gaussian: 0.0, ..Noise::default() },
            colour: false,
            seed: 3,
        }
    }

    /// Area and centre of what is bright.
    fn moments(frame: &Frame) -> (f64, Point2<f64>) {
        let Payload::Grey(picture) = &frame.payload else { panic!("grey") };
        let (mut area, mut sum) = (0.0, [0.0; 2]);
        for (x, y, p) in picture.enumerate_pixels() {
            let w = f64::from(p.0[0]) / 255.0;
            area += w;
            sum[0] += w * f64::from(x);
            sum[1] += w * f64::from(y);
        }
        (area, Point2::new(sum[0] / area, sum[1] / area))
    }

    #[test]
    fn the_shape_is_where_its_truth_says_and_nowhere_when_hidden() {
        let mut camera = scene().sensor(SensorId(0));
        let poses = camera.poses().to_vec();
        assert_eq!(poses, scene().poses());
        for (k, pose) in poses.iter().enumerate() {
            let (area, centre) = moments(&camera.next().unwrap().unwrap());
            if (5..7).contains(&k) {
                assert_eq!(area, 0.0);
                continue;
            }
            let expected = 40.0 * 20.0 * pose.scale * pose.scale;
            assert!((area / expected - 1.0).abs() < 0.01, "{area} for {expected}");
            assert!((centre.coords - pose.translation).norm() < 0.05, "{centre} for {}", pose.translation);
            for (v, n) in [(pose.translation.x, 160.0), (pose.translation.y, 120.0)] {
                assert!((30.0..=n - 31.0).contains(&v));
            }
        }
        assert!(camera.next().unwrap().is_none());
    }

    #[test]
    fn cells_have_their_colours() {
        let colours = vec![[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0, 0.0]];
        let upright = Sim2::new(60.0, 40.0, 0.0, 1.0);
        let mut camera =
            PlanarScene { colours, columns: 2, start: upright, colour: true, ..scene() }.sensor(SensorId(0));
        let Payload::Rgb(picture) = camera.next().unwrap().unwrap().payload else { panic!("colour") };
        assert_eq!(picture.get_pixel(50, 35).0, [255, 0, 0]);
        assert_eq!(picture.get_pixel(70, 35).0, [0, 255, 0]);
        assert_eq!(picture.get_pixel(50, 45).0, [0, 0, 255]);
        assert_eq!(picture.get_pixel(70, 45).0, [255, 255, 0]);
        assert_eq!(picture.get_pixel(60, 60).0, [0; 3]);
    }
}
