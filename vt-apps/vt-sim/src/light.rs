//! Light, and how it changes over time.

use nalgebra::{UnitQuaternion, Vector3};
use vt_core::math;

/// Light at one moment: an ambient part and a distant source.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Share that reaches every surface alike.
    pub ambient: f32,
    /// Share that falls in with the cosine of the angle to the source.
    pub diffuse: f32,
    /// Brightness of highlights (J. Blinn, "Models of light reflection for computer synthesized pictures", 1977); 0
    /// is a dull surface.
    pub specular: f32,
    /// Exponent of highlights as a power of two: 5 is 32. At most 10.
    pub gloss: u32,
    /// Direction to the source in the axes of the world; its length does not matter.
    pub direction: Vector3<f64>,
}

impl Default for Light {
    fn default() -> Self {
        Self {
            ambient: 0.65,
            diffuse: 0.35,
            specular: 0.0,
            gloss: 5,
            direction: Vector3::new(-0.4, -0.7, -0.6),
        }
    }
}

/// Light over time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lighting {
    /// Light at time 0.
    pub light: Light,
    /// Relative amplitude of a swing of all brightness, 0 to 1.
    pub swing: f64,
    /// Period of the swing in seconds.
    pub period: f64,
    /// Turn of the source about the z axis of the world in radians per second.
    pub turn: f64,
    /// A shadow that sweeps over the picture.
    pub shadow: Option<Shadow>,
}

impl Default for Lighting {
    fn default() -> Self {
        Self { light: Light::default(), swing: 0.0, period: 1.0, turn: 0.0, shadow: None }
    }
}

impl Lighting {
    /// The light at time `t` in seconds.
    pub fn at(&self, t: f64) -> Light {
        let turn = UnitQuaternion::from_scaled_axis(Vector3::z() * (self.turn * t));
        Light { direction: turn * self.light.direction, ..self.light }
    }

    /// Factor on all brightness at time `t`.
    pub fn gain(&self, t: f64) -> f32 {
        (1.0 + self.swing * math::sin(core::f64::consts::TAU * t / self.period)) as f32
    }
}

/// A straight band across the picture that is darker than the rest and swings over it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shadow {
    /// Width of the band in pixels.
    pub width: f64,
    /// Width of its soft borders in pixels.
    pub soft: f64,
    /// Share of the light that it takes, 0 to 1.
    pub depth: f64,
    /// Direction in which it moves, from x to y, in radians.
    pub angle: f64,
    /// Farthest distance of its middle from that of the picture in pixels.
    pub reach: f64,
    /// Period in seconds; it starts at the far end.
    pub period: f64,
}

/// A shadow at one moment: its share of light as a function of the pixel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Band {
    normal: [f64; 2],
    middle: f64,
    half: f64,
    soft: f64,
    depth: f64,
}

impl Shadow {
    pub(crate) fn at(&self, t: f64, width: u32, height: u32) -> Band {
        let (sin, cos) = math::sin_cos(self.angle);
        let center = 0.5 * (cos * (f64::from(width) - 1.0) + sin * (f64::from(height) - 1.0));
        let middle = center - self.reach * math::cos(core::f64::consts::TAU * t / self.period);
        let (half, soft) = (0.5 * self.width, self.soft.max(1.0));
        Band { normal: [cos, sin], middle, half, soft, depth: self.depth }
    }
}

impl Band {
    #[inline]
    pub(crate) fn light(&self, x: usize, y: usize) -> f32 {
        let s = self.normal[0] * x as f64 + self.normal[1] * y as f64 - self.middle;
        let inside = ((self.half - s.abs()) / self.soft + 0.5).clamp(0.0, 1.0);
        (1.0 - self.depth * inside) as f32
    }
}
