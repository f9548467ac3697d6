//! A picture known everywhere: waves of many lengths, seen under any motion of the plane, with noise.

use image::{GrayImage, Luma};
use nalgebra::{DefaultAllocator, Matrix3, Point2, Vector2};
use vt_core::lie::PlanarMotion;
use vt_core::manifold::Alloc;
use vt_core::math;
use vt_core::random::{Random, Stream};

/// Width and height of pictures.
pub const PICTURE: (u32, u32) = (160, 120);

/// Width and height of the template.
pub const SIZE: [f64; 2] = [90.0, 66.0];

/// Numbers of a case.
pub fn random(case: u64, use_of: u32) -> Random {
    Random::new(11, Stream::Sim, 0, case, use_of)
}

/// Waves over the plane of the model.
pub struct Waves {
    waves: Vec<([f64; 2], f64, f64)>,
}

impl Waves {
    /// Waves of 7 to 90 pixels in all directions, the longer the higher.
    pub fn new(seed: u64) -> Self {
        let mut random = random(seed, 1);
        let wave = |k: usize| {
            let length = 7.0 * math::pow(90.0 / 7.0, k as f64 / 13.0);
            let angle = core::f64::consts::TAU * random.uniform();
            let (s, c) = math::sin_cos(angle);
            let pace = core::f64::consts::TAU / length;
            ([pace * c, pace * s], core::f64::consts::TAU * random.uniform(), 6.0 + 0.12 * length)
        };
        Self { waves: (0..14).map(wave).collect() }
    }

    /// Grey level, about 128 ± 30.
    fn at(&self, p: &Point2<f64>) -> f64 {
        let one = |(pace, phase, height): &([f64; 2], f64, f64)| {
            height * math::sin(pace[0] * p.x + pace[1] * p.y + phase)
        };
        128.0 + self.waves.iter().map(one).sum::<f64>()
    }

    /// The picture at a pose `picture_from_model`, after `light` of its grey levels, with white noise of this deviation.
    pub fn draw<P: PlanarMotion>(
        &self,
        pose: &P,
        light: impl Fn(f64) -> f64,
        noise: f64,
        seed: u64,
    ) -> GrayImage
    where
        DefaultAllocator: Alloc<P::D>,
    {
        let model: Matrix3<f64> = pose.matrix().try_inverse().expect("regular");
        let mut random = random(seed, 2);
        GrayImage::from_fn(PICTURE.0, PICTURE.1, |x, y| {
            let p = model * nalgebra::Vector3::new(f64::from(x), f64::from(y), 1.0);
            let level = light(self.at(&Point2::new(p.x / p.z, p.y / p.z))) + noise * random.normal();
            Luma([level.round().clamp(0.0, 255.0) as u8])
        })
    }
}

/// The template's middle in the picture's middle.
pub fn upright<P: PlanarMotion>() -> P
where
    DefaultAllocator: Alloc<P::D>,
{
    P::of(&vt_core::lie::Sim2::new(79.3, 59.6, 0.0, 1.0))
}

/// Corners of the template under a pose.
pub fn corners<P: PlanarMotion>(pose: &P) -> [Point2<f64>; 4]
where
    DefaultAllocator: Alloc<P::D>,
{
    [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]].map(|[x, y]| {
        let h = pose.matrix() * nalgebra::Vector3::new(x * SIZE[0], y * SIZE[1], 1.0);
        Point2::new(h.x / h.z, h.y / h.z)
    })
}

/// Root mean square distance of the corners, pixels.
pub fn distance<P: PlanarMotion>(a: &P, b: &P) -> f64
where
    DefaultAllocator: Alloc<P::D>,
{
    let squares = corners(a).iter().zip(corners(b)).map(|(a, b)| (a - b).norm_squared()).sum::<f64>();
    (squares / 4.0).sqrt()
}

/// A vector with deviations `sigma`.
pub fn jitter(random: &mut Random, sigma: f64) -> Vector2<f64> {
    Vector2::new(sigma * random.normal(), sigma * random.normal())
}
