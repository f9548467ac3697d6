//! A pose with its velocity and acceleration.

use nalgebra::{DefaultAllocator, Dim, DimAdd, DimSum, U1};

use super::{Extends, Gaussian, Moving, State};
use crate::batch::Row;
use crate::manifold::{Alloc, Manifold, Square, Tangent};

/// Dimension of [`Accelerating`]: three times that of the pose.
pub type Triple<D> = DimSum<DimSum<D, D>, D>;

/// A pose, its velocity (tangent units per second, as in [`super::Moving`]) and its acceleration (per second²).
/// Tangent order: pose, velocity, acceleration.
#[derive(Clone, Debug)]
pub struct Accelerating<P: Manifold>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// Pose.
    pub pose: P,
    /// Velocity in tangent units per second.
    pub velocity: Tangent<P>,
    /// Acceleration in tangent units per second².
    pub acceleration: Tangent<P>,
}

impl<P: Manifold> Accelerating<P>
where
    P::D: DimAdd<P::D>,
    DimSum<P::D, P::D>: DimAdd<P::D>,
    DefaultAllocator: Alloc<P::D> + Alloc<Triple<P::D>>,
{
    /// A matrix with this block for the pose and the identity elsewhere.
    fn pad(&self, block: &Square<P>) -> Square<Self> {
        let n = self.pose.dim();
        let mut j = Square::<Self>::identity_generic(self.dim(), self.dim());
        j.generic_view_mut((0, 0), (n, n)).copy_from(block);
        j
    }
}

impl<P: Manifold> Manifold for Accelerating<P>
where
    P::D: DimAdd<P::D>,
    DimSum<P::D, P::D>: DimAdd<P::D>,
    DefaultAllocator: Alloc<P::D> + Alloc<Triple<P::D>>,
{
    type D = Triple<P::D>;
    const FLAT: bool = P::FLAT;

    fn dim(&self) -> Self::D {
        let n = self.pose.dim();
        n.add(n).add(n)
    }

    fn retract(&self, d: &Tangent<Self>) -> Self {
        let n = self.pose.dim();
        Self {
            pose: self.pose.retract(&d.rows_generic(0, n).into_owned()),
            velocity: &self.velocity + d.rows_generic(n.value(), n),
            acceleration: &self.acceleration + d.rows_generic(2 * n.value(), n),
        }
    }

    fn local(&self, other: &Self) -> Tangent<Self> {
        let n = self.pose.dim();
        let mut d = Tangent::<Self>::zeros_generic(self.dim(), U1);
        d.rows_generic_mut(0, n).copy_from(&self.pose.local(&other.pose));
        d.rows_generic_mut(n.value(), n).copy_from(&(&other.velocity - &self.velocity));
        d.rows_generic_mut(2 * n.value(), n).copy_from(&(&other.acceleration - &self.acceleration));
        d
    }

    fn retract_jacobian(&self, d: &Tangent<Self>) -> Square<Self> {
        self.pad(&self.pose.retract_jacobian(&d.rows_generic(0, self.pose.dim()).into_owned()))
    }

    fn transport(&self, d: &Tangent<Self>) -> Square<Self> {
        self.pad(&self.pose.transport(&d.rows_generic(0, self.pose.dim()).into_owned()))
    }

    fn is_finite(&self) -> bool {
        self.pose.is_finite() && self.velocity.iter().chain(&self.acceleration).all(|v| v.is_finite())
    }

    fn retract_each<S>(states: &mut [S], point: impl Fn(&mut S) -> &mut Self, d: &[Row]) {
        let n = states.first_mut().map_or(1, |s| point(s).velocity.len().max(1));
        for d in d.chunks_exact(3 * n) {
            P::retract_each(states, |s| &mut point(s).pose, &d[..n]);
            for (k, state) in states.iter_mut().enumerate() {
                let x = point(state);
                x.velocity
                    .iter_mut()
                    .chain(&mut x.acceleration)
                    .zip(&d[n..])
                    .for_each(|(v, row)| *v += row[k]);
            }
        }
    }

    fn blocks(&self) -> Vec<(String, usize)> {
        let pose = self.pose.blocks();
        let of = |what| pose.iter().map(|(name, n)| (format!("{what} of {name}"), *n)).collect();
        [pose.clone(), of("velocity"), of("acceleration")].concat()
    }
}

impl<P: Manifold> State<P> for Accelerating<P>
where
    P::D: DimAdd<P::D>,
    DimSum<P::D, P::D>: DimAdd<P::D>,
    DefaultAllocator: Alloc<P::D> + Alloc<Triple<P::D>>,
{
    fn pose(&self) -> &P {
        &self.pose
    }

    fn at_rest(pose: P) -> Self {
        let zero = pose.zero();
        Self { pose, velocity: zero.clone(), acceleration: zero }
    }

    fn spread(pose: &Gaussian<P>, rest: &[Tangent<P>]) -> Gaussian<Self> {
        let n = pose.mean.dim();
        let mean = Self::at_rest(pose.mean.clone());
        let mut covariance = Square::<Self>::zeros_generic(mean.dim(), mean.dim());
        covariance.generic_view_mut((0, 0), (n, n)).copy_from(&pose.covariance);
        for (order, sigma) in rest.iter().take(2).enumerate() {
            for k in 0..n.value() {
                let at = (order + 1) * n.value() + k;
                covariance[(at, at)] = sigma[k] * sigma[k];
            }
        }
        Gaussian { mean, covariance }
    }
}

impl<P: Manifold> Extends<P> for Accelerating<P>
where
    P::D: DimAdd<P::D>,
    DimSum<P::D, P::D>: DimAdd<P::D>,
    DefaultAllocator: Alloc<P::D> + Alloc<Triple<P::D>>,
{
    fn part(&self) -> P {
        self.pose.clone()
    }
    fn with_part(&self, part: &P) -> Self {
        Self { pose: part.clone(), ..self.clone() }
    }
}

impl<P: Manifold> Extends<Moving<P>> for Accelerating<P>
where
    P::D: DimAdd<P::D>,
    DimSum<P::D, P::D>: DimAdd<P::D>,
    DefaultAllocator: Alloc<P::D> + Alloc<DimSum<P::D, P::D>> + Alloc<Triple<P::D>>,
{
    fn part(&self) -> Moving<P> {
        Moving { pose: self.pose.clone(), velocity: self.velocity.clone() }
    }
    fn with_part(&self, part: &Moving<P>) -> Self {
        let Moving { pose, velocity } = part.clone();
        Self { pose, velocity, acceleration: self.acceleration.clone() }
    }
}
