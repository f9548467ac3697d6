//! Model-free evidence: what image processing makes of a frame, once, for all targets and modalities that ask.

use core::any::{Any, type_name};
use std::sync::Arc;

use crate::error::MeasureError;
use crate::frame::{Frame, Roi, SensorId};

/// Name of a piece of evidence: what was computed, with which parameters, on which sensor's frame.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct EvidenceKey {
    /// Sensor whose frame is processed.
    pub sensor: SensorId,
    /// Name with parameters, such as `gradient/sigma=1.0`; equal names mean equal results.
    pub name: Arc<str>,
}

/// Where a piece of evidence lives. Host and device buffers are different states and are never mixed silently.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Residency {
    /// In main memory.
    #[default]
    Host,
    /// On an accelerator.
    Device,
}

/// Storage of one piece of evidence; the buffer inside is used again frame after frame.
#[derive(Default)]
pub struct Slot {
    value: Option<Box<dyn Any + Send + Sync>>,
    /// Where the value lives.
    pub residency: Residency,
}

impl Slot {
    /// The buffer of the frame before, or a fresh one.
    pub fn buffer<T: Any + Send + Sync + Default>(&mut self) -> &mut T {
        if !self.value.as_ref().is_some_and(|v| v.is::<T>()) {
            self.value = Some(Box::<T>::default());
        }
        match self.value.as_mut().and_then(|v| v.downcast_mut()) {
            Some(buffer) => buffer,
            None => unreachable!("a value of this type was put there just above"),
        }
    }

    fn get<T: Any>(&self) -> Option<&T> {
        self.value.as_ref().and_then(|v| v.downcast_ref())
    }
}

/// A step of image processing that knows no model (paper §5.1, left column of Fig. 4).
pub trait Processing: Send + Sync {
    /// Name of what this makes.
    fn key(&self) -> &EvidenceKey;

    /// Processes the frame, inside `roi` only when one is given, into the buffer of `slot`.
    fn run(&self, frame: &Frame, roi: Option<Roi>, slot: &mut Slot) -> Result<(), MeasureError>;
}

/// All frames and evidence of one step.
#[derive(Default)]
pub struct Evidence {
    frames: Vec<Frame>,
    units: Vec<Unit>,
}

/// A processing unit with what it made.
struct Unit {
    processing: Box<dyn Processing>,
    slot: Slot,
    state: State,
}

impl Unit {
    fn run(&mut self, frame: &Frame, roi: Option<Roi>) {
        let outcome = self.processing.run(frame, roi, &mut self.slot);
        self.state = outcome.map_or_else(State::Failed, |()| State::Fresh);
    }
}

/// Units of a step that are still to run; see [`Evidence::pending`].
pub struct Pending<'a> {
    frames: &'a [Frame],
    requests: &'a [(EvidenceKey, Option<Roi>)],
    units: &'a mut [Unit],
}

impl<'a> Pending<'a> {
    fn job(&self, unit: &Unit) -> Option<(&'a Frame, Option<Roi>)> {
        let key = unit.processing.key();
        let (_, roi) = self.requests.iter().find(|(wanted, _)| wanted == key)?;
        let frame = Evidence::find(self.frames, key.sensor).ok()?;
        matches!(unit.state, State::Stale).then_some((frame, *roi))
    }

    /// Number of units to run.
    pub fn count(&self) -> usize {
        self.units.iter().filter(|unit| self.job(unit).is_some()).count()
    }

    /// Two parts with about half of the units each.
    pub fn split(self) -> (Self, Self) {
        let half = self.count() / 2;
        let mut seen = 0;
        let at = self.units.iter().position(|unit| {
            seen += usize::from(self.job(unit).is_some());
            seen > half
        });
        let (left, right) = self.units.split_at_mut(at.unwrap_or(0));
        (Self { units: left, ..self }, Self { units: right, ..self })
    }

    /// Runs them one after the other.
    pub fn run(self) {
        let Self { frames, requests, units } = self;
        for unit in units {
            let job = Pending { frames, requests, units: &mut [] }.job(unit);
            if let Some((frame, roi)) = job {
                unit.run(frame, roi);
            }
        }
    }
}

/// State of a piece of evidence in this step.
enum State {
    Stale,
    Fresh,
    Failed(MeasureError),
}

impl Evidence {
    /// Adds a processing unit; one with the key of an earlier unit is dropped, since it would make the same.
    pub fn add(&mut self, unit: Box<dyn Processing>) {
        if !self.units.iter().any(|u| u.processing.key() == unit.key()) {
            self.units.push(Unit { processing: unit, slot: Slot::default(), state: State::Stale });
        }
    }

    /// Starts a step: these frames replace those of the step before, all evidence is out of date.
    pub fn begin(&mut self, frames: impl IntoIterator<Item = Frame>) {
        self.frames.clear();
        self.frames.extend(frames);
        for unit in &mut self.units {
            unit.state = State::Stale;
        }
    }

    /// Computes what is asked for and out of date. A failure is kept, too: whoever reads the evidence gets it.
    ///
    /// # Errors
    /// Those of the processing units; a missing frame or unit.
    pub fn prepare(&mut self, key: &EvidenceKey, roi: Option<Roi>) -> Result<(), MeasureError> {
        let frame = Self::find(&self.frames, key.sensor)?;
        let unit = self.units.iter_mut().find(|u| u.processing.key() == key).ok_or_else(|| missing(key))?;
        if matches!(unit.state, State::Stale) {
            unit.run(frame, roi);
        }
        match &unit.state {
            State::Failed(e) => Err(e.clone()),
            _ => Ok(()),
        }
    }

    /// What of `requests` (each key once) is out of date and has a frame: units that do not depend on each other, to be
    /// run in any order or at the same time. What cannot be made fails where it is read.
    pub fn pending<'a>(&'a mut self, requests: &'a [(EvidenceKey, Option<Roi>)]) -> Pending<'a> {
        Pending { frames: &self.frames, requests, units: &mut self.units }
    }

    /// The frame of a sensor.
    ///
    /// # Errors
    /// [`MeasureError::MissingFrame`].
    pub fn frame(&self, sensor: SensorId) -> Result<&Frame, MeasureError> {
        Self::find(&self.frames, sensor)
    }

    /// All frames of this step.
    pub fn frames(&self) -> &[Frame] {
        &self.frames
    }

    /// Evidence made in this step.
    ///
    /// # Errors
    /// [`MeasureError::MissingEvidence`] when it was not prepared, [`MeasureError::EvidenceType`] when it is no `T`, and
    /// what kept it from being made.
    pub fn get<T: Any>(&self, key: &EvidenceKey) -> Result<&T, MeasureError> {
        let unit = self.units.iter().find(|u| u.processing.key() == key).ok_or_else(|| missing(key))?;
        match &unit.state {
            State::Stale => Err(missing(key)),
            State::Failed(e) => Err(e.clone()),
            State::Fresh => unit.slot.get().ok_or_else(|| MeasureError::EvidenceType {
                key: key.name.clone(),
                expected: type_name::<T>(),
            }),
        }
    }

    fn find(frames: &[Frame], sensor: SensorId) -> Result<&Frame, MeasureError> {
        frames.iter().find(|f| f.sensor == sensor).ok_or(MeasureError::MissingFrame { sensor: sensor.0 })
    }
}

fn missing(key: &EvidenceKey) -> MeasureError {
    MeasureError::MissingEvidence { key: key.name.clone(), sensor: key.sensor.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::Payload;
    use crate::time::Timestamp;
    use std::sync::Arc;
    use std::sync::atomic::{AtomicUsize, Ordering};

    struct Sum(EvidenceKey, Arc<AtomicUsize>);
    impl Processing for Sum {
        fn key(&self) -> &EvidenceKey {
            &self.0
        }
        fn run(&self, frame: &Frame, _: Option<Roi>, slot: &mut Slot) -> Result<(), MeasureError> {
            self.1.fetch_add(1, Ordering::Relaxed);
            *slot.buffer::<f64>() = frame.vector()?.iter().sum();
            Ok(())
        }
    }

    fn frame(sensor: u32, v: Vec<f64>) -> Frame {
        Frame { sensor: SensorId(sensor), number: 0, time: Timestamp(0), payload: Payload::Vector(v) }
    }

    #[test]
    fn evidence_is_computed_once_a_step_and_never_stale() {
        let runs = Arc::new(AtomicUsize::new(0));
        let key = EvidenceKey { sensor: SensorId(0), name: "sum".into() };
        let mut ev = Evidence::default();
        ev.add(Box::new(Sum(key.clone(), runs.clone())));
        ev.add(Box::new(Sum(key.clone(), runs.clone())));
        ev.begin([frame(0, vec![1.0, 2.0])]);
        assert!(matches!(ev.get::<f64>(&key), Err(MeasureError::MissingEvidence { .. })));
        ev.prepare(&key, None).unwrap();
        ev.prepare(&key, None).unwrap();
        assert_eq!((runs.load(Ordering::Relaxed), *ev.get::<f64>(&key).unwrap()), (1, 3.0));
        assert!(matches!(ev.get::<u8>(&key), Err(MeasureError::EvidenceType { .. })));
        ev.begin([frame(0, vec![5.0])]);
        assert!(ev.get::<f64>(&key).is_err());
        ev.prepare(&key, None).unwrap();
        assert_eq!(*ev.get::<f64>(&key).unwrap(), 5.0);
    }

    #[test]
    fn pending_units_can_be_split_in_any_way() {
        let runs = Arc::new(AtomicUsize::new(0));
        let key = |k: u32| EvidenceKey { sensor: SensorId(k % 2), name: format!("sum {k}").into() };
        let mut ev = Evidence::default();
        (0..7).for_each(|k| ev.add(Box::new(Sum(key(k), runs.clone()))));
        // Not of unit 3, and of a sensor without a frame and a unit that is not there in vain.
        let requests: Vec<_> = [0, 1, 2, 4, 6, 8].map(|k| (key(k), None)).into();
        ev.begin([frame(0, vec![1.0, 2.0])]);
        ev.prepare(&key(2), None).unwrap();
        let pending = ev.pending(&requests);
        assert_eq!(pending.count(), 3);
        let (left, right) = pending.split();
        assert_eq!((left.count(), right.count()), (1, 2));
        right.run();
        let (none, one) = left.split();
        assert_eq!((none.count(), one.count()), (0, 1));
        one.run();
        assert_eq!(runs.load(Ordering::Relaxed), 4);
        assert_eq!(ev.pending(&requests).count(), 0);
        assert!([0, 2, 4, 6].iter().all(|k| *ev.get::<f64>(&key(*k)).unwrap() == 3.0));
        assert!([1, 3, 5, 8].iter().all(|k| ev.get::<f64>(&key(*k)).is_err()));
    }

    #[test]
    fn missing_frames_and_units_are_named() {
        let mut ev = Evidence::default();
        ev.begin([frame(0, vec![])]);
        let other = EvidenceKey { sensor: SensorId(3), name: "sum".into() };
        assert_eq!(ev.prepare(&other, None), Err(MeasureError::MissingFrame { sensor: 3 }));
        let key = EvidenceKey { sensor: SensorId(0), name: "edges".into() };
        assert!(ev.prepare(&key, None).unwrap_err().to_string().contains("edges"));
    }
}
