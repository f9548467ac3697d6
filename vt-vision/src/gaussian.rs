//! Gaussian smoothing of grey pictures.

use image::GrayImage;
use vt_core::batch::vectorized;
use vt_core::error::ConfigError;
use vt_core::frame::Roi;
use vt_core::math;

use crate::plane::{Plane, area, clip, grown, reserve};

/// Longest half of a kernel, pixels.
const MOST_REACH: u32 = 64;

/// A sampled Gaussian with sum one, applied along rows, then along columns. Beyond the picture's border its outermost pixels go on.
#[derive(Clone, Debug, PartialEq)]
pub struct Gaussian {
    sigma: f64,
    /// Weights at the distances 0, 1, 2, …
    weights: Vec<f32>,
}

/// A value of a smoothed pixel, from its exact number.
pub trait Smoothed: Copy + Default {
    /// The nearest value.
    fn of(value: f32) -> Self;
}

impl Smoothed for f32 {
    #[inline(always)]
    fn of(value: f32) -> Self {
        value
    }
}

impl Smoothed for u8 {
    #[inline(always)]
    fn of(value: f32) -> Self {
        // The nearest integer is in the lowest bits of the sum.
        (value + 8_388_608.0).to_bits() as u8
    }
}

/// Smoothing with buffers that are used again.
#[derive(Clone, Debug, Default)]
pub struct Blur {
    /// One row of the picture with its continuation on both sides.
    padded: Vec<f32>,
    /// Rows smoothed along themselves, as many as the kernel is high, in turn.
    ring: Vec<f32>,
}

impl Gaussian {
    /// Standard deviation `sigma` in pixels; weights beyond `3 sigma` are left out.
    ///
    /// # Errors
    /// [`ConfigError::Parameter`] unless `0 < sigma` and `3 sigma ≤ 64`.
    pub fn new(sigma: f64) -> Result<Self, ConfigError> {
        let reach = (3.0 * sigma).ceil();
        if !(sigma > 0.0 && reach <= f64::from(MOST_REACH)) {
            return Err(ConfigError::parameter("sigma", sigma, "above 0 and at most 21 px"));
        }
        Self::with_reach(sigma, reach as u32)
    }

    /// The same with weights up to `reach` pixels away.
    ///
    /// # Errors
    /// [`ConfigError::Parameter`] unless `sigma > 0` and `1 ≤ reach ≤ 64`.
    pub fn with_reach(sigma: f64, reach: u32) -> Result<Self, ConfigError> {
        if !(sigma > 0.0 && sigma.is_finite()) {
            return Err(ConfigError::parameter("sigma", sigma, "a positive number of pixels"));
        }
        if !(1..=MOST_REACH).contains(&reach) {
            return Err(ConfigError::parameter("reach", reach, format!("1 to {MOST_REACH} px")));
        }
        let weight = |k: u32| math::exp(-0.5 * (f64::from(k) / sigma) * (f64::from(k) / sigma));
        let sum = weight(0) + 2.0 * (1..=reach).map(weight).sum::<f64>();
        Ok(Self { sigma, weights: (0..=reach).map(|k| (weight(k) / sum) as f32).collect() })
    }

    /// Standard deviation, pixels.
    pub fn sigma(&self) -> f64 {
        self.sigma
    }

    /// Weights at the distances 0, 1, 2, …
    pub(crate) fn weights(&self) -> &[f32] {
        &self.weights
    }

    /// Distance of the farthest pixel with a weight.
    pub fn reach(&self) -> u32 {
        self.weights.len() as u32 - 1
    }
}

impl Blur {
    /// Smooths `image` inside `roi`, or everywhere; pixels around the region take part.
    pub fn compute<T: Smoothed>(
        &mut self,
        image: &GrayImage,
        roi: Option<Roi>,
        kernel: &Gaussian,
        out: &mut Plane<T>,
    ) {
        let region = clip(roi, image.dimensions(), 0);
        out.reserve(area(image.dimensions()));
        let values = out.reshape(region);
        if region.width > 0 {
            self.rows(image, region, kernel, values, region.width as usize);
        }
    }

    /// Smooths `image` inside `roi`, or everywhere, into a picture that gets its size; the rest of that is left as it is.
    pub fn picture(&mut self, image: &GrayImage, roi: Option<Roi>, kernel: &Gaussian, out: &mut GrayImage) {
        if out.dimensions() != image.dimensions() {
            *out = GrayImage::new(image.width(), image.height());
        }
        let region = clip(roi, image.dimensions(), 0);
        if region.width > 0 {
            let stride = image.width() as usize;
            let start = region.y as usize * stride + region.x as usize;
            self.rows(image, region, kernel, &mut (**out)[start..], stride);
        }
    }

    /// Rows of the region go where `out` begins, and every `stride` values on.
    fn rows<T: Smoothed>(
        &mut self,
        image: &GrayImage,
        region: Roi,
        kernel: &Gaussian,
        out: &mut [T],
        stride: usize,
    ) {
        let reach = kernel.reach() as usize;
        let (width, taps) = (region.width as usize, 2 * reach + 1);
        let most = image.width() as usize;
        reserve(&mut self.padded, most + 2 * reach);
        reserve(&mut self.ring, most * taps);
        self.padded.resize(width + 2 * reach, 0.0);
        self.ring.resize(width * taps, 0.0);
        let (ring, padded) = (&mut self.ring[..width * taps], &mut self.padded[..width + 2 * reach]);
        let last = i64::from(image.height()) - 1;
        let mut next = i64::from(region.y) - reach as i64;
        for (y, target) in out.chunks_mut(stride).take(region.height as usize).enumerate() {
            let target = &mut target[..width];
            let end = i64::from(region.y) + (y + reach) as i64;
            while next <= end {
                let place = next.rem_euclid(taps as i64) as usize;
                pad(image, next.clamp(0, last) as usize, region, reach, padded);
                along(padded, &kernel.weights, &mut ring[place * width..][..width]);
                next += 1;
            }
            let row = |offset: i64| {
                let place = (end - reach as i64 + offset).rem_euclid(taps as i64) as usize;
                &ring[place * width..][..width]
            };
            across(row, &kernel.weights, target);
        }
    }
}

/// The pixels of a row as numbers, with what continues it on both sides.
fn pad(image: &GrayImage, y: usize, region: Roi, reach: usize, padded: &mut [f32]) {
    let size = image.width() as usize;
    let row = &image.as_raw()[y * size..][..size];
    let span = grown(region, reach as u32, image.dimensions());
    let before = reach - (region.x - span.x) as usize;
    let inside = span.width as usize;
    let pixels = &row[span.x as usize..][..inside];
    vectorized(
        #[inline(always)]
        || {
            for (to, &from) in padded[before..].iter_mut().zip(pixels) {
                *to = f32::from(from);
            }
        },
    );
    padded[..before].fill(f32::from(pixels[0]));
    padded[before + inside..].fill(f32::from(pixels[inside - 1]));
}

/// Weighted sums along a row, of which `padded` has `weights.len() - 1` values more on either side.
pub(crate) fn along(padded: &[f32], weights: &[f32], out: &mut [f32]) {
    vectorized(
        #[inline(always)]
        || match *weights {
            [a, b, c] => row_of_five(padded, [a, b, c], out),
            _ => {
                let reach = weights.len() - 1;
                let width = out.len();
                let centre = &padded[reach..][..width];
                out.iter_mut().zip(centre).for_each(|(o, p)| *o = p * weights[0]);
                for (k, &w) in weights.iter().enumerate().skip(1) {
                    let (left, right) = (&padded[reach - k..][..width], &padded[reach + k..][..width]);
                    out.iter_mut().zip(left.iter().zip(right)).for_each(|(o, (l, r))| *o += (l + r) * w);
                }
            }
        },
    );
}

#[inline(always)]
fn row_of_five(padded: &[f32], [a, b, c]: [f32; 3], out: &mut [f32]) {
    let n = out.len();
    // One by one: lengths that go through an array are not seen to be equal, and each index would be checked.
    let (p0, p1, p2) = (&padded[..n], &padded[1..][..n], &padded[2..][..n]);
    let (p3, p4) = (&padded[3..][..n], &padded[4..][..n]);
    for i in 0..n {
        out[i] = p2[i] * a + (p1[i] + p3[i]) * b + (p0[i] + p4[i]) * c;
    }
}

/// Weighted sums of rows at the same distance above and below; `row` gives them by their offset.
pub(crate) fn across<'a, T: Smoothed>(row: impl Fn(i64) -> &'a [f32], weights: &[f32], out: &mut [T]) {
    let n = out.len();
    vectorized(
        #[inline(always)]
        || match *weights {
            [a, b, c] => {
                let (p0, p1, p2) = (&row(-2)[..n], &row(-1)[..n], &row(0)[..n]);
                let (p3, p4) = (&row(1)[..n], &row(2)[..n]);
                let out = &mut out[..n];
                for i in 0..n {
                    out[i] = T::of(p2[i] * a + (p1[i] + p3[i]) * b + (p0[i] + p4[i]) * c);
                }
            }
            _ => {
                // In blocks, so that the sums stay in registers or close by.
                let mut sums = [0.0f32; 64];
                for start in (0..n).step_by(64) {
                    let count = (n - start).min(64);
                    let part = |k: i64| &row(k)[start..][..count];
                    sums[..count].iter_mut().zip(part(0)).for_each(|(s, p)| *s = p * weights[0]);
                    for (k, &w) in weights.iter().enumerate().skip(1) {
                        let (above, below) = (part(-(k as i64)), part(k as i64));
                        let pairs = above.iter().zip(below);
                        sums[..count].iter_mut().zip(pairs).for_each(|(s, (a, b))| *s += (a + b) * w);
                    }
                    out[start..][..count].iter_mut().zip(&sums).for_each(|(o, &s)| *o = T::of(s));
                }
            }
        },
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Luma;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn smoothing_is_the_double_sum(
            (width, height) in (1u32..24, 1u32..20), seed in 0u32..1000, sigma in 0.3..4.0f64, five in any::<bool>(),
            (x, y, w, h) in (0u32..20, 0u32..16, 1u32..30, 1u32..30),
        ) {
            let image = GrayImage::from_fn(width, height, |x, y| Luma([((x * 97 + y * 61 + x * y * seed) % 256) as u8]));
            let kernel = if five { Gaussian::with_reach(sigma, 2) } else { Gaussian::new(sigma) }.unwrap();
            let (mut blur, mut fine, mut bytes) = (Blur::default(), Plane::<f32>::default(), Plane::<u8>::default());
            let roi = Some(Roi { x, y, width: w, height: h });
            blur.compute(&image, roi, &kernel, &mut fine);
            blur.compute(&image, roi, &kernel, &mut bytes);
            let mut whole = GrayImage::default();
            blur.picture(&image, None, &kernel, &mut whole);
            let reach = i64::from(kernel.reach());
            let weight = |k: i64| math::exp(-0.5 * (k as f64 / sigma).powi(2));
            let norm: f64 = (-reach..=reach).map(weight).sum();
            for v in 0..height {
                for u in 0..width {
                    let Some(found) = fine.get(u, v) else { continue };
                    let mut sum = 0.0;
                    for j in -reach..=reach {
                        for i in -reach..=reach {
                            let at = |p: u32, k: i64, n: u32| (i64::from(p) + k).clamp(0, i64::from(n) - 1) as u32;
                            let pixel = image.get_pixel(at(u, i, width), at(v, j, height))[0];
                            sum += weight(i) * weight(j) * f64::from(pixel);
                        }
                    }
                    let exact = sum / (norm * norm);
                    prop_assert!((f64::from(found) - exact).abs() < 2e-4, "{} {}", found, exact);
                    let byte = bytes.get(u, v).unwrap();
                    prop_assert!((f64::from(byte) - exact).abs() < 0.5 + 2e-4);
                    prop_assert_eq!(byte, whole.get_pixel(u, v)[0]);
                }
            }
        }
    }

    #[test]
    fn kernels_out_of_range_are_refused() {
        for sigma in [0.0, -1.0, f64::NAN, f64::INFINITY, 22.0] {
            assert!(Gaussian::new(sigma).unwrap_err().to_string().contains("sigma"));
        }
        assert!(Gaussian::with_reach(1.0, 0).is_err() && Gaussian::with_reach(1.0, 65).is_err());
    }
}
