//! Pixels under a kernel that is warped with the object.

use nalgebra::{Matrix3, Point2, Vector2};
use vt_core::batch::LANES;

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
}

impl Pixel {
    /// Epanechnikov's kernel.
    pub fn weight(&self) -> f64 {
        let [u, v] = self.place;
        (1.0 - u * u - v * v).max(0.0)
    }
}

/// A run of places of the lattice along a row.
pub(super) struct Row {
    /// Number of the first place along the row.
    first: f64,
    pub count: usize,
    /// Place on the unit disc of the row's number 0, homogeneous, and the way from one to the next.
    start: [f64; 3],
    along: [f64; 3],
    affine: bool,
}

impl Row {
    /// Place on the unit disc of one of the run.
    #[inline(always)]
    fn place(&self, k: usize) -> [f64; 2] {
        let x = self.first + k as f64;
        let [u, v] = [0, 1].map(|axis| self.start[axis] + self.along[axis] * x);
        if self.affine {
            return [u, v];
        }
        let w = self.start[2] + self.along[2] * x;
        [u / w, v / w]
    }

    /// Weights of at least `count` of the run from one on, in units of [`UNIT`].
    #[inline(always)]
    pub fn weights(&self, from: usize, count: usize, out: &mut [u64; LANES]) {
        // Whole registers: what comes after the last is not asked for.
        let out = &mut out[..count.next_multiple_of(8).min(LANES)];
        if self.affine {
            let (u0, v0) = (self.start[0], self.start[1]);
            let first = self.first + from as f64;
            // Numbers of 32 bits become others in lanes.
            for (k, w) in (0_u32..).zip(out.iter_mut()) {
                let x = first + f64::from(k);
                let (u, v) = (u0 + self.along[0] * x, v0 + self.along[1] * x);
                *w = whole((1.0 - u * u - v * v).max(0.0));
            }
            return;
        }
        for (k, w) in out.iter_mut().enumerate() {
            let [u, v] = self.place(from + k);
            *w = whole((1.0 - u * u - v * v).max(0.0));
        }
    }
}

/// Unit of weights that are whole numbers: their sums are exact in any order, and added in a cycle.
pub(super) const UNIT: f64 = 1.0 / (1_u64 << 40) as f64;

/// A weight up to 1 in units.
#[inline(always)]
fn whole(weight: f64) -> u64 {
    // The last bit of 2^12 and more is one unit.
    (weight + (1_u64 << 12) as f64).to_bits() & ((1 << 52) - 1)
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
    /// Every pixel; the weights of so many still have a sum.
    pub const ALL: Self = Self { stride: 1, most: (1 << 24) as f64 };
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
        // NaN becomes zero, and that one.
        ((area / samples as f64).sqrt().ceil() as u32).clamp(1, 1000)
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
        let stride = lattice.stride as usize;
        self.visit_rows(
            bins,
            image_from_object,
            lattice,
            #[inline(always)]
            |row, bins| {
                for k in 0..row.count {
                    let bin = bins.get(k * stride).map_or(OUTSIDE, |bin| *bin);
                    f(Pixel { bin, place: row.place(k) });
                }
            },
        )
    }

    /// Calls `f` for every run of pixels of a row of the lattice under the kernel, with the bins from the first pixel of the run on,
    /// every so-many-th of which is on the lattice; none for those outside of the picture.
    #[inline(always)]
    pub(super) fn visit_rows(
        &self,
        bins: &Plane<u16>,
        image_from_object: &Matrix3<f64>,
        lattice: Lattice,
        mut f: impl FnMut(&Row, &[u16]),
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
        let few = bottom - top < lattice.most;
        if !few {
            return false;
        }
        let region = bins.region();
        let width = region.width as usize;
        // What of a row is in the picture.
        let (stride, left) = (i64::from(lattice.stride), i64::from(region.x));
        let (leftmost, rightmost) =
            ((left + stride - 1).div_euclid(stride), (left + i64::from(region.width) - 1).div_euclid(stride));
        // u² + v² < w² along a row: A x² + 2 B x + C < 0.
        let a = m.m11 * m.m11 + m.m21 * m.m21 - m.m31 * m.m31;
        let ellipse = a > 0.0;
        if !ellipse {
            return true;
        }
        let scale = 1.0 / (a * step);
        let along = [m.m11 * step, m.m21 * step, m.m31 * step];
        let starts = |y: f64| [m.m12 * y + m.m13, m.m22 * y + m.m23, m.m32 * y + m.m33];
        let mut looked = 0.0;
        // Ends of so many rows in lanes.
        let mut ends = [[0.0; LANES]; 2];
        for j in top as i64..=bottom as i64 {
            let lane = (j - top as i64) as usize % LANES;
            if lane == 0 {
                let [firsts, lasts] = &mut ends;
                let rows = (bottom as i64 - j) as usize + 1;
                let rows = rows.next_multiple_of(8).min(LANES);
                for (k, (first, last)) in (0_u32..).zip(firsts[..rows].iter_mut().zip(&mut lasts[..rows])) {
                    let [u0, v0, w0] = starts((j as f64 + f64::from(k)) * step);
                    let b = m.m11 * u0 + m.m21 * v0 - m.m31 * w0;
                    let c = u0 * u0 + v0 * v0 - w0 * w0;
                    let discriminant = b * b - a * c;
                    let root = discriminant.max(0.0).sqrt();
                    *first = ((-b - root) * scale).ceil();
                    *last =
                        if discriminant > 0.0 { ((-b + root) * scale).floor() } else { f64::NEG_INFINITY };
                }
            }
            let (first, last) = (ends[0][lane], ends[1][lane]);
            if last < first {
                continue;
            }
            looked += last - first + 1.0;
            let few = looked < lattice.most;
            if !few {
                return false;
            }
            let y = j as f64 * step;
            let start = starts(y);
            let mut run = |first: i64, end: i64, bins: &[u16]| {
                if end > first {
                    f(
                        &Row { first: first as f64, count: (end - first) as usize, start, along, affine },
                        bins,
                    );
                }
            };
            let (first, end) = (first as i64, last as i64 + 1);
            let from = first.max(leftmost);
            let to = end.min(rightmost + 1);
            let inside = y >= f64::from(region.y) && y < f64::from(region.y) + f64::from(region.height);
            if !inside || from >= to {
                run(first, end, &[]);
                continue;
            }
            run(first, from, &[]);
            let row = &bins.values()[(j * stride - i64::from(region.y)) as usize * width..][..width];
            run(from, to, &row[(from * stride - left) as usize..]);
            run(to, end, &[]);
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
        let in_front = w[2] > (w[0] * w[0] + w[1] * w[1]).sqrt();
        if !in_front {
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
            let visited = part.visit(&bins, &warp.matrix, Lattice { stride, most: 1e5 }, |p| {
                let weight = (1.0 - p.place[0].powi(2) - p.place[1].powi(2)).max(0.0);
                if p.bin == OUTSIDE { outside += weight } else { found[usize::from(p.bin)] += weight }
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
