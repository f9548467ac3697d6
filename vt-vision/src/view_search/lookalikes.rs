//! Poses that look nearly like a given one: where a search has found one of them, the right one may be another.

use nalgebra::{Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};
use vt_core::lie::SE3;
use vt_core::math;

/// Half turns of the object about its own axes, and for each of its main planes the pose reversed in depth, in which
/// the plane leans to the other side: from far away it looks the same. The `center` stays where it is.
pub fn lookalikes(pose: &SE3, center: &Point3<f64>) -> [SE3; 6] {
    let middle = pose.act(center);
    let rotation = pose.rotation.to_rotation_matrix().into_inner();
    let mirror = |n: Vector3<f64>| Matrix3::identity() - n * n.transpose() * 2.0;
    let sight = middle.coords.try_normalize(0.0).unwrap_or_else(Vector3::z);
    core::array::from_fn(|k| {
        let mut axis = Vector3::zeros();
        axis[k % 3] = 1.0;
        // A mirror on each side, or on one side only turned inside out, makes a rotation.
        let turned = if k < 3 { rotation * -mirror(axis) } else { mirror(sight) * rotation * mirror(axis) };
        let turned = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(turned));
        SE3::new(turned, middle.coords - turned * center.coords)
    })
}

/// Leans of the object by [`LEAN`] out of the picture, in all directions; an alignment that goes astray ends this far from
/// the right pose. The `center` stays where it is.
pub fn neighbours(pose: &SE3, center: &Point3<f64>) -> [SE3; 8] {
    let middle = pose.act(center);
    let sight = UnitQuaternion::rotation_between(&Vector3::z(), &middle.coords).unwrap_or_default();
    core::array::from_fn(|k| {
        let (s, c) = math::sin_cos(k as f64 * core::f64::consts::FRAC_PI_4);
        let lean = UnitQuaternion::from_scaled_axis(sight * Vector3::new(c, s, 0.0) * LEAN);
        let leaned = lean * pose.rotation;
        SE3::new(leaned, middle.coords - leaned * center.coords)
    })
}

/// Angle to [`neighbours`], radians: 12°.
const LEAN: f64 = 0.21;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lookalikes_keep_the_centre_and_what_they_promise() {
        let pose = SE3::from_rotation_vector(&Vector3::new(0.3, -0.5, 0.2), Vector3::new(0.05, -0.02, 9.0));
        let center = Point3::new(0.1, 0.2, 0.3);
        let all = lookalikes(&pose, &center);
        let seen = |pose: &SE3, p: &Point3<f64>| {
            let q = pose.act(p);
            q.xy() / q.z
        };
        for (k, other) in all.iter().enumerate() {
            assert!((other.act(&center) - pose.act(&center)).norm() < 1e-12);
            let mut axis = Vector3::zeros();
            axis[k % 3] = 1.0;
            let turn = pose.rotation.inverse() * other.rotation;
            if k < 3 {
                assert!((turn * axis - axis).norm() < 1e-12, "{k}: about its axis");
                assert!((turn.angle() - core::f64::consts::PI).abs() < 1e-7, "{k}: a half turn");
                continue;
            }
            // A point in the plane through the centre is seen nearly where it was.
            let mut in_plane = Vector3::repeat(0.1);
            in_plane[k % 3] = 0.0;
            let p = center + in_plane;
            let moved = (seen(other, &p) - seen(&pose, &p)).norm();
            assert!(moved < 0.03 * (seen(&pose, &p) - seen(&pose, &center)).norm(), "{k}: {moved}");
        }
    }

    #[test]
    fn neighbours_lean_to_all_sides_about_axes_across_the_line_of_sight() {
        let pose = SE3::from_rotation_vector(&Vector3::new(0.3, -0.5, 0.2), Vector3::new(0.4, -0.2, 1.1));
        let center = Point3::new(0.1, 0.2, 0.3);
        let sight = pose.act(&center).coords.normalize();
        let leans = neighbours(&pose, &center).map(|other| {
            assert!((other.act(&center) - pose.act(&center)).norm() < 1e-12, "the centre stays");
            (other.rotation * pose.rotation.inverse()).scaled_axis()
        });
        for (k, lean) in leans.iter().enumerate() {
            assert!((lean.norm() - LEAN).abs() < 1e-12 && lean.dot(&sight).abs() < 1e-12, "{k}: {lean}");
            assert!(
                (lean.angle(&leans[(k + 1) % 8]) - core::f64::consts::FRAC_PI_4).abs() < 1e-7,
                "{k}: one side"
            );
        }
    }
}
