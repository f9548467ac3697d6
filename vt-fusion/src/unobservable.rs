//! What a measurement does not tell.

use nalgebra::DefaultAllocator;
use vt_core::belief::Gaussian;
use vt_core::least_squares::Spectrum;
use vt_core::manifold::{Alloc, Manifold, Tangent};
use vt_core::measurement::{Measurement, NormalEquations};

/// Scaled eigenvalue of the information below which the data do not determine a direction.
const RANK_TOLERANCE: f64 = 1e-10;

/// Variance, as a part of the largest in design units, up to which a direction is locked.
const LOCKED: f64 = 1e-20;

/// Directions that `z` does not determine at the posterior `pose`, as unit tangent vectors; those that are locked (no
/// variance) are nobody's question. Judged in units of `scale`, so that metres and radians compare.
pub(crate) fn unobservable<P: Manifold>(
    z: &dyn Measurement<P>,
    pose: &Gaussian<P>,
    scale: &Tangent<P>,
    out: &mut Vec<f64>,
) where
    DefaultAllocator: Alloc<P::D>,
{
    out.clear();
    let mut data = NormalEquations::empty(&pose.mean);
    z.normal_equations(&pose.mean, &mut data);
    let mut covariance = pose.covariance.clone();
    for r in 0..scale.len() {
        for c in 0..scale.len() {
            data.information[(r, c)] *= scale[r] * scale[c];
            covariance[(r, c)] /= scale[r] * scale[c];
        }
    }
    let locked = LOCKED * covariance.diagonal().max();
    for null in Spectrum::new(&data.information, RANK_TOLERANCE).unobservable() {
        if null.dot(&(&covariance * &null)) > locked {
            out.extend(null.component_mul(scale).normalize().iter());
        }
    }
}
