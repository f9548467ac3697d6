//! Facts that the law harness does not state: known values, angles near π, drift, conversions.

use core::f64::consts::PI;

use nalgebra::{
    Isometry3, Matrix3, Matrix4, Matrix6, Point3, SMatrix, SVector, UnitQuaternion, Vector3, Vector6,
};

use super::*;
use crate::manifold::{Coordinates, Manifold};
use crate::math;

/// Some motion with all coordinates different.
fn some() -> SE3 {
    SE3::exp(&Vector6::new(0.3, -1.2, 0.7, 0.5, -0.9, 1.1))
}

#[test]
fn series_and_closed_forms_meet() {
    for n in 1..200 {
        let x = f64::from(n) * 0.05;
        let [c0, c1, c2, c3] = series::stumpff(x);
        let [c4, c5] = series::stumpff_high(x);
        let a = x.sqrt();
        assert!((c0 - math::cos(a)).abs() < 4e-16 && (c1 - math::sin(a) / a).abs() < 4e-16, "{x}");
        // c_n = 1/n! - x c_{n+2}
        assert!((c0 - (1.0 - x * c2)).abs() < 1e-15 && (c1 - (1.0 - x * c3)).abs() < 1e-15, "{x}");
        assert!((c2 - (0.5 - x * c4)).abs() < 1e-15 && (c3 - (1.0 / 6.0 - x * c5)).abs() < 1e-15, "{x}");
        // An independent series with all its terms.
        let direct = [(4.0, 1.0 / 24.0), (5.0, 1.0 / 120.0)].map(|(n, first)| {
            let (mut sum, mut term) = (0.0, first);
            for k in 0..40 {
                sum += term;
                let m = n + 2.0 * f64::from(k);
                term *= -x / ((m + 1.0) * (m + 2.0));
            }
            sum
        });
        assert!((c4 / direct[0] - 1.0).abs() < 1e-13 && (c5 / direct[1] - 1.0).abs() < 1e-12, "{x}");
    }
}

#[test]
fn a_quarter_turn_has_known_numbers() {
    // A screw with unit pitch per radian: V(π/2 z) moves along x by 2/π and along y by 2/π.
    let m = SE3::exp(&Vector6::new(1.0, 0.0, 0.5, 0.0, 0.0, PI / 2.0));
    assert!((m.translation - Vector3::new(2.0 / PI, 2.0 / PI, 0.5)).norm() < 1e-15);
    assert!((m.act(&Point3::new(1.0, 0.0, 0.0)) - Point3::new(2.0 / PI, 1.0 + 2.0 / PI, 0.5)).norm() < 1e-15);
    // Growth by e while moving: t = v (e - 1).
    let s = Sim3::exp(&SVector::from([1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0]));
    assert!((s.translation - Vector3::new(1.0, 2.0, 3.0) * math::exp_m1(1.0)).norm() < 1e-14);
}

#[test]
fn rotations_near_half_a_turn_have_the_right_logarithm() {
    let axis = Vector3::new(0.48, -0.6, 0.64);
    for angle in [PI - 1e-3, PI - 1e-9, PI, PI + 1e-9, PI + 1e-3, -PI + 1e-9] {
        let w = SO3::exp(&(axis * angle)).log();
        let expected = if angle > PI { axis * (angle - 2.0 * PI) } else { axis * angle };
        let error = (w - expected).norm().min(if (angle.abs() - PI).abs() < 1e-15 {
            (w + expected).norm()
        } else {
            9.0
        });
        assert!(error < 1e-14, "{angle}: {w}");
        let full = SE3::exp(&Vector6::new(1.0, 2.0, 3.0, w.x, w.y, w.z));
        assert!((full.log() - Vector6::new(1.0, 2.0, 3.0, w.x, w.y, w.z)).norm() < 1e-13, "{angle}");
    }
    assert_eq!(
        SO3 { rotation: UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(-1.0, 0.0, 0.0, 0.0)) }.log(),
        Vector3::zeros()
    );
}

#[test]
fn jacobians_equal_the_series_of_the_bracket() {
    // ad of SE(3) by definition: columns are brackets with unit vectors.
    for d in [Vector6::new(0.4, -2.0, 1.0, 0.7, 1.9, -1.4), Vector6::new(3.0, 1.0, -2.0, 1e-5, -2e-5, 1e-5)] {
        let (v, w) = (
            series::cross(&d.fixed_rows::<3>(0).into_owned()),
            series::cross(&d.fixed_rows::<3>(3).into_owned()),
        );
        let mut ad = Matrix6::zeros();
        ad.fixed_view_mut::<3, 3>(0, 0).copy_from(&w);
        ad.fixed_view_mut::<3, 3>(0, 3).copy_from(&v);
        ad.fixed_view_mut::<3, 3>(3, 3).copy_from(&w);
        assert!((SE3::left_jacobian(&d) - sim3::phi(&ad)).amax() < 1e-14);
        assert!(
            (SE3::left_jacobian(&d) * SE3::left_jacobian_inverse(&d) - Matrix6::identity()).amax() < 1e-13
        );
    }
    for s in [1e-12, 1e-9, 1e-4, 0.3, 1.2] {
        for d in [
            [0.4, -2.0, 1.0, 0.7, 1.9, -1.4, 1.0],
            [0.4, -2.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            [1.0, 2.0, 3.0, 1.0, 0.5, 0.1, 0.0],
        ] {
            let mut d = SVector::<f64, 7>::from(d);
            d.rows_mut(3, 4).scale_mut(s);
            let product = Sim3::left_jacobian(&d) * Sim3::left_jacobian_inverse(&d);
            assert!((product - SMatrix::<f64, 7, 7>::identity()).amax() < 1e-12, "{d}");
            assert!((Sim3::exp(&d).log() - d).amax() < 1e-13, "{d}");
        }
    }
}

#[test]
fn similarities_of_scale_one_are_rigid_motions() {
    let d = Vector6::new(0.3, -1.2, 0.7, 0.5, -0.9, 1.1);
    let s = Sim3::exp(&SVector::<f64, 7>::from_fn(|k, _| if k < 6 { d[k] } else { 0.0 }));
    let m = SE3::exp(&d);
    assert!((s.translation - m.translation).norm() < 1e-15 && s.scale == 1.0);
    let j = Sim3::left_jacobian(&SVector::<f64, 7>::from_fn(|k, _| if k < 6 { d[k] } else { 0.0 }));
    assert!((j.fixed_view::<6, 6>(0, 0) - SE3::left_jacobian(&d)).amax() < 1e-14);
}

#[test]
fn a_million_products_do_not_drift() {
    let step = SE3::exp(&Vector6::new(0.01, 0.02, -0.01, 0.3, -0.2, 0.1));
    let plane = SE2::new(0.1, 0.2, 0.3);
    let (mut m, mut p): (SE3, SE2) = (SE3::identity(), SE2::identity());
    for _ in 0..1_000_000 {
        m = m.compose(&step);
        p = p.compose(&plane);
    }
    assert!((m.rotation.norm() - 1.0).abs() < 1e-14, "{}", m.rotation.norm());
    assert!((p.rotation.norm() - 1.0).abs() < 1e-14);
    // The same from the closed form: a million steps along one screw.
    let turns = SO3::exp(&(Vector3::new(0.3, -0.2, 0.1) * 1e6));
    assert!(turns.rotation.angle_to(&m.rotation) < 1e-8);
}

#[test]
fn coordinates_are_canonical_and_refuse_nonsense() {
    let mut m = some();
    m.rotation = UnitQuaternion::new_unchecked(-m.rotation.into_inner());
    let mut c = vec![];
    m.write(&mut c);
    assert!(c[6] >= 0.0);
    assert!(SE3::read(&c).is_some_and(|r| m.local(&r).norm() < 1e-15));
    let tripled: Vec<f64> = c.iter().enumerate().map(|(k, v)| if k < 3 { *v } else { 3.0 * v }).collect();
    assert!(SE3::read(&tripled).is_some_and(|r| m.local(&r).norm() < 1e-15));
    for bad in [&c[..6], &[0.0; 7], &[0.0, 0.0, f64::NAN, 0.0, 0.0, 0.0, 1.0], &[0.0; 8]] {
        assert_eq!(SE3::read(bad), None);
    }
    // Neither tiny nor huge quaternions under- or overflow.
    for f in [1e-200, 1e300] {
        assert_eq!(
            SE3::read(&[1.0, 2.0, 3.0, 0.0, 0.0, 0.0, f]),
            SE3::read(&[1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0])
        );
    }
    assert_eq!(Sim3::read(&[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, -2.0]), None);
    assert_eq!(Vector::<2>::read(&[1.0]), None);
    assert_eq!(DynVector::read(&[1.0, f64::INFINITY]), None);
    let mut out = vec![];
    SE2::new(1.0, 2.0, -3.0).write(&mut out);
    assert!(SE2::read(&out).is_some_and(|r| (r.angle() + 3.0).abs() < 1e-15));
}

#[test]
fn matrices_go_in_and_out() {
    let m = some();
    assert!(SE3::from_matrix(&m.to_matrix(), 1e-12).is_ok_and(|r| m.local(&r).norm() < 1e-14));
    let rounded = m.to_matrix().map(|v| (v * 1e6).round() / 1e6);
    assert!(SE3::from_matrix(&rounded, 1e-9).is_err());
    let read = SE3::from_matrix(&rounded, 1e-5).expect("nearly a rotation");
    assert!(m.local(&read).norm() < 2e-6 && (read.rotation.norm() - 1.0).abs() < 1e-15);
    // Half turns, where quaternions from the trace fail.
    for axis in [Vector3::x(), Vector3::y(), Vector3::z(), Vector3::new(0.6, 0.0, 0.8)] {
        let m = SE3::from_rotation_vector(&(axis * PI), Vector3::zeros());
        assert!(
            SE3::from_matrix(&m.to_matrix(), 1e-12).is_ok_and(|r| m.rotation.angle_to(&r.rotation) < 1e-14)
        );
    }
    let mut mirror = Matrix4::identity();
    mirror[(2, 2)] = -1.0;
    assert!(SE3::from_matrix(&mirror, 1e-3).is_err_and(|e| e.to_string().contains("rotation")));
    let mut perspective = Matrix4::identity();
    perspective[(3, 0)] = 0.5;
    assert!(SE3::from_matrix(&perspective, 1e-3).is_err_and(|e| e.to_string().contains("last row")));
    assert!(SE3::from_matrix(&Matrix4::from_element(f64::NAN), 1.0).is_err());
    assert!(SE3::from_matrix(&(Matrix4::identity() * 0.0), 1e-3).is_err());
    let iso: Isometry3<f64> = m.into();
    assert_eq!(SE3::from(iso), m);
    let p = Point3::new(0.1, 0.2, 0.3);
    assert!((iso * p - m * p).norm() < 1e-15);
    assert!(((m * m) * p - m * (m * p)).norm() < 1e-15);
}

#[test]
fn the_mean_of_opposite_poses_is_the_middle() {
    let d = Vector6::new(0.1, 0.2, 0.3, 0.4, -0.2, 0.1);
    let (a, b) = (some().retract(&d), some().retract(&-d));
    let mean = SE3::mean(&[a, b], &[2.0, 2.0]).expect("positive weights");
    assert!(mean.local(&some()).norm() < 1e-12);
    assert!(SE3::mean(&[a, b], &[0.0, 0.0]).is_none());
}

#[test]
fn a_free_base_with_joints_is_one_manifold() {
    let x = Product { first: some(), second: DynVector(nalgebra::DVector::from_column_slice(&[0.1, 0.2])) };
    let mut d = x.zero();
    assert_eq!(d.len(), 8);
    d[0] = 0.5;
    d[7] = -1.0;
    let y = x.retract(&d);
    assert!((x.local(&y) - d).norm() < 1e-15);
    assert_eq!(x.blocks().iter().map(|b| b.1).sum::<usize>(), 8);
}

#[test]
fn the_rotation_matrix_is_the_exponential_of_the_cross_product() {
    let w = Vector3::new(0.4, -0.3, 0.8);
    let r = SO3::exp(&w).adjoint();
    let k = series::cross(&w);
    assert!((r - (Matrix3::identity() + k * sim3::phi(&k))).amax() < 1e-15);
}

#[test]
fn planar_groups_hold_each_other() {
    // The first coordinates of the larger group are those of the smaller one.
    let d = [30.0, -20.0, 0.4, 0.3];
    let similarity = Sim2::exp(&d.into());
    let affine = Affine2::exp(&SVector::from([d[0], d[1], d[2], d[3], 0.0, 0.0]));
    let homography = SL3::exp(&SVector::from([d[0], d[1], d[2], d[3], 0.0, 0.0, 0.0, 0.0]));
    let rigid = SE2::exp(&Vector3::new(d[0], d[1], d[2]));
    let growing = TranslationScale::exp(&Vector3::new(d[0], d[1], d[3]));
    assert!((similarity.matrix() - affine.matrix).amax() < 1e-12);
    assert!((homography.matrix / homography.matrix.m33 - affine.matrix).amax() < 1e-12);
    assert!((Sim2::exp(&[d[0], d[1], d[2], 0.0].into()).matrix() - rigid.matrix()).amax() < 1e-13);
    assert!((Sim2::exp(&[d[0], d[1], 0.0, d[3]].into()).matrix() - growing.matrix()).amax() < 1e-13);
    // Far in the picture the logarithm is still good.
    assert!((affine.log() - SVector::from([d[0], d[1], d[2], d[3], 0.0, 0.0])).amax() < 1e-10);
    assert!((homography.log().fixed_rows::<4>(0) - SVector::from(d)).amax() < 1e-10);
    // A quarter of growth by e while turning by a quarter: the end of a logarithmic spiral.
    let end = similarity.act(&nalgebra::Point2::new(1.0, 0.0)) - similarity.act(&nalgebra::Point2::origin());
    assert!((end.norm() - math::exp(0.3)).abs() < 1e-13 && (math::atan2(end.y, end.x) - 0.4).abs() < 1e-13);
}

#[test]
fn maps_without_a_logarithm_have_no_finite_one() {
    let stretched_half_turn = Affine2::from_rows([-2.0, 0.0, 0.0], [0.0, -0.5, 0.0]).expect("no mirror");
    assert!(stretched_half_turn.log().iter().all(|v| !v.is_finite()));
    assert!(stretched_half_turn.is_finite());
    assert_eq!(Affine2::from_rows([1.0, 0.0, 0.0], [0.0, -1.0, 0.0]), None);
    assert_eq!(SL3::from_matrix(&Matrix3::zeros()), None);
}

#[test]
fn a_homography_is_known_by_four_points() {
    let corners = [[0.0, 0.0], [100.0, 0.0], [100.0, 60.0], [0.0, 60.0]].map(nalgebra::Point2::from);
    let image = [[12.0, 5.0], [90.0, 20.0], [120.0, 88.0], [-10.0, 70.0]].map(nalgebra::Point2::from);
    let found = SL3::from_points(&corners, &image).expect("no three on a line");
    for (from, to) in corners.iter().zip(&image) {
        assert!((found.act(from) - to).norm() < 1e-10);
    }
    assert!((found.matrix.determinant() - 1.0).abs() < 1e-12);
    let mut c = vec![];
    found.write(&mut c);
    assert!(SL3::read(&c).is_some_and(|r| (r.matrix - found.matrix).amax() < 1e-12));
    assert_eq!(SL3::from_points(&[corners[0]; 4], &image), None);
    for (space, wrong) in [("scale", [1.0, 2.0, -1.0]), ("zero", [1.0, 2.0, 0.0])] {
        assert_eq!(TranslationScale::read(&wrong), None, "{space}");
    }
    assert_eq!(Sim2::read(&[1.0, 2.0, 0.1, -1.0]), None);
    let mut out = vec![];
    Sim2::new(1.0, 2.0, -3.0, 0.5).write(&mut out);
    assert!(Sim2::read(&out).is_some_and(|r| (r.angle() + 3.0).abs() < 1e-15 && r.scale == 0.5));
}
