//! Pixels under a kernel that is warped with the object.

use nalgebra::{Matrix3, Point2, Vector2};

use crate::plane::Plane;

/// Epanechnikov's kernel `1 − u² − v²` on an ellipse of the object, `u = (x − x₀) / a`, `v = (y − y₀) / b`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KernelPart {
    /// Centre in the units of the object.
    pub centre: Point2<f64>,
    /// Half axes along those of the object.
    pub half_axes: Vector2<f64>,
}

/// A pixel under the kernel.
pub(super) struct Pixel {
    /// Bin; [`OUTSIDE`] outside of the picture.
    pub bin: u16,
    /// Place on the unit disc.
    pub place: [f64; 2],
    /// `1 − u² − v²`, not negative.
    pub weight: f64,
}

/// Bin of what lies outside of the picture.
pub(super) const OUTSIDE: u16 = u16::MAX;

/// A lattice in the picture: every so-many-th row and column, and how many places of it may be looked at.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lattice {
    pub stride: u32,
    pub most: f64,
}

impl Lattice {
    /// Every pixel.
    pub const ALL: Self = Self { stride: 1, most: 1e8 };
}

impl KernelPart {
    /// `columns × rows` parts of a rectangle of this size about the origin, by rows.
    pub fn grid(width: f64, height: f64, columns: u32, rows: u32) -> Vec<Self> {
        let half_axes = Vector2::new(0.5 * width / f64::from(columns), 0.5 * height / f64::from(rows));
        let place = |k: u32, half: f64, n: u32| half * (f64::from(2 * k + 1) - f64::from(n));
        let cell = |j: u32, i: u32| Self {
            centre: Point2::new(place(i, half_axes.x, columns), place(j, half_axes.y, rows)),
            half_axes,
        };
        (0..rows).flat_map(|j| (0..columns).map(move |i| cell(j, i))).collect()
    }

    /// Distance of the lattice at which about `samples` pixels lie under the kernel.
    pub(super) fn stride(&self, image_from_object: &Matrix3<f64>, samples: usize) -> u32 {
        let h = image_from_object * self.centre.to_homogeneous();
        // Area of the image of a small square at the centre.
        let growth = image_from_object.determinant() / (h.z * h.z * h.z);
        let area = core::f64::consts::PI * self.half_axes.x * self.half_axes.y * growth.abs();
        // NaN becomes one.
        (area / samples as f64).sqrt().ceil().max(1.0).min(1000.0) as u32
    }

    /// Calls `f` for every pixel of the lattice under the kernel. `false` where the map folds the ellipse, or makes so much
    /// of it that not all of it is looked at.
    #[inline(always)]
    pub(super) fn visit(
        &self,
        bins: &Plane<u16>,
        image_from_object: &Matrix3<f64>,
        lattice: Lattice,
        mut f: impl FnMut(Pixel),
    ) -> bool {
        let Some(rows) = self.rows_in(image_from_object) else { return false };
        let Some(object_from_image) = image_from_object.try_inverse() else { return false };
        // Place on the unit disc from pixel, homogeneous.
        let (a, b, c) = (self.half_axes.x, self.half_axes.y, self.centre);
        let disc = Matrix3::new(1.0 / a, 0.0, -c.x / a, 0.0, 1.0 / b, -c.y / b, 0.0, 0.0, 1.0);
        let m = disc * object_from_image;
        let affine = m.m31 == 0.0 && m.m32 == 0.0;
        let m = if affine { m / m.m33 } else { m };
        let step = f64::from(lattice.stride);
        let (top, bottom) = ((rows[0] / step).ceil(), (rows[1] / step).floor());
        if !(bottom - top < lattice.most) {
            return false;
        }
        let region = bins.region();
        let width = region.width as usize;
        let mut looked = 0.0;
        for j in top as i64..=bottom as i64 {
            let y = j as f64 * step;
            let [u0, v0, w0] = [m.m12 * y + m.m13, m.m22 * y + m.m23, m.m32 * y + m.m33];
            // u² + v² < w² along the row: A x² + 2 B x + C < 0.
            let a = m.m11 * m.m11 + m.m21 * m.m21 - m.m31 * m.m31;
            let b = m.m11 * u0 + m.m21 * v0 - m.m31 * w0;
            let c = u0 * u0 + v0 * v0 - w0 * w0;
            let discriminant = b * b - a * c;
            if !(discriminant > 0.0 && a > 0.0) {
                continue;
            }
            let (root, scale) = (discriminant.sqrt(), 1.0 / (a * step));
            let (first, last) = (((-b - root) * scale).ceil(), ((-b + root) * scale).floor());
            looked += last - first;
            if !(looked < lattice.most) {
                return false;
            }
            let pixel = |i: i64, bin: u16| {
                let x = i as f64 * step;
                let (mut u, mut v) = (m.m11 * x + u0, m.m21 * x + v0);
                if !affine {
                    let w = m.m31 * x + w0;
                    (u, v) = (u / w, v / w);
                }
                Pixel { bin, place: [u, v], weight: (1.0 - u * u - v * v).max(0.0) }
            };
            let (first, last) = (first as i64, last as i64);
            // What of the row is in the picture.
            let (stride, left) = (i64::from(lattice.stride), i64::from(region.x));
            let from = first.max((left + stride - 1).div_euclid(stride));
            let to = last.min((left + i64::from(region.width) - 1).div_euclid(stride));
            let inside = y >= f64::from(region.y) && y < f64::from(region.y) + f64::from(region.height);
            if !inside || from > to {
                (first..=last).for_each(|i| f(pixel(i, OUTSIDE)));
                continue;
            }
            (first..from).for_each(|i| f(pixel(i, OUTSIDE)));
            let row = &bins.values()[(j * stride - i64::from(region.y)) as usize * width..][..width];
            let along = row[(from * stride - left) as usize..].iter().step_by(lattice.stride as usize);
            for (i, &bin) in (from..=to).zip(along) {
                f(pixel(i, bin));
            }
            (to + 1..=last).for_each(|i| f(pixel(i, OUTSIDE)));
        }
        true
    }

    /// Least and largest row of the ellipse's image; `None` where a part of it has none.
    fn rows_in(&self, m: &Matrix3<f64>) -> Option<[f64; 2]> {
        // The dual conic of the ellipse, diag(a², b², −1) about its centre, maps as M C Mᵀ; the rows y touch it where
        // (0, 1, −y) C (0, 1, −y)ᵀ = 0.
        let axis = |k: usize| {
            let (x, y) = (m[(k, 0)] * self.half_axes.x, m[(k, 1)] * self.half_axes.y);
            [x, y, m[(k, 0)] * self.centre.x + m[(k, 1)] * self.centre.y + m[(k, 2)]]
        };
        let (p, w) = (axis(1), axis(2));
        // Depth is positive all over the ellipse.
        if !(w[2] > (w[0] * w[0] + w[1] * w[1]).sqrt()) {
            return None;
        }
        let product = |a: [f64; 3], b: [f64; 3]| a[2] * b[2] - a[0] * b[0] - a[1] * b[1];
        let (ww, pw, pp) = (product(w, w), product(p, w), product(p, p));
        let root = (pw * pw - ww * pp).max(0.0).sqrt();
        Some([(pw - root) / ww, (pw + root) / ww])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use vt_core::frame::Roi;
    use vt_core::laws::group;
    use vt_core::lie::{LieGroup, SL3};

    fn map(scale: f64, x: f64, y: f64) -> SL3 {
        SL3::from_matrix(&Matrix3::new(scale, 0.0, x, 0.0, scale, y, 0.0, 0.0, 1.0)).unwrap()
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 60, rng_seed: proptest::test_runner::RngSeed::Fixed(3), ..Default::default() })]

        /// What is visited is what a look at every pixel of the plane finds under the kernel.
        #[test]
        fn all_pixels_under_the_kernel_are_visited_once(
            small in group::<SL3>(0.3),
            (x, y) in (-10.0..50.0_f64, -10.0..40.0_f64),
            (a, b) in (3.0..14.0_f64, 3.0..14.0_f64),
            stride in 1..4_u32,
        ) {
            let region = Roi { x: 4, y: 3, width: 30, height: 25 };
            let mut bins = Plane::<u16>::default();
            bins.reshape(region).iter_mut().enumerate().for_each(|(k, bin)| *bin = (k % 7) as u16);
            // A motion of the unit square, on an object of some 20 pixels.
            let warp = map(20.0, x, y).compose(&small).compose(&map(1.0 / 20.0, 0.0, 0.0));
            let part = KernelPart { centre: Point2::new(1.0, -2.0), half_axes: Vector2::new(a, b) };
            let (mut found, mut outside) = ([0.0; 7], 0.0);
            let visited = part.visit(&bins, &warp.matrix, Lattice { stride, most: 1e5 }, |p| match p.bin {
                OUTSIDE => outside += p.weight,
                bin => found[usize::from(bin)] += p.weight,
            });
            prop_assert!(visited);
            let (mut expected, mut beyond) = ([0.0; 7], 0.0);
            let inverse = warp.inverse();
            let s = stride as i32;
            for (i, j) in (-120..160_i32).flat_map(|j| (-120..160_i32).map(move |i| (i * s, j * s))) {
                let pixel = Point2::new(f64::from(i), f64::from(j));
                let h = inverse.matrix * pixel.to_homogeneous();
                let p = Point2::new(h.x / h.z, h.y / h.z) - part.centre;
                let weight = 1.0 - (p.x / a).powi(2) - (p.y / b).powi(2);
                if weight > 0.0 && h.z > 0.0 {
                    match (i >= 0 && j >= 0).then(|| bins.get(i as u32, j as u32)).flatten() {
                        Some(bin) => expected[usize::from(bin)] += weight,
                        None => beyond += weight,
                    }
                }
            }
            for k in 0..7 {
                prop_assert!((found[k] - expected[k]).abs() < 1e-8, "{}: {} {}", k, found[k], expected[k]);
            }
            prop_assert!((outside - beyond).abs() < 1e-7, "{} {}", outside, beyond);
        }
    }

    #[test]
    fn parts_tile_the_rectangle_and_absurd_maps_are_refused() {
        let parts = KernelPart::grid(60.0, 40.0, 3, 2);
        assert_eq!(parts.len(), 6);
        assert_eq!(parts[0].centre, Point2::new(-20.0, -10.0));
        assert_eq!(parts[5].centre, Point2::new(20.0, 10.0));
        assert_eq!(parts[0].half_axes, Vector2::new(10.0, 10.0));
        let mut bins = Plane::<u16>::default();
        bins.reshape(Roi { x: 0, y: 0, width: 4, height: 4 });
        let one = Matrix3::identity();
        for m in [
            Matrix3::from_diagonal(&Vector2::new(1e9, 1e9).push(1.0)),
            Matrix3::zeros(),
            one * f64::NAN,
            Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, -1.0, 0.0, 1.0),
        ] {
            assert!(!parts[5].visit(&bins, &m, Lattice { stride: 1, most: 1e4 }, |_| ()), "{m}");
        }
        assert_eq!(parts[0].stride(&one, 400), 1);
        assert_eq!(parts[0].stride(&Matrix3::from_diagonal(&Vector2::new(4.0, 4.0).push(1.0)), 400), 4);
        assert_eq!(parts[0].stride(&(one * f64::NAN), 400), 1);
    }
}
