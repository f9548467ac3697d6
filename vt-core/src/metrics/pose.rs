//! Errors of rigid poses.

use nalgebra::Point3;

use crate::lie::{LieGroup, SE3};

/// Distance of a pose from the truth.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PoseError {
    /// Distance of the translations `‖t - t̂‖` in metres.
    pub translation: f64,
    /// Geodesic angle between the rotations in radians, in `[0, π]`.
    pub rotation: f64,
}

impl PoseError {
    /// Error of `estimate`; both poses lead from the object to the same frame.
    pub fn new(estimate: &SE3, truth: &SE3) -> Self {
        Self {
            translation: (estimate.translation - truth.translation).norm(),
            rotation: truth.inverse().compose(estimate).rotation_vector().norm(),
        }
    }

    /// True below both thresholds (metres, radians), such as "5 cm 5°".
    pub fn within(&self, translation: f64, rotation: f64) -> bool {
        self.translation < translation && self.rotation < rotation
    }
}

/// ADD: mean distance in metres between model points under both poses; `None` without points.
///
/// S. Hinterstoisser et al., "Model based training, detection and pose estimation of texture-less 3D objects in
/// heavily cluttered scenes", 2012.
pub fn add(estimate: &SE3, truth: &SE3, points: &[Point3<f64>]) -> Option<f64> {
    let sum: f64 = points.iter().map(|p| (estimate.act(p) - truth.act(p)).norm()).sum();
    (!points.is_empty()).then(|| sum / points.len() as f64)
}

/// ADD-S, for objects with symmetries: mean distance in metres from each model point under the true pose to the
/// nearest one under the estimate; `None` without points. Compares all pairs: for some thousand points.
pub fn add_s(estimate: &SE3, truth: &SE3, points: &[Point3<f64>]) -> Option<f64> {
    let placed: Vec<_> = points.iter().map(|p| estimate.act(p)).collect();
    let nearest = |p: Point3<f64>| {
        let squared = placed.iter().map(|q| (q - p).norm_squared());
        squared.fold(f64::INFINITY, f64::min).sqrt()
    };
    let sum: f64 = points.iter().map(|p| nearest(truth.act(p))).sum();
    (!points.is_empty()).then(|| sum / points.len() as f64)
}

/// Share of the errors below `threshold`; `None` without errors. A failure counts as an infinite error or NaN.
pub fn share_below(errors: &[f64], threshold: f64) -> Option<f64> {
    let hits = errors.iter().filter(|e| **e < threshold).count();
    (!errors.is_empty()).then(|| hits as f64 / errors.len() as f64)
}

/// Area under the curve of [`share_below`] for thresholds from zero to `largest`, as a share of the whole (ADD-AUC
/// with `largest` = 0.1 m); exact, not sampled. `None` without errors.
pub fn area_under_errors(errors: &[f64], largest: f64) -> Option<f64> {
    // An error e counts for all thresholds in (e, largest].
    let sum: f64 = errors.iter().filter(|e| !e.is_nan()).map(|e| (1.0 - e / largest).clamp(0.0, 1.0)).sum();
    (!errors.is_empty()).then(|| sum / errors.len() as f64)
}

#[cfg(test)]
mod tests {
    use core::f64::consts::PI;

    use nalgebra::{Vector3, Vector6};

    use super::*;

    fn cross() -> Vec<Point3<f64>> {
        vec![
            Point3::new(0.1, 0.0, 0.0),
            Point3::new(-0.1, 0.0, 0.0),
            Point3::new(0.0, 0.1, 0.0),
            Point3::new(0.0, -0.1, 0.0),
        ]
    }

    #[test]
    fn errors_are_distances_and_angles() {
        let truth = SE3::exp(&Vector6::new(0.3, -1.2, 0.7, 0.5, -0.9, 1.1));
        assert_eq!(PoseError::new(&truth, &truth).translation, 0.0);
        assert!(PoseError::new(&truth, &truth).rotation < 1e-15);
        let mut moved = truth;
        moved.translation += Vector3::new(0.03, 0.0, -0.04);
        moved.rotation *= nalgebra::UnitQuaternion::from_axis_angle(&Vector3::y_axis(), 0.2);
        let error = PoseError::new(&moved, &truth);
        assert!((error.translation - 0.05).abs() < 1e-15 && (error.rotation - 0.2).abs() < 1e-14);
        let back = PoseError::new(&truth, &moved);
        assert!((back.translation - 0.05).abs() < 1e-15 && (back.rotation - 0.2).abs() < 1e-14);
        assert!(error.within(0.051, 0.21) && !error.within(0.049, 0.21) && !error.within(0.051, 0.19));
        let turned = truth.compose(&SE3::from_rotation_vector(&Vector3::new(0.0, 0.0, PI), Vector3::zeros()));
        assert!((PoseError::new(&turned, &truth).rotation - PI).abs() < 1e-14);
    }

    #[test]
    fn symmetric_objects_need_the_symmetric_distance() {
        let truth = SE3::exp(&Vector6::new(0.0, 0.0, 1.0, 0.2, 0.0, 0.0));
        let quarter =
            truth.compose(&SE3::from_rotation_vector(&Vector3::new(0.0, 0.0, PI / 2.0), Vector3::zeros()));
        assert!((add(&quarter, &truth, &cross()).expect("points") - 0.1 * 2.0_f64.sqrt()).abs() < 1e-15);
        assert!(add_s(&quarter, &truth, &cross()).expect("points") < 1e-15);
        let mut moved = truth;
        moved.translation.x += 0.01;
        assert!((add(&moved, &truth, &cross()).expect("points") - 0.01).abs() < 1e-15);
        assert!((add_s(&moved, &truth, &cross()).expect("points") - 0.01).abs() < 1e-15);
        assert_eq!((add(&moved, &truth, &[]), add_s(&moved, &truth, &[])), (None, None));
    }

    #[test]
    fn shares_and_areas_count_failures() {
        let errors = [0.0, 0.02, 0.05, f64::INFINITY, f64::NAN];
        assert_eq!(share_below(&errors, 0.05), Some(0.4));
        assert!((area_under_errors(&errors, 0.1).expect("errors") - (1.0 + 0.8 + 0.5) / 5.0).abs() < 1e-15);
        // The area is the integral of the share.
        let n = 100_000;
        let sampled: f64 =
            (0..n).filter_map(|k| share_below(&errors, 0.1 * (f64::from(k) + 0.5) / f64::from(n))).sum();
        assert!((sampled / f64::from(n) - 0.46).abs() < 1e-9);
        assert_eq!((share_below(&[], 1.0), area_under_errors(&[], 1.0)), (None, None));
    }
}
