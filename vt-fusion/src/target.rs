//! One target: its modalities, estimator, loss detector and re-initialiser.

use std::time::Instant;

use nalgebra::DefaultAllocator;
use vt_core::agent::{Estimator, LossDetector, Reinitializer};
use vt_core::belief::Gaussian;
use vt_core::error::{EstimateError, MeasureError};
use vt_core::evidence::{Evidence, EvidenceKey};
use vt_core::frame::{Roi, SensorId};
use vt_core::manifold::{Alloc, Coordinates, Manifold, Tangent};
use vt_core::measurement::{Measurement, Modality};
use vt_core::report::{Assessment, Status, StepReport};
use vt_core::sketch::Mark;
use vt_core::time::Seconds;

use crate::stacked::Stacked;

/// A target, or a group of targets that share detections, whatever its pose space: the one erasure of the loop.
pub trait AnyTarget: Send {
    /// Number of targets in here; each has one report a step.
    fn count(&self) -> usize;

    /// Name of the target with this index.
    fn name(&self, index: usize) -> &str;

    /// Sensors whose frames are looked at.
    fn sensors(&self) -> &[SensorId];

    /// Advances the belief.
    ///
    /// # Errors
    /// When numbers stop being finite.
    fn predict(&mut self, dt: Seconds) -> Result<(), EstimateError>;

    /// Appends the evidence that `update` will read, with the part of the picture that matters.
    fn requests(&self, out: &mut Vec<(EvidenceKey, Option<Roi>)>);

    /// Measures, corrects, assesses and, where lost, re-initialises; fills one report a target.
    fn update(&mut self, evidence: &Evidence, reports: &mut [StepReport]);

    /// Draws the target with this index.
    fn sketch(&self, index: usize, out: &mut Vec<Mark>);
}

/// Most modalities that one target may have.
const MOST_PARTS: usize = 16;

/// One target of pose space `P`.
pub struct Target<P: Manifold>
where
    DefaultAllocator: Alloc<P::D>,
{
    name: String,
    sensors: Vec<SensorId>,
    modalities: Vec<Box<dyn Modality<P>>>,
    estimator: Box<dyn Estimator<P>>,
    loss: Box<dyn LossDetector>,
    reinitializer: Option<Box<dyn Reinitializer<P>>>,
    /// Design deviation of each pose coordinate, for the scaled log-determinant.
    scale: Tangent<P>,
    trusted: Gaussian<P>,
    status: Status,
    proposals: Vec<Gaussian<P>>,
}

impl<P: Coordinates> Target<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// A target whose estimator already holds the prior. `scale` is the deviation of each pose coordinate that the
    /// design expects; the covariance is judged relative to it.
    pub fn new(
        name: impl Into<String>,
        sensors: Vec<SensorId>,
        mut modalities: Vec<Box<dyn Modality<P>>>,
        estimator: Box<dyn Estimator<P>>,
        loss: Box<dyn LossDetector>,
        reinitializer: Option<Box<dyn Reinitializer<P>>>,
        scale: Tangent<P>,
    ) -> Self {
        modalities.truncate(MOST_PARTS);
        let trusted = estimator.pose();
        Self {
            name: name.into(),
            sensors,
            modalities,
            estimator,
            loss,
            reinitializer,
            scale,
            trusted,
            status: Status::Tracking,
            proposals: vec![],
        }
    }

    /// The estimator.
    pub fn estimator(&self) -> &dyn Estimator<P> {
        self.estimator.as_ref()
    }

    /// Corrects with a measurement made elsewhere (a detection), then assesses; for targets without modalities.
    pub(crate) fn correct_with(&mut self, z: Option<&dyn Measurement<P>>, report: &mut StepReport) {
        let figures = match z {
            Some(z) => Self::correct(self.estimator.as_mut(), &self.scale, z, report),
            None => self.unmeasured(),
        };
        self.conclude(figures, report);
    }

    /// Writes what is known before the measurement.
    pub(crate) fn open(&self, evidence: &Evidence, report: &mut StepReport) {
        if report.target != self.name {
            report.target.clone_from(&self.name);
        }
        if let Some(frame) = self.sensors.iter().find_map(|&s| evidence.frame(s).ok()) {
            report.frame = frame.number;
            report.time = frame.time;
        }
        report.prediction.set(&self.estimator.pose());
        report.failure = None;
        report.reinitialized = false;
        report.unobservable.clear();
        report.timings = Default::default();
    }

    fn unmeasured(&self) -> Assessment {
        let log_det = self.estimator.pose().scaled_log_det(&self.scale);
        Assessment { log_det, ..Assessment::default() }
    }

    fn correct(
        estimator: &mut dyn Estimator<P>,
        scale: &Tangent<P>,
        z: &dyn Measurement<P>,
        report: &mut StepReport,
    ) -> Assessment {
        let start = Instant::now();
        let innovation = match estimator.correct(z) {
            Ok(innovation) => Some(innovation),
            Err(e) => {
                report.failure = Some(e.to_string());
                None
            }
        };
        report.timings.correct = nanoseconds(start);
        let pose = estimator.pose();
        let quality = Some(z.quality(&pose.mean));
        Assessment { quality, innovation, log_det: pose.scaled_log_det(scale) }
    }

    /// Measures near `prior` with all modalities and corrects the estimator with what they saw.
    fn measure_and_correct(&mut self, evidence: &Evidence, report: &mut StepReport) -> Assessment {
        let start = Instant::now();
        let prior = self.estimator.pose();
        for modality in &mut self.modalities {
            match modality.measure(evidence, &prior) {
                Ok(_) => {}
                // In an asynchronous system a sensor has nothing in most steps: no failure.
                Err(MeasureError::MissingFrame { .. }) => {}
                Err(e) => report.failure = Some(e.to_string()),
            }
        }
        report.timings.measure += nanoseconds(start);
        let mut parts: [Option<&dyn Measurement<P>>; MOST_PARTS] = [None; MOST_PARTS];
        let mut count = 0;
        for z in self.modalities.iter().filter_map(|m| m.last()) {
            parts[count] = Some(z);
            count += 1;
        }
        match (count, parts[0]) {
            (0, _) | (_, None) => self.unmeasured(),
            (1, Some(z)) => Self::correct(self.estimator.as_mut(), &self.scale, z, report),
            (_, Some(first)) => {
                let mut all = [first; MOST_PARTS];
                all.iter_mut().zip(parts.iter().flatten()).for_each(|(slot, z)| *slot = *z);
                Self::correct(self.estimator.as_mut(), &self.scale, &Stacked(&all[..count]), report)
            }
        }
    }

    fn conclude(&mut self, figures: Assessment, report: &mut StepReport) {
        let start = Instant::now();
        report.assessment = figures;
        report.verdict = self.loss.assess(&figures);
        // Once lost, only a good step ends it: a detector that was just reset has forgotten.
        if self.status == Status::Lost && report.verdict.loss_probability > 0.5 {
            report.verdict.status = Status::Lost;
        }
        self.status = report.verdict.status;
        let pose = self.estimator.pose();
        report.posterior.set(&pose);
        if self.status == Status::Tracking {
            self.trusted = pose;
        }
        report.timings.assess = nanoseconds(start);
    }

    /// Tries every proposed prior on this frame and keeps the one that the data support best, if it is not itself
    /// judged a loss.
    fn reinitialize(&mut self, evidence: &Evidence, report: &mut StepReport) {
        let Some(reinitializer) = &mut self.reinitializer else { return };
        let start = Instant::now();
        let mut proposals = core::mem::take(&mut self.proposals);
        proposals.clear();
        if let Err(e) = reinitializer.propose(evidence, &self.trusted, &mut proposals) {
            report.failure = Some(e.to_string());
        }
        let mut best: Option<(f64, Gaussian<P>, Assessment)> = None;
        for prior in &proposals {
            if self.estimator.reset(prior).is_err() {
                continue;
            }
            let figures = self.measure_and_correct(evidence, report);
            let Some(quality) = figures.quality else { continue };
            if best.as_ref().is_none_or(|(score, ..)| quality.log_ratio > *score) {
                best = Some((quality.log_ratio, self.estimator.pose(), figures));
            }
        }
        self.proposals = proposals;
        self.loss.reset();
        let accepted = best.filter(|(.., figures)| self.loss.assess(figures).loss_probability < 0.5);
        match accepted {
            Some((_, pose, figures)) => {
                self.loss.reset();
                // A pose that was just read off a picture is a valid prior; if not, the target stays where it was.
                if self.estimator.reset(&pose).is_ok() {
                    report.reinitialized = true;
                    self.conclude(figures, report);
                }
            }
            None => {
                let _ = self.estimator.reset(&self.trusted);
                report.verdict.status = Status::Lost;
                self.status = Status::Lost;
            }
        }
        report.timings.reinitialize = nanoseconds(start);
    }
}

impl<P: Coordinates> AnyTarget for Target<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    fn count(&self) -> usize {
        1
    }

    fn name(&self, _: usize) -> &str {
        &self.name
    }

    fn sensors(&self) -> &[SensorId] {
        &self.sensors
    }

    fn predict(&mut self, dt: Seconds) -> Result<(), EstimateError> {
        self.estimator.predict(dt)
    }

    fn requests(&self, out: &mut Vec<(EvidenceKey, Option<Roi>)>) {
        let prior = self.estimator.pose();
        for modality in &self.modalities {
            let region = modality.region(&prior);
            out.extend(modality.needs().iter().map(|key| (key.clone(), region)));
        }
        if let (Status::Lost, Some(r)) = (self.status, &self.reinitializer) {
            out.extend(r.needs().iter().map(|key| (key.clone(), None)));
        }
    }

    fn update(&mut self, evidence: &Evidence, reports: &mut [StepReport]) {
        let [report] = reports else { return };
        self.open(evidence, report);
        let figures = self.measure_and_correct(evidence, report);
        self.conclude(figures, report);
        if self.status == Status::Lost {
            self.reinitialize(evidence, report);
        }
    }

    fn sketch(&self, _: usize, out: &mut Vec<Mark>) {
        let pose = self.estimator.pose().mean;
        for modality in &self.modalities {
            modality.sketch(&pose, out);
        }
    }
}

fn nanoseconds(since: Instant) -> u64 {
    u64::try_from(since.elapsed().as_nanos()).unwrap_or(u64::MAX)
}
