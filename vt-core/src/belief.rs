//! Gaussian beliefs on manifolds.

use nalgebra::{Cholesky, DefaultAllocator, Dim, DimAdd, DimSum, U1};

use crate::batch::Row;
use crate::manifold::{Alloc, Manifold, Square, Tangent};
use crate::math;

mod accelerating;

pub use accelerating::{Accelerating, Triple};

/// A belief `x = mean ⊞ d`, `d ~ N(0, covariance)`: the covariance lives in the tangent space at the mean, in the
/// tangent order of the space (SE(3): translation in metres first, then rotation in radians).
#[derive(Clone, Debug)]
pub struct Gaussian<M: Manifold>
where
    DefaultAllocator: Alloc<M::D>,
{
    /// The most probable point.
    pub mean: M,
    /// Covariance of the tangent error, symmetric positive semi-definite.
    pub covariance: Square<M>,
}

impl<M: Manifold> Gaussian<M>
where
    DefaultAllocator: Alloc<M::D>,
{
    /// A belief with independent errors of the given standard deviations.
    pub fn from_sigmas(mean: M, sigmas: &Tangent<M>) -> Self {
        let mut covariance = Square::<M>::from_diagonal(sigmas);
        for k in 0..sigmas.len() {
            covariance[(k, k)] *= sigmas[k];
        }
        Self { mean, covariance }
    }

    /// Squared Mahalanobis length of the error of `truth`: `d = truth ⊟ mean`, `dᵀ P⁻¹ d` (NEES). Its mean is the
    /// number of free coordinates when the belief is honest. `None` when their covariance is not positive definite.
    pub fn nees(&self, truth: &M) -> Option<f64> {
        let d = self.mean.local(truth);
        let (p, free) = self.free_part();
        let d = d.map_with_location(|r, _, v| if free[r] != 0.0 { v } else { 0.0 });
        Some(d.dot(&cholesky(p)?.solve(&d)))
    }

    /// `ln det(D⁻¹ P D⁻¹) / n` with `D = diag(scale)`: spread per degree of freedom against a reference deviation.
    /// `None` when the covariance of the free coordinates is not positive definite, or when none is free.
    pub fn scaled_log_det(&self, scale: &Tangent<M>) -> Option<f64> {
        let (p, free) = self.free_part();
        let n = free.sum();
        let root = cholesky(p)?;
        let l = root.l_dirty();
        let log_det: f64 = (0..scale.len())
            .filter(|&k| free[k] != 0.0)
            .map(|k| 2.0 * (math::ln(l[(k, k)]) - math::ln(scale[k])))
            .sum();
        (n > 0.0).then(|| log_det / n)
    }

    /// The covariance with a unit diagonal in the place of locked coordinates (of zero variance), which then say
    /// nothing in statistics; and a vector of 1 for free, 0 for locked coordinates.
    fn free_part(&self) -> (Square<M>, Tangent<M>) {
        let mut p = self.covariance.clone();
        let mut free = self.mean.zero();
        for k in 0..free.len() {
            if p[(k, k)] == 0.0 {
                p[(k, k)] = 1.0;
            } else {
                free[k] = 1.0;
            }
        }
        (p, free)
    }

    /// Mean and covariance of this belief in the chart at `x`: there it is `δ ~ N(μ, P)`, to first order about `x` (the
    /// linearisation of Gauss and Newton), not about the mean.
    #[inline]
    pub fn in_chart(&self, x: &M) -> (Tangent<M>, Square<M>) {
        if M::FLAT {
            return (x.local(&self.mean), self.covariance.clone());
        }
        // x ⊞ δ = mean ⊞ (away + J⁻¹ δ) to first order: the mean lies at δ = −J away.
        let away = self.mean.local(x);
        let moved = self.mean.retract_jacobian(&away);
        let mut covariance = &moved * &self.covariance * moved.transpose();
        symmetrize(&mut covariance);
        (-(moved * away), covariance)
    }

    /// The belief that is `δ ~ N(mean, covariance)` in the chart at `x`, with its covariance moved to the chart at its
    /// own mean.
    #[inline]
    pub fn from_chart(x: &M, mean: &Tangent<M>, covariance: Square<M>) -> Self {
        let covariance = if M::FLAT {
            covariance
        } else {
            let g = x.retract_jacobian(mean);
            let mut moved = &g * covariance * g.transpose();
            symmetrize(&mut moved);
            moved
        };
        Self { mean: x.retract(mean), covariance }
    }

    /// True when the mean and every entry of the covariance are finite.
    #[inline]
    pub fn is_finite(&self) -> bool {
        self.mean.is_finite() && math::all_finite(self.covariance.as_slice())
    }
}

/// Cholesky factor of a symmetric matrix given by its lower triangle; `None` unless positive definite and finite.
pub fn cholesky<D: Dim>(m: nalgebra::OMatrix<f64, D, D>) -> Option<Cholesky<f64, D>>
where
    DefaultAllocator: Alloc<D>,
{
    if !math::all_finite(m.as_slice()) {
        return None;
    }
    Cholesky::new(m)
}

/// Makes a matrix exactly symmetric by averaging it with its transpose.
pub fn symmetrize<D: Dim>(m: &mut nalgebra::OMatrix<f64, D, D>)
where
    DefaultAllocator: Alloc<D>,
{
    for r in 0..m.nrows() {
        for c in 0..r {
            let v = 0.5 * (m[(r, c)] + m[(c, r)]);
            m[(r, c)] = v;
            m[(c, r)] = v;
        }
    }
}

/// A state that contains a pose; the pose's tangent coordinates come first.
///
/// Every pose is a state of its own (Brownian models), and [`Moving`] adds a velocity.
pub trait State<P: Manifold>: Manifold
where
    DefaultAllocator: Alloc<P::D> + Alloc<Self::D>,
{
    /// The pose in this state.
    fn pose(&self) -> &P;

    /// The state with this pose and everything else at rest.
    fn at_rest(pose: P) -> Self;

    /// The state covariance of a pose covariance, the remaining coordinates at their a-priori deviations `rest`
    /// (one value for each derivative order: velocity, acceleration).
    fn spread(pose: &Gaussian<P>, rest: &[Tangent<P>]) -> Gaussian<Self>;
}

impl<P: Manifold> State<P> for P
where
    DefaultAllocator: Alloc<P::D>,
{
    fn pose(&self) -> &P {
        self
    }
    fn at_rest(pose: P) -> Self {
        pose
    }
    fn spread(pose: &Gaussian<P>, _: &[Tangent<P>]) -> Gaussian<Self> {
        pose.clone()
    }
}

/// A pose and its velocity, a tangent vector at the pose per second (SE(3): the body twist ν, `T(t+Δ) = T·Exp(νΔ)`).
/// Tangent order: pose, velocity.
#[derive(Clone, Debug)]
pub struct Moving<P: Manifold>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// Pose.
    pub pose: P,
    /// Velocity in tangent units per second.
    pub velocity: Tangent<P>,
}

impl<P: Manifold> Manifold for Moving<P>
where
    P::D: DimAdd<P::D>,
    DefaultAllocator: Alloc<P::D> + Alloc<DimSum<P::D, P::D>>,
{
    type D = DimSum<P::D, P::D>;
    const FLAT: bool = P::FLAT;

    fn dim(&self) -> Self::D {
        self.pose.dim().add(self.pose.dim())
    }

    fn retract(&self, d: &Tangent<Self>) -> Self {
        let n = self.pose.dim();
        Self {
            pose: self.pose.retract(&d.rows_generic(0, n).into_owned()),
            velocity: &self.velocity + d.rows_generic(n.value(), n),
        }
    }

    fn local(&self, other: &Self) -> Tangent<Self> {
        let n = self.pose.dim();
        let mut d = Tangent::<Self>::zeros_generic(self.dim(), U1);
        d.rows_generic_mut(0, n).copy_from(&self.pose.local(&other.pose));
        d.rows_generic_mut(n.value(), n).copy_from(&(&other.velocity - &self.velocity));
        d
    }

    fn retract_jacobian(&self, d: &Tangent<Self>) -> Square<Self> {
        let n = self.pose.dim();
        let mut j = Square::<Self>::identity_generic(self.dim(), self.dim());
        let block = self.pose.retract_jacobian(&d.rows_generic(0, n).into_owned());
        j.generic_view_mut((0, 0), (n, n)).copy_from(&block);
        j
    }

    fn transport(&self, d: &Tangent<Self>) -> Square<Self> {
        let n = self.pose.dim();
        let mut j = Square::<Self>::identity_generic(self.dim(), self.dim());
        let block = self.pose.transport(&d.rows_generic(0, n).into_owned());
        j.generic_view_mut((0, 0), (n, n)).copy_from(&block);
        j
    }

    fn is_finite(&self) -> bool {
        self.pose.is_finite() && self.velocity.iter().fold(0.0, |sum, v| sum + v * 0.0) == 0.0
    }

    fn retract_each<S>(states: &mut [S], point: impl Fn(&mut S) -> &mut Self, d: &[Row]) {
        let n = states.first_mut().map_or(1, |s| point(s).velocity.len().max(1));
        for d in d.chunks_exact(2 * n) {
            P::retract_each(states, |s| &mut point(s).pose, &d[..n]);
            for (k, state) in states.iter_mut().enumerate() {
                let x = point(state);
                x.velocity.iter_mut().zip(&d[n..]).for_each(|(v, row)| *v += row[k]);
            }
        }
    }

    fn blocks(&self) -> Vec<(String, usize)> {
        let pose = self.pose.blocks();
        let velocity = pose.iter().map(|(name, n)| (format!("velocity of {name}"), *n)).collect();
        [pose, velocity].concat()
    }
}

impl<P: Manifold> State<P> for Moving<P>
where
    P::D: DimAdd<P::D>,
    DefaultAllocator: Alloc<P::D> + Alloc<DimSum<P::D, P::D>>,
{
    fn pose(&self) -> &P {
        &self.pose
    }

    fn at_rest(pose: P) -> Self {
        let velocity = pose.zero();
        Self { pose, velocity }
    }

    fn spread(pose: &Gaussian<P>, rest: &[Tangent<P>]) -> Gaussian<Self> {
        let n = pose.mean.dim();
        let mean = Self::at_rest(pose.mean.clone());
        let mut covariance = Square::<Self>::zeros_generic(mean.dim(), mean.dim());
        covariance.generic_view_mut((0, 0), (n, n)).copy_from(&pose.covariance);
        if let Some(sigma) = rest.first() {
            for k in 0..n.value() {
                covariance[(n.value() + k, n.value() + k)] = sigma[k] * sigma[k];
            }
        }
        Gaussian { mean, covariance }
    }
}

/// A state whose leading tangent coordinates are those of a smaller state `S`, such as a pose with a velocity and the
/// pose alone: what estimators of unlike states exchange.
pub trait Extends<S: Manifold>: Manifold
where
    DefaultAllocator: Alloc<S::D> + Alloc<Self::D>,
{
    /// The smaller state.
    fn part(&self) -> S;

    /// This state with the smaller one replaced.
    fn with_part(&self, part: &S) -> Self;
}

impl<S: Manifold> Extends<S> for S
where
    DefaultAllocator: Alloc<S::D>,
{
    fn part(&self) -> S {
        self.clone()
    }
    fn with_part(&self, part: &S) -> Self {
        part.clone()
    }
}

impl<P: Manifold> Extends<P> for Moving<P>
where
    P::D: DimAdd<P::D>,
    DefaultAllocator: Alloc<P::D> + Alloc<DimSum<P::D, P::D>>,
{
    fn part(&self) -> P {
        self.pose.clone()
    }
    fn with_part(&self, part: &P) -> Self {
        Self { pose: part.clone(), velocity: self.velocity.clone() }
    }
}

/// The pose part of a state belief: mean and the leading block of the covariance.
pub fn pose_marginal<P: Manifold, S: State<P>>(belief: &Gaussian<S>) -> Gaussian<P>
where
    DefaultAllocator: Alloc<P::D> + Alloc<S::D>,
{
    let pose = belief.mean.pose().clone();
    let n = pose.dim();
    Gaussian { covariance: belief.covariance.generic_view((0, 0), (n, n)).into_owned(), mean: pose }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lie::Vector;
    use nalgebra::{Matrix3, Vector3};

    #[test]
    fn in_another_chart_a_belief_says_the_same() {
        use crate::lie::{LieGroup, SE3};
        use nalgebra::{Matrix6, Vector6};
        let d = Vector6::new(0.3, -0.2, 0.5, 0.1, -0.4, 0.2);
        let covariance = Matrix6::from_fn(|r, c| if r == c { 2.0 + r as f64 } else { 0.3 });
        let belief = Gaussian { mean: SE3::exp(&d), covariance };
        let x = SE3::exp(&Vector6::new(0.1, 0.2, 0.3, 0.3, 0.2, 0.1));
        let (delta, spread) = belief.in_chart(&x);
        assert!((delta - x.local(&belief.mean)).amax() < 1e-14);
        let there = spread.try_inverse().unwrap();
        let distance = |e: Vector6<f64>| (e - delta).dot(&(there * (e - delta)));
        assert!((distance(Vector6::zeros()) - belief.nees(&x).unwrap()).abs() < 1e-13);
        for k in 0..6 {
            let e = Vector6::ith(k, 1e-4);
            let slope = |at: &dyn Fn(Vector6<f64>) -> f64| (at(e) - at(-e)) / 2e-4;
            let found = slope(&distance);
            let expected = slope(&|e| belief.nees(&x.retract(&e)).unwrap());
            assert!((found - expected).abs() < 1e-8, "{k}: {found} {expected}");
        }
        let same = Gaussian::from_chart(&belief.mean, &Vector6::zeros(), covariance);
        assert!(same.mean == belief.mean && (same.covariance - covariance).amax() < 1e-15);
    }

    #[test]
    fn locked_coordinates_say_nothing_in_statistics() {
        let mut covariance = Matrix3::from_diagonal(&Vector3::new(4.0, 0.0, 9.0));
        covariance[(0, 2)] = 1.0;
        covariance[(2, 0)] = 1.0;
        let belief = Gaussian { mean: Vector(Vector3::new(1.0, 2.0, 3.0)), covariance };
        let scale = Vector3::new(2.0, 0.0, 3.0);
        let expected = 0.5 * math::ln((4.0 * 9.0 - 1.0) / 36.0);
        assert!((belief.scaled_log_det(&scale).unwrap() - expected).abs() < 1e-12);
        let d2 = belief.nees(&Vector(Vector3::new(2.0, 7.0, 3.0))).unwrap();
        assert!((d2 - 9.0 / 35.0).abs() < 1e-12);
        let locked = Gaussian { mean: belief.mean, covariance: Matrix3::zeros() };
        assert_eq!(locked.scaled_log_det(&scale), None);
    }
}
