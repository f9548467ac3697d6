//! Motion in front of a camera that stands still: differences of frames, their history, where it moves and what belongs together.

mod difference;
mod gradient;
mod history;
mod segments;
mod still;

pub use difference::{difference, three_frame_difference};
pub use gradient::{Flow, MotionGradient};
pub use history::{MotionHistory, update_history};
pub use segments::{MotionSegment, MotionSegmentation};
pub use still::StillPicture;

use image::GrayImage;
use vt_core::error::{ConfigError, MeasureError};
use vt_core::evidence::{EvidenceKey, Processing, Slot};
use vt_core::frame::{Frame, Roi, SensorId};
use vt_core::time::Seconds;

use crate::color::copy_grey;
use crate::plane::Plane;

/// Which frames are compared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Compared {
    /// The last two: what moved is seen where it is and where it was.
    Two,
    /// The last with each of the two before: what moved is seen where it is.
    #[default]
    Three,
    /// The last with the picture of all that stood still for one duration ([`StillPicture`]): what moved is seen whole, where it is.
    /// Where that is not known yet, the last three.
    Still,
}

/// Parameters of [`MotionProcessing`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionParams {
    /// Grey levels that a pixel must change by more.
    pub threshold: u8,
    /// Which frames are compared.
    pub compared: Compared,
    /// Age at which motion is forgotten.
    pub duration: Seconds,
    /// Time after which what stands before the picture of what stood still is taken for part of it.
    pub absorbed: Seconds,
}

impl Default for MotionParams {
    fn default() -> Self {
        Self { threshold: 25, compared: Compared::default(), duration: Seconds(0.5), absorbed: Seconds(0.5) }
    }
}

impl MotionParams {
    /// Checks the parameters.
    ///
    /// # Errors
    /// [`ConfigError::Parameter`] with the first that is out of its range.
    pub fn check(self) -> Result<Self, ConfigError> {
        for (key, Seconds(v)) in [("duration", self.duration), ("absorbed", self.absorbed)] {
            if !(v > 0.0 && v.is_finite()) {
                return Err(ConfigError::parameter(key, v, "a positive number of seconds"));
            }
        }
        Ok(self)
    }
}

/// What moves in the frames of a sensor. The frames that were processed before are remembered.
#[derive(Clone, Debug, Default)]
pub struct Motion {
    mask: Plane<u8>,
    /// Of two frames, for what stands still.
    changes: Plane<u8>,
    history: MotionHistory,
    still: StillPicture,
    /// Newest first.
    frames: [GrayImage; 3],
    seen: usize,
}

impl Motion {
    /// Takes in a frame.
    ///
    /// # Errors
    /// [`MeasureError::Payload`] for frames that are no picture.
    pub fn compute(&mut self, frame: &Frame, params: &MotionParams) -> Result<(), MeasureError> {
        self.frames.rotate_right(1);
        copy_grey(frame, &mut self.frames[0])?;
        let [now, before, earlier] = &self.frames;
        let (width, height) = now.dimensions();
        if before.dimensions() != now.dimensions() {
            self.seen = 0;
        }
        self.seen = (self.seen + 1).min(3);
        let region = Roi { x: 0, y: 0, width, height };
        let mask = self.mask.reshape(region);
        match params.compared {
            Compared::Two if self.seen >= 2 => difference(now, before, params.threshold, mask),
            Compared::Three | Compared::Still if self.seen >= 3 => {
                three_frame_difference(now, before, earlier, params.threshold, mask);
            }
            _ => mask.fill(0),
        }
        if params.compared == Compared::Still {
            let changes = self.changes.reshape(region);
            difference(now, before, params.threshold, changes);
            self.history.update(&self.changes, frame.time, params.duration);
            self.still.update(now, &self.history, frame.time, params.threshold, params.absorbed);
            self.still.compare(now, params.threshold, self.mask.values_mut());
        } else {
            self.history.update(&self.mask, frame.time, params.duration);
        }
        Ok(())
    }

    /// 255 where the newest frame differs from those before, 0 elsewhere.
    pub fn mask(&self) -> &Plane<u8> {
        &self.mask
    }

    /// What stood still; empty unless frames are compared with it.
    pub fn still(&self) -> &StillPicture {
        &self.still
    }

    /// When pixels moved last.
    pub fn history(&self) -> &MotionHistory {
        &self.history
    }
}

/// Makes a [`Motion`] of the frames of a sensor, always of the whole picture: regions change, history stays.
pub struct MotionProcessing {
    key: EvidenceKey,
    params: MotionParams,
}

impl MotionProcessing {
    /// Motion in the pictures of `sensor`.
    pub fn new(sensor: SensorId, params: MotionParams) -> Self {
        Self { key: Self::key_for(sensor, &params), params }
    }

    /// Key under which the [`Motion`] is found.
    pub fn key_for(sensor: SensorId, params: &MotionParams) -> EvidenceKey {
        let MotionParams { threshold, compared, duration, absorbed } = params;
        let (duration, absorbed) = (duration.0, absorbed.0);
        let name =
            format!("motion/threshold={threshold}/{compared:?}/duration={duration}/absorbed={absorbed}");
        EvidenceKey { sensor, name: name.into() }
    }
}

impl Processing for MotionProcessing {
    fn key(&self) -> &EvidenceKey {
        &self.key
    }

    fn run(&self, frame: &Frame, _: Option<Roi>, slot: &mut Slot) -> Result<(), MeasureError> {
        slot.buffer::<Motion>().compute(frame, &self.params)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Luma;
    use std::sync::Arc;
    use vt_core::frame::Payload;
    use vt_core::time::Timestamp;

    fn frame(number: u64, image: GrayImage) -> Frame {
        let time = Timestamp(40_000_000 * number as i64);
        Frame { sensor: SensorId(0), number, time, payload: Payload::Grey(Arc::new(image)) }
    }

    fn square(at: u32) -> GrayImage {
        GrayImage::from_fn(60, 20, |x, y| {
            let inside = (at..at + 8).contains(&x) && (6..14).contains(&y);
            Luma([if inside { 200 } else { 50 }])
        })
    }

    #[test]
    fn three_frames_show_where_it_is_and_two_where_it_was_too() {
        for (compared, columns) in [(Compared::Two, 20..38), (Compared::Three, 30..38)] {
            let params = MotionParams { compared, ..MotionParams::default() };
            let mut motion = Motion::default();
            for (k, at) in [10, 20, 30].into_iter().enumerate() {
                motion.compute(&frame(k as u64, square(at)), &params).unwrap();
                if k == 0 {
                    assert!(motion.mask().values().iter().all(|&m| m == 0));
                }
            }
            for y in 0..20 {
                for x in 0..60 {
                    let inside = columns.contains(&x) && (6..14).contains(&y) && !(28..30).contains(&x);
                    assert_eq!(motion.mask().get(x, y), Some(if inside { 255 } else { 0 }), "{x} {y}");
                }
            }
            // Nothing moves: no motion, but a history of it; another size starts anew.
            motion.compute(&frame(3, square(30)), &params).unwrap();
            motion.compute(&frame(4, square(30)), &params).unwrap();
            motion.compute(&frame(5, square(30)), &params).unwrap();
            assert!(motion.mask().values().iter().all(|&m| m == 0));
            assert!((motion.history().age(35, 10).unwrap() - 0.12).abs() < 0.041);
            motion.compute(&frame(6, GrayImage::new(9, 9)), &params).unwrap();
            assert_eq!((motion.mask().values().len(), motion.history().age(3, 3)), (81, None));
        }
    }
}
