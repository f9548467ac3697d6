//! Object-level measurement: a pose seen directly, with its information.

use nalgebra::{DefaultAllocator, Dim};

use crate::dynamics::pivoted_root;
use crate::error::EstimateError;
use crate::manifold::{Alloc, Manifold, Square, Tangent};
use crate::measurement::{Level, Linearized, Measurement, NormalEquations, Quality};

/// A measured pose `z` with information `A` in the tangent space at `z`: `local(z, truth) ~ N(0, A⁻¹)`.
///
/// `A` may be singular: directions that the data do not determine have zero information and never a made-up number.
#[derive(Clone, Debug)]
pub struct PoseMeasurement<P: Manifold>
where
    DefaultAllocator: Alloc<P::D>,
{
    pose: P,
    information: Square<P>,
    root: Square<P>,
    quality: Quality,
}

impl<P: Manifold> PoseMeasurement<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// A measured pose with symmetric positive semi-definite `information`.
    pub fn new(pose: P, information: Square<P>, quality: Quality) -> Self {
        let root = pivoted_root(&information);
        Self { pose, information, root, quality }
    }

    /// The measured pose.
    pub fn pose(&self) -> &P {
        &self.pose
    }

    /// Its information.
    pub fn information(&self) -> &Square<P> {
        &self.information
    }

    /// Error `e = local(z, at)` and its derivative with respect to a perturbation of `at`, `∂e/∂δ`.
    fn error(&self, at: &P) -> (Tangent<P>, Square<P>) {
        let e = self.pose.local(at);
        // local(z, at ⊞ δ) = e + E δ with retract_jacobian(e) E = 1, since z ⊞ (e + Eδ) = at ⊞ δ.
        let n = self.pose.dim();
        let jacobian = self.pose.retract_jacobian(&e);
        let derivative = jacobian.try_inverse().unwrap_or_else(|| Square::<P>::identity_generic(n, n));
        (e, derivative)
    }
}

impl<P: Manifold> Measurement<P> for PoseMeasurement<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    fn fits(&self, at: &P) -> Result<(), EstimateError> {
        let expected = at.dim().value();
        EstimateError::unless_equal("the measured pose", self.pose.dim().value(), expected)?;
        EstimateError::unless_equal(
            "the information of the measured pose",
            self.information.nrows(),
            expected,
        )
    }

    fn log_likelihoods(&self, poses: &[P], out: &mut [f64]) {
        for (pose, l) in poses.iter().zip(out) {
            let e = self.pose.local(pose);
            *l = -0.5 * self.root.tr_mul(&e).norm_squared();
        }
    }

    fn residuals(&self, at: &P, out: &mut Linearized<P>) {
        out.clear();
        let (e, derivative) = self.error(at);
        let r = self.root.tr_mul(&e);
        let j = self.root.tr_mul(&derivative);
        for k in 0..r.len() {
            // Rows of zero information say nothing.
            if self.root.column(k).iter().any(|&v| v != 0.0) {
                out.push(-r[k], j.row(k).transpose(), 1.0, 1.0);
            }
        }
    }

    fn normal_equations(&self, at: &P, out: &mut NormalEquations<P>) {
        let (e, derivative) = self.error(at);
        let weighted = derivative.tr_mul(&self.information);
        out.gradient.copy_from(&(-(&weighted * &e)));
        out.information.copy_from(&(weighted * derivative));
        crate::belief::symmetrize(&mut out.information);
        out.cost = 0.5 * self.root.tr_mul(&e).norm_squared();
        out.rows = (0..self.root.ncols()).filter(|&k| self.root[(k, k)] != 0.0).count();
    }

    fn normalized_residuals(&self, poses: &[P], out: &mut Vec<f64>) -> Option<usize> {
        out.clear();
        for pose in poses {
            out.extend(self.root.tr_mul(&self.pose.local(pose)).iter().map(|e| -e));
        }
        Some(self.root.ncols())
    }

    fn quality(&self, _: &P) -> Quality {
        self.quality
    }

    fn level(&self) -> Level {
        Level::Object
    }
}
