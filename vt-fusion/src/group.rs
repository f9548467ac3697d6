//! Targets that share detections: detect → associate → correct (paper Fig. 1 with data association).

use nalgebra::DefaultAllocator;
use vt_core::agent::{Association, Associator, Costs};
use vt_core::belief::Gaussian;
use vt_core::error::{EstimateError, MeasureError};
use vt_core::evidence::{Evidence, EvidenceKey};
use vt_core::frame::{Roi, SensorId};
use vt_core::manifold::{Alloc, Coordinates, Manifold, Square};
use vt_core::measurement::{Detector, Quality};
use vt_core::pose_measurement::PoseMeasurement;
use vt_core::report::{BeliefRecord, StepReport};
use vt_core::sketch::Mark;
use vt_core::time::Seconds;

use crate::target::{AnyTarget, Target, watched};

/// Targets of one pose space that share a detector.
pub struct Group<P: Manifold>
where
    DefaultAllocator: Alloc<P::D>,
{
    targets: Vec<Target<P>>,
    detector: Box<dyn Detector<P>>,
    associator: Box<dyn Associator>,
    sensors: Vec<SensorId>,
    gate: f64,
    detections: Vec<Gaussian<P>>,
    costs: Costs,
    association: Association,
}

impl<P: Coordinates> Group<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// A group whose targets have no modalities of their own. `gate` is the largest squared Mahalanobis distance
    /// between a detection and a target's prediction.
    pub fn new(
        targets: Vec<Target<P>>,
        detector: Box<dyn Detector<P>>,
        associator: Box<dyn Associator>,
        sensors: Vec<SensorId>,
        gate: f64,
    ) -> Self {
        Self {
            targets,
            detector,
            associator,
            sensors,
            gate,
            detections: vec![],
            costs: Costs::default(),
            association: Association::default(),
        }
    }

    fn price(&mut self) {
        let costs = &mut self.costs;
        (costs.targets, costs.detections) = (self.targets.len(), self.detections.len());
        costs.pair.clear();
        for target in &self.targets {
            let prior = target.estimator().pose();
            costs.pair.extend(self.detections.iter().map(|z| {
                let spread =
                    Gaussian { mean: prior.mean.clone(), covariance: &prior.covariance + &z.covariance };
                match spread.nees(&z.mean) {
                    Some(d2) if d2 <= self.gate => d2,
                    _ => f64::INFINITY,
                }
            }));
        }
        costs.miss.clear();
        costs.miss.resize(self.targets.len(), self.gate);
    }
}

impl<P: Coordinates> AnyTarget for Group<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    fn count(&self) -> usize {
        self.targets.len()
    }

    fn name(&self, index: usize) -> &str {
        self.targets[index].name(0)
    }

    fn sensors(&self) -> &[SensorId] {
        &self.sensors
    }

    fn predict(&mut self, dt: Seconds) -> Result<(), EstimateError> {
        self.targets.iter_mut().try_for_each(|t| t.predict(dt))
    }

    fn requests(&self, out: &mut Vec<(EvidenceKey, Option<Roi>)>) {
        out.extend(self.detector.needs().iter().map(|key| (key.clone(), None)));
    }

    fn update(&mut self, evidence: &Evidence, reports: &mut [StepReport]) {
        if !watched(&self.sensors, evidence) {
            for (target, report) in self.targets.iter().zip(reports) {
                target.coast(evidence, report);
            }
            return;
        }
        self.detections.clear();
        let seen = self.detector.detect(evidence, &mut self.detections);
        self.price();
        self.associator.associate(&self.costs, &mut self.association);
        for (k, (target, report)) in self.targets.iter_mut().zip(reports).enumerate() {
            target.open(evidence, report);
            match &seen {
                Ok(()) | Err(MeasureError::MissingFrame { .. }) => {}
                Err(e) => report.failure = Some(e.to_string()),
            }
            let row = self.association.weights.chunks(self.detections.len().max(1)).nth(k).unwrap_or(&[]);
            let chosen = row.iter().position(|&w| w > 0.5);
            let z = chosen.and_then(|d| measurement(&self.detections[d]));
            target.correct_with(z.as_ref().map(|z| z as _), report);
        }
    }

    fn place(&mut self, index: usize, prior: &BeliefRecord) -> Result<(), EstimateError> {
        self.targets[index].place(0, prior)
    }

    fn learn(&mut self, index: usize, evidence: &Evidence) {
        self.targets[index].learn(0, evidence);
    }

    fn sketch(&self, index: usize, out: &mut Vec<Mark>) {
        self.targets[index].sketch(0, out);
    }
}

/// A detection as a measurement of the target it was given to; `None` when its covariance is not positive definite.
fn measurement<P: Manifold>(z: &Gaussian<P>) -> Option<PoseMeasurement<P>>
where
    DefaultAllocator: Alloc<P::D>,
{
    let n = z.mean.dim();
    let factor = vt_core::belief::cholesky(z.covariance.clone())?;
    let information: Square<P> = factor.solve(&Square::<P>::identity_generic(n, n));
    let quality = Quality { expected: 1, inliers: 1, inlier_ratio: 1.0, log_ratio: 1.0, normalized_rms: 1.0 };
    Some(PoseMeasurement::new(z.mean.clone(), information, quality))
}
