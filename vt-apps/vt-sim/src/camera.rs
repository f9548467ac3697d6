//! The simulated camera as a sensor.

use std::collections::BTreeMap;
use std::sync::Arc;

use image::{GrayImage, RgbImage};
use rayon::prelude::*;
use vt_core::agent::Sensor;
use vt_core::error::DeviceError;
use vt_core::frame::{Frame, Payload, SensorId};
use vt_core::lie::SE3;
use vt_core::random::{Source, Stream};
use vt_core::time::Timestamp;

use crate::path::SmoothPath;
use crate::scene::Scene;
use crate::texture::Colour;

/// Settings of the sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Number of frames.
    pub frames: u64,
    /// Frames per second.
    pub rate: f64,
    /// Standard deviation of the sensor's noise in grey levels of 255.
    pub noise: f64,
    /// Whether frames are colour pictures.
    pub colour: bool,
    /// Seed of the noise.
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self { frames: 100, rate: 25.0, noise: 2.0, colour: false, seed: 0 }
    }
}

/// A camera that sees a [`Scene`] along a [`SmoothPath`]; frames count from 0.
pub struct SimulatedCamera {
    id: SensorId,
    scene: Scene,
    path: SmoothPath,
    settings: Settings,
    next: u64,
}

impl SimulatedCamera {
    /// A camera that sees this scene.
    pub fn new(id: SensorId, scene: Scene, path: SmoothPath, settings: Settings) -> Self {
        Self { id, scene, path, settings, next: 0 }
    }

    /// True poses camera_from_object of all frames by number.
    pub fn truth(&self) -> BTreeMap<u64, SE3> {
        (0..self.settings.frames).map(|k| (k, self.path.pose(k as f64 / self.settings.rate))).collect()
    }
}

impl Sensor for SimulatedCamera {
    fn next(&mut self) -> Result<Option<Frame>, DeviceError> {
        let (number, settings) = (self.next, self.settings);
        if number >= settings.frames {
            return Ok(None);
        }
        self.next += 1;
        let t = number as f64 / settings.rate;
        let (width, height) = self.scene.camera().size();
        let linear = self.scene.draw(&self.path.pose(t));
        let channels = if settings.colour { 3 } else { 1 };
        let mut bytes = vec![0_u8; linear.len() * channels];
        let noise = Source::new(settings.seed, Stream::Sim, 2 + u64::from(self.id.0));
        let stride = width as usize * channels;
        bytes.par_chunks_mut(stride).zip(linear.par_chunks(width as usize)).enumerate().for_each(
            |(y, (out, row))| {
                let mut random = noise.at(number, y as u32);
                for (pixel, colour) in out.chunks_mut(channels).zip(row) {
                    for (k, value) in pixel.iter_mut().enumerate() {
                        let light = if channels == 3 { colour[k] } else { grey(*colour) };
                        let noise = if settings.noise > 0.0 { settings.noise * random.normal() } else { 0.0 };
                        *value = (255.0 * f64::from(light) + noise).round().clamp(0.0, 255.0) as u8;
                    }
                }
            },
        );
        let wrong = || DeviceError::new("simulated camera", "picture size does not fit its bytes");
        let payload = if settings.colour {
            Payload::Rgb(Arc::new(RgbImage::from_raw(width, height, bytes).ok_or_else(wrong)?))
        } else {
            Payload::Grey(Arc::new(GrayImage::from_raw(width, height, bytes).ok_or_else(wrong)?))
        };
        Ok(Some(Frame { sensor: self.id, number, time: Timestamp::from_seconds(t), payload }))
    }

    fn remaining(&self) -> Option<usize> {
        usize::try_from(self.settings.frames - self.next).ok()
    }
}

/// Luma weights of ITU-R BT.709.
fn grey([r, g, b]: Colour) -> f32 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bracket::bracket;
    use nalgebra::Vector3;
    use vt_models::camera::Camera;

    fn camera(noise: f64, seed: u64, colour: bool) -> SimulatedCamera {
        let camera = Camera::new(120.0, 120.0, 63.5, 47.5, 128, 96).unwrap();
        let start = SE3::from_rotation_vector(&Vector3::new(2.4, 0.5, 0.2), Vector3::new(0.0, 0.0, 0.25));
        let path = SmoothPath { start, translation: [0.02; 3], rotation: [0.2; 3], period: 4.0 };
        let settings = Settings { frames: 3, noise, seed, colour, ..Settings::default() };
        SimulatedCamera::new(SensorId(0), Scene::new(bracket(0.04), camera, 5), path, settings)
    }

    fn bytes(mut c: SimulatedCamera) -> Vec<u8> {
        let frames = std::iter::from_fn(|| c.next().unwrap());
        frames.flat_map(|f| f.grey().unwrap().clone().into_raw()).collect()
    }

    #[test]
    fn pictures_are_the_same_at_any_number_of_threads() {
        let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let many = rayon::ThreadPoolBuilder::new().num_threads(4).build().unwrap();
        let a = alone.install(|| bytes(camera(3.0, 7, false)));
        assert_eq!(a, many.install(|| bytes(camera(3.0, 7, false))));
        assert_ne!(a, bytes(camera(3.0, 8, false)));
    }

    #[test]
    fn noise_has_the_deviation_that_was_asked_for() {
        let (clean, noisy) = (bytes(camera(0.0, 0, false)), bytes(camera(4.0, 0, false)));
        let d: Vec<f64> = clean
            .iter()
            .zip(&noisy)
            .filter(|(c, _)| (20..235).contains(*c))
            .map(|(c, n)| f64::from(*n) - f64::from(*c))
            .collect();
        let mean = d.iter().sum::<f64>() / d.len() as f64;
        let deviation = (d.iter().map(|v| v * v).sum::<f64>() / d.len() as f64).sqrt();
        assert!(mean.abs() < 0.1 && (deviation - 4.0).abs() < 0.1, "{mean} {deviation}");
    }

    #[test]
    fn colour_frames_truth_and_count() {
        let mut c = camera(1.0, 0, true);
        assert_eq!(c.remaining(), Some(3));
        assert_eq!(c.next().unwrap().unwrap().rgb().unwrap().dimensions(), (128, 96));
        assert_eq!((c.truth().len(), c.truth()[&0]), (3, c.path.start));
        assert_eq!(std::iter::from_fn(|| c.next().unwrap()).count(), 2);
    }
}
