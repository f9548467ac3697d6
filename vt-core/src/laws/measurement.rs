//! Duality of measurements.

use nalgebra::{DefaultAllocator, Dim, OVector, U1};

use super::{block, compare, difference_jacobian};
use crate::least_squares::symmetric_eigen;
use crate::manifold::{Alloc, Manifold};
use crate::measurement::{Linearized, Measurement, NormalEquations};

/// How closely both forms of a measurement must agree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeasurementTolerance {
    /// Step of the differences in tangent units.
    pub step: f64,
    /// Difference of gradients relative to their largest coordinate, or to the gradient one step from the optimum.
    pub gradient: f64,
    /// Difference between accumulated residuals and normal equations, relative to the largest entry.
    pub accumulation: f64,
}

impl Default for MeasurementTolerance {
    fn default() -> Self {
        Self { step: 1e-4, gradient: 1e-5, accumulation: 1e-9 }
    }
}

/// Checks at the pose `at`: the gradient of `-log_likelihoods` and that of the cost are `-normal_equations.gradient`;
/// accumulated residuals are the normal equations; the information is symmetric and positive semi-definite; a batch
/// gives what single calls give; quality figures are possible.
///
/// # Panics
/// When a law is broken.
pub fn check_measurement<P: Manifold>(z: &dyn Measurement<P>, at: &P, tolerance: MeasurementTolerance)
where
    DefaultAllocator: Alloc<P::D>,
{
    let (n, blocks) = (at.dim(), at.blocks());
    let one = vec![("value".to_string(), 1)];
    let likelihood = |pose: &P| {
        let mut l = [f64::NAN];
        z.log_likelihoods(core::slice::from_ref(pose), &mut l);
        l[0]
    };
    let equations = |pose: &P| {
        let mut e = NormalEquations::empty(pose);
        // Twice, for the content must be replaced.
        z.normal_equations(pose, &mut e);
        z.normal_equations(pose, &mut e);
        e
    };
    let moved = |e: &[f64]| at.retract(&OVector::from_fn_generic(n, U1, |k, _| e[k]));
    let found = equations(at);
    let claimed = block(&found.gradient).transpose();
    // At the optimum gradients vanish: there they are measured against that of one step away.
    let floor = (found.information.amax() * tolerance.step).max(f64::MIN_POSITIVE);
    let size = claimed.amax().max(floor);

    let slope = difference_jacobian(1, n.value(), tolerance.step, |e| vec![likelihood(&moved(e))]);
    compare(
        "gradient against log_likelihoods",
        &one,
        &blocks,
        &(&claimed / size),
        &(slope / size),
        tolerance.gradient,
    );
    let slope = difference_jacobian(1, n.value(), tolerance.step, |e| vec![-equations(&moved(e)).cost]);
    compare(
        "gradient against the cost",
        &one,
        &blocks,
        &(claimed / size),
        &(slope / size),
        tolerance.gradient,
    );

    let mut rows = Linearized::default();
    z.residuals(at, &mut rows);
    z.residuals(at, &mut rows);
    let lengths = [rows.jacobians.len(), rows.variances.len(), rows.weights.len()];
    assert_eq!(lengths, [rows.len(); 3], "lengths of Jacobians, variances and weights");
    assert!(rows.variances.iter().all(|v| v.is_finite() && *v > 0.0), "variances must be positive");
    assert!(rows.weights.iter().all(|w| w.is_finite() && *w >= 0.0), "weights must not be negative");
    let mut sum = NormalEquations::empty(at);
    rows.accumulate(&mut sum);
    let size = found.information.amax().max(f64::MIN_POSITIVE);
    let (a, b) = (block(&sum.information) / size, block(&found.information) / size);
    compare("information of the residuals", &blocks, &blocks, &a, &b, tolerance.accumulation);
    let size = found.gradient.amax().max(floor);
    let (a, b) = (block(&sum.gradient) / size, block(&found.gradient) / size);
    compare("gradient of the residuals", &blocks, &one, &a, &b, tolerance.accumulation);

    let information = &found.information;
    let largest = information.amax();
    assert!(
        (information - information.transpose()).amax() <= 1e-12 * largest,
        "information is not symmetric"
    );
    let lowest = symmetric_eigen(information).0.min();
    assert!(lowest >= -1e-9 * largest, "information has the negative eigenvalue {lowest}");

    let batch = [at.clone(), moved(&vec![tolerance.step; n.value()]), at.clone()];
    let mut l = [f64::NAN; 3];
    z.log_likelihoods(&batch, &mut l);
    for (l, pose) in l.iter().zip(&batch) {
        assert!(*l == likelihood(pose), "a batch gives {l}, a single call {}", likelihood(pose));
    }
    let quality = z.quality(at);
    assert!(quality.inliers <= quality.expected, "{quality:?}");
    assert!((0.0..=1.0).contains(&quality.inlier_ratio), "{quality:?}");
    assert!(quality.normalized_rms >= 0.0 && quality.log_ratio.is_finite(), "{quality:?}");
}
