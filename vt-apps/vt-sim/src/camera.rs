//! The simulated camera as a sensor.

use std::collections::BTreeMap;
use std::sync::Arc;

use image::{ImageBuffer, Luma, Pixel, Rgb};
use nalgebra::Point3;
use rayon::prelude::*;
use vt_core::agent::Sensor;
use vt_core::error::DeviceError;
use vt_core::frame::{Frame, Payload, SensorId};
use vt_core::lie::SE3;
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
    grey: Pool<Luma<u8>>,
    rgb: Pool<Rgb<u8>>,
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
        let (last, grey, rgb) = (None, Pool(vec![]), Pool(vec![]));
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
        let payload = if self.settings.colour {
            let Self { renderer, converter, rgb, .. } = self;
            let view = Exposed { renderer, converter, world: &world, t };
            Payload::Rgb(rgb.picture(renderer.camera(), |bytes| {
                view.develop(bytes, self.settings.seed, self.id, number, 3, |c, k| c[k]);
            }))
        } else {
            let Self { renderer, converter, grey, .. } = self;
            let view = Exposed { renderer, converter, world: &world, t };
            Payload::Grey(grey.picture(renderer.camera(), |bytes| {
                view.develop(bytes, self.settings.seed, self.id, number, 1, |c, _| luma(c));
            }))
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
    fn develop(
        &self,
        bytes: &mut [u8],
        seed: u64,
        id: SensorId,
        number: u64,
        channels: usize,
        channel: impl Fn(&Colour, usize) -> f32 + Sync,
    ) {
        let (width, height) = self.renderer.camera().size();
        let source = Source::new(seed, Stream::Sim, 2 + u64::from(id.0));
        let gain = self.world.lighting.gain(self.t);
        let band = self.world.lighting.shadow.map(|s| s.at(self.t, width, height));
        let rows = bytes.par_chunks_mut(width as usize * channels);
        rows.zip(self.renderer.mean()).enumerate().for_each(|(y, (out, row))| {
            let light = row.enumerate().flat_map(|(x, colour)| {
                let gain = band.as_ref().map_or(gain, |b| gain * b.light(x, y));
                let channel = &channel;
                (0..channels).map(move |k| gain * channel(&colour, k))
            });
            self.converter.convert(light, out, &mut source.at(number, y as u32));
        });
    }
}

/// Pictures that are used again when nobody else holds them any more.
struct Pool<P: Pixel<Subpixel = u8>>(Vec<Arc<ImageBuffer<P, Vec<u8>>>>);

impl<P: Pixel<Subpixel = u8>> Pool<P> {
    /// Pictures kept.
    const SIZE: usize = 4;

    fn picture(&mut self, camera: &Camera, fill: impl FnOnce(&mut [u8])) -> Arc<ImageBuffer<P, Vec<u8>>> {
        let (width, height) = camera.size();
        let free = self.0.iter().position(|p| Arc::strong_count(p) == 1);
        let mut picture = match free {
            Some(k) => self.0.swap_remove(k),
            None => Arc::new(ImageBuffer::new(width, height)),
        };
        if let Some(picture) = Arc::get_mut(&mut picture) {
            fill(picture);
        }
        if self.0.len() < Self::SIZE {
            self.0.push(picture.clone());
        }
        picture
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
fn luma([r, g, b]: &Colour) -> f32 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backdrop::{Background, Clutter};
    use crate::bodies::{cuboid, house};
    use crate::light::{Lighting, Shadow};
    use crate::path::{Line, Motion, Path, SmoothPath};
    use crate::scene::Object;
    use crate::texture::Texture;
    use nalgebra::{UnitQuaternion, Vector3};
    use vt_core::lie::LieGroup;

    fn object(path: Path) -> Object {
        let texture = Texture::Faces { from: 0.2, to: 0.9 };
        Object { name: "house".into(), body: Body::new(house(0.1), texture, 5), path }
    }

    fn smooth() -> Path {
        let start = SE3::from_rotation_vector(&Vector3::new(2.4, 0.5, 0.2), Vector3::new(0.0, 0.0, 0.3));
        SmoothPath { start, translation: [0.02; 3], rotation: [0.2; 3], period: 2.0 }.into()
    }

    fn world(objects: Vec<Object>) -> World {
        let clutter = Clutter { size: 15.0, density: 0.4, brightness: 0.4, contrast: 0.4 };
        World { objects, lighting: Lighting::default(), background: Background::Clutter(clutter), seed: 5 }
    }

    fn quiet() -> Settings {
        let noise = Noise { gaussian: 0.0, ..Noise::default() };
        Settings { frames: 4, noise, ..Settings::default() }
    }

    fn camera(world: World, settings: Settings) -> SimulatedCamera {
        let intrinsics = Camera::new(120.0, 120.0, 63.5, 47.5, 128, 96).unwrap();
        SimulatedCamera::new(SensorId(0), Arc::new(world), intrinsics, SE3::identity(), settings)
    }

    fn pictures(mut c: SimulatedCamera) -> Vec<Vec<u8>> {
        let frames = std::iter::from_fn(|| c.next().unwrap());
        frames.map(|f| f.grey().unwrap().clone().into_raw()).collect()
    }

    #[test]
    fn pictures_are_the_same_at_any_number_of_threads() {
        let pool = |n| rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
        let noise = Noise { gaussian: 2.0, photon: 0.1, salt_and_pepper: 0.01, ..Noise::default() };
        let run = |seed| {
            let lighting = Lighting {
                swing: 0.3,
                turn: 1.0,
                shadow: Some(Shadow {
                    width: 30.0,
                    soft: 5.0,
                    depth: 0.5,
                    angle: 0.4,
                    reach: 50.0,
                    period: 1.0,
                }),
                ..Lighting::default()
            };
            let plate = Object {
                name: "plate".into(),
                body: Body::new(cuboid([0.03, 0.1, 0.01]), Texture::Squares { size: 0.01, contrast: 0.5 }, 2),
                path: Path::still(SE3::from_rotation_vector(&Vector3::x(), Vector3::new(0.01, 0.0, 0.2))),
            };
            let world = World { lighting, ..world(vec![object(smooth()), plate]) };
            let settings = Settings { noise, exposure: 0.7, seed, duplicated: 0.3, ..quiet() };
            pictures(camera(world, settings))
        };
        let alone = pool(1).install(|| run(7));
        assert_eq!(alone, pool(2).install(|| run(7)));
        assert_ne!(alone, run(8));
    }

    #[test]
    fn a_blurred_picture_is_the_mean_of_sharp_ones_and_its_truth_the_middle() {
        let line = Line {
            start: smooth().pose(0.0),
            velocity: Vector3::new(0.5, 0.2, 0.0),
            spin: Vector3::new(0.0, 2.0, 0.0),
        };
        let path = Path::from(Motion::Line(line));
        let settings = Settings { exposure: 0.8, ..quiet() };
        let mut blurred = camera(world(vec![object(path.clone())]), settings);
        blurred.shot();
        let shot = blurred.shot().unwrap();
        assert_eq!(shot.poses[0], path.pose(0.04));
        let times: Vec<f64> = blurred.subframes(1).collect();
        assert!(times.len() > 5, "{times:?}");
        assert!((times.iter().sum::<f64>() / times.len() as f64 - 0.04).abs() < 1e-12);
        assert!((times[times.len() - 1] - times[0] - 0.032).abs() < 0.032 / times.len() as f64 + 1e-12);
        let mut sum = vec![0.0; 128 * 96];
        for t in &times {
            let still = camera(world(vec![object(Path::still(path.pose(*t)))]), quiet());
            for (s, v) in sum.iter_mut().zip(&pictures(still)[0]) {
                *s += f64::from(*v) / times.len() as f64;
            }
        }
        // Each sharp picture is rounded, and so is the blurred one.
        for (blurred, mean) in shot.frame.grey().unwrap().iter().zip(sum) {
            assert!((f64::from(*blurred) - mean).abs() <= 1.001, "{blurred} instead of {mean}");
        }
    }

    #[test]
    fn an_occluder_hides_its_object_while_it_is_there() {
        let wall = Object {
            name: "wall".into(),
            body: Body::new(cuboid([0.5, 0.5, 0.01]), Texture::Plain(0.3), 0),
            path: Motion::Line(Line {
                start: SE3::from_rotation_vector(&Vector3::zeros(), Vector3::new(-0.8, 0.0, 0.15)),
                velocity: Vector3::new(10.0, 0.0, 0.0),
                spin: Vector3::zeros(),
            })
            .into(),
        };
        let mut c = camera(world(vec![object(smooth()), wall]), quiet());
        let visible: Vec<f64> = std::iter::from_fn(|| c.shot()).map(|s| s.visible[0]).collect();
        assert_eq!((visible[0], visible[2]), (1.0, 0.0), "{visible:?}");
        let mut c = camera(world(vec![object(smooth())]), quiet());
        assert!(std::iter::from_fn(|| c.shot()).all(|s| s.visible == [1.0]));
    }

    #[test]
    fn two_cameras_see_one_world() {
        let left = SE3::identity();
        let right = SE3::new(UnitQuaternion::from_euler_angles(0.0, 0.2, 0.1), Vector3::new(-0.1, 0.0, 0.02));
        let world = Arc::new(world(vec![object(smooth())]));
        let intrinsics = Camera::new(120.0, 120.0, 63.5, 47.5, 128, 96).unwrap();
        let mut cameras = [left, right].map(|extrinsics| {
            SimulatedCamera::new(SensorId(0), world.clone(), intrinsics, extrinsics, quiet())
        });
        let [a, b] = [0, 1].map(|k| {
            cameras[k].shot();
            cameras[k].shot().unwrap()
        });
        assert_eq!(a.frame.time, b.frame.time);
        assert_ne!(a.frame.grey().unwrap(), b.frame.grey().unwrap());
        // A vertex in the one camera's frame, carried over, is seen where the other truth says.
        let p = world.objects[0].body.mesh().vertices()[0];
        let carried = right.act(&left.inverse().act(&a.poses[0].act(&p)));
        let (from, to) = (intrinsics.project(&carried), intrinsics.project(&b.poses[0].act(&p)));
        assert!((from.unwrap() - to.unwrap()).norm() < 1e-9);
        // And the picture shows it there: the silhouette's box is that of the projected vertices.
        let background = pictures(camera(super::tests::world(vec![]), quiet()))[0].clone();
        let picture = b.frame.grey().unwrap();
        let changed = picture
            .enumerate_pixels()
            .filter(|(x, y, p)| background[*y as usize * 128 + *x as usize].abs_diff(p.0[0]) > 8);
        let columns: Vec<f64> = changed.map(|(x, ..)| f64::from(x)).collect();
        let corners = world.objects[0].body.mesh().vertices().iter();
        let seen: Vec<f64> = corners.map(|p| intrinsics.project(&b.poses[0].act(p)).unwrap().x).collect();
        let range = |v: &[f64]| v.iter().fold((f64::MAX, f64::MIN), |(l, h), x| (l.min(*x), h.max(*x)));
        let ((l0, h0), (l1, h1)) = (range(&columns), range(&seen));
        assert!((l0 - l1).abs() < 2.0 && (h0 - h1).abs() < 2.0, "{l0} {h0} instead of {l1} {h1}");
    }

    #[test]
    fn dropped_frames_keep_the_numbers_and_times_of_the_others() {
        let all = pictures(camera(world(vec![object(smooth())]), Settings { frames: 40, ..quiet() }));
        let settings = Settings { frames: 40, dropped: 0.2, gaps: vec![[10, 14]], ..quiet() };
        let mut c = camera(world(vec![object(smooth())]), settings);
        let (expected, truth) = (c.remaining().unwrap(), c.truth(0));
        let frames: Vec<Frame> = std::iter::from_fn(|| c.next().unwrap()).collect();
        assert_eq!(frames.len(), expected);
        assert!(frames.len() < 35 && frames.len() > 15, "{}", frames.len());
        assert!(frames.iter().map(|f| f.number).eq(truth.keys().copied()));
        assert!(frames.iter().all(|f| !(10..=14).contains(&f.number)));
        for f in &frames {
            assert_eq!(f.time, Timestamp::from_seconds(f.number as f64 / 25.0));
            assert_eq!(f.grey().unwrap().as_raw(), &all[f.number as usize]);
        }
    }

    #[test]
    fn duplicated_frames_show_the_picture_before() {
        let settings = Settings { frames: 60, duplicated: 0.3, ..quiet() };
        let mut c = camera(world(vec![object(smooth())]), settings);
        let shots: Vec<Shot> = std::iter::from_fn(|| c.shot()).collect();
        let same = |w: &[Shot]| w[0].frame.grey().unwrap() == w[1].frame.grey().unwrap();
        let repeated = shots.windows(2).filter(|w| same(w)).count();
        assert!((8..30).contains(&repeated), "{repeated}");
        assert!(shots.windows(2).all(|w| w[0].frame.time < w[1].frame.time && w[0].poses != w[1].poses));
    }

    #[test]
    fn pictures_are_used_again_and_never_changed_while_held() {
        let settings = Settings { frames: 12, ..quiet() };
        let mut c = camera(world(vec![object(smooth())]), settings.clone());
        let held: Vec<Frame> = std::iter::from_fn(|| c.next().unwrap()).collect();
        let fleeting = pictures(camera(world(vec![object(smooth())]), settings));
        assert!(held.iter().zip(&fleeting).all(|(f, p)| f.grey().unwrap().as_raw() == p));
    }

    #[test]
    fn colour_frames_and_brightness_over_time() {
        let mut c = camera(world(vec![object(smooth())]), Settings { colour: true, ..quiet() });
        assert_eq!(c.remaining(), Some(4));
        assert_eq!(c.next().unwrap().unwrap().rgb().unwrap().dimensions(), (128, 96));
        assert_eq!(std::iter::from_fn(|| c.next().unwrap()).count(), 3);
        let lighting = Lighting { swing: 0.5, period: 0.16, ..Lighting::default() };
        let world = World { lighting, background: Background::Plain(0.4), ..world(vec![]) };
        let grey: Vec<u8> = pictures(camera(world, quiet())).iter().map(|p| p[0]).collect();
        // A quarter of the period passes from frame to frame.
        assert_eq!(grey, [102, 153, 102, 51]);
    }
}
