//! The picture of what stands still.

use vt_core::batch::vectorized;
use vt_core::time::{Seconds, Timestamp};

use super::MotionHistory;
use crate::plane::Plane;

/// For every pixel the last grey level that it had while it had not moved for one duration of a [`MotionHistory`]. Nothing is known of a
/// pixel before that: what stands in the first frames and then goes leaves no hole where it stood. What comes to a stand before what
/// is known becomes part of it only later: people stop to talk.
#[derive(Clone, Debug, Default)]
pub struct StillPicture {
    levels: Plane<u8>,
    /// 255 where the level is known.
    known: Plane<u8>,
    /// Seconds from the first frame to that in which the level was seen last.
    agreed: Plane<f32>,
    /// First frame and the last one.
    times: Option<[Timestamp; 2]>,
}

impl StillPicture {
    /// Takes in a frame whose changes are in the history already. What differs by more than `threshold` from what is known and stands is
    /// taken for it `absorbed` after that was seen last. It starts anew with pictures of another size and when time does not go on.
    pub fn update(
        &mut self,
        frame: &[u8],
        history: &MotionHistory,
        time: Timestamp,
        threshold: u8,
        absorbed: Seconds,
    ) {
        let region = history.stamps().region();
        let same = self.levels.region() == region;
        let (levels, known) = (self.levels.reshape(region), self.known.reshape(region));
        let agreed = self.agreed.reshape(region);
        let first = match self.times {
            Some([first, last]) if same && time > last => first,
            _ => {
                known.fill(0);
                time
            }
        };
        self.times = Some([first, time]);
        if (time - first).0 < f64::from(history.duration()) {
            return;
        }
        let (now, absorbed) = ((time - first).0 as f32, absorbed.0 as f32);
        let stamps = history.stamps().values();
        vectorized(
            #[inline(always)]
            move || {
                let places = frame.iter().zip(stamps).zip(levels).zip(known).zip(agreed);
                for ((((&new, &h), level), known), agreed) in places {
                    let agrees = *known != 0 && new.abs_diff(*level) <= threshold;
                    let old = *known == 0 || now - *agreed > absorbed;
                    let taken = h == 0.0 && (agrees || old);
                    *agreed = if agrees || taken { now } else { *agreed };
                    *level = if taken { new } else { *level };
                    *known = if taken { 255 } else { *known };
                }
            },
        );
    }

    /// Writes 255 to `mask` where a frame differs by more than `threshold` grey levels from what is known, 0 where it does not, and
    /// nothing where nothing is known.
    pub fn compare(&self, frame: &[u8], threshold: u8, mask: &mut [u8]) {
        let (levels, known) = (self.levels.values(), self.known.values());
        vectorized(
            #[inline(always)]
            move || {
                for (((&new, &level), &known), m) in frame.iter().zip(levels).zip(known).zip(mask) {
                    let differs = if new.abs_diff(level) > threshold { 255 } else { 0 };
                    *m = if known != 0 { differs } else { *m };
                }
            },
        );
    }

    /// Grey levels; of no meaning where they are not known.
    pub fn levels(&self) -> &Plane<u8> {
        &self.levels
    }

    /// 255 where the level is known, 0 elsewhere.
    pub fn known(&self) -> &Plane<u8> {
        &self.known
    }
}

#[cfg(test)]
mod tests {
    use vt_core::frame::Roi;

    use super::super::difference;
    use super::*;

    /// A bar of 8 pixels in a row of 100 that goes 2 pixels a frame, from a stand of so many frames.
    fn row(frame: u32, stand: u32) -> Vec<u8> {
        let at = 10 + 2 * frame.saturating_sub(stand);
        (0..100).map(|x| if (at..at + 8).contains(&x) { 30 } else { 100 + (x % 7) as u8 }).collect()
    }

    fn run(frames: u32, stand: u32, absorbed: Seconds) -> (StillPicture, Vec<u8>) {
        let (mut still, mut history, mut changes) =
            (StillPicture::default(), MotionHistory::default(), Plane::default());
        let mut mask = vec![0; 100];
        for k in 0..frames {
            let (now, before) = (row(k, stand), row(k.saturating_sub(1), stand));
            difference(&now, &before, 20, changes.reshape(Roi { x: 0, y: 0, width: 100, height: 1 }));
            let time = Timestamp::from_seconds(0.1 * f64::from(k));
            history.update(&changes, time, Seconds(0.75));
            still.update(&now, &history, time, 20, absorbed);
            mask.fill(7);
            still.compare(&now, 20, &mut mask);
        }
        (still, mask)
    }

    #[test]
    fn what_moves_is_seen_whole_and_leaves_no_hole() {
        let (still, mask) = run(30, 0, Seconds(0.75));
        let at = 10 + 2 * 29;
        for (x, m) in (0u32..).zip(mask) {
            // What it left less than a duration ago is not known.
            let expected = match x {
                _ if (at..at + 8).contains(&x) => 255,
                _ => 0,
            };
            if still.known().get(x, 0) == Some(255) {
                assert_eq!(m, expected, "{x}");
            } else {
                assert_eq!(m, 7, "{x}");
            }
        }
        let known = (0..100).filter(|&x| still.known().get(x, 0) == Some(255)).count();
        assert!(known >= 90, "{known}");
        assert_eq!(still.levels().get(12, 0), Some(100 + 12 % 7));
    }

    #[test]
    fn what_comes_to_a_stand_is_absorbed_late() {
        let stopped = |frames, absorbed| {
            let (mut still, mut history, mut changes) =
                (StillPicture::default(), MotionHistory::default(), Plane::default());
            let mut mask = vec![0; 100];
            // It moves until frame 30 and stands from then on.
            for k in 0..frames {
                let (now, before) = (row(k.min(30), 0), row(k.saturating_sub(1).min(30), 0));
                difference(&now, &before, 20, changes.reshape(Roi { x: 0, y: 0, width: 100, height: 1 }));
                let time = Timestamp::from_seconds(0.1 * f64::from(k));
                history.update(&changes, time, Seconds(0.75));
                still.update(&now, &history, time, 20, absorbed);
                mask.fill(7);
                still.compare(&now, 20, &mut mask);
            }
            mask[(10 + 2 * 30) as usize + 4]
        };
        assert_eq!([31, 36, 60].map(|k| stopped(k, Seconds(0.75))), [255, 255, 0]);
        assert_eq!([31, 60, 120].map(|k| stopped(k, Seconds(5.0))), [255, 255, 0]);
    }

    #[test]
    fn nothing_is_known_before_one_duration_and_after_another_size() {
        let (still, mask) = run(7, 0, Seconds(0.75));
        assert!(still.known().values().iter().all(|&k| k == 0));
        assert!(mask.iter().all(|&m| m == 7));
        let (mut still, _) = run(30, 0, Seconds(0.75));
        still.update(&[1, 2], &MotionHistory::default(), Timestamp(0), 20, Seconds(0.75));
        assert!(still.known().values().is_empty());
        // What stood for a duration is taken for the background, and its place for motion once it goes.
        let (_, mask) = run(20, 15, Seconds(0.75));
        assert_eq!(mask[11], 255);
    }
}
