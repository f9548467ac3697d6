//! Smooth scripted motion.

use nalgebra::Vector3;
use vt_core::lie::SE3;
use vt_core::math;

/// Motion about a start pose: each of the six coordinates swings as a sine, all with different periods, so that the
/// path does not repeat soon. The motion sets in from rest within the first tenth of a period.
///
/// The speed of a coordinate never exceeds `amplitude · 2π · 1.5 / period`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SmoothPath {
    /// camera_from_object at time 0.
    pub start: SE3,
    /// Amplitudes along the camera's axes in metres.
    pub translation: [f64; 3],
    /// Amplitudes of the rotation vector about the object's axes in radians.
    pub rotation: [f64; 3],
    /// Period of the first coordinate in seconds; the others lie between 2/3 and 5/3 of it.
    pub period: f64,
}

/// Rates of the coordinates in parts of the first one's.
const RATES: [f64; 6] = [1.0, 1.31, 0.83, 0.71, 1.13, 1.47];

impl SmoothPath {
    /// camera_from_object at time `t` in seconds.
    pub fn pose(&self, t: f64) -> SE3 {
        // The clock starts slowly: quadratic up to `ease`, then even.
        let ease = 0.1 * self.period;
        let clock = if t < ease { 0.5 * t * t / ease } else { t - 0.5 * ease };
        let swing = |k: usize| math::sin(core::f64::consts::TAU * RATES[k] * clock / self.period);
        let moved = Vector3::from_fn(|k, _| self.translation[k] * swing(k));
        let turned = Vector3::from_fn(|k, _| self.rotation[k] * swing(k + 3));
        let turn = SE3::from_rotation_vector(&turned, Vector3::zeros());
        SE3::new(self.start.rotation * turn.rotation, self.start.translation + moved)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_path_starts_at_rest_and_keeps_its_speed() {
        let start = SE3::from_rotation_vector(&Vector3::new(0.1, 0.2, 0.3), Vector3::new(0.0, 0.1, 0.5));
        let path =
            SmoothPath { start, translation: [0.05, 0.02, 0.1], rotation: [0.3, 0.2, 0.1], period: 3.0 };
        assert_eq!(path.pose(0.0), start);
        let h = 1e-4;
        assert!((path.pose(h).translation - start.translation).norm() / h < 1e-3);
        let bound = core::f64::consts::TAU * 1.5 / 3.0;
        for k in 0..10_000 {
            let t = f64::from(k) * 1e-3;
            let v = (path.pose(t + h).translation - path.pose(t).translation) / h;
            for (speed, amplitude) in v.iter().zip(path.translation) {
                assert!(speed.abs() <= amplitude * bound * 1.001);
            }
        }
    }
}
