//! Several tracks of one object as one target of the loop.

use nalgebra::DefaultAllocator;
use rayon::prelude::*;
use vt_core::belief::Gaussian;
use vt_core::error::EstimateError;
use vt_core::evidence::{Evidence, EvidenceKey};
use vt_core::frame::{Roi, SensorId};
use vt_core::manifold::{Alloc, Coordinates, Manifold, Tangent};
use vt_core::report::{BeliefRecord, Status, StepReport, Verdict};
use vt_core::sketch::Mark;
use vt_core::time::Seconds;

use crate::stacked::together;
use crate::target::{AnyTarget, Target, note, watched};
use crate::tracks::{Track, TrackFusion};

/// Dynamic fusion in the loop: targets that are tracks of one object, each with its own modalities, estimator and loss
/// detector, and one fused track that is reported under its own name. What estimates the object is the fused track; a
/// track that is lost does not count, and the object is lost when all are.
pub struct FusedTarget<P: Manifold>
where
    DefaultAllocator: Alloc<P::D>,
{
    name: String,
    sensors: Vec<SensorId>,
    targets: Vec<Target<P>>,
    rule: Box<dyn TrackFusion<P>>,
    scale: Tangent<P>,
    tracks: Vec<Track<P>>,
    fused: Gaussian<P>,
    /// Reports of the tracks.
    reports: Vec<StepReport>,
    listed: bool,
    feedback: bool,
}

impl<P: Coordinates> FusedTarget<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// Tracks of one object that start from one prior. `scale` is as for [`Target::new`].
    ///
    /// # Errors
    /// When the tracks cannot be fused by this rule.
    pub fn new(
        name: impl Into<String>,
        targets: Vec<Target<P>>,
        mut rule: Box<dyn TrackFusion<P>>,
        scale: Tangent<P>,
    ) -> Result<Self, EstimateError> {
        let mut sensors: Vec<SensorId> = vec![];
        for sensor in targets.iter().flat_map(|t| t.sensors()) {
            if !sensors.contains(sensor) {
                sensors.push(*sensor);
            }
        }
        // A track that watches every sensor makes the fused one do so.
        if targets.iter().any(|t| t.sensors().is_empty()) {
            sensors.clear();
        }
        let tracks: Vec<_> = targets.iter().map(|t| Track::at(t.estimator().pose())).collect();
        let fused = rule.fuse(&tracks)?.posterior;
        let reports = vec![StepReport::default(); targets.len()];
        let name = name.into();
        Ok(Self {
            name,
            sensors,
            targets,
            rule,
            scale,
            tracks,
            fused,
            reports,
            listed: false,
            feedback: false,
        })
    }

    /// The same, with the tracks reported as targets of their own after the fused one.
    #[must_use]
    pub fn with_tracks_listed(self) -> Self {
        Self { listed: true, ..self }
    }

    /// The same, but a track that is lost, or that is not where the fused one is, starts again there with what it knows of the object.
    #[must_use]
    pub fn with_feedback(self) -> Self {
        Self { feedback: true, ..self }
    }

    /// Reports of the tracks, of the last step.
    pub fn tracks(&self) -> &[StepReport] {
        &self.reports
    }

    fn fuse(&mut self, judged: bool, report: &mut StepReport) {
        let best = |of: fn(&Verdict) -> f64| {
            self.reports.iter().map(|r| of(&r.verdict)).fold(f64::INFINITY, f64::min)
        };
        let status = best(|v| f64::from(v.status as u8));
        if judged {
            report.verdict.loss_probability = best(|v| v.loss_probability);
            report.verdict.status = [Status::Tracking, Status::Doubtful, Status::Lost]
                .into_iter()
                .find(|s| f64::from(*s as u8) == status)
                .unwrap_or_default();
        }
        report.assessment = Default::default();
        match self.rule.fuse(&self.tracks) {
            Ok(fused) => {
                report.prediction.set(&fused.prediction);
                report.assessment.innovation = fused.innovation;
                let seen = self.tracks.iter().filter(|t| t.usable).filter_map(|t| t.quality);
                if seen.clone().next().is_some() {
                    report.assessment.quality = Some(together(seen));
                }
                self.fused = fused.posterior;
            }
            Err(e) => {
                report.prediction.set(&self.fused);
                report.verdict = Verdict { status: Status::Lost, loss_probability: 1.0 };
                note(report, e);
            }
        }
        report.posterior.set(&self.fused);
        report.assessment.log_det = self.fused.scaled_log_det(&self.scale);
    }

    /// Tracks that are lost or elsewhere start again at the fused belief.
    fn feed_back(&mut self) {
        for k in 0..self.targets.len() {
            let astray = !self.tracks[k].usable || elsewhere(&self.tracks[k].posterior, &self.fused);
            if astray && self.targets[k].restart(&self.fused).is_ok() {
                self.tracks[k] = Track::at(self.fused.clone());
                self.rule.rejoin(&self.tracks, k);
            }
        }
    }
}

/// Squared distance in deviations for each degree of freedom beyond which a track is not of the same object. What is fused
/// shares the errors of its tracks: it may be no farther off than they know.
const ELSEWHERE: f64 = 9.0;

/// Whether a track is not where the fused one is, as far as it knows its own error; false where it knows none.
fn elsewhere<P: Manifold>(track: &Gaussian<P>, fused: &Gaussian<P>) -> bool
where
    DefaultAllocator: Alloc<P::D>,
{
    let apart = track.mean.local(&fused.mean);
    let n = apart.len() as f64;
    track.covariance.clone().cholesky().is_some_and(|c| apart.dot(&c.solve(&apart)) > ELSEWHERE * n)
}

impl<P: Coordinates> AnyTarget for FusedTarget<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    fn count(&self) -> usize {
        1 + if self.listed { self.targets.len() } else { 0 }
    }

    fn name(&self, index: usize) -> &str {
        index.checked_sub(1).map_or(&self.name, |k| self.targets[k].name(0))
    }

    fn sensors(&self) -> &[SensorId] {
        &self.sensors
    }

    fn predict(&mut self, dt: Seconds) -> Result<(), EstimateError> {
        // All of them, whatever becomes of one.
        let rule = self.rule.predict(&self.tracks, dt);
        self.targets.iter_mut().map(|t| t.predict(dt)).fold(rule, Result::and)
    }

    fn requests(&self, out: &mut Vec<(EvidenceKey, Option<Roi>)>) {
        self.targets.iter().for_each(|t| t.requests(out));
    }

    fn update(&mut self, evidence: &Evidence, reports: &mut [StepReport]) {
        let Some((report, listed)) = reports.split_first_mut() else { return };
        let each = self.targets.par_iter_mut().zip(&mut self.reports).zip(&mut self.tracks);
        each.for_each(|((target, report), track)| {
            track.prediction = target.estimator().pose();
            target.update(evidence, core::slice::from_mut(report));
            track.posterior = target.estimator().pose();
            track.quality = report.assessment.quality;
            track.innovation = report.assessment.innovation;
            track.usable = report.verdict.status != Status::Lost;
            track.restarted = report.reinitialized;
        });
        if report.target != self.name {
            report.target.clone_from(&self.name);
        }
        let Some(first) = self.reports.first() else { return };
        // The frame is that of a track which has one.
        let own = self.targets.iter().position(|t| watched(t.sensors(), evidence));
        report.frame = own.map_or(first.frame, |k| self.reports[k].frame);
        report.time = first.time;
        report.reinitialized = false;
        report.unobservable.clear();
        report.timings = Default::default();
        report.failure = None;
        for track in &self.reports {
            report.timings.measure += track.timings.measure;
            report.timings.correct += track.timings.correct;
            report.timings.assess += track.timings.assess;
            report.timings.reinitialize += track.timings.reinitialize;
            if let Some(failure) = &track.failure {
                note(report, failure);
            }
        }
        let before = report.verdict.status;
        self.fuse(own.is_some(), report);
        report.reinitialized = before == Status::Lost && self.tracks.iter().any(|t| t.restarted && t.usable);
        listed.clone_from_slice(&self.reports[..listed.len()]);
        if self.feedback && report.verdict.status == Status::Tracking {
            self.feed_back();
        }
    }

    fn place(&mut self, _: usize, prior: &BeliefRecord) -> Result<(), EstimateError> {
        for (target, track) in self.targets.iter_mut().zip(&mut self.tracks) {
            target.place(0, prior)?;
            *track = Track::at(target.estimator().pose());
        }
        let Some(belief) = prior.get::<P>() else { return Ok(()) };
        self.rule.reset(&belief)?;
        self.fused = belief;
        Ok(())
    }

    fn learn(&mut self, _: usize, evidence: &Evidence) {
        self.targets.iter_mut().for_each(|t| t.learn(0, evidence));
    }

    fn sketch(&self, index: usize, out: &mut Vec<Mark>) {
        match index.checked_sub(1) {
            None => self.targets.iter().for_each(|t| t.sketch_at(&self.fused.mean, out)),
            Some(k) => self.targets[k].sketch(0, out),
        }
    }
}
