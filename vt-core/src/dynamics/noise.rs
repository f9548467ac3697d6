//! Noise of motion models: its covariance, its root, its parameters.

use nalgebra::{DefaultAllocator, Dim, OVector};

use crate::agent::Dynamics;
use crate::error::{ConfigError, EstimateError};
use crate::manifold::{Alloc, Manifold, Square, Tangent};
use crate::time::Seconds;

/// `Q(Δt) = ∫ G(τ) diag(q) G(τ)ᵀ dτ` for a model driven by white noise on the last coordinates of its tangent space,
/// `G(τ)` the last columns of its Jacobian over the time `τ` that remains after the disturbance.
///
/// `density` are the spectral densities `q`, one for each driven coordinate, in (tangent unit)² per second. The
/// integral is a Gauss–Legendre rule of three points: exact where the Jacobian is a polynomial in time of degree two,
/// as in the models here on `R^n`; positive semi-definite always. A negative `dt` gives the noise of going back,
/// `Q(-Δ) = F(-Δ) Q(Δ) F(-Δ)ᵀ`.
pub fn driven_noise<S: Manifold>(
    model: &impl Dynamics<S>,
    state: &S,
    dt: Seconds,
    density: &[f64],
) -> Square<S>
where
    DefaultAllocator: Alloc<S::D>,
{
    // Nodes ½ ± √(3/20) and ½.
    const RULE: [(f64, f64); 3] =
        [(0.112_701_665_379_258_3, 5.0 / 18.0), (0.5, 4.0 / 9.0), (0.887_298_334_620_741_7, 5.0 / 18.0)];
    integrate(&RULE, 1, model, state, dt, density)
}

/// The same in several parts by the rule of five points, for models whose Jacobian is no polynomial.
pub(super) fn driven_noise_in<S: Manifold>(
    parts: u32,
    model: &impl Dynamics<S>,
    state: &S,
    dt: Seconds,
    density: &[f64],
) -> Square<S>
where
    DefaultAllocator: Alloc<S::D>,
{
    // Nodes ½ ± √(5 ± 2√(10/7))/6 and ½.
    const RULE: [(f64, f64); 5] = [
        (0.046_910_077_030_668_004, 0.118_463_442_528_094_54),
        (0.230_765_344_947_158_45, 0.239_314_335_249_683_24),
        (0.5, 64.0 / 225.0),
        (0.769_234_655_052_841_6, 0.239_314_335_249_683_24),
        (0.953_089_922_969_332, 0.118_463_442_528_094_54),
    ];
    integrate(&RULE, parts, model, state, dt, density)
}

fn integrate<S: Manifold>(
    rule: &[(f64, f64)],
    parts: u32,
    model: &impl Dynamics<S>,
    state: &S,
    dt: Seconds,
    density: &[f64],
) -> Square<S>
where
    DefaultAllocator: Alloc<S::D>,
{
    let n = state.dim();
    let first = n.value().saturating_sub(density.len());
    let mut q = Square::<S>::zeros_generic(n, n);
    let share = 1.0 / f64::from(parts);
    for part in 0..parts {
        for (node, weight) in rule {
            let at = (f64::from(part) + node) * share;
            let before = model.propagate(state, Seconds(at * dt.0));
            let f = model.jacobian(&before, Seconds((1.0 - at) * dt.0));
            for (column, density) in f.column_iter().skip(first).zip(density) {
                if *density > 0.0 {
                    q.ger(weight * share * dt.0.abs() * density, &column, &column, 1.0);
                }
            }
        }
    }
    q
}

/// Spectral densities must be finite and not negative; zero locks a coordinate.
pub(super) fn check_density<D: Dim>(density: OVector<f64, D>) -> Result<OVector<f64, D>, ConfigError>
where
    DefaultAllocator: Alloc<D>,
{
    match density.iter().find(|q| !(q.is_finite() && **q >= 0.0)) {
        Some(bad) => Err(ConfigError::parameter("noise density", bad, "finite numbers, zero or positive")),
        None => Ok(density),
    }
}

/// A density has as many entries as the pose that it moves.
pub(super) fn fits<P: Manifold>(density: &Tangent<P>, pose: &P) -> Result<(), EstimateError>
where
    DefaultAllocator: Alloc<P::D>,
{
    EstimateError::unless_equal("the noise density", density.len(), pose.dim().value())
}
