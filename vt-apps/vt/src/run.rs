//! Running a task: sensors → tracking loop → outputs.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use cpu_time::ProcessTime;
use vt_core::agent::{Output, Sensor, Step};
use vt_core::error::DeviceError;
use vt_core::frame::Frame;
use vt_core::report::StepReport;
use vt_fusion::tracking::StepError;
use vt_io::report::Header;
use vt_io::summary::Summary;
use vt_task::assembly::Scene;
use vt_task::{Document, Registry, Task, TaskErrors, check};

use crate::protocol::{Judge, Protocol, ProtocolError, Score};

/// How a task is run.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Folder for results; made when it is not there.
    pub out: PathBuf,
    /// Ends the run after so many steps.
    pub max_frames: Option<usize>,
    /// Ends the run after the current step once it is set.
    pub stop: Arc<AtomicBool>,
    /// Starts targets at the truth and judges them against it.
    pub protocol: Option<Protocol>,
}

/// What a run gave besides its outputs.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Figures of the run.
    pub summary: Summary,
    /// Time of each tracking step: evidence, measurement, estimate; without reading pictures and without outputs.
    pub times: Vec<StepTime>,
    /// One for each target that the protocol judges.
    pub scores: Vec<Score>,
    /// Whether the run was ended before its time by [`Options::stop`].
    pub interrupted: bool,
}

/// Time of a tracking step in seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepTime {
    /// CPU time of the process, all threads together.
    pub cpu: f64,
    /// Wall-clock time.
    pub wall: f64,
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
    /// A sensor has no good frame.
    #[error(transparent)]
    Sensor(DeviceError),
    /// An output cannot be written.
    #[error(transparent)]
    Output(#[from] DeviceError),
    /// The run cannot be judged.
    #[error(transparent)]
    Protocol(#[from] ProtocolError),
    /// A target could not be put to the true pose.
    #[error("frame {frame}: {source}")]
    Reset {
        /// Number of the frame.
        frame: u64,
        /// What failed.
        source: StepError,
    },
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
) -> Result<Outcome, RunError> {
    let task = check(document, registry)?;
    let mut scene = Scene::build(document, &task, registry)?;
    let mut judges = judges(options.protocol.as_ref(), &task, &mut scene)?;
    let mut queue = Queue::default();
    for sensor in &mut scene.sensors {
        queue.waiting.push(sensor.next().map_err(RunError::Sensor)?);
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
    let mut times = vec![];

    let result = (|| {
        for step in 0..limit {
            if options.stop.load(Ordering::Relaxed) {
                header.interrupted.store(true, Ordering::Relaxed);
                break;
            }
            let Some(frames) = queue.take(&mut scene.sensors).map_err(RunError::Sensor)? else { break };
            let (cpu, wall) = (ProcessTime::now(), Instant::now());
            tracking.step(frames).map_err(|source| RunError::Step { step, source })?;
            times.push(StepTime { cpu: cpu.elapsed().as_secs_f64(), wall: wall.elapsed().as_secs_f64() });
            let go_on = tracking.with_step(|s| {
                summary.add(s);
                observe(&Progress { steps: step + 1, total, reports: s.reports });
                write(&mut outputs, s)
            })?;
            for judge in &mut judges {
                let seen =
                    tracking.with_step(|s| s.reports.get(judge.index).map(|r| (r.frame, judge.see(r))));
                let Some((frame, verdict)) = seen else { continue };
                if let Some(prior) = verdict? {
                    let placed = tracking.place(judge.index, &prior);
                    placed.map_err(|source| RunError::Reset { frame, source })?;
                }
            }
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
    let interrupted = header.interrupted.load(Ordering::Relaxed);
    Ok(Outcome { summary, times, scores: judges.into_iter().map(|j| j.score).collect(), interrupted })
}

/// The judges of a protocol; the targets that they judge will start at the truth.
fn judges(protocol: Option<&Protocol>, task: &Task, scene: &mut Scene) -> Result<Vec<Judge>, RunError> {
    let mut out = vec![];
    let Some(protocol) = protocol else { return Ok(out) };
    for (k, name) in protocol.targets.iter().enumerate() {
        let index = task.targets.iter().position(|t| t.name == *name);
        let index = index.ok_or_else(|| ProtocolError::UnknownTarget {
            name: name.clone(),
            known: task.targets.iter().map(|t| t.name.clone()).collect(),
        })?;
        out.push(Judge::new(protocol, k, index, scene.truths[index].clone().unwrap_or_default())?);
        scene.true_starts[index] = true;
    }
    Ok(out)
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
    /// Why there is no further frame; told when those before it are taken.
    failed: Option<DeviceError>,
}

impl Queue {
    fn take(&mut self, sensors: &mut [Box<dyn Sensor>]) -> Result<Option<Vec<Frame>>, DeviceError> {
        if let Some(e) = self.failed.take() {
            return Err(e);
        }
        let Some(now) = self.waiting.iter().flatten().map(|f| f.time).min() else { return Ok(None) };
        let mut frames = vec![];
        for (slot, sensor) in self.waiting.iter_mut().zip(sensors) {
            if slot.as_ref().is_some_and(|f| f.time == now) {
                frames.extend(slot.take());
                match sensor.next() {
                    Ok(next) => *slot = next,
                    Err(e) => self.failed = Some(e),
                }
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
        let waiting = sensors.iter_mut().map(|s| s.next().unwrap()).collect();
        let mut queue = Queue { waiting, failed: None };
        let mut seen = vec![];
        while let Some(frames) = queue.take(&mut sensors).unwrap() {
            seen.push(frames.iter().map(|f| (f.sensor.0, f.time.0)).collect::<Vec<_>>());
        }
        let expected: [&[(u32, i64)]; 5] =
            [&[(0, 0), (1, 0)], &[(0, 10)], &[(1, 15)], &[(0, 20)], &[(0, 30), (1, 30)]];
        assert_eq!(seen, expected);
    }
}
