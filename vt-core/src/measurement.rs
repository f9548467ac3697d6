//! Measurements of one target, in both forms of the paper's §5.2.2: `P(z|s)` and `z = h(s, v)` with its Jacobian.

use nalgebra::{DefaultAllocator, U1};

use crate::belief::Gaussian;
use crate::error::{EstimateError, MeasureError};
use crate::evidence::{Evidence, EvidenceKey};
use crate::frame::Roi;
use crate::manifold::{Alloc, Manifold, Square, Tangent};
use crate::sketch::Mark;

/// Processing level of a measurement (columns of the paper's Fig. 4).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// Evidence maps: only a likelihood is at hand, residuals are implied by it.
    Pixel,
    /// A variable number of image features with residuals.
    Feature,
    /// A pose with its information.
    Object,
}

/// One measurement of the pose `P`, valid for the frame it was made from.
///
/// **Duality**: both forms describe the same data, so any measurement runs under any estimator. `normal_equations`
/// is the Gauss–Newton expansion of `-log_likelihoods` up to a constant (checked by `measurement_laws!`).
pub trait Measurement<P: Manifold>: Sync
where
    DefaultAllocator: Alloc<P::D>,
{
    /// Whether poses of this size can be compared with it; estimators ask before anything else. Measurements of a size that is
    /// only known at run time override it.
    ///
    /// # Errors
    /// [`EstimateError::Dimension`] when they cannot.
    fn fits(&self, at: &P) -> Result<(), EstimateError> {
        let _ = at;
        Ok(())
    }

    /// `ln P(z|p)` up to a constant for a batch of hypotheses; `out` has the length of `poses`.
    fn log_likelihoods(&self, poses: &[P], out: &mut [f64]);

    /// `ln g(p)` of poses of which the tangent coordinates `placed` are drawn and the others only predicted, for
    /// estimators that place articulated bodies part after part. Any positive function is right; the better it is
    /// proportional to `P(z|p)` over all values of the others, the fewer hypotheses are lost.
    fn importances(&self, poses: &[P], placed: &[usize], out: &mut [f64]) {
        let _ = placed;
        self.log_likelihoods(poses, out);
    }

    /// Residuals `observed − predicted` at `at` with Jacobians of the prediction; replaces the content of `out`.
    /// The number of rows may differ from call to call.
    fn residuals(&self, at: &P, out: &mut Linearized<P>);

    /// Normal equations of the data term at `at` (never of a prior); replaces the content of `out`.
    fn normal_equations(&self, at: &P, out: &mut NormalEquations<P>);

    /// Residuals in units of their noise, `R^(-1/2) (z − h(p))`, for every pose of the batch, one pose after the other;
    /// replaces the content of `out` and returns the number of rows of a pose.
    ///
    /// This is the way of estimators that need `h` itself and not its derivative (sigma points). It exists where the
    /// rows are the same for every pose and their noise is Gaussian; `None`, the default, where they are not (matches
    /// that depend on the pose, robust weights): such estimators then linearise as the others do.
    fn normalized_residuals(&self, poses: &[P], out: &mut Vec<f64>) -> Option<usize> {
        let _ = (poses, out);
        None
    }

    /// How well the data support the pose `at`.
    fn quality(&self, at: &P) -> Quality;

    /// Level at which this measurement was made.
    fn level(&self) -> Level;
}

/// Rows of a linearised measurement: `r(p ⊞ δ) ≈ r − J δ`.
#[derive(Clone, Debug)]
pub struct Linearized<P: Manifold>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// Residual of each row, observed − predicted.
    pub residuals: Vec<f64>,
    /// Jacobian of each row's prediction with respect to the pose's tangent.
    pub jacobians: Vec<Tangent<P>>,
    /// Variance of each row's noise.
    pub variances: Vec<f64>,
    /// Robust weight of each row in `[0, 1]`; zero for an outlier.
    pub weights: Vec<f64>,
}

impl<P: Manifold> Default for Linearized<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    fn default() -> Self {
        Self { residuals: vec![], jacobians: vec![], variances: vec![], weights: vec![] }
    }
}

impl<P: Manifold> Linearized<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// Removes all rows and keeps the storage.
    pub fn clear(&mut self) {
        self.residuals.clear();
        self.jacobians.clear();
        self.variances.clear();
        self.weights.clear();
    }

    /// Adds a row.
    pub fn push(&mut self, residual: f64, jacobian: Tangent<P>, variance: f64, weight: f64) {
        self.residuals.push(residual);
        self.jacobians.push(jacobian);
        self.variances.push(variance);
        self.weights.push(weight);
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.residuals.len()
    }

    /// True without rows.
    pub fn is_empty(&self) -> bool {
        self.residuals.is_empty()
    }

    /// Adds all rows to `out`.
    pub fn accumulate(&self, out: &mut NormalEquations<P>) {
        for k in 0..self.len() {
            out.add(self.residuals[k], &self.jacobians[k], self.weights[k] / self.variances[k]);
        }
    }
}

/// `A δ = b` with `A = Σ w JJᵀ`, `b = Σ w J r`, and the cost `½ Σ w r²`.
#[derive(Clone, Debug)]
pub struct NormalEquations<P: Manifold>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// Information matrix `A` of the data.
    pub information: Square<P>,
    /// Right-hand side `b`, the negative gradient of the cost.
    pub gradient: Tangent<P>,
    /// `½ Σ w r²`, or the robust cost the modality minimises.
    pub cost: f64,
    /// Number of rows that entered.
    pub rows: usize,
}

impl<P: Manifold> NormalEquations<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// No data, for poses of the dimension of `at`.
    pub fn empty(at: &P) -> Self {
        let n = at.dim();
        Self {
            information: Square::<P>::zeros_generic(n, n),
            gradient: Tangent::<P>::zeros_generic(n, U1),
            cost: 0.0,
            rows: 0,
        }
    }

    /// Removes all data and keeps the storage.
    pub fn clear(&mut self) {
        self.information.fill(0.0);
        self.gradient.fill(0.0);
        self.cost = 0.0;
        self.rows = 0;
    }

    /// Adds one row with residual `r`, Jacobian `j` and weight `w` (inverse variance times robust weight).
    pub fn add(&mut self, r: f64, j: &Tangent<P>, w: f64) {
        self.information.ger(w, j, j, 1.0);
        self.gradient.axpy(w * r, j, 1.0);
        self.cost += 0.5 * w * r * r;
        self.rows += 1;
    }

    /// Adds independent data of the same pose.
    pub fn join(&mut self, other: &Self) {
        self.information += &other.information;
        self.gradient += &other.gradient;
        self.cost += other.cost;
        self.rows += other.rows;
    }
}

/// How well the data support a pose, for loss tests. Without data all figures are zero.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Quality {
    /// Rows (sites, pixels, matches) that were looked for.
    pub expected: usize,
    /// Rows found near where the pose predicts them.
    pub inliers: usize,
    /// `inliers / expected`, each row counted by its weight in the modality.
    pub inlier_ratio: f64,
    /// Mean log-likelihood ratio of a row, this pose against clutter, in nats; positive when the pose explains more.
    pub log_ratio: f64,
    /// Root mean square of the inliers' residuals in units of their standard deviation; 1 when the noise model holds.
    pub normalized_rms: f64,
}

/// Turns evidence and a predicted pose into one measurement for one target (paper §5.1, right column of Fig. 4).
///
/// One instance per target, so that targets run in parallel.
pub trait Modality<P: Manifold>: Send
where
    DefaultAllocator: Alloc<P::D>,
{
    /// Evidence that must be prepared before `measure`.
    fn needs(&self) -> &[EvidenceKey];

    /// The part of `needs` that is read under this prior.
    fn needs_near(&self, prior: &Gaussian<P>) -> &[EvidenceKey] {
        let _ = prior;
        self.needs()
    }

    /// Part of the sensor's picture that matters under this prior ("restrict search"); `None` for all of it.
    fn region(&self, prior: &Gaussian<P>) -> Option<Roi> {
        let _ = prior;
        None
    }

    /// Measures near the prior. The prior guides the search and never enters the measurement. `None` when there is
    /// nothing to see. The measurement is lent from the modality's buffers until the next call.
    ///
    /// # Errors
    /// When the evidence does not fit this modality.
    fn measure(
        &mut self,
        evidence: &Evidence,
        prior: &Gaussian<P>,
    ) -> Result<Option<&dyn Measurement<P>>, MeasureError>;

    /// The measurement of the last call of `measure`, if it gave one.
    fn last(&self) -> Option<&dyn Measurement<P>>;

    /// Forgets what was learnt from earlier pictures (appearance, on-line features): the target is placed anew, and
    /// what was learnt since it was last placed may come from somewhere else. Nothing to do for who learns nothing.
    fn forget(&mut self) {}

    /// Adapts the appearance to what this frame shows at `posterior` (the paper's model processor, §7). Called after the
    /// correction, and only in steps whose estimate is trusted. Nothing to do for who adapts nothing.
    ///
    /// # Errors
    /// When the evidence does not fit; what was known is then unchanged.
    fn adapt(&mut self, evidence: &Evidence, posterior: &Gaussian<P>) -> Result<(), MeasureError> {
        let _ = (evidence, posterior);
        Ok(())
    }

    /// Forgets what was learnt while the target may have been somewhere else: it is lost, and other places are tried. What was
    /// learnt in steps that were trusted may stay; who does not tell them apart forgets all.
    fn revert(&mut self) {
        self.forget();
    }

    /// Draws what was looked for and found, with the model at `pose`.
    fn sketch(&self, pose: &P, out: &mut Vec<Mark>) {
        let _ = (pose, out);
    }
}

/// Finds measurements without a target, before association (paper §2).
pub trait Detector<P: Manifold>: Send
where
    DefaultAllocator: Alloc<P::D>,
{
    /// Evidence that must be prepared before `detect`.
    fn needs(&self) -> &[EvidenceKey];

    /// Appends all poses seen, each with the covariance of its error.
    ///
    /// # Errors
    /// When the evidence does not fit this detector.
    fn detect(&mut self, evidence: &Evidence, out: &mut Vec<Gaussian<P>>) -> Result<(), MeasureError>;
}
