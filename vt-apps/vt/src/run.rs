//! Running a task: sensors → tracking loop → outputs.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use vt_core::agent::{Output, Sensor, Step};
use vt_core::error::DeviceError;
use vt_core::frame::Frame;
use vt_core::report::StepReport;
use vt_fusion::tracking::StepError;
use vt_io::report::Header;
use vt_io::summary::Summary;
use vt_task::assembly::Scene;
use vt_task::{Document, Registry, TaskErrors, check};

/// How a task is run.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Folder for results; made when it is not there.
    pub out: PathBuf,
    /// Ends the run after so many steps.
    pub max_frames: Option<usize>,
    /// Ends the run after the current step once it is set.
    pub stop: Arc<AtomicBool>,
}

/// What is known after a step.
pub struct Progress<'a> {
    /// Steps made.
    pub steps: usize,
    /// Steps there will be, where that is known.
    pub total: Option<usize>,
    /// Reports of the last step.
    pub reports: &'a [StepReport],
}

/// Why a run did not come to its end.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// The task is wrong.
    #[error(transparent)]
    Task(#[from] TaskErrors),
    /// A sensor or an output failed.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// A step could not be made.
    #[error("step {step}: {source}")]
    Step {
        /// Index of the step.
        step: usize,
        /// What failed.
        source: StepError,
    },
}

/// Checks and runs a task; `observe` sees every step. Outputs are complete after an interruption and after a failure
/// too.
///
/// # Errors
/// [`RunError`].
pub fn run(
    document: &Document,
    registry: &Registry,
    options: &Options,
    observe: &mut dyn FnMut(&Progress<'_>),
) -> Result<Summary, RunError> {
    let task = check(document, registry)?;
    let mut scene = Scene::build(document, &task, registry)?;
    let mut queue = Queue::default();
    for sensor in &mut scene.sensors {
        queue.waiting.push(sensor.next()?);
    }
    let limit = options.max_frames.unwrap_or(usize::MAX);
    // The frames that wait count too. Sensors that do not run in step need more steps than this.
    let left = scene.sensors.iter().map(|s| s.remaining().map(|n| n + 1)).max().flatten();
    let total = left.map(|n| n.min(limit));
    let first: Vec<Frame> = queue.waiting.iter().flatten().cloned().collect();
    let mut tracking = scene.tracking(document, &task, registry, &first)?;
    let header = Header {
        task: document.name().to_owned(),
        title: task.title.clone(),
        seed: task.seed.into(),
        interrupted: Arc::default(),
    };
    let mut outputs = scene.outputs(document, &task, registry, &options.out, &header)?;
    let mut summary = scene.summary(&task);

    let result = (|| {
        for step in 0..limit {
            if options.stop.load(Ordering::Relaxed) {
                header.interrupted.store(true, Ordering::Relaxed);
                break;
            }
            let Some(frames) = queue.take(&mut scene.sensors)? else { break };
            tracking.step(frames).map_err(|source| RunError::Step { step, source })?;
            let go_on = tracking.with_step(|s| {
                summary.add(s);
                observe(&Progress { steps: step + 1, total, reports: s.reports });
                write(&mut outputs, s)
            })?;
            if !go_on {
                break;
            }
        }
        Ok(())
    })();
    if result.is_err() {
        header.interrupted.store(true, Ordering::Relaxed);
    }
    // All outputs are finished, also when one of them fails.
    let finished = outputs.iter_mut().map(|o| o.finish()).fold(Ok(()), Result::and);
    result.and(finished.map_err(RunError::from))?;
    Ok(summary)
}

/// Gives a step to all outputs; false when one of them ends the run.
fn write(outputs: &mut [Box<dyn Output>], step: &Step<'_>) -> Result<bool, RunError> {
    let mut go_on = true;
    for output in outputs {
        go_on &= output.step(step)?.is_continue();
    }
    Ok(go_on)
}

/// One waiting frame a sensor; those of the earliest time are taken together.
#[derive(Default)]
struct Queue {
    waiting: Vec<Option<Frame>>,
}

impl Queue {
    fn take(&mut self, sensors: &mut [Box<dyn Sensor>]) -> Result<Option<Vec<Frame>>, DeviceError> {
        let Some(now) = self.waiting.iter().flatten().map(|f| f.time).min() else { return Ok(None) };
        let mut frames = vec![];
        for (slot, sensor) in self.waiting.iter_mut().zip(sensors) {
            if slot.as_ref().is_some_and(|f| f.time == now) {
                frames.extend(slot.take());
                *slot = sensor.next()?;
            }
        }
        Ok(Some(frames))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vt_core::frame::{Payload, SensorId};
    use vt_core::time::Timestamp;

    struct Clock(u32, std::vec::IntoIter<i64>);
    impl Sensor for Clock {
        fn next(&mut self) -> Result<Option<Frame>, DeviceError> {
            let payload = Payload::Vector(vec![]);
            Ok(self.1.next().map(|t| Frame {
                sensor: SensorId(self.0),
                number: 0,
                time: Timestamp(t),
                payload,
            }))
        }
    }

    #[test]
    fn frames_of_one_time_go_together_and_time_never_goes_back() {
        let clock = |id, times: Vec<i64>| Box::new(Clock(id, times.into_iter())) as Box<dyn Sensor>;
        let mut sensors = vec![clock(0, vec![0, 10, 20, 30]), clock(1, vec![0, 15, 30])];
        let mut queue = Queue { waiting: sensors.iter_mut().map(|s| s.next().unwrap()).collect() };
        let mut seen = vec![];
        while let Some(frames) = queue.take(&mut sensors).unwrap() {
            seen.push(frames.iter().map(|f| (f.sensor.0, f.time.0)).collect::<Vec<_>>());
        }
        let expected: [&[(u32, i64)]; 5] =
            [&[(0, 0), (1, 0)], &[(0, 10)], &[(1, 15)], &[(0, 20)], &[(0, 30), (1, 30)]];
        assert_eq!(seen, expected);
    }
}
