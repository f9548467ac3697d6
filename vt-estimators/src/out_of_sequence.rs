//! Measurements that arrive late, exactly: the estimator goes back to before the measurement and takes all later ones
//! again.
//!
//! Pictures know when they were taken and arrive when they are ready. With a memory of some steps the result is bit
//! for bit that of the right order, for every estimator. [`crate::retrodiction`] is the cheap approximation.

use std::collections::VecDeque;

use core::marker::PhantomData;

use nalgebra::DefaultAllocator;
use vt_core::agent::Estimator;
use vt_core::belief::Gaussian;
use vt_core::error::EstimateError;
use vt_core::manifold::{Alloc, Manifold};
use vt_core::measurement::Measurement;
use vt_core::report::Innovation;
use vt_core::time::{Seconds, Timestamp};

/// An estimator with a memory of its last measurements and of itself after each.
///
/// Between measurements predictions go from time stamp to time stamp; several measurements of one time are taken in the
/// order of their arrival.
pub struct Replay<P, E, Z> {
    steps: VecDeque<Moment<E, Z>>,
    tail: Vec<Moment<E, Z>>,
    capacity: usize,
    pose: PhantomData<fn() -> P>,
}

/// The estimator after the measurement of a time; the first one has none.
struct Moment<E, Z> {
    time: Timestamp,
    after: E,
    z: Option<Z>,
}

impl<P, E, Z> Replay<P, E, Z>
where
    P: Manifold,
    E: Estimator<P> + Clone,
    Z: Measurement<P>,
    DefaultAllocator: Alloc<P::D>,
{
    /// An estimator whose belief is that of `time`, with a memory of the last `capacity` measurements, at least one.
    pub fn new(estimator: E, time: Timestamp, capacity: usize) -> Self {
        let capacity = capacity.max(1);
        let mut steps = VecDeque::with_capacity(capacity + 2);
        steps.push_back(Moment { time, after: estimator, z: None });
        Self { steps, tail: Vec::with_capacity(capacity + 1), capacity, pose: PhantomData }
    }

    /// The newest time and the estimator then.
    pub fn newest(&self) -> Option<(Timestamp, &E)> {
        self.steps.back().map(|m| (m.time, &m.after))
    }

    /// Time before which measurements come too late.
    pub fn oldest(&self) -> Option<Timestamp> {
        self.steps.front().map(|m| m.time)
    }

    /// Takes in a measurement of `time`, late or not; returns its innovation.
    ///
    /// # Errors
    /// [`EstimateError::TooLate`] when it is older than the memory; errors of the estimator. The memory is then what it was.
    pub fn take(&mut self, time: Timestamp, z: Z) -> Result<Innovation, EstimateError> {
        let after = self.steps.iter().rposition(|m| m.time <= time);
        let Some(after) = after else {
            let oldest = self.oldest().unwrap_or_default();
            return Err(EstimateError::TooLate { seconds: (oldest - time).0 });
        };
        let innovation = self.replay(after, time, &z)?;
        let mut later: VecDeque<_> = self.steps.drain(after + 1..).collect();
        let mut z = Some(z);
        for mut moment in self.tail.drain(..) {
            moment.z = z.take().or_else(|| later.pop_front().and_then(|m| m.z));
            self.steps.push_back(moment);
        }
        while self.steps.len() > self.capacity + 1 {
            self.steps.pop_front();
        }
        Ok(innovation)
    }

    /// The estimator after `z` and after all that came later, into the tail.
    fn replay(&mut self, after: usize, time: Timestamp, z: &Z) -> Result<Innovation, EstimateError> {
        self.tail.clear();
        let mut innovation = None;
        let start = &self.steps[after];
        let (mut now, mut estimator) = (start.time, start.after.clone());
        let later = self.steps.iter().skip(after + 1).filter_map(|m| m.z.as_ref().map(|z| (m.time, z)));
        for (time, z) in core::iter::once((time, z)).chain(later) {
            // Equal times need no prediction: estimators may draw random numbers in it.
            if time > now {
                estimator.predict(time - now)?;
            }
            let one = estimator.correct(z)?;
            innovation.get_or_insert(one);
            now = time;
            self.tail.push(Moment { time, after: estimator.clone(), z: None });
        }
        innovation.ok_or(EstimateError::NotFinite("the measurement"))
    }

    /// The pose with its covariance at any time from the newest measurement on, without taking it in.
    ///
    /// # Errors
    /// Those of the estimator's prediction; [`EstimateError::TooLate`] for earlier times.
    pub fn pose_at(&self, time: Timestamp) -> Result<Gaussian<P>, EstimateError> {
        let (newest, estimator) = self.newest().ok_or(EstimateError::NoParticles)?;
        let ahead: Seconds = time - newest;
        if ahead.0 < 0.0 {
            return Err(EstimateError::TooLate { seconds: -ahead.0 });
        }
        let mut estimator = estimator.clone();
        if ahead.0 > 0.0 {
            estimator.predict(ahead)?;
        }
        Ok(estimator.pose())
    }
}
