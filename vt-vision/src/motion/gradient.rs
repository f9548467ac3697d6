//! Where the motion goes: the gradient of its history points to newer stamps.

use nalgebra::Vector2;
use vt_core::batch::vectorized;
use vt_core::frame::Roi;

use super::MotionHistory;
use crate::plane::{Plane, clip, intersection};

/// Gradient of a motion history, seconds a pixel; zero where it says nothing.
#[derive(Clone, Debug, Default)]
pub struct MotionGradient {
    x: Plane<f32>,
    y: Plane<f32>,
}

/// Common direction of the motion in a region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flow {
    /// Mean of the unit vectors of its pixels, the newer the heavier: the direction, and by its length from 0 to 1 how common it
    /// is.
    pub direction: Vector2<f64>,
    /// Harmonic mean of the speeds along the gradients, pixels per second: stamps come in layers, over which slowness averages.
    pub speed: f64,
    /// Number of pixels that have a direction.
    pub count: usize,
}

impl MotionGradient {
    /// Sobel's mask where all nine pixels have moved, at stamps that differ by `least` to `most` seconds: less is one layer, more
    /// are two motions.
    pub fn compute(&mut self, history: &MotionHistory, roi: Option<Roi>, least: f32, most: f32) {
        let stamps = history.stamps();
        let all = stamps.region();
        let inner = clip(None, (all.width, all.height), 1);
        let inner = Roi { x: all.x + inner.x, y: all.y + inner.y, ..inner };
        let region = intersection(inner, roi.unwrap_or(inner));
        let width = region.width as usize;
        let (x, y) = (self.x.reshape(region), self.y.reshape(region));
        if width == 0 {
            return;
        }
        let lines = x.chunks_exact_mut(width).zip(y.chunks_exact_mut(width));
        for (row, (x, y)) in (region.y..).zip(lines) {
            let wide = Roi { x: region.x - 1, y: row - 1, width: region.width + 2, height: 3 };
            let three = [row - 1, row, row + 1].map(|v| stamps.row(v, wide));
            slopes(three, [least, most], x, y);
        }
    }

    /// Pixels for which the gradient is known.
    pub fn region(&self) -> Roi {
        self.x.region()
    }

    /// Gradient at a pixel, seconds a pixel; the motion along it has the speed `1 / |g|`.
    #[inline]
    pub fn get(&self, x: u32, y: u32) -> Option<Vector2<f32>> {
        let g = Vector2::new(self.x.get(x, y)?, self.y.get(x, y)?);
        (g != Vector2::zeros()).then_some(g)
    }

    /// Common direction of the pixels of a region; none without any. Weights fall from one for what moves now to zero at the age of one
    /// duration.
    pub fn flow(&self, history: &MotionHistory, region: Roi) -> Option<Flow> {
        let part = intersection(self.region(), region);
        let (mut sum, mut weights, mut slowness, mut count) = (Vector2::zeros(), 0.0, 0.0, 0);
        for y in part.y..part.y + part.height {
            let rows = self.x.row(y, part).iter().zip(self.y.row(y, part));
            for ((&gx, &gy), &stamp) in rows.zip(history.stamps().row(y, part)) {
                let g = Vector2::new(f64::from(gx), f64::from(gy));
                let size = g.norm();
                if size > 0.0 {
                    let weight = 1.0 - f64::from((history.now() - stamp) / history.duration());
                    sum += g * (weight / size);
                    slowness += weight * size;
                    weights += weight;
                    count += 1;
                }
            }
        }
        (weights > 0.0).then(|| Flow { direction: sum / weights, speed: weights / slowness, count })
    }
}

/// Gradients along a row of the history, whose rows have one pixel more on both sides.
fn slopes(rows: [&[f32]; 3], [least, most]: [f32; 2], x: &mut [f32], y: &mut [f32]) {
    vectorized(
        #[inline(always)]
        || {
            let n = x.len();
            let [[a0, a1, a2], [b0, b1, b2], [c0, c1, c2]] =
                rows.map(|row| [0, 1, 2].map(|k| &row[k..][..n]));
            let (x, y) = (&mut x[..n], &mut y[..n]);
            for i in 0..n {
                let nine = [a0[i], a1[i], a2[i], b0[i], b1[i], b2[i], c0[i], c1[i], c2[i]];
                let (mut low, mut high) = (nine[0], nine[0]);
                for h in nine {
                    low = if h < low { h } else { low };
                    high = if h > high { h } else { high };
                }
                let valid = (low > 0.0) & (high - low >= least) & (high - low <= most);
                let gx = (nine[2] - nine[0] + 2.0 * (nine[5] - nine[3]) + nine[8] - nine[6]) * 0.125;
                let gy = (nine[6] - nine[0] + 2.0 * (nine[7] - nine[1]) + nine[8] - nine[2]) * 0.125;
                x[i] = if valid { gx } else { 0.0 };
                y[i] = if valid { gy } else { 0.0 };
            }
        },
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use vt_core::time::{Seconds, Timestamp};

    /// A front that sweeps the picture with a velocity in pixels per second.
    fn sweep(velocity: Vector2<f64>) -> MotionHistory {
        let mut history = MotionHistory::default();
        let mut mask = Plane::default();
        for k in 0..40 {
            let front = 0.02 * f64::from(k) * velocity.norm();
            for (p, m) in mask.reshape(Roi { x: 0, y: 0, width: 60, height: 40 }).iter_mut().enumerate() {
                let at = Vector2::new((p % 60) as f64 - 30.0, (p / 60) as f64 - 20.0);
                let along = at.dot(&velocity.normalize()) + 10.0;
                *m = u8::from((front - 5.0..front).contains(&along));
            }
            history.update(&mask, Timestamp::from_seconds(0.02 * f64::from(k)), Seconds(0.6));
        }
        history
    }

    #[test]
    fn the_gradient_is_the_inverse_of_the_velocity() {
        for velocity in [Vector2::new(40.0, 0.0), Vector2::new(-25.0, 30.0), Vector2::new(3.0, -45.0)] {
            let history = sweep(velocity);
            let mut gradient = MotionGradient::default();
            gradient.compute(&history, None, 0.005, 0.3);
            assert_eq!(gradient.region(), Roi { x: 1, y: 1, width: 58, height: 38 });
            let flow = gradient.flow(&history, gradient.region()).unwrap();
            assert!(flow.count > 200, "{flow:?}");
            assert!(flow.direction.norm() > 0.95, "{flow:?}");
            assert!(flow.direction.normalize().dot(&velocity.normalize()) > 0.999, "{flow:?}");
            assert!((flow.speed / velocity.norm() - 1.0).abs() < 0.1, "{flow:?} {velocity}");
            // A region knows what the whole knows.
            let whole = gradient.clone();
            let roi = Roi { x: 20, y: 10, width: 9, height: 7 };
            gradient.compute(&history, Some(roi), 0.005, 0.3);
            assert_eq!(gradient.region(), roi);
            for (x, y) in [(20, 10), (24, 13), (28, 16)] {
                assert_eq!(gradient.get(x, y), whole.get(x, y));
            }
            assert_eq!(gradient.flow(&history, Roi { x: 0, y: 0, width: 3, height: 3 }), None);
        }
        // One layer and two motions say nothing.
        let history = sweep(Vector2::new(40.0, 0.0));
        let mut gradient = MotionGradient::default();
        gradient.compute(&history, None, 0.3, 0.5);
        assert_eq!(gradient.flow(&history, gradient.region()), None);
        gradient.compute(&MotionHistory::default(), None, 0.0, 1.0);
        assert_eq!(gradient.region().width, 0);
    }
}
