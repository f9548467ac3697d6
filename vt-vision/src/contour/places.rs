//! Points of a warped contour with their normals.

use nalgebra::{DefaultAllocator, Point2, Vector2};
use vt_core::agent::{Posed, Warp};
use vt_core::batch::{LANES, vectorized, with_rows};
use vt_core::manifold::{Alloc, Manifold, Tangent};
use vt_models::contour::Contour;

/// A contour point in the picture.
#[derive(Clone, Copy)]
pub(super) struct Place {
    /// Number of the point.
    pub index: usize,
    pub y: Point2<f64>,
    pub normal: Vector2<f64>,
    /// Distance of the point's neighbours.
    pub length: f64,
}

/// Places and unit normals of all points of a warped contour, coordinate by coordinate; NaN where there is none.
pub(super) struct Normals<'a> {
    pub x: &'a mut [f64],
    pub y: &'a mut [f64],
    pub nx: &'a mut [f64],
    pub ny: &'a mut [f64],
    /// Distance of the point's neighbours.
    pub length: &'a mut [f64],
}

/// Lends the normals of a warped contour.
#[inline(always)]
pub(super) fn with_normals<P: Manifold, W: Warp<P>, R>(
    posed: &W::Posed<'_>,
    contour: &Contour<W::Body>,
    f: impl FnOnce(&Normals<'_>) -> R,
) -> R
where
    DefaultAllocator: Alloc<P::D>,
{
    let n = contour.points().len();
    let each = n.div_ceil(LANES);
    with_rows(5 * each, |rows| {
        let mut parts = rows.chunks_exact_mut(each).map(|rows| &mut rows.as_flattened_mut()[..n]);
        let mut part = || parts.next().unwrap_or_default();
        let mut normals = Normals { x: part(), y: part(), nx: part(), ny: part(), length: part() };
        normals.fill::<P, W>(posed, contour);
        f(&normals)
    })
}

impl Normals<'_> {
    /// The normal of a point is the difference `d` of its neighbours turned, `(d_y, −d_x) / |d|`, as in
    /// [`vt_models::contour::normal`].
    #[inline(always)]
    fn fill<P: Manifold, W: Warp<P>>(&mut self, posed: &W::Posed<'_>, contour: &Contour<W::Body>)
    where
        DefaultAllocator: Alloc<P::D>,
    {
        let Self { x, y, nx, ny, length } = self;
        for (k, point) in contour.points().iter().enumerate() {
            [x[k], y[k]] = posed.locate(point).map_or([f64::NAN; 2], Into::into);
        }
        for (k, &[before, after]) in contour.links().iter().enumerate() {
            let (before, after) = (before as usize, after as usize);
            nx[k] = y[after] - y[before];
            ny[k] = x[before] - x[after];
        }
        vectorized(
            #[inline(always)]
            || {
                for ((u, v), length) in nx.iter_mut().zip(ny.iter_mut()).zip(length.iter_mut()) {
                    let norm = (*u * *u + *v * *v).sqrt();
                    // Zero times infinity is NaN: places that coincide have no normal.
                    let reciprocal = 1.0 / norm;
                    *u *= reciprocal;
                    *v *= reciprocal;
                    *length = norm;
                }
            },
        );
    }
}

/// Calls `f` for every contour point that has a place and a normal in the picture.
#[inline(always)]
pub(super) fn places<P: Manifold, W: Warp<P>>(
    posed: &W::Posed<'_>,
    contour: &Contour<W::Body>,
    mut f: impl FnMut(Place),
) where
    DefaultAllocator: Alloc<P::D>,
{
    with_normals::<P, W, _>(posed, contour, |all| {
        for index in 0..all.x.len() {
            let normal = Vector2::new(all.nx[index], all.ny[index]);
            if normal.x.is_finite() && normal.y.is_finite() {
                let y = Point2::new(all.x[index], all.y[index]);
                f(Place { index, y, normal, length: all.length[index] });
            }
        }
    });
}

impl Place {
    /// Unit tangent of the contour.
    pub fn tangent(&self) -> Vector2<f64> {
        Vector2::new(-self.normal.y, self.normal.x)
    }

    /// Derivatives of the place along the normal, `n · ∂y`, and of the normal, `ω = n · ∂(y₊ − y₋) / |y₊ − y₋|` with
    /// `∂n = −t ω`.
    pub fn derivatives<P: Manifold, W: Warp<P>>(
        &self,
        posed: &W::Posed<'_>,
        contour: &Contour<W::Body>,
    ) -> Option<(Tangent<P>, Tangent<P>)>
    where
        DefaultAllocator: Alloc<P::D>,
    {
        let along = |k: usize| Some(posed.linearize(&contour.points()[k])?.1.tr_mul(&self.normal));
        let [before, after] = contour.links()[self.index].map(|k| along(k as usize));
        Some((along(self.index)?, (after? - before?) / self.length))
    }
}
