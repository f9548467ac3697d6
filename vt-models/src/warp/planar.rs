//! Warps of flat models: points of the model's plane to pixels, without a camera (paper §6: translation, translation
//! and scale, `a R(θ) x + b`, and on to homographies).

use core::marker::PhantomData;

use nalgebra::{DefaultAllocator, Dim, Matrix, Matrix2, Matrix3, OMatrix, Point2, StorageMut, U2};
use vt_core::agent::{Posed, Warp};
use vt_core::lie::PlanarMotion;
use vt_core::manifold::Alloc;

/// Flat model in an uncalibrated picture: `y = W(p) x` with `x` in the units of the model (those of a reference picture:
/// pixels) about an origin of its own, and `y` in pixels.
///
/// The Jacobian under `p · Exp(δ)` is that of the map at `x` times the generators at `x`.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanarWarp<P> {
    locked: Vec<usize>,
    pose: PhantomData<fn() -> P>,
}

impl<P> Default for PlanarWarp<P> {
    fn default() -> Self {
        Self { locked: vec![], pose: PhantomData }
    }
}

impl<P> PlanarWarp<P> {
    /// Frees some degrees of freedom, in tangent order; the columns of the others are zero.
    #[must_use]
    pub fn with_free(self, free: &[bool]) -> Self {
        Self { locked: (0..free.len()).filter(|&k| !free[k]).collect(), ..self }
    }

    /// Sets the columns of the locked degrees of freedom in rows over the tangent space to zero.
    #[inline]
    pub fn lock<R: Dim, D: Dim, S: StorageMut<f64, R, D>>(&self, rows: &mut Matrix<f64, R, D, S>) {
        for &k in &self.locked {
            rows.column_mut(k).fill(0.0);
        }
    }
}

/// [`PlanarWarp`] at one pose.
#[derive(Clone, Debug)]
pub struct PosedPlanar<'a, P> {
    matrix: Matrix3<f64>,
    warp: &'a PlanarWarp<P>,
}

impl<P: PlanarMotion> Warp<P> for PlanarWarp<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    type Body = Point2<f64>;
    type Posed<'a> = PosedPlanar<'a, P>;

    #[inline]
    fn at<'a>(&'a self, pose: &P) -> PosedPlanar<'a, P> {
        PosedPlanar { matrix: pose.matrix(), warp: self }
    }
}

impl<P: PlanarMotion> Posed<P> for PosedPlanar<'_, P>
where
    DefaultAllocator: Alloc<P::D>,
{
    type Body = Point2<f64>;

    #[inline]
    fn locate(&self, x: &Point2<f64>) -> Option<Point2<f64>> {
        let m = &self.matrix;
        let depth = m.m31 * x.x + m.m32 * x.y + m.m33;
        let y = Point2::new(m.m11 * x.x + m.m12 * x.y + m.m13, m.m21 * x.x + m.m22 * x.y + m.m23);
        // Affine maps have depth one, and the division by it is exact.
        (depth > 0.0).then(|| if depth == 1.0 { y } else { y / depth })
    }

    fn linearize(&self, x: &Point2<f64>) -> Option<(Point2<f64>, OMatrix<f64, U2, P::D>)> {
        let y = self.locate(x)?;
        let m = &self.matrix;
        let depth = m.m31 * x.x + m.m32 * x.y + m.m33;
        let by_model =
            Matrix2::new(m.m11 - y.x * m.m31, m.m12 - y.x * m.m32, m.m21 - y.y * m.m31, m.m22 - y.y * m.m32)
                / depth;
        let mut jacobian = by_model * P::generators(x);
        self.warp.lock(&mut jacobian);
        Some((y, jacobian))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{OVector, SVector, U1};
    use proptest::prelude::*;
    use vt_core::laws::{Dual64, group, lift};
    use vt_core::lie::{Affine2, LieGroup, SE2, SL3, Sim2, TranslationScale, Vector};
    use vt_core::warp_laws;

    fn bodies() -> impl Strategy<Value = Vec<Point2<f64>>> {
        let point = prop::array::uniform2(-0.4..0.4_f64).prop_map(Point2::from);
        prop::collection::vec(point, 1..5)
    }

    /// `p · Exp(e) · x` over dual numbers.
    fn dual<G: LieGroup>(pose: &G, x: &Point2<f64>, e: &[Dual64]) -> Option<[Dual64; 2]>
    where
        G::Over<Dual64>: LieGroup<Dual64, Dim = G::Dim, Point = Point2<Dual64>>,
        DefaultAllocator: Alloc<G::Dim>,
    {
        let d = lift(&pose.log());
        let step = OVector::from_fn_generic(d.shape_generic().0, U1, |k, _| e[k]);
        let moved = G::Over::<Dual64>::exp(&d).compose(&G::Over::<Dual64>::exp(&step));
        Some(moved.act(&x.map(Dual64::from)).into())
    }

    warp_laws!(shift: PlanarWarp::default(), group::<Vector<2>>(100.0), bodies(),
    dual = |_: &_, p: &Vector<2>, x: &Point2<f64>, e: &[Dual64]| {
        Some([0, 1].map(|k| e[k] + p.0[k] + x[k]))
    });
    warp_laws!(growing: PlanarWarp::default(), group::<TranslationScale>(1.0), bodies(),
        dual = |_: &_, p: &TranslationScale, x: &_, e: &_| dual(p, x, e));
    warp_laws!(rigid: PlanarWarp::default(), group::<SE2>(1.0), bodies(), dual = |_: &_, p: &SE2, x: &_, e: &_| dual(p, x, e));
    warp_laws!(similar: PlanarWarp::default(), group::<Sim2>(1.0), bodies(), dual = |_: &_, p: &Sim2, x: &_, e: &_| dual(p, x, e));
    warp_laws!(affine: PlanarWarp::default(), group::<Affine2>(1.0), bodies(), dual = |_: &_, p: &Affine2, x: &_, e: &_| dual(p, x, e));
    warp_laws!(homography: PlanarWarp::default(), group::<SL3>(0.7), bodies(), dual = |_: &_, p: &SL3, x: &_, e: &_| dual(p, x, e));

    #[test]
    fn in_pixels_the_derivative_of_a_homography_holds_at_once() {
        // A tilted rectangle of 60 x 40 pixels.
        let matrix = Matrix3::new(1.1, 0.1, 200.0, -0.05, 0.9, 150.0, 1e-4, -2e-4, 1.0);
        let (warp, pose) = (PlanarWarp::default(), SL3::from_matrix(&matrix).unwrap());
        let x = Point2::new(-30.0, 20.0);
        let (y, j) = warp.at(&pose).linearize(&x).unwrap();
        let steps = [1e-3, 1e-3, 1e-5, 1e-5, 1e-5, 1e-5, 1e-7, 1e-7];
        for (k, step) in steps.into_iter().enumerate() {
            let mut d = SVector::<f64, 8>::zeros();
            d[k] = step;
            let at = |d: &SVector<f64, 8>| warp.at(&pose.compose(&SL3::exp(d))).locate(&x).unwrap();
            let difference = (at(&d) - at(&-d)) / (2.0 * step);
            assert!((difference - j.column(k)).norm() < 1e-5 * j.column(k).norm(), "{k}: {difference}{j}");
        }
        assert!((pose.act(&x) - y).norm() < 1e-10);
        let locked = PlanarWarp::default().with_free(&[true, true, false, true, false, false, false, false]);
        let some = locked.at(&pose).linearize(&x).unwrap().1;
        assert_eq!(some.column(2).norm() + some.columns(4, 4).norm(), 0.0);
        assert_eq!(some.columns(0, 2), j.columns(0, 2));
        // Behind the plane of projection there is no image.
        assert_eq!(warp.at(&pose).locate(&Point2::new(-20_000.0, 0.0)), None);
    }
}
