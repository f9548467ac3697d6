//! Scenes as a whole: cameras in a world, and random ones for Monte Carlo runs.

use std::sync::Arc;

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use vt_core::frame::SensorId;
use vt_core::lie::{LieGroup, SE3};
use vt_core::math;
use vt_core::random::{Random, Stream};
use vt_models::camera::Camera;
use vt_models::mesh::Mesh;

use crate::backdrop::{Background, Clutter};
use crate::bodies::cuboid;
use crate::camera::{Settings, SimulatedCamera};
use crate::light::{Light, Lighting, Shadow};
use crate::noise::Noise;
use crate::path::{Jump, Line, Motion, Path, SmoothPath};
use crate::scene::{Body, Object, World};
use crate::texture::Texture;

/// Cameras in a world.
pub struct Scenario {
    /// What there is to see. In random scenes object 0 is the tracked one.
    pub world: Arc<World>,
    /// The cameras, each with camera_from_world.
    pub cameras: Vec<(Camera, SE3)>,
    /// Settings of all cameras.
    pub settings: Settings,
}

/// What makes a random scene hard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Disturbance {
    /// Nothing.
    None,
    /// A textured box, 0.4 to 1.2 times as large as the object appears, passes in front of it within 0.5 to 1.5 s.
    Occlusion,
    /// The shutter is open for 0.4 to 1 of the time between frames, and the motion is twice as fast.
    Blur,
    /// Background of density 0.6 to 1.8, contrast 0.4 to 0.8, shapes of 20 to 60 px.
    Clutter,
    /// The object jumps to another place and turns by 20 to 90 degrees.
    Teleport,
    /// Brightness swings by 20 to 50 %, the source turns by 0.3 to 1.5 rad/s, a shadow sweeps over the picture.
    Light,
}

/// Distribution of random scenes. All draws are uniform unless said otherwise:
///
/// - size of the object's diameter in the picture from `pixels`, uniform in its logarithm, any orientation (uniform on
///   the rotations), anywhere in the picture as long as it stays inside;
/// - swings ([`SmoothPath`]) of 15 to 100 px along the picture's axes, less where the picture ends, 3 to 12 % of the
///   distance, 8 to 30 degrees about each axis of the object, with a period of 3 to 6 s: a few millimetres and degrees a
///   frame, as in a hand;
/// - reflectances of the faces in a range of 0.25 to 0.6 about a mean of 0.3 to 0.55; ambient light 0.35 to 0.65,
///   source 0.3 to 0.6 from a random direction on the side of the camera, highlights in every fourth scene;
/// - background of brightness 0.15 to 0.6 and contrast 0.1 to 0.4 with shapes of 15 to 60 px, density 0 to 0.6;
/// - Gaussian noise of 1 to 3 grey levels and shot noise of 0 to 0.05 levels an electron.
///
/// Disturbances in time fall between 30 and 70 % of the sequence.
#[derive(Clone, Debug, PartialEq)]
pub struct Distribution {
    /// The camera.
    pub camera: Camera,
    /// Number of frames.
    pub frames: u64,
    /// Frames per second.
    pub rate: f64,
    /// Smallest and largest diameter of the object in pixels.
    pub pixels: [f64; 2],
}

impl Distribution {
    /// 60 frames at 30 Hz, object between 80 and 250 px.
    pub fn new(camera: Camera) -> Self {
        Self { camera, frames: 60, rate: 30.0, pixels: [80.0, 250.0] }
    }

    /// The scene number `seed`.
    pub fn scenario(&self, mesh: Mesh, seed: u64, disturbance: Disturbance) -> Scenario {
        let mut draw = Draw(Random::new(seed, Stream::Sim, 1 << 33, 0, 0));
        let diameter = mesh.diameter();
        let size = math::exp(draw.between(math::ln(self.pixels[0]), math::ln(self.pixels[1])));
        let haste = if disturbance == Disturbance::Blur { 0.5 } else { 1.0 };
        let (fx, fy) = self.camera.focal();
        let depth = (fx * fy).sqrt() * diameter / size;
        let room = self.room(size);
        let swing = room.map(|room| draw.between(15.0, 100.0).min(room));
        let start = SE3::new(draw.rotation(), self.place(&mut draw, depth, room, swing));
        let mut path = Path::from(SmoothPath {
            start,
            translation: [swing[0] * depth / fx, swing[1] * depth / fy, draw.between(0.03, 0.12) * depth],
            rotation: [0; 3].map(|_| draw.between(8.0, 30.0).to_radians()),
            period: haste * draw.between(3.0, 6.0),
        });
        let duration = self.frames as f64 / self.rate;
        let moment = draw.between(0.3, 0.7) * duration;
        let faces = draw.faces();
        let mut lighting = Lighting { light: draw.light(), ..Lighting::default() };
        let mut clutter = Clutter {
            size: draw.between(15.0, 60.0),
            density: draw.between(0.0, 0.6),
            brightness: draw.between(0.15, 0.6) as f32,
            contrast: draw.between(0.1, 0.4) as f32,
        };
        let noise =
            Noise { gaussian: draw.between(1.0, 3.0), photon: draw.between(0.0, 0.05), ..Noise::default() };
        let mut exposure = 0.0;
        let mut occluder = None;
        match disturbance {
            Disturbance::None => {}
            Disturbance::Occlusion => {
                occluder = Some(self.occluder(&mut draw, &path, diameter, moment, seed));
            }
            Disturbance::Blur => exposure = draw.between(0.4, 1.0),
            Disturbance::Clutter => {
                let (density, contrast) = (draw.between(0.6, 1.8), draw.between(0.4, 0.8) as f32);
                clutter = Clutter { size: draw.between(20.0, 60.0), density, contrast, brightness: 0.5 };
            }
            Disturbance::Teleport => {
                let translation = self.place(&mut draw, depth, room, swing) - start.translation;
                let angle = draw.between(20.0, 90.0).to_radians();
                path.jumps.push((moment, Jump { translation, rotation: draw.direction() * angle }));
            }
            Disturbance::Light => {
                lighting.swing = draw.between(0.2, 0.5);
                lighting.period = draw.between(1.0, 4.0);
                lighting.turn = draw.sign() * draw.between(0.3, 1.5);
                lighting.shadow = Some(Shadow {
                    width: draw.between(0.5, 2.0) * size,
                    soft: draw.between(1.0, 20.0),
                    depth: draw.between(0.3, 0.7),
                    angle: draw.between(0.0, core::f64::consts::TAU),
                    reach: 0.6 * f64::from(self.camera.size().0),
                    period: draw.between(2.0, 5.0),
                });
            }
        }
        let object = Object { name: "object".into(), body: Body::new(mesh, faces, seed), path };
        let objects = core::iter::once(object).chain(occluder).collect();
        let world = World { objects, lighting, background: Background::Clutter(clutter), seed };
        let (frames, rate) = (self.frames, self.rate);
        let settings = Settings { frames, rate, exposure, noise, seed, ..Settings::default() };
        Scenario { world: Arc::new(world), cameras: vec![(self.camera, SE3::identity())], settings }
    }

    /// Half the picture without its border and half an object of `size` pixels, which is larger at its nearest.
    fn room(&self, size: f64) -> [f64; 2] {
        let (width, height) = self.camera.size();
        [width, height].map(|n| (0.425 * f64::from(n) - 0.65 * size).max(0.0))
    }

    /// A place at this depth from which an object swings by so many pixels without leaving the picture.
    fn place(&self, draw: &mut Draw, depth: f64, room: [f64; 2], swing: [f64; 2]) -> Vector3<f64> {
        let ((fx, fy), (cx, cy)) = (self.camera.focal(), self.camera.principal_point());
        let (width, height) = self.camera.size();
        let mut along = |k: usize, n: u32, c: f64, focal: f64| {
            let pixel = 0.5 * (f64::from(n) - 1.0) + draw.between(-1.0, 1.0) * (room[k] - swing[k]);
            (pixel - c) * depth / focal
        };
        Vector3::new(along(0, width, cx, fx), along(1, height, cy, fy), depth)
    }

    /// A box that passes in front of the object.
    fn occluder(&self, draw: &mut Draw, path: &Path, diameter: f64, moment: f64, seed: u64) -> Object {
        let there = path.pose(moment).translation;
        let share = draw.between(0.55, 0.7);
        // As large as it must be at this distance to appear `ratio` times as large as the object.
        let ratio = draw.between(0.4, 1.2);
        let size = ratio * diameter * share;
        let sides = [size, size * draw.between(0.5, 1.0), size * draw.between(0.3, 0.8)];
        let (sin, cos) = math::sin_cos(draw.between(0.0, core::f64::consts::TAU));
        let speed = (1.0 + ratio) * diameter * share / draw.between(0.5, 1.5);
        let velocity = Vector3::new(cos, sin, 0.0) * speed;
        let start = SE3::new(draw.rotation(), there * share - velocity * moment);
        let spin = draw.direction() * draw.between(0.5, 3.0);
        let texture = Texture::Squares { size: 0.2 * size, contrast: 0.5 };
        let body = Body::new(cuboid(sides), texture, seed.wrapping_add(1));
        Object { name: "occluder".into(), body, path: Motion::Line(Line { start, velocity, spin }).into() }
    }
}

impl Scenario {
    /// The random scene number `seed` before a camera of 640 × 480 pixels with a focal length of 600 px; see
    /// [`Distribution`] for what is drawn and how to change it.
    pub fn random(mesh: Mesh, seed: u64, disturbance: Disturbance) -> Self {
        let camera = Camera::new(600.0, 600.0, 319.5, 239.5, 640, 480).expect("the numbers are a camera");
        Distribution::new(camera).scenario(mesh, seed, disturbance)
    }

    /// The sensor of a camera, from the first frame on; `None` when there is none of this index. It gives frames
    /// with their truth ([`SimulatedCamera::shot`]).
    pub fn sensor(&self, camera: usize) -> Option<SimulatedCamera> {
        let (intrinsics, camera_from_world) = self.cameras.get(camera)?;
        let id = SensorId(camera as u32);
        Some(SimulatedCamera::new(
            id,
            self.world.clone(),
            *intrinsics,
            *camera_from_world,
            self.settings.clone(),
        ))
    }
}

/// Random numbers in order.
struct Draw(Random);

impl Draw {
    fn between(&mut self, a: f64, b: f64) -> f64 {
        a + (b - a) * self.0.uniform()
    }

    fn sign(&mut self) -> f64 {
        if self.0.uniform() < 0.5 { -1.0 } else { 1.0 }
    }

    fn direction(&mut self) -> Vector3<f64> {
        let v = Vector3::from_fn(|_, _| self.0.normal());
        v.try_normalize(0.0).unwrap_or_else(Vector3::x)
    }

    /// Uniform: a normal quaternion has no preferred direction.
    fn rotation(&mut self) -> UnitQuaternion<f64> {
        let [w, x, y, z] = [0; 4].map(|_| self.0.normal());
        UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z))
    }

    fn faces(&mut self) -> Texture {
        let (mean, range) = (self.between(0.3, 0.55), self.between(0.25, 0.6));
        let share = |v: f64| v.clamp(0.03, 0.95) as f32;
        Texture::Faces { from: share(mean - 0.5 * range), to: share(mean + 0.5 * range) }
    }

    fn light(&mut self) -> Light {
        let mut direction = self.direction();
        direction.z = -direction.z.abs();
        let (ambient, diffuse) = (self.between(0.35, 0.65) as f32, self.between(0.3, 0.6) as f32);
        let specular = self.between(-0.9, 0.3).max(0.0) as f32;
        Light { ambient, diffuse, specular, gloss: 4, direction }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bodies::house;

    const ALL: [Disturbance; 6] = [
        Disturbance::None,
        Disturbance::Occlusion,
        Disturbance::Blur,
        Disturbance::Clutter,
        Disturbance::Teleport,
        Disturbance::Light,
    ];

    #[test]
    fn random_scenes_keep_what_their_distribution_promises() {
        let mut hidden = 0;
        for seed in 0..60 {
            let disturbance = ALL[seed as usize % ALL.len()];
            let scenario = Scenario::random(house(0.18), seed, disturbance);
            let object = &scenario.world.objects[0];
            let (camera, _) = scenario.cameras[0];
            let diameter = object.body.mesh().diameter();
            let start = object.path.pose(0.0).translation;
            let size = 600.0 * diameter / start.z;
            assert!((79.9..250.1).contains(&size), "{seed}: {size} px");
            let mut jumps = 0;
            for k in 0..60 {
                let pose = object.path.pose(f64::from(k) / 30.0);
                for p in object.body.mesh().vertices() {
                    let pixel = camera.project(&pose.act(p)).expect("in front of the camera");
                    assert!(camera.contains(&pixel, 0.0), "{seed} {k}: {pixel} is not in the picture");
                }
                let next = object.path.pose(f64::from(k + 1) / 30.0);
                let moved = (next.translation - pose.translation).norm();
                let turned = (pose.rotation.inverse() * next.rotation).angle().to_degrees();
                let jump = turned > 12.0;
                jumps += u32::from(jump);
                assert!(jump || moved < 0.2 * diameter, "{seed} {k}: {moved} m");
            }
            assert_eq!(jumps, u32::from(disturbance == Disturbance::Teleport), "{seed}");
            if disturbance == Disturbance::Occlusion && seed < 24 {
                let mut sensor = scenario.sensor(0).unwrap();
                let least = std::iter::from_fn(|| sensor.shot()).map(|s| s.visible[0]).fold(1.0, f64::min);
                hidden += u32::from(least < 0.7);
            }
        }
        assert_eq!(hidden, 4, "each occluder hides a good part of its object");
    }

    #[test]
    fn a_seed_is_a_scene() {
        let first = |seed| {
            let mut sensor = Scenario::random(house(0.18), seed, Disturbance::Blur).sensor(0).unwrap();
            let shot = sensor.shot().unwrap();
            (shot.frame.grey().unwrap().clone().into_raw(), shot.poses)
        };
        assert_eq!(first(4), first(4));
        assert_ne!(first(4).0, first(5).0);
        assert!(Scenario::random(house(0.18), 1, Disturbance::None).sensor(1).is_none());
    }
}
