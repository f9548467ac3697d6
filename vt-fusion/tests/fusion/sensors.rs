//! Sensors and targets of the tests.

use nalgebra::{DefaultAllocator, Vector2};
use vt_core::agent::{Estimator, Reinitializer};
use vt_core::belief::{Gaussian, Moving};
use vt_core::dynamics::ConstantVelocity;
use vt_core::error::MeasureError;
use vt_core::evidence::{Evidence, EvidenceKey};
use vt_core::frame::{Frame, Payload, SensorId};
use vt_core::lie::Vector;
use vt_core::manifold::{Alloc, Coordinates, Square, Tangent};
use vt_core::measurement::{Measurement, Modality, Quality};
use vt_core::pose_measurement::PoseMeasurement;
use vt_core::random::{Random, Stream};
use vt_core::report::StepReport;
use vt_core::time::Timestamp;
use vt_estimators::kalman::KalmanFilter;
use vt_fusion::Target;
use vt_fusion::loss::FusedLoss;

pub type Plane = Vector<2>;

pub fn random(case: u64) -> Random {
    Random::new(5, Stream::Sim, 0, case, 0)
}

/// A frame of numbers at a time in milliseconds.
pub fn frame(sensor: u32, milliseconds: i64, numbers: Vec<f64>) -> Frame {
    let time = Timestamp(milliseconds * 1_000_000);
    Frame { sensor: SensorId(sensor), number: milliseconds as u64, time, payload: Payload::Vector(numbers) }
}

/// Fully supported, against rare clutter.
pub const SUPPORTED: Quality =
    Quality { expected: 1, inliers: 1, inlier_ratio: 1.0, log_ratio: 5.0, normalized_rms: 1.0 };

/// Sees the pose itself in a frame of its coordinates, if it is within `reach` of the prediction.
///
/// Keeps what it measured last until it measures again, as modalities with buffers do.
pub struct Direct<P: Coordinates>
where
    DefaultAllocator: Alloc<P::D>,
{
    pub sensor: SensorId,
    pub information: Square<P>,
    pub reach: f64,
    pub last: Option<PoseMeasurement<P>>,
}

impl<P: Coordinates> Direct<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    pub fn new(sensor: u32, information: Square<P>) -> Self {
        Self { sensor: SensorId(sensor), information, reach: f64::INFINITY, last: None }
    }
}

impl<P: Coordinates> Modality<P> for Direct<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    fn needs(&self) -> &[EvidenceKey] {
        &[]
    }
    fn measure(
        &mut self,
        evidence: &Evidence,
        prior: &Gaussian<P>,
    ) -> Result<Option<&dyn Measurement<P>>, MeasureError> {
        let numbers = evidence.frame(self.sensor)?.vector()?;
        let Some(z) = P::read(numbers) else { return Ok(None) };
        if prior.mean.local(&z).norm() > self.reach {
            return Ok(None);
        }
        self.last = Some(PoseMeasurement::new(z, self.information.clone(), SUPPORTED));
        Ok(self.last())
    }
    fn last(&self) -> Option<&dyn Measurement<P>> {
        self.last.as_ref().map(|z| z as _)
    }
}

/// A filter at constant velocity in the plane, one unit wide.
pub fn filter(x: f64, y: f64) -> KalmanFilter<Plane, Moving<Plane>, ConstantVelocity<Plane>> {
    let prior = Gaussian::from_sigmas(Vector(Vector2::new(x, y)), &Vector2::repeat(1.0));
    let motion = ConstantVelocity::new(Vector2::repeat(0.5)).expect("not negative");
    KalmanFilter::new(&prior, vec![Vector2::repeat(3.0)], motion, 1).expect("a prior")
}

/// A target with these modalities, its covariance judged against deviations of one.
pub fn target<P: Coordinates>(
    name: &str,
    sensors: &[u32],
    modalities: Vec<Box<dyn Modality<P>>>,
    estimator: impl Estimator<P> + 'static,
    reinitializer: Option<Box<dyn Reinitializer<P>>>,
) -> Target<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    let scale: Tangent<P> = estimator.pose().mean.zero().map(|_| 1.0);
    let sensors = sensors.iter().map(|s| SensorId(*s)).collect();
    let loss = Box::new(FusedLoss::default());
    Target::new(name, sensors, modalities, Box::new(estimator), loss, reinitializer, scale)
}

/// All that a report says but for the wall clock.
pub fn content(reports: &[StepReport]) -> String {
    let timeless = reports.iter().map(|r| StepReport { timings: Default::default(), ..r.clone() });
    timeless.map(|r| format!("{r:?}\n")).collect()
}
