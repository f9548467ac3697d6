//! The gradient of a colour picture.

use image::{GrayImage, RgbImage};
use vt_core::batch::vectorized;
use vt_core::frame::Roi;

use crate::color::rows;
use crate::gaussian::{Blur, Gaussian};
use crate::gradient::Gradient;
use crate::plane::grown;

/// Buffers for one channel after the other.
#[derive(Clone, Debug, Default)]
pub(super) struct Channels {
    plain: GrayImage,
    smooth: GrayImage,
    gradients: [Gradient; 3],
}

impl Channels {
    /// Gradient of a region and one pixel around it: `√λ e` with the greatest eigenvalue and its eigenvector of the sum of the
    /// channels' `g gᵀ`, pointing where the channels grow in sum.
    pub(super) fn gradient(
        &mut self,
        image: &RgbImage,
        region: Roi,
        kernel: Option<&Gaussian>,
        blur: &mut Blur,
        out: &mut Gradient,
    ) {
        let size = image.dimensions();
        if self.plain.dimensions() != size {
            self.plain = GrayImage::new(size.0, size.1);
        }
        let reach = kernel.map_or(0, Gaussian::reach);
        let (around, wide) = (grown(region, 1, size), grown(region, 2, size));
        let read = grown(wide, reach, size);
        for (channel, gradient) in self.gradients.iter_mut().enumerate() {
            let stride = size.0 as usize;
            let start = read.y as usize * stride + read.x as usize;
            let lines = self.plain.get_mut(start..).unwrap_or_default().chunks_mut(stride.max(1));
            for (rgb, line) in rows(image, read).zip(lines) {
                pick(rgb, channel, line);
            }
            let source = match kernel {
                Some(kernel) => {
                    blur.picture(&self.plain, Some(wide), kernel, &mut self.smooth);
                    &self.smooth
                }
                None => &self.plain,
            };
            gradient.compute(source, Some(around));
        }
        let [r, g, b] = &self.gradients;
        out.resize(r.region.unwrap_or(Roi { x: 0, y: 0, width: 0, height: 0 }), size);
        strongest([&r.x, &g.x, &b.x], [&r.y, &g.y, &b.y], &mut out.x, &mut out.y);
    }
}

/// One channel of a row of pixels.
fn pick(rgb: &[u8], channel: usize, out: &mut [u8]) {
    vectorized(
        #[inline(always)]
        move || {
            for (to, from) in out.iter_mut().zip(rgb.chunks_exact(3)) {
                *to = from[channel];
            }
        },
    );
}

/// Direction and size of the strongest change.
fn strongest(x: [&[i16]; 3], y: [&[i16]; 3], out_x: &mut [i16], out_y: &mut [i16]) {
    vectorized(
        #[inline(always)]
        move || {
            let n = out_x.len().min(out_y.len());
            let [x0, x1, x2] = x.map(|c| &c[..n]);
            let [y0, y1, y2] = y.map(|c| &c[..n]);
            for i in 0..n {
                let [x0, x1, x2] = [x0[i], x1[i], x2[i]].map(f32::from);
                let [y0, y1, y2] = [y0[i], y1[i], y2[i]].map(f32::from);
                let xx = x0 * x0 + x1 * x1 + x2 * x2;
                let yy = y0 * y0 + y1 * y1 + y2 * y2;
                let xy = x0 * y0 + x1 * y1 + x2 * y2;
                let half = 0.5 * (xx - yy);
                let root = (half * half + xy * xy).sqrt();
                let size = (0.5 * (xx + yy) + root).max(0.0).sqrt();
                // Of the two forms of the eigenvector the one without cancellation.
                let (u, v) = if half >= 0.0 { (half + root, xy) } else { (xy, root - half) };
                let norm = (u * u + v * v).sqrt();
                let (u, v) = if norm > 0.0 { (u / norm, v / norm) } else { (1.0, 0.0) };
                let along = u * (x0 + x1 + x2) + v * (y0 + y1 + y2);
                let size = if along < 0.0 { -size } else { size };
                out_x[i] = nearest(u * size);
                out_y[i] = nearest(v * size);
            }
        },
    );
}

/// The nearest integer to a number between −2^14 and 2^14.
#[inline(always)]
fn nearest(x: f32) -> i16 {
    // 1.5 · 2^23: the sum's lowest bits are the integer, in two's complement.
    (x + 12_582_912.0).to_bits() as i16
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix2, Vector2};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_strongest_change_is_the_first_eigenvector(g in prop::array::uniform6(-1020i16..=1020)) {
            let (mut x, mut y) = ([0], [0]);
            strongest([0, 1, 2].map(|k| &g[k..=k]), [3, 4, 5].map(|k| &g[k..=k]), &mut x, &mut y);
            let found = Vector2::new(f64::from(x[0]), f64::from(y[0]));
            let mut tensor = Matrix2::zeros();
            let mut sum = Vector2::zeros();
            for k in 0..3 {
                let channel = Vector2::new(f64::from(g[k]), f64::from(g[k + 3]));
                tensor += channel * channel.transpose();
                sum += channel;
            }
            let eigen = tensor.symmetric_eigen();
            let first = eigen.eigenvalues.imax();
            let size = eigen.eigenvalues[first].max(0.0).sqrt();
            // Rounding to whole numbers moves both ends of the vector by at most half a unit an axis.
            prop_assert!((found.norm() - size).abs() < 0.75);
            let growth = ((tensor * found).dot(&found) / found.norm_squared().max(1.0)).sqrt();
            prop_assert!((growth - size).abs() < 1.0, "{} {}", growth, size);
            prop_assert!(found.dot(&sum) >= -0.75 * sum.norm());
        }
    }
}
