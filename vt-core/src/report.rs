//! What one step of one target produced, without the types of its pose space: for outputs and loss tests.

use nalgebra::DefaultAllocator;

use crate::belief::Gaussian;
use crate::manifold::{Alloc, Coordinates};
use crate::measurement::Quality;
use crate::time::Timestamp;

/// A belief by its numbers.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BeliefRecord {
    /// Pose space, such as `"se3"`.
    pub space: &'static str,
    /// Coordinates of the mean (SE(3): `tx ty tz qx qy qz qw`, camera_from_object, metres).
    pub coordinates: Vec<f64>,
    /// Covariance of the tangent error by rows, all entries.
    pub covariance: Vec<f64>,
}

impl BeliefRecord {
    /// Takes over the numbers of `belief` without new storage once the sizes have settled.
    pub fn set<P: Coordinates>(&mut self, belief: &Gaussian<P>)
    where
        DefaultAllocator: Alloc<P::D>,
    {
        self.space = P::SPACE;
        self.coordinates.clear();
        belief.mean.write(&mut self.coordinates);
        self.covariance.clear();
        for r in 0..belief.covariance.nrows() {
            self.covariance.extend((0..belief.covariance.ncols()).map(|c| belief.covariance[(r, c)]));
        }
    }

    /// The belief again, when the space fits.
    pub fn get<P: Coordinates>(&self) -> Option<Gaussian<P>>
    where
        DefaultAllocator: Alloc<P::D>,
    {
        if self.space != P::SPACE {
            return None;
        }
        let mean = P::read(&self.coordinates)?;
        let n = mean.dim();
        let mut covariance = crate::manifold::Square::<P>::zeros_generic(n, n);
        if self.covariance.len() != covariance.len() {
            return None;
        }
        for r in 0..covariance.nrows() {
            for c in 0..covariance.ncols() {
                covariance[(r, c)] = self.covariance[r * covariance.ncols() + c];
            }
        }
        Some(Gaussian { mean, covariance })
    }

    /// Dimension of the tangent space.
    pub fn dim(&self) -> usize {
        (self.covariance.len() as f64).sqrt() as usize
    }
}

/// Why an iteration ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum StopReason {
    /// No iteration was needed.
    #[default]
    Direct,
    /// The step became negligible against the posterior deviation.
    SmallStep,
    /// The cost no longer fell.
    SmallDecrease,
    /// The number of iterations was used up.
    Iterations,
    /// The equations could not be solved.
    Singular,
}

/// What a correction says about the prediction.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Innovation {
    /// Normalised innovation squared: prediction against measurement, χ² with `dof` degrees when both are honest.
    pub nis: f64,
    /// Degrees of freedom of `nis`: the observable directions of the measurement.
    pub dof: usize,
    /// `ln ∫ P(z|s) p(s) ds` up to a constant of the measurement.
    pub log_evidence: f64,
    /// Effective number of particles, where the estimator has particles.
    pub effective_particles: Option<f64>,
    /// Iterations used.
    pub iterations: u32,
    /// Why they ended.
    pub stop: StopReason,
}

/// Condition of a target.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Status {
    /// The estimate is good.
    #[default]
    Tracking,
    /// Evidence of loss, not yet enough.
    Doubtful,
    /// The estimate is not to be used.
    Lost,
}

impl Status {
    /// Lower-case name, as in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tracking => "tracking",
            Self::Doubtful => "doubtful",
            Self::Lost => "lost",
        }
    }
}

/// Verdict of a loss detector.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Verdict {
    /// Condition after hysteresis.
    pub status: Status,
    /// Probability that the target is lost, from this step's figures.
    pub loss_probability: f64,
}

/// Figures from which loss is judged. Absent figures are `None`: never a made-up number.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Assessment {
    /// Support of the posterior by the data; `None` without a measurement.
    pub quality: Option<Quality>,
    /// Prediction against measurement.
    pub innovation: Option<Innovation>,
    /// `ln det` of the unit-scaled pose covariance per degree of freedom (paper §6, scaled).
    pub log_det: Option<f64>,
}

/// Wall-clock time of the parts of a step in nanoseconds; never part of a result.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Timings {
    /// Prediction.
    pub predict: u64,
    /// Measurement, and adaptation of what is known of the target's looks.
    pub measure: u64,
    /// Correction.
    pub correct: u64,
    /// Loss assessment.
    pub assess: u64,
    /// Re-initialisation.
    pub reinitialize: u64,
}

/// One step of one target.
#[derive(Clone, Debug, Default)]
pub struct StepReport {
    /// Name of the target.
    pub target: String,
    /// Number of the frame.
    pub frame: u64,
    /// Time of the step.
    pub time: Timestamp,
    /// Belief before the measurement.
    pub prediction: BeliefRecord,
    /// Belief after the measurement (the prediction when there was none).
    pub posterior: BeliefRecord,
    /// Figures of the assessment.
    pub assessment: Assessment,
    /// Condition of the target.
    pub verdict: Verdict,
    /// True when the target was re-initialised in this step.
    pub reinitialized: bool,
    /// Pose directions that the data of this step do not determine, as unit tangent vectors one after the other.
    pub unobservable: Vec<f64>,
    /// Why there is no measurement, where something failed.
    pub failure: Option<String>,
    /// Wall-clock times.
    pub timings: Timings,
}
