//! Dynamic fusion: several tracks of one object, each with an estimator of its own, become one (paper §2).
//!
//! Tracks of one object are not independent: they share its process noise, often the prior, sometimes data. The rules differ in what they
//! know of that:
//!
//! | rule | knows | result |
//! |---|---|---|
//! | [`information_sum`] | that there is none | exact for independent beliefs, over-confident for others |
//! | [`Intersection`] | nothing | never over-confident (Julier and Uhlmann, 1997) |
//! | [`bar_shalom_campo`] | the cross-covariance, see [`CrossCovariance`] | best linear combination (Bar-Shalom and Campo, 1986) |
//! | [`equivalent_measurement`] | what each track knew before | the central filter, at full rate (Drummond, 1997) |
//!
//! Beliefs are combined in the chart at a common point, which moves to the result until it stays there; on a vector
//! space that is one step. Directions that are locked (no variance) in all tracks stay so.

mod cross_covariance;
mod intersection;
mod rules;

use nalgebra::{DefaultAllocator, U1};
use vt_core::belief::{Gaussian, symmetrize};
use vt_core::error::EstimateError;
use vt_core::least_squares::Spectrum;
use vt_core::manifold::{Alloc, Manifold, Square, Tangent};
use vt_core::measurement::Quality;
use vt_core::pose_measurement::PoseMeasurement;

pub use cross_covariance::CrossCovariance;
pub use intersection::{Criterion, Intersection};
pub(crate) use rules::one_after_the_other;
pub use rules::{BarShalomCampo, EquivalentMeasurements, Track, TrackFusion};

use crate::summed::quadratic;

/// Variance or information of a direction, scaled to a unit diagonal, that counts as none.
const RANK: f64 = 1e-12;

/// Step, in deviations of the result, at which the common point counts as found.
const SETTLED: f64 = 1e-9;

/// Steps of the common point.
const STEPS: usize = 30;

/// Combines beliefs in the chart at a point that moves to the result. `combine` gives mean and covariance in the chart
/// at its argument.
fn settle<P: Manifold>(
    start: &P,
    mut combine: impl FnMut(&P) -> (Tangent<P>, Square<P>),
) -> Result<Gaussian<P>, EstimateError>
where
    DefaultAllocator: Alloc<P::D>,
{
    let mut x = start.clone();
    for step in 1.. {
        let (delta, covariance) = combine(&x);
        let small = |k: usize| delta[k] * delta[k] <= SETTLED * SETTLED * covariance[(k, k)];
        let done = P::FLAT || step == STEPS || (0..delta.len()).all(small);
        if done || !delta.iter().all(|v| v.is_finite()) {
            let belief = Gaussian::from_chart(&x, &delta, covariance);
            let fine = belief.is_finite();
            return if fine { Ok(belief) } else { Err(EstimateError::NotFinite("the fused belief")) };
        }
        x = x.retract(&delta);
    }
    unreachable!("the last step returns")
}

/// Pseudo-inverse of a covariance or of an information matrix.
fn inverse<P: Manifold>(m: &Square<P>) -> Square<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    Spectrum::new(m, RANK).covariance()
}

/// Checked before anything is combined.
fn checked<'a, P: Manifold>(
    beliefs: impl Iterator<Item = &'a Gaussian<P>>,
) -> Result<Option<&'a P>, EstimateError>
where
    DefaultAllocator: Alloc<P::D>,
{
    let mut first: Option<&P> = None;
    for belief in beliefs {
        if !belief.is_finite() {
            return Err(EstimateError::NotFinite("the belief of a track"));
        }
        let expected = first.get_or_insert(&belief.mean).dim();
        if belief.mean.dim() != expected {
            return Err(EstimateError::Dimension {
                what: "the belief of a track",
                found: nalgebra::Dim::value(&belief.mean.dim()),
                expected: nalgebra::Dim::value(&expected),
            });
        }
    }
    Ok(first)
}

const NO_TRACK: EstimateError = EstimateError::Unsupported("fusion of no track at all");

/// Fuses beliefs with independent errors: their information adds up.
///
/// # Errors
/// Without a belief, and when one is not finite.
pub fn information_sum<'a, P: Manifold>(
    beliefs: impl IntoIterator<Item = &'a Gaussian<P>, IntoIter: Clone>,
) -> Result<Gaussian<P>, EstimateError>
where
    DefaultAllocator: Alloc<P::D>,
{
    let beliefs = beliefs.into_iter();
    let start = checked(beliefs.clone())?.ok_or(NO_TRACK)?;
    let n = start.dim();
    settle(start, |x| {
        let mut vector = Tangent::<P>::zeros_generic(n, U1);
        let mut sum = Square::<P>::zeros_generic(n, n);
        for belief in beliefs.clone() {
            let (mean, covariance) = belief.in_chart(x);
            let information = inverse::<P>(&covariance);
            vector += &information * mean;
            sum += information;
        }
        let covariance = inverse::<P>(&sum);
        (&covariance * vector, covariance)
    })
}

/// The best linear combination of two beliefs whose errors have the covariance `cross = E[e_a e_bᵀ]`, each error in
/// the chart at its own mean (Bar-Shalom and Campo, "The effect of the common process noise on the two-sensor fused-track
/// covariance", 1986):
///
/// ```text
/// S = A + B − C − Cᵀ,   K = (A − C) S⁺,   x = a + K (b − a),   P = [1−K K] [A C; Cᵀ B] [1−K K]ᵀ
/// ```
///
/// With `C = 0` it is [`information_sum`]; of errors that are one and the same, the first belief stays.
///
/// # Errors
/// When a belief or the cross-covariance is not finite.
pub fn bar_shalom_campo<P: Manifold>(
    a: &Gaussian<P>,
    b: &Gaussian<P>,
    cross: &Square<P>,
) -> Result<Gaussian<P>, EstimateError>
where
    DefaultAllocator: Alloc<P::D>,
{
    checked([a, b].into_iter())?;
    if !vt_core::math::all_finite(cross.as_slice()) {
        return Err(EstimateError::NotFinite("the cross-covariance of two tracks"));
    }
    let n = a.mean.dim();
    let moved = |belief: &Gaussian<P>, x: &P| belief.mean.retract_jacobian(&belief.mean.local(x));
    settle(&a.mean, |x| {
        let ((at, of_a), (to, of_b)) = (a.in_chart(x), b.in_chart(x));
        let c = match P::FLAT {
            true => cross.clone(),
            false => moved(a, x) * cross * moved(b, x).transpose(),
        };
        let mut spread = &of_a + &of_b - &c - c.transpose();
        symmetrize(&mut spread);
        let gain = (&of_a - &c) * inverse::<P>(&spread);
        let rest = Square::<P>::identity_generic(n, n) - &gain;
        let mixed = &rest * &c * gain.transpose();
        let mut covariance =
            &rest * of_a * rest.transpose() + &gain * of_b * gain.transpose() + &mixed + mixed.transpose();
        symmetrize(&mut covariance);
        (&at + gain * (to - &at), covariance)
    })
}

/// What a track learnt between two beliefs, as a measurement that does not depend on what it knew before: `Y⁺ − Y⁻` and
/// `y⁺ − y⁻` ("tracklet", O. Drummond, 1997). One per correction is exactly the data of a linear Gaussian correction;
/// so a filter that takes in those of all tracks is the central one. Directions in which nothing was learnt have no information.
///
/// # Errors
/// When a belief is not finite.
pub fn equivalent_measurement<P: Manifold>(
    prediction: &Gaussian<P>,
    posterior: &Gaussian<P>,
    quality: Quality,
) -> Result<PoseMeasurement<P>, EstimateError>
where
    DefaultAllocator: Alloc<P::D>,
{
    checked([prediction, posterior].into_iter())?;
    let x = &posterior.mean;
    let (mean, covariance) = prediction.in_chart(x);
    let before = inverse::<P>(&covariance);
    let after = inverse::<P>(&posterior.covariance);
    let gradient = -(&before * mean);
    Ok(quadratic(x, &(&after - before), &gradient, &after.diagonal(), quality))
}
