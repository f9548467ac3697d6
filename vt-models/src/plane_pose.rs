//! Pose of a plane from its homography: T. Collins, A. Bartoli, "Infinitesimal plane-based pose estimation", 2014 (IPPE).
//!
//! The first derivatives of a homography at one point determine the rotation up to a two-fold ambiguity: the plane may be tilted to
//! either side. Far away or nearly from the front both explain the picture about equally well, hence both are given.

use nalgebra::{Matrix2, Matrix3, Point2, Point3, Rotation3, UnitQuaternion, Vector2, Vector3};
use vt_core::agent::{Posed, Warp};
use vt_core::lie::{LieGroup, SE3};

use crate::camera::Camera;
use crate::homography::fit;
use crate::reprojection::Pair;
use crate::warp::Se3Warp;

/// Two poses that explain a picture of a plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlanePoses {
    /// `camera_from_plane`, the one with the smaller error first; the plane is `z = 0`.
    pub poses: [SE3; 2],
    /// Root mean square of the distances in the picture, in deviations of the pairs. Where the second pose would put points behind
    /// the camera, its error is infinite and the first pose stands in its place.
    pub errors: [f64; 2],
}

impl PlanePoses {
    /// The smaller error as a part of the larger one: near one, the pictures do not tell the poses apart. Above 0.6 to 0.8 something
    /// else must decide, as the pose of the frame before.
    pub fn ambiguity(&self) -> f64 {
        if self.errors[1] > 0.0 { self.errors[0] / self.errors[1] } else { 1.0 }
    }
}

/// Poses of a plane from at least four of its points, metres, seen from either side by a calibrated camera. None where the points do
/// not determine a homography, where a pixel has no ray, or where no pose has all points before the camera.
///
/// A start for [`refine`](crate::reprojection::refine) with [`Se3Warp`], which gives the covariance, too.
pub fn plane_poses(camera: &Camera, pairs: &[Pair<Point2<f64>>]) -> Option<PlanePoses> {
    let count = pairs.len() as f64;
    let centre = pairs.iter().map(|p| p.body.coords).sum::<Vector2<f64>>() / count;
    let focal = 0.5 * (camera.focal().0 + camera.focal().1);
    let normalized = |pair: &Pair<Point2<f64>>| {
        let ray = camera.unproject(&pair.seen).ok()?;
        let seen = Point2::new(ray.x / ray.z, ray.y / ray.z);
        (ray.z > 0.0).then(|| Pair { body: pair.body - centre, seen, deviation: pair.deviation / focal })
    };
    let normalized: Vec<_> = pairs.iter().map(normalized).collect::<Option<_>>()?;
    let rotations = rotations(&fit(normalized.iter())?.matrix)?;
    let warp = Se3Warp::new(*camera);
    let both = rotations.map(|rotation| {
        let translation = translation(&rotation, &normalized)?;
        let about_centre = SE3::new(UnitQuaternion::from_rotation_matrix(&rotation), translation);
        let to_centre = SE3::new(UnitQuaternion::identity(), Vector3::new(-centre.x, -centre.y, 0.0));
        let pose = about_centre.compose(&to_centre);
        let posed = warp.at(&pose);
        let mut sum = 0.0;
        for pair in pairs {
            let y = posed.locate(&Point3::new(pair.body.x, pair.body.y, 0.0))?;
            sum += (pair.seen - y).norm_squared() / (pair.deviation * pair.deviation);
        }
        Some((pose, (sum / count).sqrt()))
    });
    let (first, second) = match both {
        [Some(a), Some(b)] if b.1 < a.1 => (b, a),
        [Some(a), Some(b)] => (a, b),
        // A pose that puts points behind the camera is no rival.
        [Some(a), None] | [None, Some(a)] => (a, (a.0, f64::INFINITY)),
        [None, None] => return None,
    };
    Some(PlanePoses { poses: [first.0, second.0], errors: [first.1, second.1] })
}

/// Both rotations `camera_from_plane` by the first derivatives of a homography from the plane to normalised coordinates, at the
/// plane's origin.
fn rotations(h: &Matrix3<f64>) -> Option<[Rotation3<f64>; 2]> {
    let h = h / h.m33;
    let v = Vector2::new(h.m13, h.m23);
    let jacobian =
        Matrix2::new(h.m11 - h.m31 * v.x, h.m12 - h.m32 * v.x, h.m21 - h.m31 * v.y, h.m22 - h.m32 * v.y);
    // Turns the optical axis to the line of sight.
    let sight = to_sight(&v);
    let s = sight.matrix();
    let projection =
        Matrix2::new(s.m11 - v.x * s.m31, s.m12 - v.x * s.m32, s.m21 - v.y * s.m31, s.m22 - v.y * s.m32);
    let a = projection.try_inverse()? * jacobian;
    // Largest singular value: one over the depth.
    let gram = a.tr_mul(&a);
    let (mean, half) = (0.5 * gram.trace(), 0.5 * (gram.m11 - gram.m22));
    let gamma = (mean + (half * half + gram.m12 * gram.m12).sqrt()).sqrt();
    let upper = a / gamma;
    let missing = Matrix2::identity() - upper.tr_mul(&upper);
    let (x, y) = (missing.m11.max(0.0).sqrt(), missing.m22.max(0.0).sqrt());
    let lower = Vector2::new(x, if missing.m12 < 0.0 { -y } else { y });
    if !lower.iter().chain(upper.iter()).all(|v| v.is_finite()) {
        return None;
    }
    Some([lower, -lower].map(|b| {
        let first = Vector3::new(upper.m11, upper.m21, b.x);
        let second = Vector3::new(upper.m12, upper.m22, b.y);
        // Orthonormal but for what noise has left.
        let first = first.normalize();
        let second = (second - first * first.dot(&second)).normalize();
        let columns = [first, second, first.cross(&second)];
        sight * Rotation3::from_matrix_unchecked(Matrix3::from_columns(&columns))
    }))
}

/// The smallest rotation of the optical axis to the ray `(v, 1)`; by square roots alone, so that bits are the same everywhere.
fn to_sight(v: &Vector2<f64>) -> Rotation3<f64> {
    let u = Vector3::new(v.x, v.y, 1.0).normalize();
    let (x, y) = (u.x / (1.0 + u.z), u.y / (1.0 + u.z));
    Rotation3::from_matrix_unchecked(Matrix3::new(
        1.0 - x * u.x,
        -x * u.y,
        u.x,
        -y * u.x,
        1.0 - y * u.y,
        u.y,
        -u.x,
        -u.y,
        u.z,
    ))
}

/// The translation with the least squares of `t_xy − u t_z = u (R x)_z − (R x)_xy` over all points.
fn translation(rotation: &Rotation3<f64>, pairs: &[Pair<Point2<f64>>]) -> Option<Vector3<f64>> {
    let (mut information, mut gradient) = (Matrix3::zeros(), Vector3::zeros());
    for pair in pairs {
        let turned = rotation * Vector3::new(pair.body.x, pair.body.y, 0.0);
        let weight = 1.0 / (pair.deviation * pair.deviation);
        for (k, u) in [pair.seen.x, pair.seen.y].into_iter().enumerate() {
            let mut row = Vector3::new(0.0, 0.0, -u);
            row[k] = 1.0;
            information += row * row.transpose() * weight;
            gradient += row * (weight * (u * turned.z - turned[k]));
        }
    }
    information.try_inverse().map(|inverse| inverse * gradient)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn camera() -> Camera {
        Camera::new(600.0, 620.0, 320.0, 240.0, 640, 480).unwrap()
    }

    fn pairs(pose: &SE3, points: &[Point2<f64>]) -> Option<Vec<Pair<Point2<f64>>>> {
        let warp = Se3Warp::new(camera());
        let posed = warp.at(pose);
        let pair = |p: &Point2<f64>| {
            let seen = posed.locate(&Point3::new(p.x, p.y, 0.0))?;
            Some(Pair { body: *p, seen, deviation: 1.0 })
        };
        points.iter().map(pair).collect()
    }

    proptest! {
        /// Exact points give the exact pose, and the other one is tilted the other way.
        #[test]
        fn the_true_pose_is_one_of_both(
            turn in prop::array::uniform3(-1.1..1.1f64), behind in any::<bool>(),
            shift in prop::array::uniform2(-0.2..0.2f64), depth in 0.8..3.0f64,
            points in prop::collection::vec(prop::array::uniform2(-0.15..0.15f64), 4..12), origin in prop::array::uniform2(-0.3..0.3f64),
        ) {
            let mut pose = SE3::from_rotation_vector(&turn.into(), Vector3::new(shift[0], shift[1], depth));
            if behind {
                pose.rotation *= UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(0.0, 1.0, 0.0, 0.0));
            }
            let corners = [[-0.15, -0.14], [0.15, -0.15], [0.14, 0.15], [-0.15, 0.15]];
            let origin = Vector2::from(origin);
            let at = |p: &[f64; 2]| Point2::from(*p) + origin;
            let points: Vec<_> = corners.iter().chain(&points).map(at).collect();
            // From either side, but not along it.
            let front = (pose.rotation * Vector3::z()).dot(&(pose.act(&Point3::new(origin.x, origin.y, 0.0)).coords));
            prop_assume!(front.abs() > 0.15);
            let Some(pairs) = pairs(&pose, &points) else { return Ok(()) };
            let found = plane_poses(&camera(), &pairs).unwrap();
            let off = |p: &SE3| pose.inverse().compose(p).log().norm();
            prop_assert!(off(&found.poses[0]) < 1e-4, "{found:?} {pose:?}");
            prop_assert!(found.errors[0] < 1e-3 && found.ambiguity() < 1.0);
        }
    }

    #[test]
    fn far_away_both_explain_the_picture() {
        let points = [[-0.05, -0.05], [0.05, -0.05], [0.05, 0.05], [-0.05, 0.05]].map(Point2::from);
        let at = |depth| {
            let pose =
                SE3::from_rotation_vector(&Vector3::new(0.4, 0.3, 0.0), Vector3::new(0.02, 0.0, depth));
            let mut pairs = pairs(&pose, &points).unwrap();
            for (k, pair) in pairs.iter_mut().enumerate() {
                pair.seen += Vector2::new(0.2, -0.1) * if k % 2 == 0 { 1.0 } else { -1.0 };
            }
            plane_poses(&camera(), &pairs).unwrap().ambiguity()
        };
        assert!(at(0.3) < 0.3 && at(4.0) > 0.5, "{} {}", at(0.3), at(4.0));
    }

    #[test]
    fn what_determines_no_pose_gives_none() {
        let line = [0.0, 0.1, 0.2, 0.3, 0.4].map(|x| Pair {
            body: Point2::new(x, 2.0 * x),
            seen: Point2::new(300.0 + 100.0 * x, 200.0),
            deviation: 1.0,
        });
        assert_eq!(plane_poses(&camera(), &line), None);
        assert_eq!(plane_poses(&camera(), &line[..3]), None);
        assert_eq!(plane_poses(&camera(), &[]), None);
        let nan = [Pair { body: Point2::new(f64::NAN, 0.0), ..line[0] }; 6];
        assert_eq!(plane_poses(&camera(), &nan), None);
    }
}
