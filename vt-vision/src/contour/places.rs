//! Points of a warped contour with their normals.

use nalgebra::{DefaultAllocator, Point2, Vector2};
use vt_core::agent::{Posed, Warp};
use vt_core::manifold::{Alloc, Manifold, Tangent};
use vt_models::contour::{Contour, normal};

use super::params::MOST_SAMPLES;

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

/// Calls `f` for every contour point that has a place and a normal in the picture.
#[inline(always)]
pub(super) fn places<P: Manifold, W: Warp<P>>(
    posed: &W::Posed<'_>,
    contour: &Contour<W::Body>,
    mut f: impl FnMut(Place),
) where
    DefaultAllocator: Alloc<P::D>,
{
    let mut images = [Point2::new(f64::NAN, f64::NAN); MOST_SAMPLES];
    let images = &mut images[..contour.points().len()];
    for (image, point) in images.iter_mut().zip(contour.points()) {
        if let Some(y) = posed.locate(point) {
            *image = y;
        }
    }
    for (index, (&y, &[before, after])) in images.iter().zip(contour.links()).enumerate() {
        let (before, after) = (images[before as usize], images[after as usize]);
        if let Some(normal) = normal(&before, &after) {
            // The normal is the difference turned and divided by this.
            let length = normal.x * (after.y - before.y) - normal.y * (after.x - before.x);
            f(Place { index, y, normal, length });
        }
    }
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
