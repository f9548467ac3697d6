//! Steepest-descent rows and their sums, in blocks of points.
//!
//! The generators of every group of motions of the plane are combinations of those of SL(3), `G(x) = G_SL3(x) E` with a
//! constant matrix `E`. All sums over points are therefore made once, in the eight coordinates of SL(3), and brought to
//! those of the group afterwards. Points are in units of half the template's diagonal, so that the coordinates are of
//! one size.

use nalgebra::{DefaultAllocator, Dim, Matrix3, Point2, SMatrix, SVector, U1};
use vt_core::batch::{LANES, Row, vectorized};
use vt_core::lie::{PlanarMotion, SL3};
use vt_core::manifold::{Alloc, Square, Tangent};

use super::planes::View;

/// Sums over the coordinates of SL(3).
pub(super) type Vector8 = SVector<f64, 8>;
/// Products of such sums.
pub(super) type Matrix8 = SMatrix<f64, 8, 8>;

/// What a block has where there is no point.
pub(super) const NOTHING: Row = [0.0; LANES];

/// Points of the template, in blocks; those beyond the last have weight zero.
#[derive(Clone, Debug, Default)]
pub(super) struct Points {
    pub x: Vec<Row>,
    pub y: Vec<Row>,
    pub count: usize,
}

/// Vectors at the points: gradients by their coordinates.
#[derive(Clone, Debug, Default)]
pub(super) struct Gradients {
    pub x: Vec<Row>,
    pub y: Vec<Row>,
}

impl Gradients {
    pub fn resize(&mut self, blocks: usize) {
        self.x.resize(blocks, NOTHING);
        self.y.resize(blocks, NOTHING);
    }
}

/// Grey levels of a picture at the points.
#[derive(Clone, Debug, Default)]
pub(super) struct Seen {
    pub level: Vec<Row>,
    /// Slopes along the coordinates of the points.
    pub slope: Gradients,
    /// One for a point in the picture, zero for another.
    pub inside: Vec<Row>,
    pub count: usize,
}

impl Seen {
    pub fn resize(&mut self, blocks: usize) {
        self.level.resize(blocks, NOTHING);
        self.inside.resize(blocks, NOTHING);
        self.slope.resize(blocks);
    }

    /// Looks at the images of the points under `m`.
    pub fn look(&mut self, view: &View, m: &Matrix3<f64>, points: &Points) {
        self.count = 0;
        let mut left = points.count;
        for b in 0..points.x.len() {
            let count = left.min(LANES);
            left -= count;
            let (mut u, mut v, mut depth) = (NOTHING, NOTHING, NOTHING);
            let (x, y) = (&points.x[b], &points.y[b]);
            vectorized(
                #[inline(always)]
                || {
                    for k in 0..LANES {
                        let d = m.m31 * x[k] + m.m32 * y[k] + m.m33;
                        let inverse = 1.0 / d;
                        u[k] = (m.m11 * x[k] + m.m12 * y[k] + m.m13) * inverse;
                        v[k] = (m.m21 * x[k] + m.m22 * y[k] + m.m23) * inverse;
                        depth[k] = inverse;
                    }
                },
            );
            let (mut du, mut dv) = (NOTHING, NOTHING);
            let (level, inside) = (&mut self.level[b], &mut self.inside[b]);
            *inside = NOTHING;
            for k in 0..count {
                let found = if depth[k] > 0.0 { view.interpolate(u[k], v[k]) } else { None };
                let [value, x, y] = found.unwrap_or_default();
                (level[k], du[k], dv[k]) = (value, x, y);
                inside[k] = f64::from(u8::from(found.is_some()));
            }
            self.count += inside.iter().filter(|w| **w > 0.0).count();
            let (sx, sy) = (&mut self.slope.x[b], &mut self.slope.y[b]);
            vectorized(
                #[inline(always)]
                || {
                    for k in 0..LANES {
                        let (u, v, d) = (u[k], v[k], depth[k]);
                        sx[k] = (du[k] * (m.m11 - u * m.m31) + dv[k] * (m.m21 - v * m.m31)) * d;
                        sy[k] = (du[k] * (m.m12 - u * m.m32) + dv[k] * (m.m22 - v * m.m32)) * d;
                    }
                },
            );
        }
    }
}

/// Rows `gᵀ G_SL3(x)` of a block.
#[inline(always)]
pub(super) fn rows(x: &Row, y: &Row, gx: &Row, gy: &Row) -> [Row; 8] {
    let mut j = [NOTHING; 8];
    for k in 0..LANES {
        let (x, y, gx, gy) = (x[k], y[k], gx[k], gy[k]);
        let along = x * gx + y * gy;
        j[0][k] = gx;
        j[1][k] = gy;
        j[2][k] = x * gy - y * gx;
        j[3][k] = along;
        j[4][k] = x * gx - y * gy;
        j[5][k] = y * gx + x * gy;
        j[6][k] = -x * along;
        j[7][k] = -y * along;
    }
    j
}

/// Sums of every eighth lane, so that a sum is as wide as registers are; the order does not depend on the machine.
pub(super) type Lanes = [f64; 8];

/// `sums += a b`, lane by lane.
#[inline(always)]
pub(super) fn add_products(sums: &mut Lanes, a: &Row, b: &Row) {
    for k in 0..LANES / 8 {
        for l in 0..8 {
            sums[l] += a[8 * k + l] * b[8 * k + l];
        }
    }
}

/// `sums += a`, lane by lane.
#[inline(always)]
pub(super) fn add(sums: &mut Lanes, a: &Row) {
    for k in 0..LANES / 8 {
        for l in 0..8 {
            sums[l] += a[8 * k + l];
        }
    }
}

/// The whole sum.
pub(super) fn whole([a, b, c, d, e, f, g, h]: Lanes) -> f64 {
    ((a + e) + (c + g)) + ((b + f) + (d + h))
}

/// `Σ G_SL3(x)ᵀ g`.
pub(super) fn sum(points: &Points, g: &Gradients) -> Vector8 {
    let mut sums = [[0.0; 8]; 8];
    for b in 0..points.x.len() {
        vectorized(
            #[inline(always)]
            || {
                let j = rows(&points.x[b], &points.y[b], &g.x[b], &g.y[b]);
                for r in 0..8 {
                    add(&mut sums[r], &j[r]);
                }
            },
        );
    }
    Vector8::from(sums.map(whole))
}

/// `Σ w Jᵀ J` of the rows `J = gᵀ G_SL3(x)`.
pub(super) fn squares(points: &Points, g: &Gradients, weights: &[Row]) -> Matrix8 {
    let mut sums = [[[0.0; 8]; 8]; 8];
    for (b, weights) in weights.iter().enumerate() {
        vectorized(
            #[inline(always)]
            || {
                let j = rows(&points.x[b], &points.y[b], &g.x[b], &g.y[b]);
                for r in 0..8 {
                    let mut weighted = NOTHING;
                    for k in 0..LANES {
                        weighted[k] = weights[k] * j[r][k];
                    }
                    for c in 0..=r {
                        add_products(&mut sums[r][c], &weighted, &j[c]);
                    }
                }
            },
        );
    }
    let mut out = Matrix8::from_fn(|r, c| whole(sums[r][c]));
    out.fill_upper_triangle_with_lower_triangle();
    out
}

/// `Σ w J` and `Σ w v J` with one number `v` a point.
pub(super) fn moments(points: &Points, g: &Gradients, weights: &[Row], values: &[Row]) -> [Vector8; 2] {
    let (mut ones, mut with_values) = ([[0.0; 8]; 8], [[0.0; 8]; 8]);
    for (b, weights) in weights.iter().enumerate() {
        vectorized(
            #[inline(always)]
            || {
                let j = rows(&points.x[b], &points.y[b], &g.x[b], &g.y[b]);
                let mut weighted = NOTHING;
                for k in 0..LANES {
                    weighted[k] = weights[k] * values[b][k];
                }
                for r in 0..8 {
                    add_products(&mut ones[r], weights, &j[r]);
                    add_products(&mut with_values[r], &weighted, &j[r]);
                }
            },
        );
    }
    [ones, with_values].map(|sums| Vector8::from(sums.map(whole)))
}

/// The matrix `E` of a group, by columns.
#[derive(Clone, Debug)]
pub(super) struct Basis {
    columns: Vec<Vector8>,
}

impl Basis {
    /// That of `P`, for points in units of `scale`.
    pub fn of<P: PlanarMotion>(at: &P, scale: f64) -> Self
    where
        DefaultAllocator: Alloc<P::D>,
    {
        // Four points of which no three lie on a line determine a homography, and their motions a generator.
        let places = [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]].map(Point2::from);
        let mut all = Matrix8::zeros();
        for (k, p) in places.iter().enumerate() {
            all.fixed_view_mut::<2, 8>(2 * k, 0).copy_from(&SL3::generators(p));
        }
        let inverse = all.try_inverse().unwrap_or_default();
        let column = |c: usize| {
            let mut motion = Vector8::zeros();
            for (k, p) in places.iter().enumerate() {
                let g = P::generators(&(p * scale));
                (motion[2 * k], motion[2 * k + 1]) = (g[(0, c)] / scale, g[(1, c)] / scale);
            }
            inverse * motion
        };
        Self { columns: (0..at.dim().value()).map(column).collect() }
    }

    /// `Eᵀ v`.
    pub fn vector<P: PlanarMotion>(&self, at: &P, v: &Vector8) -> Tangent<P>
    where
        DefaultAllocator: Alloc<P::D>,
    {
        Tangent::<P>::from_fn_generic(at.dim(), U1, |r, _| self.columns[r].dot(v))
    }

    /// `Eᵀ m E`.
    pub fn matrix<P: PlanarMotion>(&self, at: &P, m: &Matrix8) -> Square<P>
    where
        DefaultAllocator: Alloc<P::D>,
    {
        let n = at.dim();
        let mut out = Square::<P>::zeros_generic(n, n);
        for (c, column) in self.columns.iter().enumerate() {
            let image = m * column;
            for (r, row) in self.columns.iter().enumerate() {
                out[(r, c)] = row.dot(&image);
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vt_core::lie::{Affine2, SE2, Sim2, TranslationScale, Vector};

    /// Random numbers without a generator.
    fn noise(k: usize) -> f64 {
        ((k * 7919 + 31) % 1013) as f64 / 506.5 - 1.0
    }

    /// Sums agree with the group's own generators.
    fn holds<P: PlanarMotion>(pose: &P)
    where
        DefaultAllocator: Alloc<P::D>,
    {
        let (scale, count) = (37.0, 100);
        let mut points = Points { x: vec![NOTHING; 2], y: vec![NOTHING; 2], count };
        let (mut g, mut w) = (Gradients::default(), vec![NOTHING; 2]);
        g.resize(2);
        let n = pose.dim();
        let (mut sums, mut products) = (Tangent::<P>::zeros_generic(n, U1), Square::<P>::zeros_generic(n, n));
        for k in 0..count {
            let (b, l) = (k / LANES, k % LANES);
            let [x, y, gx, gy] = [0, 1, 2, 3].map(|c| noise(4 * k + c));
            (points.x[b][l], points.y[b][l], g.x[b][l], g.y[b][l]) = (x, y, gx, gy);
            w[b][l] = 1.5 + noise(k);
            let row = P::generators(&Point2::new(scale * x, scale * y))
                .tr_mul(&nalgebra::Vector2::new(gx / scale, gy / scale));
            sums += &row;
            products.ger(w[b][l], &row, &row, 1.0);
        }
        let basis = Basis::of(pose, scale);
        let found = basis.vector(pose, &sum(&points, &g));
        assert!((found - &sums).norm() < 1e-9 * sums.norm());
        let found = basis.matrix(pose, &squares(&points, &g, &w));
        assert!((found - &products).norm() < 1e-9 * products.norm());
    }

    #[test]
    fn sums_of_all_groups_come_from_those_of_homographies() {
        let s = Sim2::new(3.0, 4.0, 0.5, 2.0);
        holds(&Vector::<2>::of(&s));
        holds(&TranslationScale::of(&s));
        holds(&SE2::of(&s));
        holds(&s);
        holds(&Affine2::of(&s));
        holds(&SL3::of(&s));
    }
}
