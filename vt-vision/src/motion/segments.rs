//! Motions apart: everything that a path of falling stamps joins to a newest pixel belongs to one (Bradski and Davis, "Motion
//! segmentation and pose recognition with motion history gradients", 2002).

use vt_core::frame::Roi;

use super::MotionHistory;
use crate::moments::Moments;
use crate::plane::Plane;

/// One motion.
#[derive(Clone, Copy, Debug)]
pub struct MotionSegment {
    /// Smallest rectangle around its pixels.
    pub region: Roi,
    /// Of all its pixels, each with weight one.
    pub moments: Moments,
    /// Of the pixels that move now.
    pub newest: Moments,
}

/// Segments of a motion history.
#[derive(Clone, Debug, Default)]
pub struct MotionSegmentation {
    labels: Plane<u32>,
    segments: Vec<MotionSegment>,
    open: Vec<u32>,
}

impl MotionSegmentation {
    /// Floods from the pixels with the newest stamp, by rows, to neighbours (of eight) whose stamp is older by at most `step` seconds and not
    /// newer; a pixel belongs to the first motion that reaches it. Motions of fewer than `least` pixels are dropped.
    pub fn compute(&mut self, history: &MotionHistory, step: f32, least: u32) {
        let stamps = history.stamps();
        let region = stamps.region();
        let (width, height) = (region.width as usize, region.height as usize);
        let labels = self.labels.reshape(region);
        labels.fill(0);
        self.segments.clear();
        let values = stamps.values();
        for start in 0..values.len() {
            if values[start] != history.now() || labels[start] != 0 {
                continue;
            }
            let label = self.segments.len() as u32 + 1;
            let (mut moments, mut newest) = (Moments::default(), Moments::default());
            let (mut low, mut high) = ([usize::MAX; 2], [0; 2]);
            labels[start] = label;
            self.open.push(start as u32);
            while let Some(at) = self.open.pop() {
                let at = at as usize;
                let (x, y) = (at % width, at / width);
                let here = values[at];
                let place = [f64::from(region.x) + x as f64, f64::from(region.y) + y as f64];
                moments.add(place, 1.0);
                if here == history.now() {
                    newest.add(place, 1.0);
                }
                low = [low[0].min(x), low[1].min(y)];
                high = [high[0].max(x), high[1].max(y)];
                for v in y.saturating_sub(1)..(y + 2).min(height) {
                    for k in v * width + x.saturating_sub(1)..v * width + (x + 2).min(width) {
                        let fall = here - values[k];
                        if values[k] > 0.0 && labels[k] == 0 && fall >= 0.0 && fall <= step {
                            labels[k] = label;
                            self.open.push(k as u32);
                        }
                    }
                }
            }
            let size = [high[0] - low[0] + 1, high[1] - low[1] + 1].map(|n| n as u32);
            let (x, y) = (region.x + low[0] as u32, region.y + low[1] as u32);
            self.segments.push(MotionSegment {
                region: Roi { x, y, width: size[0], height: size[1] },
                moments,
                newest,
            });
        }
        self.segments.retain(|s| s.moments.mass() >= f64::from(least));
    }

    /// The motions in the order of their first newest pixel.
    pub fn segments(&self) -> &[MotionSegment] {
        &self.segments
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vt_core::time::{Seconds, Timestamp};

    #[test]
    fn two_motions_have_their_trails() {
        let (mut history, mut mask) = (MotionHistory::default(), Plane::default());
        for k in 0..6u32 {
            for (p, m) in (0u32..).zip(mask.reshape(Roi { x: 0, y: 0, width: 60, height: 30 }).iter_mut()) {
                let (x, y) = (p % 60, p / 60);
                let right = (2 + 3 * k..5 + 3 * k).contains(&x) && (2..8).contains(&y);
                let left = (55 - 4 * k..59 - 4 * k).contains(&x) && (20..26).contains(&y);
                let speck = k == 5 && (x, y) == (50, 2);
                *m = u8::from(right || left || speck);
            }
            history.update(&mask, Timestamp::from_seconds(0.04 * f64::from(k)), Seconds(1.0));
        }
        let mut motions = MotionSegmentation::default();
        motions.compute(&history, 0.05, 2);
        let regions = [Roi { x: 2, y: 2, width: 18, height: 6 }, Roi { x: 35, y: 20, width: 24, height: 6 }];
        assert_eq!(motions.segments().iter().map(|s| s.region).collect::<Vec<_>>(), regions);
        let newest = motions.segments()[1].newest.centroid().unwrap();
        assert!((newest.x - 36.5).abs() < 1e-9 && (newest.y - 22.5).abs() < 1e-9, "{newest}");
        // Steps shorter than a frame leave the newest layer alone.
        motions.compute(&history, 0.01, 1);
        assert_eq!(motions.segments().len(), 3);
        assert_eq!(motions.segments()[0].region, Roi { x: 17, y: 2, width: 3, height: 6 });
        motions.compute(&MotionHistory::default(), 0.1, 0);
        assert!(motions.segments().is_empty());
    }
}
