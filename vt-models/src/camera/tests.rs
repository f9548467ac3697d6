use super::*;
use num_dual::Dual64;
use proptest::prelude::*;

fn camera() -> Camera {
    Camera::new(610.0, 605.0, 318.2, 241.7, 640, 480).unwrap()
}

fn distorted() -> Camera {
    camera().with_lens(Lens::new(-0.28, 0.07, 1.1e-3, -0.7e-3, 0.01).unwrap())
}

#[test]
fn parameters_are_checked() {
    let bad = |c: Result<Camera, CameraError>| c.unwrap_err().to_string();
    let text = bad(Camera::new(0.0, 1.0, 0.0, 0.0, 2, 2));
    assert_eq!(text, "camera parameter fx: found 0, expected a positive number of pixels");
    assert!(bad(Camera::new(1.0, f64::NAN, 0.0, 0.0, 2, 2)).contains("fy"));
    assert!(bad(Camera::new(1.0, 1.0, f64::INFINITY, 0.0, 2, 2)).contains("cx"));
    assert!(bad(Camera::new(1.0, 1.0, 0.0, 0.0, 2, 0)).contains("height"));
    assert!(Lens::new(0.0, f64::NAN, 0.0, 0.0, 0.0).unwrap_err().to_string().contains("k2"));
}

#[test]
fn principal_ray_and_points_behind() {
    for c in [camera(), distorted()] {
        assert_eq!(c.project(&Point3::new(0.0, 0.0, 2.0)), Some(Point2::new(318.2, 241.7)));
        assert_eq!(c.project(&Point3::new(0.0, 0.0, -2.0)), None);
        assert_eq!(c.project(&Point3::new(0.1, 0.0, 0.0)), None);
        assert_eq!(c.project(&Point3::new(0.1, 0.0, f64::NAN)), None);
        assert!(c.project_with_jacobian(&Point3::new(0.1, 0.0, f64::NAN)).is_none());
    }
}

#[test]
fn barrel_distortion_folds_back_at_its_limit() {
    // d(r(1 - r²/4))/dr = 1 - 3r²/4 vanishes at r² = 4/3.
    let lens = Lens::new(-0.25, 0.0, 0.0, 0.0, 0.0).unwrap();
    assert!((lens.limit() - 4.0 / 3.0).abs() < 1e-9, "{}", lens.limit());
    let c = camera().with_lens(lens);
    let r = (4.0_f64 / 3.0).sqrt();
    assert!(c.project(&Point3::new(r * 0.999, 0.0, 1.0)).is_some());
    assert!(c.project(&Point3::new(r * 1.001, 0.0, 1.0)).is_none());
    assert_eq!(Lens::new(0.2, 0.1, 0.0, 0.0, 0.0).unwrap().limit(), f64::INFINITY);
    // Two extremes: the slope dips below zero and rises again; the first root counts.
    let lens = Lens::new(-1.0, 0.2, 0.0, 0.0, 0.2).unwrap();
    let slope = |s: f64| 1.0 - 3.0 * s + s * s + 1.4 * s * s * s;
    assert!(slope(lens.limit() * 0.99) > 0.0 && slope(lens.limit() * 1.01) < 0.0, "{}", lens.limit());
    let far = Point2::new(318.2 + 610.0 * 1.2, 241.7);
    assert!(matches!(c.unproject(&far), Err(CameraError::NoRay { .. })));
    assert!(c.unproject(&Point2::new(f64::NAN, 0.0)).is_err());
}

#[test]
fn pyramid_levels_follow_the_pixel_convention() {
    let c = distorted();
    let p = Point3::new(0.21, -0.13, 1.0);
    let base = c.project(&p).unwrap();
    for level in 0..4 {
        let scaled = c.scaled_to_level(level);
        let q = scaled.project(&p).unwrap();
        let factor = f64::from(1 << level);
        let back = Point2::new((q.x + 0.5) * factor - 0.5, (q.y + 0.5) * factor - 0.5);
        assert!((back - base).norm() < 1e-9);
        assert_eq!(scaled.size(), (640 >> level, 480 >> level));
    }
}

fn fisheye() -> Camera {
    let lens = Fisheye::new(-0.013, 0.021, -0.017, 0.003).unwrap();
    Camera::new(190.0, 188.0, 318.2, 241.7, 640, 480).unwrap().with_fisheye(lens)
}

#[test]
fn fisheye_on_the_axis_beside_and_behind_the_camera() {
    let c = fisheye();
    let (q, j) = c.project_with_jacobian(&Point3::new(0.0, 0.0, 2.0)).unwrap();
    assert_eq!(q, Point2::new(318.2, 241.7));
    assert_eq!(j, Matrix2x3::new(95.0, 0.0, 0.0, 0.0, 94.0, 0.0));
    // 100° off the axis: θ' = θ (1 + k1 θ² + …) with θ = 1.7453.
    let theta = 100.0_f64.to_radians();
    let p = Point3::new(3.0 * math::sin(theta), 0.0, 3.0 * math::cos(theta));
    let s = theta * theta;
    let bent = theta * (1.0 - 0.013 * s + 0.021 * s.powi(2) - 0.017 * s.powi(3) + 0.003 * s.powi(4));
    assert!((c.project(&p).unwrap() - Point2::new(318.2 + 190.0 * bent, 241.7)).norm() < 1e-9);
    for nowhere in [Point3::origin(), Point3::new(0.0, 0.0, -1.0), Point3::new(f64::NAN, 0.0, 1.0)] {
        assert_eq!(c.project(&nowhere), None);
    }
    assert!(c.widest_angle() > 1.6);
}

#[test]
fn fisheye_is_used_up_to_where_its_radius_grows() {
    // d(θ - θ³/4)/dθ vanishes at θ² = 4/3.
    let lens = Fisheye::new(-0.25, 0.0, 0.0, 0.0).unwrap();
    assert!((lens.limit() - (4.0_f64 / 3.0).sqrt()).abs() < 1e-12, "{}", lens.limit());
    let c = camera().with_fisheye(lens);
    let at = |angle: f64| c.project(&Point3::new(math::sin(angle), 0.0, math::cos(angle)));
    assert!(at(lens.limit() - 1e-6).is_some() && at(lens.limit() + 1e-6).is_none());
    let edge = at(lens.limit() - 1e-6).unwrap();
    assert!(c.ray(&edge).is_ok() && c.ray(&Point2::new(edge.x + 1.0, edge.y)).is_err());
    assert_eq!(Fisheye::new(0.0, 0.0, 0.0, 0.0).unwrap().limit(), std::f64::consts::PI);
    let e = Fisheye::new(-20.0, 0.0, 0.0, 0.0).unwrap_err();
    assert!(matches!(e, CameraError::NotMonotone { .. }), "{e}");
    assert!(Fisheye::new(0.0, f64::NAN, 0.0, 0.0).unwrap_err().to_string().contains("k2"));
    // Growth pauses and resumes: what lies beyond the pause is not used.
    let pause = Fisheye::new(-0.5, 0.06, 0.0, 0.0).unwrap();
    let slope = |a: f64| 1.0 - 1.5 * a * a + 0.3 * a.powi(4);
    assert!(slope(pause.limit() * 0.999) > 0.0 && slope(pause.limit() * 1.001) < 0.0);
    // 90° and more have a ray, but none with Z = 1.
    let side = Point2::new(318.2 + 610.0 * 1.58, 241.7);
    let wide = camera().with_fisheye(Fisheye::new(0.0, 0.0, 0.0, 0.0).unwrap());
    assert!(wide.ray(&side).unwrap().z < 0.0 && wide.unproject(&side).is_err());
}

proptest! {
    #[test]
    fn jacobian_agrees_with_dual_numbers_and_central_differences(
        x in -0.5..0.5_f64, y in -0.4..0.4_f64, z in 0.2..5.0_f64,
        k in prop::array::uniform5(-0.05..0.05_f64),
    ) {
        let c = camera().with_lens(Lens::new(k[0], k[1], k[2], k[3], k[4]).unwrap());
        let p = Point3::new(x * z, y * z, z);
        let (q, j) = c.project_with_jacobian(&p).unwrap();
        prop_assert!((q - c.project(&p).unwrap()).norm() < 1e-9);
        let scale = j.norm();
        for i in 0..3 {
            let duals = [0, 1, 2].map(|k| Dual64::new(p[k], f64::from(k == i)));
            let image = c.project_generic(duals);
            for row in 0..2 {
                prop_assert!((image[row].re - q[row]).abs() < 1e-9);
                let exact = image[row].eps;
                prop_assert!((exact - j[(row, i)]).abs() < 1e-12 * scale, "{} {}", exact, j[(row, i)]);
            }
        }
        let h = 1e-6 * z;
        for i in 0..3 {
            let mut d = Vector3::zeros();
            d[i] = h;
            let difference = (c.project(&(p + d)).unwrap() - c.project(&(p - d)).unwrap()) / (2.0 * h);
            prop_assert!((difference - j.column(i)).norm() < 1e-6 * scale);
        }
    }

    #[test]
    fn unproject_inverts_project(u in 0.0..640.0_f64, v in 0.0..480.0_f64) {
        let c = distorted();
        let ray = c.unproject(&Point2::new(u, v)).unwrap();
        let q = c.project(&Point3::from(ray * 3.0)).unwrap();
        prop_assert!((q - Point2::new(u, v)).norm() < 1e-9);
    }

    #[test]
    fn fisheye_jacobian_agrees_with_dual_numbers_and_central_differences(
        angle in prop_oneof![1e-7..1e-3_f64, 1e-3..1.9_f64], side in -3.1..3.1_f64, distance in 0.1..5.0_f64,
        k in prop::array::uniform4(-0.01..0.01_f64),
    ) {
        let c = camera().with_fisheye(Fisheye::new(k[0], k[1], k[2], k[3]).unwrap());
        let limit = match c.optics() { Optics::Fisheye(lens) => lens.limit(), Optics::Perspective(_) => 0.0 };
        prop_assume!(angle < limit - 1e-3);
        let ((s, z), (sy, cx)) = (math::sin_cos(angle), math::sin_cos(side));
        let p = Point3::new(s * cx, s * sy, z) * distance;
        let (q, j) = c.project_with_jacobian(&p).unwrap();
        prop_assert_eq!(q, c.project(&p).unwrap());
        for i in 0..3 {
            let image = c.project_generic([0, 1, 2].map(|k| Dual64::new(p[k], f64::from(k == i))));
            let mut d = Vector3::zeros();
            d[i] = 1e-6 * distance;
            let difference = (c.project(&(p + d)).unwrap() - c.project(&(p - d)).unwrap()) / (2e-6 * distance);
            for row in 0..2 {
                prop_assert!((image[row].re - q[row]).abs() < 1e-9);
                // Close to the axis the dual form cancels digits.
                let exact = 1e-11 + 1e-15 / angle;
                prop_assert!((image[row].eps - j[(row, i)]).abs() < exact * j.norm(), "{} {}", image[row].eps, j[(row, i)]);
                prop_assert!((difference[row] - j[(row, i)]).abs() < 1e-6 * j.norm());
            }
        }
    }

    #[test]
    fn fisheye_ray_inverts_project(u in 0.0..640.0_f64, v in 0.0..480.0_f64) {
        let c = fisheye();
        let pixel = Point2::new(u, v);
        if let Ok(ray) = c.ray(&pixel) {
            prop_assert!((ray.norm() - 1.0).abs() < 1e-12);
            prop_assert!((c.project(&Point3::from(ray * 3.0)).unwrap() - pixel).norm() < 1e-9);
        } else {
            // The corners lie outside the lens's circle.
            prop_assert!((pixel - Point2::new(318.2, 241.7)).norm() > 250.0);
        }
    }
}
