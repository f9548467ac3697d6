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
use vt_core::report::{Assessment, BeliefRecord, Innovation, Status, StepReport};
use vt_core::sketch::Mark;
use vt_core::time::Seconds;

use crate::stacked::{Stacked, StaticFusion};
use crate::summed::information_sum;
use crate::tracks::one_after_the_other;
use crate::unobservable::unobservable;

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

    /// Places the target with this index: at this belief, at rest, trusted, with nothing learnt.
    ///
    /// # Errors
    /// When the belief is one of another pose space or of no use; the target is then unchanged.
    fn place(&mut self, index: usize, prior: &BeliefRecord) -> Result<(), EstimateError>;

    /// Lets the target with this index learn from a frame where it is; the frame does not correct its belief.
    fn learn(&mut self, index: usize, evidence: &Evidence);

    /// Draws the target with this index.
    fn sketch(&self, index: usize, out: &mut Vec<Mark>);
}

/// Modalities whose measurements are listed without storage on the heap.
const FEW: usize = 16;

/// Good steps in a row, with the one in which it was taken, that confirm a proposal: one picture may deceive.
const CONFIRMED: u32 = 3;

/// True when a step holds a frame of one of these sensors, or when none is named.
pub(crate) fn watched(sensors: &[SensorId], evidence: &Evidence) -> bool {
    sensors.is_empty() || sensors.iter().any(|&s| evidence.frame(s).is_ok())
}

/// One target of pose space `P`.
pub struct Target<P: Manifold>
where
    DefaultAllocator: Alloc<P::D>,
{
    name: String,
    sensors: Vec<SensorId>,
    modalities: Vec<Box<dyn Modality<P>>>,
    /// Whether each modality gave a measurement in this step.
    seen: Vec<bool>,
    fusion: StaticFusion,
    estimator: Box<dyn Estimator<P>>,
    loss: Box<dyn LossDetector>,
    reinitializer: Option<Box<dyn Reinitializer<P>>>,
    /// Design deviation of each pose coordinate, for the scaled log-determinant.
    scale: Tangent<P>,
    trusted: Gaussian<P>,
    status: Status,
    /// Good steps since a proposal was taken that is not confirmed yet.
    unconfirmed: Option<u32>,
    proposals: Vec<Gaussian<P>>,
}

impl<P: Coordinates> Target<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// A target whose estimator already holds the prior. `scale` is the deviation of each pose coordinate that the
    /// design expects; the covariance is judged relative to it. Steps without a frame of `sensors` are passed over; with
    /// no sensor named, every step counts.
    pub fn new(
        name: impl Into<String>,
        sensors: Vec<SensorId>,
        modalities: Vec<Box<dyn Modality<P>>>,
        estimator: Box<dyn Estimator<P>>,
        loss: Box<dyn LossDetector>,
        reinitializer: Option<Box<dyn Reinitializer<P>>>,
        scale: Tangent<P>,
    ) -> Self {
        let trusted = estimator.pose();
        Self {
            name: name.into(),
            sensors,
            seen: vec![false; modalities.len()],
            modalities,
            fusion: StaticFusion::default(),
            estimator,
            loss,
            reinitializer,
            scale,
            trusted,
            status: Status::Tracking,
            unconfirmed: None,
            proposals: vec![],
        }
    }

    /// The same target, but where it is is not known yet: it begins as lost, so that the re-initialiser is asked at the
    /// first step.
    #[must_use]
    pub fn beginning_lost(self) -> Self {
        Self { status: Status::Lost, ..self }
    }

    /// The same target with another way from several measurements to one correction.
    #[must_use]
    pub fn with_fusion(self, fusion: StaticFusion) -> Self {
        Self { fusion, ..self }
    }

    /// The estimator.
    pub fn estimator(&self) -> &dyn Estimator<P> {
        self.estimator.as_ref()
    }

    /// Corrects with a measurement made elsewhere (a detection), then assesses; for targets without modalities.
    pub(crate) fn correct_with(&mut self, z: Option<&dyn Measurement<P>>, report: &mut StepReport) {
        let figures = match z {
            Some(z) => Self::correct(self.estimator.as_mut(), self.fusion, &self.scale, &[z], report),
            None => self.unmeasured(),
        };
        self.conclude(figures, report);
    }

    /// Writes what is known before the measurement.
    pub(crate) fn open(&self, evidence: &Evidence, report: &mut StepReport) {
        if report.target != self.name {
            report.target.clone_from(&self.name);
        }
        let newest = evidence.frames().iter().max_by_key(|f| f.time);
        if let Some(frame) = self.sensors.iter().find_map(|&s| evidence.frame(s).ok()).or(newest) {
            report.frame = frame.number;
        }
        report.time = newest.map_or(report.time, |f| f.time);
        report.prediction.set(&self.estimator.pose());
        report.failure = None;
        report.reinitialized = false;
        report.unobservable.clear();
        report.timings = Default::default();
    }

    /// Nothing in this step is for this target: it goes on as predicted and is not judged.
    pub(crate) fn coast(&self, evidence: &Evidence, report: &mut StepReport) {
        self.open(evidence, report);
        report.posterior.clone_from(&report.prediction);
        report.assessment = self.unmeasured();
    }

    fn unmeasured(&self) -> Assessment {
        let log_det = self.estimator.pose().scaled_log_det(&self.scale);
        Assessment { log_det, ..Assessment::default() }
    }

    fn correct(
        estimator: &mut dyn Estimator<P>,
        fusion: StaticFusion,
        scale: &Tangent<P>,
        parts: &[&dyn Measurement<P>],
        report: &mut StepReport,
    ) -> Assessment {
        let start = Instant::now();
        let stack = Stacked(parts);
        let whole: &dyn Measurement<P> = if let [one] = parts { *one } else { &stack };
        let sum =
            (fusion == StaticFusion::InformationSum).then(|| information_sum(parts, &estimator.pose().mean));
        let at_once = [sum.as_ref().map_or(whole, |z| z as _)];
        let list = if fusion == StaticFusion::Sequential { parts } else { &at_once };
        let (mut innovation, mut failed) = (None::<Innovation>, None);
        for z in list {
            match estimator.correct(*z) {
                Ok(new) => innovation = Some(innovation.map_or(new, |sum| one_after_the_other(sum, new))),
                Err(e) => failed = Some(e),
            }
        }
        report.timings.correct = nanoseconds(start);
        let pose = estimator.pose();
        match failed {
            None => unobservable(whole, &pose, scale, &mut report.unobservable),
            Some(e) => note(report, e),
        }
        let quality = Some(whole.quality(&pose.mean));
        Assessment { quality, innovation, log_det: pose.scaled_log_det(scale) }
    }

    /// Measures near `prior` with all modalities and corrects the estimator with what they saw.
    fn measure_and_correct(&mut self, evidence: &Evidence, report: &mut StepReport) -> Assessment {
        let start = Instant::now();
        let prior = self.estimator.pose();
        for (modality, seen) in self.modalities.iter_mut().zip(&mut self.seen) {
            let outcome = modality.measure(evidence, &prior);
            *seen = matches!(outcome, Ok(Some(_)));
            match outcome {
                // In an asynchronous system a sensor has nothing in most steps: no failure.
                Ok(_) | Err(MeasureError::MissingFrame { .. }) => {}
                Err(e) => note(report, e),
            }
        }
        report.timings.measure += nanoseconds(start);
        // What a modality measured in an earlier step is no measurement of this one.
        let mut parts =
            self.modalities.iter().zip(&self.seen).filter(|(_, seen)| **seen).filter_map(|(m, _)| m.last());
        let Some(first) = parts.next() else { return self.unmeasured() };
        let (mut few, mut many) = ([first; FEW], vec![]);
        let mut count = 1;
        for z in parts {
            if count < FEW {
                few[count] = z;
            } else {
                many.extend(if many.is_empty() { few.as_slice() } else { &[] });
                many.push(z);
            }
            count += 1;
        }
        let parts = if many.is_empty() { &few[..count] } else { many.as_slice() };
        Self::correct(self.estimator.as_mut(), self.fusion, &self.scale, parts, report)
    }

    fn conclude(&mut self, figures: Assessment, report: &mut StepReport) {
        let start = Instant::now();
        report.assessment = figures;
        report.verdict = self.loss.assess(&figures);
        // Once lost, only a good step ends it: a detector that was just reset has forgotten.
        if self.status == Status::Lost && report.verdict.loss_probability > 0.5 {
            report.verdict.status = Status::Lost;
        }
        if let Some(good) = self.unconfirmed {
            let good = if report.verdict.loss_probability > 0.5 { None } else { Some(good + 1) };
            report.verdict.status = match good {
                None => Status::Lost,
                Some(n) if n < CONFIRMED => Status::Doubtful,
                Some(_) => Status::Tracking,
            };
            self.unconfirmed = good.filter(|n| *n < CONFIRMED);
        }
        self.status = report.verdict.status;
        let pose = self.estimator.pose();
        report.posterior.set(&pose);
        if self.status == Status::Tracking {
            self.trusted = pose;
        }
        report.timings.assess = nanoseconds(start);
    }

    /// Draws what was seen, with the model at `pose`.
    pub(crate) fn sketch_at(&self, pose: &P, out: &mut Vec<Mark>) {
        for modality in &self.modalities {
            modality.sketch(pose, out);
        }
    }

    fn forget(&mut self) {
        self.modalities.iter_mut().for_each(|m| m.forget());
        if let Some(reinitializer) = &mut self.reinitializer {
            reinitializer.forget();
        }
    }

    fn revert(&mut self) {
        self.modalities.iter_mut().for_each(|m| m.revert());
    }

    /// Lets those that saw the target in this step, and the re-initialiser, adapt to what it looks like.
    fn adapt(&mut self, evidence: &Evidence, report: &mut StepReport) {
        let start = Instant::now();
        let pose = self.estimator.pose();
        let seeing = self.modalities.iter_mut().zip(&self.seen).filter(|(_, seen)| **seen);
        let mut outcomes = seeing.map(|(m, _)| m.adapt(evidence, &pose)).fold(Ok(()), Result::and);
        if let Some(reinitializer) = &mut self.reinitializer {
            outcomes = outcomes.and(reinitializer.adapt(evidence, &pose));
        }
        match outcomes {
            Ok(()) | Err(MeasureError::MissingFrame { .. }) => {}
            Err(e) => note(report, e),
        }
        report.timings.measure += nanoseconds(start);
    }

    /// Puts the target where another track of it is: trusted, with what it learnt in trusted steps.
    pub(crate) fn restart(&mut self, belief: &Gaussian<P>) -> Result<(), EstimateError> {
        self.estimator.reset(belief)?;
        self.revert();
        self.trust(belief);
        Ok(())
    }

    /// Counts as tracked there from now on.
    fn trust(&mut self, belief: &Gaussian<P>) {
        self.loss.reset();
        self.unconfirmed = None;
        self.status = Status::Tracking;
        self.trusted.clone_from(belief);
    }

    /// True when the target may be re-initialised in the step to come.
    fn searching(&self) -> bool {
        self.reinitializer.is_some() && self.status != Status::Tracking
    }

    /// Tries every proposed prior on this frame and keeps the one that the data support best, if it is not itself
    /// judged a loss and they support it better than where the target was thought to be. It stays doubtful until the steps that
    /// follow confirm it, and what was trusted before is kept until then. With no such prior the target goes on from where
    /// it was thought to be if no proposal is better supported, and else from where it was trusted.
    fn reinitialize(&mut self, evidence: &Evidence, report: &mut StepReport) {
        let Some(reinitializer) = &mut self.reinitializer else { return };
        let start = Instant::now();
        let (here, support) = (self.estimator.pose(), report.assessment.quality.map(|q| q.log_ratio));
        let mut proposals = core::mem::take(&mut self.proposals);
        proposals.clear();
        match reinitializer.propose(evidence, &self.trusted, &mut proposals) {
            Ok(()) | Err(MeasureError::MissingFrame { .. }) => {}
            Err(e) => note(report, e),
        }
        let mut best: Option<(f64, Gaussian<P>, Vec<f64>, Assessment)> = None;
        for prior in &proposals {
            if self.estimator.reset(prior).is_err() {
                continue;
            }
            // What was learnt while the target slipped away, or at the proposal before, speaks for wrong places.
            self.revert();
            let figures = self.measure_and_correct(evidence, report);
            let Some(quality) = figures.quality else { continue };
            if best.as_ref().is_none_or(|(score, ..)| quality.log_ratio > *score) {
                let unobservable = core::mem::take(&mut report.unobservable);
                best = Some((quality.log_ratio, self.estimator.pose(), unobservable, figures));
            }
        }
        self.proposals = proposals;
        self.revert();
        self.loss.reset();
        let best = best.filter(|(score, ..)| support.is_none_or(|here| *score > here));
        let stay = best.is_none() && support.is_some();
        let accepted = best.filter(|(.., figures)| self.loss.assess(figures).loss_probability < 0.5);
        match accepted {
            Some((_, pose, unobservable, figures)) => {
                self.loss.reset();
                report.unobservable = unobservable;
                // A pose that was just read off a picture is a valid prior; if not, the target stays where it was.
                if self.estimator.reset(&pose).is_ok() {
                    report.reinitialized = true;
                    self.unconfirmed = Some(0);
                    self.conclude(figures, report);
                }
            }
            None => {
                let _ = self.estimator.reset(if stay { &here } else { &self.trusted });
                report.posterior.set(&self.estimator.pose());
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
        // Other priors than this one may be tried.
        let anywhere = self.searching();
        for modality in &self.modalities {
            let (needs, region) = match anywhere {
                true => (modality.needs(), None),
                false => (modality.needs_near(&prior), modality.region(&prior)),
            };
            out.extend(needs.iter().map(|key| (key.clone(), region)));
        }
        if let (true, Some(r)) = (anywhere, &self.reinitializer) {
            out.extend(r.needs().iter().map(|key| (key.clone(), None)));
        }
    }

    fn update(&mut self, evidence: &Evidence, reports: &mut [StepReport]) {
        let [report] = reports else { return };
        if !watched(&self.sensors, evidence) {
            return self.coast(evidence, report);
        }
        // Only then the whole picture was asked for.
        let searching = self.searching();
        self.open(evidence, report);
        let figures = self.measure_and_correct(evidence, report);
        self.conclude(figures, report);
        if searching && self.status == Status::Lost {
            self.reinitialize(evidence, report);
        } else if self.status == Status::Tracking && report.verdict.loss_probability < 0.5 {
            self.adapt(evidence, report);
        }
    }

    fn place(&mut self, _: usize, prior: &BeliefRecord) -> Result<(), EstimateError> {
        let belief = prior.get::<P>().ok_or(EstimateError::Space {
            found: prior.space,
            numbers: prior.coordinates.len(),
            expected: P::SPACE,
        })?;
        self.estimator.reset(&belief)?;
        self.forget();
        self.trust(&belief);
        Ok(())
    }

    fn learn(&mut self, _: usize, evidence: &Evidence) {
        let belief = self.estimator.pose();
        for modality in &mut self.modalities {
            // Only for what it learns; one that cannot measure here learns nothing.
            let _ = modality.measure(evidence, &belief);
        }
    }

    fn sketch(&self, _: usize, out: &mut Vec<Mark>) {
        self.sketch_at(&self.estimator.pose().mean, out);
    }
}

/// Adds a failure to those of this step, once.
pub(crate) fn note(report: &mut StepReport, failure: impl core::fmt::Display) {
    let failure = failure.to_string();
    match &mut report.failure {
        Some(all) if all.contains(&failure) => {}
        Some(all) => *all += &format!("; {failure}"),
        none => *none = Some(failure),
    }
}

fn nanoseconds(since: Instant) -> u64 {
    u64::try_from(since.elapsed().as_nanos()).unwrap_or(u64::MAX)
}
