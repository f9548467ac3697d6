//! The simulated camera as a sensor.

use std::collections::BTreeMap;
use std::sync::Arc;

use image::{Luma, Rgb};
use nalgebra::Point3;
use rayon::prelude::*;
use vt_core::agent::Sensor;
use vt_core::error::DeviceError;
use vt_core::frame::{Frame, Payload, SensorId};
use vt_core::lie::SE3;
use vt_core::picture_pool::PicturePool;
use vt_core::random::{Random, Source, Stream};
use vt_core::time::Timestamp;
use vt_models::camera::Camera;

use crate::noise::{Converter, Noise};
use crate::render::Renderer;
use crate::scene::{Body, World};
use crate::texture::Colour;

/// Settings of the sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Number of frames taken; those that are dropped count too.
    pub frames: u64,
    /// Frames per second.
    pub rate: f64,
    /// Part of the time between frames in which the shutter is open, 0 to 1. A frame's time is the middle of it.
    pub exposure: f64,
    /// What the sensor makes of light.
    pub noise: Noise,
    /// Whether frames are colour pictures.
    pub colour: bool,
    /// Share of frames that never arrive, 0 to 1; the first always does.
    pub dropped: f64,
    /// First and last number of runs of frames that never arrive.
    pub gaps: Vec<[u64; 2]>,
    /// Share of frames that show the picture of the frame before, 0 to 1. Number, time and truth are their own.
    pub duplicated: f64,
    /// Seed of noise and losses.
    pub seed: u64,
}

impl Default for Settings {
    /// 100 sharp grey frames at 25 Hz.
    fn default() -> Self {
        Self {
            frames: 100,
            rate: 25.0,
            exposure: 0.0,
            noise: Noise::default(),
            colour: false,
            dropped: 0.0,
            gaps: vec![],
            duplicated: 0.0,
            seed: 0,
        }
    }
}

/// A frame with what is true of it.
#[derive(Clone, Debug)]
pub struct Shot {
    /// The frame.
    pub frame: Frame,
    /// camera_from_object of each object of the world at the frame's time.
    pub poses: Vec<SE3>,
    /// Share of each object's silhouette that the picture shows, 0 to 1.
    pub visible: Vec<f64>,
}

/// More sub-frames are not drawn for one exposure.
const MOST_SUBFRAMES: usize = 32;

/// A camera in a [`World`]; frames count from 0.
pub struct SimulatedCamera {
    id: SensorId,
    world: Arc<World>,
    camera_from_world: SE3,
    renderer: Renderer,
    converter: Converter,
    settings: Settings,
    next: u64,
    last: Option<(Payload, Vec<f64>)>,
    grey: PicturePool<Luma<u8>>,
    rgb: PicturePool<Rgb<u8>>,
}

impl SimulatedCamera {
    /// A camera that stands still in a world.
    pub fn new(
        id: SensorId,
        world: Arc<World>,
        camera: Camera,
        camera_from_world: SE3,
        settings: Settings,
    ) -> Self {
        let (width, height) = camera.size();
        let renderer = Renderer::new(camera, world.background.paint(world.seed, width, height));
        let converter = Converter::new(settings.noise);
        let (last, grey, rgb) = (None, PicturePool::default(), PicturePool::default());
        Self { id, world, camera_from_world, renderer, converter, settings, next: 0, last, grey, rgb }
    }

    /// The world.
    pub fn world(&self) -> &Arc<World> {
        &self.world
    }

    /// The settings.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The camera.
    pub fn camera(&self) -> &Camera {
        self.renderer.camera()
    }

    /// Time of a frame in seconds, the middle of its exposure.
    pub fn time(&self, number: u64) -> f64 {
        number as f64 / self.settings.rate
    }

    /// camera_from_object of an object of the world at time `t`; `None` when there is none of this index.
    pub fn pose(&self, object: usize, t: f64) -> Option<SE3> {
        self.world.objects.get(object).map(|o| self.camera_from_world * o.path.pose(t))
    }

    /// True poses camera_from_object of an object in all frames that arrive, by number.
    pub fn truth(&self, object: usize) -> BTreeMap<u64, SE3> {
        let arriving = (0..self.settings.frames).filter(|&k| self.arrives(k));
        arriving.filter_map(|k| Some((k, self.pose(object, self.time(k))?))).collect()
    }

    /// Times within the exposure of a frame at which views are drawn; their mean is the picture. There are so many that
    /// no object moves by much more than a pixel between them, 32 at the most.
    pub fn subframes(&self, number: u64) -> impl Iterator<Item = f64> + use<> {
        let middle = self.time(number);
        let span = self.settings.exposure / self.settings.rate;
        let motion = (0..self.world.objects.len()).map(|o| self.blur(o, middle, span)).fold(0.0, f64::max);
        let count = if span > 0.0 { (motion.ceil() as usize).clamp(1, MOST_SUBFRAMES) } else { 1 };
        (0..count).map(move |k| middle + span * ((k as f64 + 0.5) / count as f64 - 0.5))
    }

    /// Pixels that the corners of an object's box move during an exposure.
    fn blur(&self, object: usize, middle: f64, span: f64) -> f64 {
        let Some(o) = self.world.objects.get(object).filter(|_| span > 0.0) else { return 0.0 };
        let poses = [-0.5, 0.0, 0.5].map(|k| self.camera_from_world * o.path.pose(middle + k * span));
        let bounds = o.body.mesh().bounds();
        let corner = |k: usize| {
            let side = |a: usize| if k >> a & 1 == 0 { bounds.min[a] } else { bounds.max[a] };
            Point3::new(side(0), side(1), side(2))
        };
        let path = |k: usize| {
            let [a, b, c] = poses.map(|pose| self.camera().without_lens().project(&pose.act(&corner(k))));
            // What is partly behind the camera gets as many views as there may be.
            a.zip(b).zip(c).map_or(f64::INFINITY, |((a, b), c)| (b - a).norm() + (c - b).norm())
        };
        (0..8).map(path).fold(0.0, f64::max)
    }

    /// Random numbers that decide what happens to a frame.
    fn fate(&self, number: u64) -> Random {
        Random::new(self.settings.seed, Stream::Sim, (1 << 32) + u64::from(self.id.0), number, 0)
    }

    fn arrives(&self, number: u64) -> bool {
        let settings = &self.settings;
        let gap = settings.gaps.iter().any(|[first, last]| (*first..=*last).contains(&number));
        number == 0 || !(gap || self.fate(number).uniform() < settings.dropped)
    }

    fn repeats(&self, number: u64) -> bool {
        let mut fate = self.fate(number);
        fate.uniform();
        fate.uniform() < self.settings.duplicated
    }

    /// The next frame that arrives, with what is true of it; `None` after the last.
    pub fn shot(&mut self) -> Option<Shot> {
        while self.next < self.settings.frames {
            let number = self.next;
            self.next += 1;
            if self.arrives(number) {
                return Some(self.take(number));
            }
        }
        None
    }

    fn take(&mut self, number: u64) -> Shot {
        let t = self.time(number);
        let poses = (0..self.world.objects.len()).filter_map(|o| self.pose(o, t)).collect();
        let (payload, visible) = match self.last.take().filter(|_| self.repeats(number)) {
            Some(before) => before,
            None => self.draw(number),
        };
        self.last = (self.settings.duplicated > 0.0).then(|| (payload.clone(), visible.clone()));
        let frame = Frame { sensor: self.id, number, time: Timestamp::from_seconds(t), payload };
        Shot { frame, poses, visible }
    }

    fn draw(&mut self, number: u64) -> (Payload, Vec<f64>) {
        let t = self.time(number);
        let world = self.world.clone();
        // Light changes slowly compared with an exposure.
        let mut light = world.lighting.at(t);
        light.direction = self.camera_from_world.rotation * light.direction;
        self.renderer.start();
        for at in self.subframes(number) {
            let bodies: Vec<(&Body, SE3)> =
                world.objects.iter().map(|o| (&o.body, self.camera_from_world * o.path.pose(at))).collect();
            self.renderer.add(&bodies, &light);
        }
        let visible = self.renderer.visible().collect();
        let Self { renderer, converter, settings, id, grey, rgb, .. } = self;
        let (view, size) =
            (Exposed { renderer, converter, world: &world, t }, renderer.camera().size().into());
        let payload = if settings.colour {
            Payload::Rgb(
                rgb.picture(size, |bytes| view.develop::<3>(bytes, settings.seed, *id, number, |c, k| c[k])),
            )
        } else {
            Payload::Grey(
                grey.picture(size, |bytes| {
                    view.develop::<1>(bytes, settings.seed, *id, number, |c, _| luma(c))
                }),
            )
        };
        (payload, visible)
    }
}

/// A view that was drawn, before it becomes bytes.
struct Exposed<'a> {
    renderer: &'a Renderer,
    converter: &'a Converter,
    world: &'a World,
    t: f64,
}

impl Exposed<'_> {
    fn develop<const CHANNELS: usize>(
        &self,
        bytes: &mut [u8],
        seed: u64,
        id: SensorId,
        number: u64,
        channel: impl Fn(&Colour, usize) -> f32 + Sync,
    ) {
        let (width, height) = self.renderer.camera().size();
        let source = Source::new(seed, Stream::Sim, 2 + u64::from(id.0));
        let gain = self.world.lighting.gain(self.t);
        let band = self.world.lighting.shadow.map(|s| s.at(self.t, width, height));
        let rows = bytes.par_chunks_mut(width as usize * CHANNELS);
        rows.zip(self.renderer.rows()).enumerate().for_each(|(y, (out, row))| {
            let light = |k: usize| {
                let x = k / CHANNELS;
                let gain = band.as_ref().map_or(gain, |b| gain * b.light(x, y));
                gain * channel(&row.at(x), k % CHANNELS)
            };
            self.converter.convert(light, out, &mut source.at(number, y as u32));
        });
    }
}

impl Sensor for SimulatedCamera {
    fn next(&mut self) -> Result<Option<Frame>, DeviceError> {
        Ok(self.shot().map(|s| s.frame))
    }

    fn remaining(&self) -> Option<usize> {
        Some((self.next..self.settings.frames).filter(|&k| self.arrives(k)).count())
    }
}

/// Luma weights of ITU-R BT.709.
pub(crate) fn luma([r, g, b]: &Colour) -> f32 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

#[cfg(test)]
mod tests;
