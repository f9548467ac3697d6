//! Static fusion by a sum of information: measurements of one target become one pose with its information
//! (`Y = Σ Hᵀ R⁻¹ H`, `y = Σ Hᵀ R⁻¹ z`), linearised at one point.

use nalgebra::{DefaultAllocator, U1};
use vt_core::least_squares::symmetric_eigen;
use vt_core::manifold::{Alloc, Manifold, Square, Tangent};
use vt_core::measurement::{Measurement, NormalEquations, Quality};
use vt_core::pose_measurement::PoseMeasurement;

use crate::stacked::Stacked;

/// Part of the information of a coordinate up to which that of a direction is rounding.
const ROUNDING: f64 = 1e-11;

/// Diagonal entries below this part of the largest are not scaled up further: they are rounding, not information.
const DIAGONAL_FLOOR: f64 = 1e-10;

/// All of `parts` as one measurement at object level, from their normal equations at `at`: the step of Gauss and Newton
/// without a prior. It costs an estimator the same however many parts and rows there are, and is exact for linear
/// ones. Directions that no part determines have no information.
pub fn information_sum<P: Manifold>(parts: &[&dyn Measurement<P>], at: &P) -> PoseMeasurement<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    let stack = Stacked(parts);
    let mut sum = NormalEquations::empty(at);
    stack.normal_equations(at, &mut sum);
    let largest = sum.information.diagonal().max();
    let scale = sum.information.diagonal().map(|d| d.max(DIAGONAL_FLOOR * largest));
    quadratic(at, &sum.information, &sum.gradient, &scale, stack.quality(at))
}

/// The measurement with the log-likelihood `bᵀδ − ½ δᵀAδ` in the chart at `at`. What of `A`, relative to the
/// information `scale` of each coordinate, is not more than rounding does not count.
pub(crate) fn quadratic<P: Manifold>(
    at: &P,
    information: &Square<P>,
    gradient: &Tangent<P>,
    scale: &Tangent<P>,
    quality: Quality,
) -> PoseMeasurement<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    let n = at.dim();
    let unit = scale.map(|d| if d > 0.0 { 1.0 / d.sqrt() } else { 0.0 });
    let scaled = information.map_with_location(|r, c, v| v * unit[r] * unit[c]);
    let (values, vectors) = symmetric_eigen(&scaled);
    let mut delta = Tangent::<P>::zeros_generic(n, U1);
    let mut kept = Square::<P>::zeros_generic(n, n);
    for k in (0..values.len()).filter(|k| values[*k] > ROUNDING) {
        let step = vectors.column(k).component_mul(&unit);
        delta.axpy(step.dot(gradient) / values[k], &step, 1.0);
        let row = vectors.column(k).zip_map(&unit, |v, u| if u > 0.0 { v / u } else { 0.0 });
        kept.ger(values[k], &row, &row, 1.0);
    }
    if !P::FLAT {
        // From the chart at `at` to that at the pose: at ⊞ (δ + ε) = z ⊞ Gε.
        let back = at.retract_jacobian(&delta).try_inverse();
        let back = back.unwrap_or_else(|| Square::<P>::identity_generic(n, n));
        kept = back.tr_mul(&(kept * &back));
        vt_core::belief::symmetrize(&mut kept);
    }
    PoseMeasurement::new(at.retract(&delta), kept, quality)
}
