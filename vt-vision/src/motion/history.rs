//! Motion-history image with stamps of time (Davis and Bobick, "The representation and recognition of human movement using temporal
//! templates", 1997; Bradski and Davis, 2002): independent of the frame rate.

use vt_core::batch::vectorized;
use vt_core::frame::Roi;
use vt_core::time::{Seconds, Timestamp};

use crate::plane::Plane;

/// `H ← t` where the mask is not zero, `H ← 0` where `H < t − duration`, and `H` stays elsewhere. Zero means no motion.
pub fn update_history(mask: &[u8], history: &mut [f32], stamp: f32, duration: f32) {
    let oldest = stamp - duration;
    vectorized(
        #[inline(always)]
        || {
            for (&m, h) in mask.iter().zip(history) {
                let kept = if *h < oldest { 0.0 } else { *h };
                *h = if m != 0 { stamp } else { kept };
            }
        },
    );
}

/// Numbers with 24 bits tell times of so many durations apart to a ten-thousandth of one.
const LONGEST: f64 = 1024.0;

/// For every pixel when it moved last.
#[derive(Clone, Debug, Default)]
pub struct MotionHistory {
    stamps: Plane<f32>,
    epoch: Timestamp,
    now: f32,
    duration: f32,
}

impl MotionHistory {
    /// Takes in the moving pixels of a frame. History starts anew with another region, another duration, and when time does not
    /// go on.
    pub fn update(&mut self, mask: &Plane<u8>, time: Timestamp, duration: Seconds) {
        let since = (time - self.epoch).0;
        let stamps = self.stamps.reshape(mask.region());
        let same =
            stamps.len() == mask.values().len() && self.now > 0.0 && self.duration == duration.0 as f32;
        if !same || since <= f64::from(self.now) {
            stamps.fill(0.0);
            self.start(time, duration);
        } else if since > LONGEST * duration.0 {
            let back = since - duration.0;
            for h in stamps.iter_mut() {
                *h = (f64::from(*h) - back).max(0.0) as f32;
            }
            self.start(time, duration);
        } else {
            self.now = since as f32;
        }
        update_history(mask.values(), self.stamps.values_mut(), self.now, self.duration);
    }

    /// Puts the epoch one duration before `time`.
    fn start(&mut self, time: Timestamp, duration: Seconds) {
        self.epoch = time + Seconds(-duration.0);
        self.now = duration.0 as f32;
        self.duration = duration.0 as f32;
    }

    /// Seconds from the epoch to the last motion of every pixel; 0 where there was none within the duration.
    pub fn stamps(&self) -> &Plane<f32> {
        &self.stamps
    }

    /// Stamp of the newest frame.
    pub fn now(&self) -> f32 {
        self.now
    }

    /// Age at which motion is forgotten, seconds.
    pub fn duration(&self) -> f32 {
        self.duration
    }

    /// The time that the stamps count from.
    pub fn epoch(&self) -> Timestamp {
        self.epoch
    }

    /// Seconds since a pixel moved; none where it did not within the duration.
    pub fn age(&self, x: u32, y: u32) -> Option<f32> {
        self.stamps.get(x, y).filter(|&h| h > 0.0).map(|h| self.now - h)
    }

    /// How new the motion of the pixels of a region is: 255 now, falling to 1 at the age of one duration; 0 without motion.
    pub fn recency(&self, region: Roi, out: &mut Plane<u8>) {
        let part = crate::plane::intersection(self.stamps.region(), region);
        let (now, scale) = (self.now, 254.0 / self.duration.max(f32::MIN_POSITIVE));
        let rows = out.reshape(part).chunks_exact_mut(part.width.max(1) as usize);
        for (y, out) in (part.y..).zip(rows) {
            for (o, &h) in out.iter_mut().zip(self.stamps.row(y, part)) {
                *o = if h > 0.0 { (255.5 - (now - h) * scale) as u8 } else { 0 };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn ages_are_those_of_the_last_motion(
            masks in prop::collection::vec(prop::collection::vec(0u8..2, 12), 1..30),
            steps in prop::collection::vec(0.001..2.0f64, 30), duration in 0.01..1.0f64, start in -1e6..1e9f64,
        ) {
            let mut history = MotionHistory::default();
            let mut last = [None::<f64>; 12];
            let mut time = 0.0;
            let epoch = (start * 1e9) as i64;
            for (k, mask) in masks.iter().enumerate() {
                // A long pause now and then.
                time += if k % 11 == 10 { 3000.0 } else { steps[k] };
                let mut plane = Plane::default();
                plane.reshape(Roi { x: 0, y: 0, width: 4, height: 3 }).copy_from_slice(mask);
                history.update(&plane, Timestamp(epoch + (time * 1e9) as i64), Seconds(duration));
                for (p, &m) in mask.iter().enumerate() {
                    if m != 0 {
                        last[p] = Some(time);
                    }
                    let age = last[p].map(|l| time - l);
                    let found = history.age(p as u32 % 4, p as u32 / 4);
                    match age {
                        Some(age) if age < 0.999 * duration => {
                            prop_assert!((f64::from(found.unwrap()) - age).abs() < 2e-4 * duration);
                        }
                        Some(age) if age < 1.001 * duration => {}
                        _ => prop_assert_eq!(found, None),
                    }
                }
            }
        }
    }

    #[test]
    fn time_that_goes_back_starts_anew() {
        let mut history = MotionHistory::default();
        let mut mask = Plane::default();
        mask.reshape(Roi { x: 0, y: 0, width: 1, height: 1 }).fill(1);
        history.update(&mask, Timestamp(5_000_000_000), Seconds(1.0));
        mask.values_mut().fill(0);
        history.update(&mask, Timestamp(5_100_000_000), Seconds(1.0));
        assert!((history.age(0, 0).unwrap() - 0.1).abs() < 1e-6);
        let mut recency = Plane::default();
        history.recency(Roi { x: 0, y: 0, width: 9, height: 9 }, &mut recency);
        assert_eq!(recency.values(), [230]);
        history.update(&mask, Timestamp(4_000_000_000), Seconds(1.0));
        assert_eq!(history.age(0, 0), None);
    }
}
