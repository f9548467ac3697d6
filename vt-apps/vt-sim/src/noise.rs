//! From light to bytes: gain, noise, response curve, quantisation.

use std::sync::OnceLock;

use vt_core::math;
use vt_core::random::Random;

/// What a sensor makes of light. All numbers are in grey levels of 255.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// Standard deviation of Gaussian noise.
    pub gaussian: f64,
    /// Gain of the sensor in grey levels per photon electron: shot noise has the variance `photon · level`.
    pub photon: f64,
    /// Share of pixels that are black or white at random, 0 to 1.
    pub salt_and_pepper: f64,
    /// Exponent of the response curve, `255 · (level / 255)^(1/γ)`; 1 is linear.
    pub gamma: f64,
    /// Bits of the converter, 1 to 8.
    pub bits: u32,
}

impl Default for Noise {
    /// A linear sensor with 8 bits and a deviation of 2 grey levels.
    fn default() -> Self {
        Self { gaussian: 2.0, photon: 0.0, salt_and_pepper: 0.0, gamma: 1.0, bits: 8 }
    }
}

/// Nodes of the response curve.
const NODES: usize = 4096;

/// A sensor's noise, ready for use.
pub(crate) struct Converter {
    noise: Noise,
    /// Response at `k / NODES`, as levels; empty where it is linear.
    curve: Vec<f32>,
    steps: f32,
}

/// Standard normal quantiles at the middles of 2¹⁶ equal cells, so up to 4.3 deviations: fine enough for grey levels,
/// and four numbers come of one draw.
fn normals() -> &'static [f32] {
    static TABLE: OnceLock<Vec<f32>> = OnceLock::new();
    TABLE.get_or_init(|| {
        (0..1 << 16).map(|k| math::normal_quantile((f64::from(k) + 0.5) / 65536.0) as f32).collect()
    })
}

/// Four 16-bit numbers of each draw, one after the other.
struct Sixteen<'a> {
    random: &'a mut Random,
    bits: u64,
    left: u32,
}

impl Sixteen<'_> {
    #[inline]
    fn next(&mut self) -> usize {
        if self.left == 0 {
            (self.bits, self.left) = (self.random.next_u64(), 4);
        }
        let value = self.bits & 0xFFFF;
        self.bits >>= 16;
        self.left -= 1;
        value as usize
    }
}

impl Converter {
    pub(crate) fn new(noise: Noise) -> Self {
        let response = |k: usize| (255.0 * math::pow(k as f64 / NODES as f64, 1.0 / noise.gamma)) as f32;
        let curve = if noise.gamma == 1.0 { vec![] } else { (0..=NODES).map(response).collect() };
        Self { noise, curve, steps: ((1_u32 << noise.bits.clamp(1, 8)) - 1) as f32 / 255.0 }
    }

    /// Bytes of a row of light, 0 to 1, one number a channel.
    pub(crate) fn convert(&self, light: impl Iterator<Item = f32>, out: &mut [u8], random: &mut Random) {
        let (normals, noise) = (normals(), &self.noise);
        let (variance, gain) = ((noise.gaussian * noise.gaussian) as f32, noise.photon as f32);
        let wrong = (65536.0 * noise.salt_and_pepper) as usize;
        let mut numbers = Sixteen { random, bits: 0, left: 0 };
        for (byte, light) in out.iter_mut().zip(light) {
            let mut level = 255.0 * light;
            if variance > 0.0 || gain > 0.0 {
                let deviation = if gain > 0.0 {
                    (variance + gain * level.max(0.0)).sqrt()
                } else {
                    noise.gaussian as f32
                };
                level += deviation * normals[numbers.next()];
            }
            if !self.curve.is_empty() {
                let at = (level / 255.0).clamp(0.0, 1.0) * NODES as f32;
                let k = (at as usize).min(NODES - 1);
                level = self.curve[k] + (at - k as f32) * (self.curve[k + 1] - self.curve[k]);
            }
            if wrong > 0 && numbers.next() < wrong {
                level = if numbers.next() & 1 == 0 { 0.0 } else { 255.0 };
            }
            // Half a level is added instead of rounding, which is slow; levels are not negative here.
            let level = level.clamp(0.0, 255.0);
            *byte = if noise.bits >= 8 {
                (level + 0.5) as u8
            } else {
                ((level * self.steps + 0.5).floor() / self.steps + 0.5) as u8
            };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vt_core::random::Stream;

    const N: usize = 200_000;

    fn bytes(noise: Noise, level: f32) -> Vec<f64> {
        let mut out = vec![0; N];
        let mut random = Random::new(5, Stream::Sim, 0, 0, 0);
        Converter::new(noise).convert(core::iter::repeat_n(level / 255.0, N), &mut out, &mut random);
        out.into_iter().map(f64::from).collect()
    }

    fn moments(v: &[f64]) -> (f64, f64) {
        let mean = v.iter().sum::<f64>() / N as f64;
        (mean, v.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / N as f64)
    }

    #[test]
    fn noise_has_the_moments_that_were_asked_for() {
        let quiet = Noise { gaussian: 0.0, ..Noise::default() };
        for (noise, level, variance) in [
            (Noise { gaussian: 3.0, ..quiet }, 100.0, 9.0),
            (Noise { photon: 0.5, ..quiet }, 128.0, 64.0),
            (Noise { gaussian: 3.0, photon: 0.5, ..quiet }, 32.0, 25.0),
        ] {
            let (mean, found) = moments(&bytes(noise, level));
            // A twelfth is the noise of rounding.
            let expected = variance + 1.0 / 12.0;
            assert!((mean - f64::from(level)).abs() < 0.1, "{noise:?}: mean {mean}");
            assert!((found / expected - 1.0).abs() < 0.02, "{noise:?}: variance {found}");
        }
    }

    #[test]
    fn salt_and_pepper_is_as_dense_as_asked_for() {
        let noise = Noise { gaussian: 0.0, salt_and_pepper: 0.04, ..Noise::default() };
        let pixels = bytes(noise, 100.0);
        for value in [0.0, 255.0] {
            let share = pixels.iter().filter(|v| **v == value).count() as f64 / N as f64;
            assert!((share - 0.02).abs() < 0.002, "{value}: {share}");
        }
    }

    #[test]
    fn response_and_quantisation() {
        let quiet = Noise { gaussian: 0.0, ..Noise::default() };
        let gamma = bytes(Noise { gamma: 2.2, ..quiet }, 55.0)[0];
        assert!((gamma - 255.0 * math::pow(55.0 / 255.0, 1.0 / 2.2)).abs() < 0.6, "{gamma}");
        let mut levels: Vec<u8> = (0..=255)
            .map(|level| {
                let mut out = [0];
                let mut random = Random::new(0, Stream::Sim, 0, 0, 0);
                let noise = Converter::new(Noise { bits: 3, ..quiet });
                noise.convert(core::iter::once(level as f32 / 255.0), &mut out, &mut random);
                out[0]
            })
            .collect();
        levels.dedup();
        assert_eq!(levels, [0, 36, 73, 109, 146, 182, 219, 255]);
    }
}
