//! The loop over targets and sensors (paper Fig. 1): predict → restrict search → measure → correct → assess →
//! re-initialise → report.

use rayon::prelude::*;
use vt_core::agent::Step;
use vt_core::error::EstimateError;
use vt_core::evidence::{Evidence, EvidenceKey, Pending, Processing};
use vt_core::frame::{Frame, Roi};
use vt_core::report::{BeliefRecord, StepReport};
use vt_core::sketch::Mark;
use vt_core::time::{Seconds, Timestamp};

use crate::target::AnyTarget;

/// Any number of targets of any pose spaces, observed by any number of sensors.
#[derive(Default)]
pub struct TrackingLoop {
    targets: Vec<Box<dyn AnyTarget>>,
    evidence: Evidence,
    reports: Vec<StepReport>,
    requests: Vec<(EvidenceKey, Option<Roi>)>,
    time: Option<Timestamp>,
}

impl TrackingLoop {
    /// A loop over these targets; targets run in parallel, each on its own data.
    pub fn new(targets: Vec<Box<dyn AnyTarget>>) -> Self {
        let count = targets.iter().map(|t| t.count()).sum();
        Self { targets, reports: vec![StepReport::default(); count], ..Self::default() }
    }

    /// Adds a unit of image processing that modalities may ask for.
    pub fn add_processing(&mut self, unit: Box<dyn Processing>) {
        self.evidence.add(unit);
    }

    /// Takes in the frames of one point in time, of one sensor or of several at once, and reports on every target.
    /// Between steps any amount of time may pass; a frame that is older than the step before counts as
    /// simultaneous (out-of-sequence handling is the estimators' business). A target of whose sensors none has a frame
    /// in this step goes on as predicted and is not judged.
    ///
    /// # Errors
    /// When a prediction stops being finite, or evidence cannot be made. The loop may go on with the next frame.
    pub fn step(&mut self, frames: impl IntoIterator<Item = Frame>) -> Result<&[StepReport], StepError> {
        self.evidence.begin(frames);
        let now = self.evidence.frames().iter().map(|f| f.time).max().ok_or(StepError::NoFrames)?;
        let dt = self.time.map_or(Seconds(0.0), |before| Seconds((now - before).0.max(0.0)));
        self.time = self.time.max(Some(now));
        if dt.0 > 0.0 {
            // All of them, whatever becomes of one; the first error in their order.
            match self.targets.as_mut_slice() {
                [only] => only.predict(dt)?,
                many => many.par_iter_mut().map(|t| t.predict(dt)).reduce(|| Ok(()), Result::and)?,
            }
        }
        self.requests.clear();
        for target in &self.targets {
            target.requests(&mut self.requests);
        }
        merge(&mut self.requests);
        run(self.evidence.pending(&self.requests));
        let evidence = &self.evidence;
        match self.targets.as_mut_slice() {
            [only] => only.update(evidence, &mut self.reports),
            many => {
                let mut rest = self.reports.as_mut_slice();
                let mut parts = Vec::with_capacity(many.len());
                for target in many {
                    let (mine, others) = rest.split_at_mut(target.count());
                    rest = others;
                    parts.push((target, mine));
                }
                parts.into_par_iter().for_each(|(target, reports)| target.update(evidence, reports));
            }
        }
        Ok(&self.reports)
    }

    /// Places the target with this index, over all groups, at this belief as of the last step's frames: at rest,
    /// trusted, with nothing learnt but what those frames show there.
    ///
    /// # Errors
    /// When the belief does not fit the target, which is then unchanged.
    pub fn place(&mut self, mut index: usize, prior: &BeliefRecord) -> Result<(), StepError> {
        for target in &mut self.targets {
            if index >= target.count() {
                index -= target.count();
                continue;
            }
            target.place(index, prior)?;
            // What was made for the prediction may lack what is needed here.
            let frames = self.evidence.frames().to_vec();
            self.evidence.begin(frames);
            self.requests.clear();
            target.requests(&mut self.requests);
            merge(&mut self.requests);
            run(self.evidence.pending(&self.requests));
            target.learn(index, &self.evidence);
            return Ok(());
        }
        Ok(())
    }

    /// Number of targets.
    pub fn count(&self) -> usize {
        self.reports.len()
    }

    /// What outputs see of the last step.
    pub fn with_step<R>(&self, look: impl FnOnce(&Step<'_>) -> R) -> R {
        let sketch = |index: usize, out: &mut Vec<Mark>| self.sketch(index, out);
        look(&Step { evidence: &self.evidence, reports: &self.reports, sketch: &sketch })
    }

    /// Draws the target with this index, over all groups.
    pub fn sketch(&self, mut index: usize, out: &mut Vec<Mark>) {
        for target in &self.targets {
            if index < target.count() {
                return target.sketch(index, out);
            }
            index -= target.count();
        }
    }
}

/// Runs units of image processing at the same time. Each fills a buffer of its own, so that nothing depends on their
/// order; no heap is touched.
fn run(pending: Pending<'_>) {
    if pending.count() < 2 {
        return pending.run();
    }
    let (left, right) = pending.split();
    rayon::join(|| run(left), || run(right));
}

/// One entry a key, with a region that holds all regions asked for.
fn merge(requests: &mut Vec<(EvidenceKey, Option<Roi>)>) {
    requests.sort_by(|a, b| a.0.cmp(&b.0));
    requests.dedup_by(|later, kept| {
        let same = later.0 == kept.0;
        if same {
            kept.1 = kept.1.zip(later.1).map(|(a, b)| a.union(b));
        }
        same
    });
}

/// A step that could not be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StepError {
    /// A step needs at least one frame.
    #[error("no frames in this step")]
    NoFrames,
    /// A prediction failed.
    #[error(transparent)]
    Estimate(#[from] EstimateError),
}
