//! Scripted motion.

use nalgebra::Vector3;
use vt_core::lie::SE3;
use vt_core::manifold::Manifold;
use vt_core::math;

/// Where a body is at any time: world_from_object, where the world is the first camera unless said otherwise.
#[derive(Clone, Debug, PartialEq)]
pub struct Path {
    /// How it moves.
    pub motion: Motion,
    /// Sudden displacements, each with the time in seconds from which on it holds.
    pub jumps: Vec<(f64, Jump)>,
}

/// How a body moves between jumps.
#[derive(Clone, Debug, PartialEq)]
pub enum Motion {
    /// Swings about a pose.
    Smooth(SmoothPath),
    /// Moves and turns evenly.
    Line(Line),
    /// Goes from pose to pose, each with its time in seconds, in order of time; rests before the first and after the last.
    Keys(Vec<(f64, SE3)>),
}

/// A sudden displacement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jump {
    /// Along the axes of the world in metres.
    pub translation: Vector3<f64>,
    /// Rotation vector about the axes of the object in radians.
    pub rotation: Vector3<f64>,
}

/// Even motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// Pose at time 0.
    pub start: SE3,
    /// Along the axes of the world in metres per second.
    pub velocity: Vector3<f64>,
    /// Spin about the axes of the object in radians per second.
    pub spin: Vector3<f64>,
}

impl From<SmoothPath> for Path {
    fn from(path: SmoothPath) -> Self {
        Motion::Smooth(path).into()
    }
}

impl From<Motion> for Path {
    fn from(motion: Motion) -> Self {
        Self { motion, jumps: vec![] }
    }
}

impl Path {
    /// A body that stays where it is.
    pub fn still(pose: SE3) -> Self {
        Motion::Keys(vec![(0.0, pose)]).into()
    }

    /// world_from_object at time `t` in seconds.
    pub fn pose(&self, t: f64) -> SE3 {
        let pose = match &self.motion {
            Motion::Smooth(path) => path.pose(t),
            Motion::Line(line) => moved(&line.start, &(line.velocity * t), &(line.spin * t)),
            Motion::Keys(keys) => between(keys, t),
        };
        let jumps = self.jumps.iter().filter(|(from, _)| *from <= t);
        jumps.fold(pose, |pose, (_, jump)| moved(&pose, &jump.translation, &jump.rotation))
    }
}

/// Moved along the axes of the world, turned about those of the object.
fn moved(pose: &SE3, translation: &Vector3<f64>, rotation: &Vector3<f64>) -> SE3 {
    let turn = SE3::from_rotation_vector(rotation, Vector3::zeros());
    SE3::new(pose.rotation * turn.rotation, pose.translation + translation)
}

/// Along the geodesic between neighbouring keys.
fn between(keys: &[(f64, SE3)], t: f64) -> SE3 {
    let next = keys.partition_point(|(at, _)| *at <= t);
    match (next.checked_sub(1).and_then(|k| keys.get(k)), keys.get(next)) {
        (Some((t0, a)), Some((t1, b))) => a.retract(&(a.local(b) * ((t - t0) / (t1 - t0)))),
        (Some((_, pose)), None) | (None, Some((_, pose))) => *pose,
        (None, None) => SE3::from_rotation_vector(&Vector3::zeros(), Vector3::zeros()),
    }
}

/// Motion about a start pose: each of the six coordinates swings as a sine, all with different periods, so that the
/// path does not repeat soon. The motion sets in from rest within the first tenth of a period.
///
/// The speed of a coordinate never exceeds `amplitude · 2π · 1.5 / period`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SmoothPath {
    /// Pose at time 0.
    pub start: SE3,
    /// Amplitudes along the axes of the world in metres.
    pub translation: [f64; 3],
    /// Amplitudes of the rotation vector about the object's axes in radians.
    pub rotation: [f64; 3],
    /// Period of the first coordinate in seconds; the others lie between 2/3 and 5/3 of it.
    pub period: f64,
}

/// Rates of the coordinates in parts of the first one's.
const RATES: [f64; 6] = [1.0, 1.31, 0.83, 0.71, 1.13, 1.47];

impl SmoothPath {
    /// world_from_object at time `t` in seconds; before 0 it rests at the start.
    pub fn pose(&self, t: f64) -> SE3 {
        // The clock starts slowly: quadratic up to `ease`, then even.
        let (t, ease) = (t.max(0.0), 0.1 * self.period);
        let clock = if t < ease { 0.5 * t * t / ease } else { t - 0.5 * ease };
        let swing = |k: usize| math::sin(core::f64::consts::TAU * RATES[k] * clock / self.period);
        let translation = Vector3::from_fn(|k, _| self.translation[k] * swing(k));
        let rotation = Vector3::from_fn(|k, _| self.rotation[k] * swing(k + 3));
        moved(&self.start, &translation, &rotation)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn start() -> SE3 {
        SE3::from_rotation_vector(&Vector3::new(0.1, 0.2, 0.3), Vector3::new(0.0, 0.1, 0.5))
    }

    #[test]
    fn the_path_starts_at_rest_and_keeps_its_speed() {
        let start = start();
        let path =
            SmoothPath { start, translation: [0.05, 0.02, 0.1], rotation: [0.3, 0.2, 0.1], period: 3.0 };
        assert_eq!(path.pose(0.0), start);
        assert_eq!(path.pose(-1.0), start);
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

    #[test]
    fn keys_are_met_and_what_lies_between_is_on_the_geodesic() {
        let (a, b) = (start(), moved(&start(), &Vector3::new(0.1, 0.0, 0.2), &Vector3::new(0.0, 1.0, 0.0)));
        let path = Path::from(Motion::Keys(vec![(1.0, a), (3.0, b)]));
        let off = |p: SE3, q: SE3| p.local(&q).norm();
        for (t, pose) in [(0.0, a), (1.0, a), (3.0, b), (9.0, b)] {
            assert!(off(path.pose(t), pose) < 1e-12, "{t}");
        }
        assert!((off(a, path.pose(1.5)) - 0.25 * off(a, b)).abs() < 1e-12);
    }

    #[test]
    fn a_jump_holds_from_its_time_on() {
        let jump = Jump { translation: Vector3::new(0.1, 0.0, 0.0), rotation: Vector3::new(0.0, 0.0, 0.5) };
        let mut path = Path::from(Motion::Line(Line {
            start: start(),
            velocity: Vector3::new(0.0, 0.2, 0.0),
            spin: Vector3::new(0.3, 0.0, 0.0),
        }));
        let before = path.pose(2.0);
        assert!((before.translation - start().translation - Vector3::new(0.0, 0.4, 0.0)).norm() < 1e-12);
        path.jumps = vec![(2.0, jump)];
        assert_eq!(path.pose(1.999).translation.x, start().translation.x);
        assert_eq!(path.pose(2.0), moved(&before, &jump.translation, &jump.rotation));
    }
}
