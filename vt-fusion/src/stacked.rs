//! Static fusion: independent measurements of one target become one before the estimator (paper §2).
//!
//! Stacking rows, updating one after the other and summing information are the same for linear models and
//! independent noise ([`StaticFusion`] names the three).

use nalgebra::DefaultAllocator;
use vt_core::error::EstimateError;
use vt_core::manifold::{Alloc, Manifold};
use vt_core::measurement::{Level, Linearized, Measurement, NormalEquations, Quality};

/// How several measurements of one target in one step correct its estimator. For linear measurements with independent
/// noise it does not matter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum StaticFusion {
    /// As one of all rows: [`Stacked`], solved at once. The most exact.
    #[default]
    Stacked,
    /// One after the other, each linearised where the one before left the estimate.
    Sequential,
    /// As one pose with the sum of their information, linearised at the prediction:
    /// [`crate::summed::information_sum`]. The cheapest for many hypotheses.
    InformationSum,
}

/// Hypotheses weighed at once.
const CHUNK: usize = 64;

/// Measurements of one target at one time, as one.
pub struct Stacked<'a, P: Manifold>(pub &'a [&'a dyn Measurement<P>])
where
    DefaultAllocator: Alloc<P::D>;

impl<P: Manifold> Stacked<'_, P>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// Sums of the logarithms that `f` gives for each measurement.
    fn sum(&self, poses: &[P], out: &mut [f64], f: impl Fn(&dyn Measurement<P>, &[P], &mut [f64])) {
        let mut part = [0.0; CHUNK];
        for (poses, out) in poses.chunks(CHUNK).zip(out.chunks_mut(CHUNK)) {
            out.fill(0.0);
            for z in self.0 {
                f(*z, poses, &mut part[..out.len()]);
                out.iter_mut().zip(&part).for_each(|(sum, l)| *sum += l);
            }
        }
    }
}

impl<P: Manifold> Measurement<P> for Stacked<'_, P>
where
    DefaultAllocator: Alloc<P::D>,
{
    fn fits(&self, at: &P) -> Result<(), EstimateError> {
        self.0.iter().try_for_each(|z| z.fits(at))
    }

    fn log_likelihoods(&self, poses: &[P], out: &mut [f64]) {
        self.sum(poses, out, |z, poses, out| z.log_likelihoods(poses, out));
    }

    fn importances(&self, poses: &[P], placed: &[usize], out: &mut [f64]) {
        self.sum(poses, out, |z, poses, out| z.importances(poses, placed, out));
    }

    fn residuals(&self, at: &P, out: &mut Linearized<P>) {
        out.clear();
        let mut part = Linearized::default();
        for z in self.0 {
            z.residuals(at, &mut part);
            out.residuals.append(&mut part.residuals);
            out.jacobians.append(&mut part.jacobians);
            out.variances.append(&mut part.variances);
            out.weights.append(&mut part.weights);
        }
    }

    fn normal_equations(&self, at: &P, out: &mut NormalEquations<P>) {
        out.clear();
        let mut part = NormalEquations::empty(at);
        for z in self.0 {
            z.normal_equations(at, &mut part);
            out.join(&part);
        }
    }

    /// Counts add up; ratios are means over the expected rows.
    fn quality(&self, at: &P) -> Quality {
        together(self.0.iter().map(|z| z.quality(at)))
    }

    fn level(&self) -> Level {
        match self.0 {
            [one] => one.level(),
            _ => Level::Feature,
        }
    }
}

/// Figures of several measurements as one.
pub(crate) fn together(parts: impl Iterator<Item = Quality>) -> Quality {
    let mut sum = Quality::default();
    let mut squares = 0.0;
    for q in parts {
        let share = q.expected as f64;
        sum.inlier_ratio += q.inlier_ratio * share;
        sum.log_ratio += q.log_ratio * share;
        squares += q.normalized_rms * q.normalized_rms * q.inliers as f64;
        sum.expected += q.expected;
        sum.inliers += q.inliers;
    }
    let n = (sum.expected as f64).max(1.0);
    sum.inlier_ratio /= n;
    sum.log_ratio /= n;
    sum.normalized_rms = (squares / (sum.inliers as f64).max(1.0)).sqrt();
    sum
}
