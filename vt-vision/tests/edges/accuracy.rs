//! Poses found from offsets, against the pose that was drawn.

use nalgebra::{Vector3, Vector6};
use vt_core::agent::Visibility;
use vt_core::belief::Gaussian;
use vt_core::evidence::{Evidence, Processing};
use vt_core::laws;
use vt_core::least_squares::LeastSquares;
use vt_core::lie::SE3;
use vt_core::manifold::Manifold;
use vt_core::measurement::{Level, Modality};
use vt_core::random::{Random, Stream};
use vt_models::camera::Camera;
use vt_vision::edge::{EdgeParams, Hypotheses};
use vt_vision::pyramid::PyramidProcessing;

use crate::scene::{FREE, SENSOR, Solid, pose, prior, show, tangent};
use crate::shapes::{camera, plate};

/// Largest distance along the normals between the visible contours under two poses, pixels.
fn contour_error(solid: &Solid, camera: &Camera, truth: &SE3, found: &SE3) -> f64 {
    let mut view = solid.view(camera);
    let distance = |s: &vt_models::visibility::EdgeSite| {
        let at = |pose: &SE3, x| camera.project(&pose.act(&x)).unwrap();
        let y = at(truth, s.p_in_object);
        let along = (at(truth, s.p_in_object + s.tangent * 1e-5) - y).normalize();
        along.perp(&(at(found, s.p_in_object) - y)).abs()
    };
    view.visible(truth).iter().map(distance).fold(0.0, f64::max)
}

/// Pose found from `prior` in the picture of `evidence`: by a fit to the measurement, or as measured.
fn find(
    solid: &Solid,
    camera: &Camera,
    params: EdgeParams,
    free: [bool; 6],
    evidence: &Evidence,
    prior: &Gaussian<SE3>,
) -> SE3 {
    let mut modality = solid.modality(camera, params, free);
    let z = modality.measure(evidence, prior).unwrap().expect("the solid is in view");
    assert_eq!(z.level(), params.level);
    assert!(z.quality(&prior.mean).expected > 20);
    match params.level {
        Level::Object => *modality.object().unwrap().pose(),
        _ => LeastSquares::gauss_newton().fit(z, &prior.mean, None).unwrap().pose,
    }
}

/// Offsets of 3 pixels and 3° for something 0.4 m away: along and about every axis, both ways, and in twelve
/// directions drawn at random.
fn offsets() -> Vec<Vector6<f64>> {
    let scaled = |t: [f64; 3], w: [f64; 3]| tangent(t.map(|v| 3.0 * PIXEL * v), w.map(|v| 3.0 * v));
    let mut all = vec![];
    for (axis, sign) in (0..3).flat_map(|axis| [(axis, -1.0), (axis, 1.0)]) {
        let unit = core::array::from_fn(|k| if k == axis { sign } else { 0.0 });
        all.extend([scaled(unit, [0.0; 3]), scaled([0.0; 3], unit)]);
    }
    for target in 0..12 {
        let d = laws::tangent(nalgebra::Const::<6>, &mut Random::new(1, Stream::Sim, target, 0, 0));
        let half = |k| Vector3::from(d.fixed_rows::<3>(k)).normalize().into();
        all.push(scaled(half(0), half(3)));
    }
    all
}

/// A pixel at 0.4 m, metres.
const PIXEL: f64 = 0.4 / 500.0;

/// Views of the box: two and three faces.
fn views() -> [SE3; 3] {
    [
        pose([140.0, 30.0, 10.0], [0.005, -0.003, 0.4]),
        pose([-35.0, 40.0, 20.0], [0.01, 0.0, 0.4]),
        pose([25.0, -30.0, -40.0], [-0.01, 0.002, 0.4]),
    ]
}

#[test]
fn a_box_is_found_to_a_tenth_of_a_pixel() {
    let (solid, camera) = (Solid::cuboid([0.10, 0.07, 0.05]), camera());
    for truth in views() {
        let mut evidence = Evidence::default();
        show(&mut evidence, solid.draw(&camera, &truth));
        for hypotheses in [Hypotheses::Single, Hypotheses::Multiple] {
            for level in [Level::Feature, Level::Object] {
                let params = EdgeParams { level, hypotheses, ..EdgeParams::default() };
                for offset in offsets() {
                    let prior = prior(&truth, &offset, 2.0 * PIXEL, 2.0);
                    let found = find(&solid, &camera, params, FREE, &evidence, &prior);
                    let error = contour_error(&solid, &camera, &truth, &found);
                    let before = contour_error(&solid, &camera, &truth, &prior.mean);
                    assert!(
                        error < 0.1,
                        "{hypotheses:?} {level:?} from {offset:?}: {error} px, before {before} px"
                    );
                }
            }
        }
    }
}

/// The outline of a rectangle that faces the camera says little about tilt, but enough for its image.
#[test]
fn a_plate_that_faces_the_camera_is_found_to_a_tenth_of_a_pixel() {
    let (solid, camera) = (plate(0.12, 0.08), camera());
    let truth = pose([0.0; 3], [0.003, -0.002, 0.4]);
    let mut evidence = Evidence::default();
    show(&mut evidence, solid.draw(&camera, &truth));
    for level in [Level::Feature, Level::Object] {
        let params = EdgeParams { level, ..EdgeParams::default() };
        for offset in offsets() {
            let prior = prior(&truth, &offset, 2.0 * PIXEL, 2.0);
            let found = find(&solid, &camera, params, FREE, &evidence, &prior);
            let error = contour_error(&solid, &camera, &truth, &found);
            assert!(error < 0.1, "{level:?} from {offset:?}: {error} px");
        }
    }
}

/// 30 pixels off in a picture of 640 × 480, with a range of 20 pixels on each of four scales.
#[test]
fn coarse_levels_find_a_box_thirty_pixels_away() {
    let solid = Solid::cuboid([0.10, 0.07, 0.05]);
    let camera = Camera::new(1000.0, 1000.0, 319.5, 239.5, 640, 480).unwrap();
    let truth = pose([-35.0, 40.0, 20.0], [0.01, 0.0, 0.4]);
    let coarse = PyramidProcessing::new(SENSOR, 3);
    let key = coarse.key().clone();
    let mut evidence = Evidence::default();
    evidence.add(Box::new(coarse));
    show(&mut evidence, solid.draw(&camera, &truth));
    evidence.prepare(&key, None).unwrap();
    let error = |coarse_levels, k: u32| {
        let (y, x) = vt_core::math::sin_cos(f64::from(k) * core::f64::consts::FRAC_PI_4);
        // Thirty pixels across the view, whatever the attitude.
        let shift = truth.rotation.inverse() * Vector3::new(30.0 * x, 30.0 * y, 0.0) * (0.4 / 1000.0);
        let prior = prior(&truth, &tangent(shift.into(), [0.0; 3]), 15.0 * 0.4 / 1000.0, 1.0);
        let params = EdgeParams { coarse_levels, range: [6.0, 20.0], starts: 1, ..EdgeParams::default() };
        let found = find(&solid, &camera, params, FREE, &evidence, &prior);
        contour_error(&solid, &camera, &truth, &found)
    };
    for k in 0..8 {
        assert!(error(3, k) < 0.1, "direction {k}: {} px", error(3, k));
    }
    assert!((0..8).any(|k| error(0, k) > 1.0), "the full picture alone would do: nothing is shown");
}

#[test]
fn a_locked_degree_of_freedom_stays() {
    let (solid, camera) = (Solid::cuboid([0.10, 0.07, 0.05]), camera());
    let truth = views()[1];
    let mut evidence = Evidence::default();
    show(&mut evidence, solid.draw(&camera, &truth));
    for level in [Level::Feature, Level::Object] {
        let params = EdgeParams { level, ..EdgeParams::default() };
        for locked in 0..6 {
            let free = core::array::from_fn(|k| k != locked);
            let mut offset = tangent([2.0 * PIXEL; 3], [2.0; 3]);
            offset[locked] = 0.0;
            // With and without variance along what cannot move.
            for variance in [0.0, 1.0] {
                let mut prior = prior(&truth, &offset, 2.0 * PIXEL, 2.0);
                prior.covariance[(locked, locked)] *= variance;
                let mut modality = solid.modality(&camera, params, free);
                let z = modality.measure(&evidence, &prior).unwrap().unwrap();
                let mut equations = vt_core::measurement::NormalEquations::empty(&truth);
                z.normal_equations(&prior.mean, &mut equations);
                if level == Level::Feature {
                    assert_eq!(equations.information.row(locked).amax(), 0.0);
                    assert_eq!(equations.gradient[locked], 0.0);
                }
                let found = find(&solid, &camera, params, free, &evidence, &prior);
                let moved = prior.mean.local(&found);
                // Steps that do not commute leave a trace of second order.
                assert!(
                    moved[locked].abs() < 1e-4,
                    "{level:?}: coordinate {locked} moved by {}",
                    moved[locked]
                );
                let error = contour_error(&solid, &camera, &truth, &found);
                assert!(moved.norm() > 0.03 && error < 0.1, "{level:?}, {locked} locked: {error} px");
            }
        }
    }
}
