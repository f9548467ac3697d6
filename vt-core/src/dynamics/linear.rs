//! Linear models on vector spaces, written with matrices.

use nalgebra::{DefaultAllocator, Dim, OMatrix};

use crate::agent::Dynamics;
use crate::error::{ConfigError, EstimateError};
use crate::lie::VectorSpace;
use crate::manifold::{Alloc, Square};
use crate::time::Seconds;

/// `x' = F x + w`, `w ~ N(0, Q)`, one step a prediction whatever its time: for models given by the matrices of a fixed
/// step. Two half steps are not one step; where time varies, use [`LinearRate`].
#[derive(Clone, Debug, PartialEq)]
pub struct LinearStep<D: Dim>
where
    DefaultAllocator: Alloc<D>,
{
    f: OMatrix<f64, D, D>,
    q: OMatrix<f64, D, D>,
}

impl<D: Dim> LinearStep<D>
where
    DefaultAllocator: Alloc<D>,
{
    /// A model with the transition `F` and the covariance `Q` of a step's noise.
    ///
    /// # Errors
    /// When sizes differ, numbers are not finite, or `Q` has a negative variance.
    pub fn new(f: OMatrix<f64, D, D>, q: OMatrix<f64, D, D>) -> Result<Self, ConfigError> {
        check("transition", &f, q.nrows())?;
        check_covariance(&q)?;
        Ok(Self { f, q })
    }
}

impl<S> Dynamics<S> for LinearStep<S::D>
where
    S: VectorSpace,
    DefaultAllocator: Alloc<S::D>,
{
    fn propagate(&self, state: &S, _: Seconds) -> S {
        S::from_components(&self.f * state.components())
    }
    fn jacobian(&self, _: &S, _: Seconds) -> Square<S> {
        self.f.clone()
    }
    fn noise(&self, _: &S, _: Seconds) -> Square<S> {
        self.q.clone()
    }
    fn fits(&self, state: &S) -> Result<(), EstimateError> {
        EstimateError::unless_equal("the transition", self.f.nrows(), state.dim().value())
    }
}

/// `dx/dt = A x + w` with white noise of the spectral density `W` (units of `x` squared per second).
///
/// `F = exp(AΔ)` and `Q = ∫ exp(Aτ) W exp(Aτ)ᵀ dτ` by their common series (C. Van Loan, "Computing integrals
/// involving the matrix exponential", 1978), with halving and doubling of the step: exact to rounding, and two
/// half steps are one step.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearRate<D: Dim>
where
    DefaultAllocator: Alloc<D>,
{
    a: OMatrix<f64, D, D>,
    w: OMatrix<f64, D, D>,
}

impl<D: Dim> LinearRate<D>
where
    DefaultAllocator: Alloc<D>,
{
    /// A model with the rate matrix `A` and the density `W`.
    ///
    /// # Errors
    /// When sizes differ, numbers are not finite, or `W` has a negative variance.
    pub fn new(a: OMatrix<f64, D, D>, w: OMatrix<f64, D, D>) -> Result<Self, ConfigError> {
        check("rate", &a, w.nrows())?;
        check_covariance(&w)?;
        Ok(Self { a, w })
    }

    /// `exp(AΔ)` and `Q(Δ)`.
    fn step(&self, dt: f64) -> (OMatrix<f64, D, D>, OMatrix<f64, D, D>) {
        let (n, _) = self.a.shape_generic();
        let size = self.a.amax() * self.a.nrows() as f64 * dt.abs();
        let halvings = log2_ceil(size / 0.25);
        let h = dt / f64::from(1_u32 << halvings);
        // dQ/dt = A Q + Q Aᵀ + W: the k-th derivative at zero is L^(k-1) W with L(X) = A X + X Aᵀ.
        let mut f = OMatrix::identity_generic(n, n);
        let mut power = OMatrix::identity_generic(n, n);
        let mut q = OMatrix::zeros_generic(n, n);
        let mut term = &self.w * h.abs();
        for k in 1..=14 {
            let k = f64::from(k);
            power = &self.a * power * (h / k);
            f += &power;
            q += &term;
            let side = &self.a * &term;
            term = (&side + side.transpose()) * (h / (k + 1.0));
        }
        for _ in 0..halvings {
            q = &f * &q * f.transpose() + q;
            f = &f * &f;
        }
        crate::belief::symmetrize(&mut q);
        (f, q)
    }
}

/// Smallest `k` with `2^k` not below `x`, at most 30.
fn log2_ceil(x: f64) -> u32 {
    let (mut k, mut power) = (0, 1.0);
    while power < x && k < 30 {
        power *= 2.0;
        k += 1;
    }
    k
}

impl<S> Dynamics<S> for LinearRate<S::D>
where
    S: VectorSpace,
    DefaultAllocator: Alloc<S::D>,
{
    fn propagate(&self, state: &S, dt: Seconds) -> S {
        S::from_components(self.step(dt.0).0 * state.components())
    }
    fn jacobian(&self, _: &S, dt: Seconds) -> Square<S> {
        self.step(dt.0).0
    }
    fn noise(&self, _: &S, dt: Seconds) -> Square<S> {
        self.step(dt.0).1
    }
    fn fits(&self, state: &S) -> Result<(), EstimateError> {
        EstimateError::unless_equal("the rate matrix", self.a.nrows(), state.dim().value())
    }
}

fn check<D: Dim>(key: &'static str, m: &OMatrix<f64, D, D>, rows: usize) -> Result<(), ConfigError>
where
    DefaultAllocator: Alloc<D>,
{
    if m.shape() != (rows, rows) {
        let found = format!("{} × {}", m.nrows(), m.ncols());
        return Err(ConfigError::parameter(key, found, format!("{rows} × {rows}")));
    }
    match m.iter().find(|v| !v.is_finite()) {
        Some(bad) => Err(ConfigError::parameter(key, bad, "finite entries")),
        None => Ok(()),
    }
}

fn check_covariance<D: Dim>(q: &OMatrix<f64, D, D>) -> Result<(), ConfigError>
where
    DefaultAllocator: Alloc<D>,
{
    check("noise", q, q.nrows())?;
    match (0..q.nrows()).map(|k| q[(k, k)]).find(|v| *v < 0.0) {
        Some(bad) => Err(ConfigError::parameter("noise", bad, "variances, zero or positive")),
        None => Ok(()),
    }
}
