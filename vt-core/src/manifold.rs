//! Spaces of poses and states: smooth sets with a tangent space at every point.

use nalgebra::allocator::Allocator;
use nalgebra::{DefaultAllocator, Dim, Dyn, OMatrix, OVector, U1, U2, U3};

use crate::batch::Row;

/// All storage that the algorithms of this project ask for in dimension `D`; one bound instead of ten.
pub trait Alloc<D: Dim>:
    Allocator<D, Buffer<f64>: Send + Sync>
    + Allocator<D, D, Buffer<f64>: Send + Sync>
    + Allocator<U1, D, Buffer<f64>: Send + Sync>
    + Allocator<U2, D, Buffer<f64>: Send + Sync>
    + Allocator<D, U1, Buffer<f64>: Send + Sync>
    + Allocator<D, U2>
    + Allocator<U3, D>
    + Allocator<Dyn, D, Buffer<f64>: Send + Sync>
    + Allocator<D, Dyn, Buffer<f64>: Send + Sync>
{
}

impl<D: Dim, A> Alloc<D> for A where
    A: Allocator<D, Buffer<f64>: Send + Sync>
        + Allocator<D, D, Buffer<f64>: Send + Sync>
        + Allocator<U1, D, Buffer<f64>: Send + Sync>
        + Allocator<U2, D, Buffer<f64>: Send + Sync>
        + Allocator<D, U1, Buffer<f64>: Send + Sync>
        + Allocator<D, U2>
        + Allocator<U3, D>
        + Allocator<Dyn, D, Buffer<f64>: Send + Sync>
        + Allocator<D, Dyn, Buffer<f64>: Send + Sync>
{
}

/// Storage for maps between spaces of dimensions `A` and `B`, such as a Kalman gain.
pub trait AllocPair<A: Dim, B: Dim>:
    Alloc<A> + Alloc<B> + Allocator<A, B, Buffer<f64>: Send + Sync> + Allocator<B, A, Buffer<f64>: Send + Sync>
{
}

impl<A: Dim, B: Dim, T> AllocPair<A, B> for T where
    T: Alloc<A>
        + Alloc<B>
        + Allocator<A, B, Buffer<f64>: Send + Sync>
        + Allocator<B, A, Buffer<f64>: Send + Sync>
{
}

/// A tangent vector of the manifold `M`.
pub type Tangent<M> = OVector<f64, <M as Manifold>::D>;

/// A square matrix over the tangent space of `M`: a covariance, an information matrix, a Jacobian `M → M`.
pub type Square<M> = OMatrix<f64, <M as Manifold>::D, <M as Manifold>::D>;

/// A pose or state space with tangent vectors of dimension `D`, static or known at run time.
///
/// Laws, checked by `manifold_laws!` (feature `laws`), for every `x`, `y` and small `d`:
/// `x.retract(&x.local(&y)) = y`, `x.local(&x.retract(&d)) = d`, `x.retract(&0) = x`.
///
/// The two Jacobians have a default by central differences, so that a space of your own needs two functions; Lie
/// groups override them by closed forms.
pub trait Manifold: Clone + core::fmt::Debug + Send + Sync + 'static
where
    DefaultAllocator: Alloc<Self::D>,
{
    /// Dimension of the tangent space; `Dyn` where it is known at run time only.
    type D: Dim;

    /// True where `retract` adds coordinates and `local` subtracts them: both Jacobians are the identity, and
    /// estimators leave them out.
    const FLAT: bool = false;

    /// Dimension of the tangent space at this point.
    fn dim(&self) -> Self::D;

    /// `x ⊞ d`: the point reached from here along the tangent vector `d` (on a Lie group `x · Exp(d)`).
    fn retract(&self, d: &Tangent<Self>) -> Self;

    /// `y ⊟ x`: the tangent vector that leads from here to `other` (on a Lie group `Log(x⁻¹ y)`).
    fn local(&self, other: &Self) -> Tangent<Self>;

    /// `∂ (x ⊞ (d + ε)) / ∂ε` in the chart at `x ⊞ d` (on a Lie group the right Jacobian `J_r(d)`).
    fn retract_jacobian(&self, d: &Tangent<Self>) -> Square<Self> {
        let y = self.retract(d);
        differences(self.dim(), |e| y.local(&self.retract(&(d + e))))
    }

    /// `∂ ((x ⊞ ε) ⊞ d) / ∂ε` in the chart at `x ⊞ d` (on a Lie group `Ad(Exp(-d))`).
    fn transport(&self, d: &Tangent<Self>) -> Square<Self> {
        let y = self.retract(d);
        differences(self.dim(), |e| y.local(&self.retract(e).retract(d)))
    }

    /// Names and lengths of the parts of a tangent vector, in order, for messages.
    fn blocks(&self) -> Vec<(String, usize)> {
        vec![("tangent".into(), self.dim().value())]
    }

    /// The zero tangent vector.
    fn zero(&self) -> Tangent<Self> {
        OVector::zeros_generic(self.dim(), U1)
    }

    /// True when every coordinate is finite.
    fn is_finite(&self) -> bool {
        crate::math::all_finite(self.local(self).as_slice())
    }

    /// `x_k ← x_k ⊞ d_k` for the points inside up to [`crate::batch::LANES`] states; row `r` of `d` holds coordinate `r` of
    /// all tangent vectors. Where `d` has rows for several vectors, `x_k ⊞ d_k ⊞ d'_k …`. Spaces on which many hypotheses
    /// move override it by vector instructions, bit for bit the same as [`Manifold::retract`].
    fn retract_each<S>(states: &mut [S], point: impl Fn(&mut S) -> &mut Self, d: &[Row]) {
        for (k, state) in states.iter_mut().enumerate() {
            let x = point(state);
            let n = x.dim();
            for d in d.chunks_exact(n.value().max(1)) {
                let step = OVector::from_fn_generic(n, U1, |r, _| d[r][k]);
                *x = x.retract(&step);
            }
        }
    }

    /// [`Manifold::local`], to rounding, of up to [`crate::batch::LANES`] points: row `r` of `out` gets coordinate `r` of all tangent
    /// vectors, and zero beyond the points.
    fn local_each(&self, points: &[Self], out: &mut [Row]) {
        for (k, point) in points.iter().enumerate() {
            let d = self.local(point);
            out.iter_mut().zip(&d).for_each(|(row, v)| row[k] = *v);
        }
        out.iter_mut().for_each(|row| row[points.len()..].fill(0.0));
    }

    /// A point near the mean of points with these weights, from which to start iterations: by default the heaviest one.
    /// `None` without points.
    fn centre(points: &[Self], weights: &[f64]) -> Option<Self> {
        let (heaviest, _) = weights.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1))?;
        points.get(heaviest).cloned()
    }

    /// Weighted mean of points on the manifold (Karcher): the point at which the weighted tangent vectors to all
    /// points vanish. Weights need not be normalised; `None` when no weight is positive or a point is not finite.
    fn mean(points: &[Self], weights: &[f64]) -> Option<Self> {
        let (heaviest, _) = weights.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1))?;
        let total: f64 = weights.iter().sum();
        if !(total > 0.0 && total.is_finite()) || points.len() != weights.len() {
            return None;
        }
        let mut mean = points[heaviest].clone();
        for _ in 0..50 {
            let mut step = mean.zero();
            for (p, &w) in points.iter().zip(weights) {
                step += mean.local(p) * (w / total);
            }
            let length = step.norm();
            if !length.is_finite() {
                return None;
            }
            mean = mean.retract(&step);
            if length < 1e-12 {
                break;
            }
        }
        Some(mean)
    }
}

/// Jacobian of `f` at zero by central differences, for the defaults above.
pub(crate) fn differences<D: Dim>(n: D, f: impl Fn(&OVector<f64, D>) -> OVector<f64, D>) -> OMatrix<f64, D, D>
where
    DefaultAllocator: Alloc<D>,
{
    differences_between(n, n, f, |ahead, behind| ahead - behind)
}

/// The same between spaces of dimensions `n` and `m`, for values that `subtract` compares (angles wrap).
pub(crate) fn differences_between<N: Dim, M: Dim>(
    n: N,
    m: M,
    f: impl Fn(&OVector<f64, N>) -> OVector<f64, M>,
    subtract: impl Fn(&OVector<f64, M>, &OVector<f64, M>) -> OVector<f64, M>,
) -> OMatrix<f64, M, N>
where
    DefaultAllocator: AllocPair<N, M>,
{
    const H: f64 = 1e-6;
    let mut j = OMatrix::zeros_generic(m, n);
    let mut e = OVector::zeros_generic(n, U1);
    for k in 0..n.value() {
        e[k] = H;
        let ahead = f(&e);
        e[k] = -H;
        let behind = f(&e);
        e[k] = 0.0;
        j.set_column(k, &(subtract(&ahead, &behind) / (2.0 * H)));
    }
    j
}

/// A manifold whose points have standard coordinates, for files and reports.
///
/// SE(3): `tx ty tz qx qy qz qw`; R^n: its components.
pub trait Coordinates: Manifold
where
    DefaultAllocator: Alloc<Self::D>,
{
    /// Name of the space in files, such as `"se3"`.
    const SPACE: &'static str;

    /// Appends the coordinates of this point.
    fn write(&self, out: &mut Vec<f64>);

    /// The point with these coordinates; `None` when their number is wrong or one is not finite.
    fn read(coordinates: &[f64]) -> Option<Self>;
}
