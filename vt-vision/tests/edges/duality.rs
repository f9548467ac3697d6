//! Both forms of the measurements say the same.

use nalgebra::Vector6;
use proptest::strategy::Strategy;
use vt_core::evidence::{Evidence, Processing};
use vt_core::laws::{MeasurementTolerance, check_measurement, for_each};
use vt_core::lie::SE3;
use vt_core::manifold::Manifold;
use vt_core::measurement::{Level, Linearized, Measurement, Modality, NormalEquations};
use vt_models::visibility::MeshView;
use vt_models::warp::Se3Warp;
use vt_vision::edge::{EdgeParams, EdgePixelModality};

use crate::scene::{FREE, SENSOR, Solid, pose, prior, show, tangent};
use crate::shapes::{camera, plate};

fn truth() -> SE3 {
    pose([-35.0, 40.0, 20.0], [0.01, 0.0, 0.4])
}

/// Poses up to 30 pixels and 20° away, near ones as often as far ones.
fn poses() -> impl Strategy<Value = SE3> {
    (proptest::array::uniform6(-1.0..1.0), -3.0..0.0f64).prop_map(|(d, size)| {
        let size = vt_core::math::exp(size * core::f64::consts::LN_10);
        let [x, y, z, a, b, c] = d.map(|v| v * size);
        truth().retract(&tangent([x, y, z].map(|v| 0.024 * v), [a, b, c].map(|v| 20.0 * v)))
    })
}

#[test]
fn features_and_poses_obey_the_laws_of_a_measurement() {
    let (solid, camera) = (Solid::cuboid([0.10, 0.07, 0.05]), camera());
    let mut evidence = Evidence::default();
    show(&mut evidence, solid.draw(&camera, &truth()));
    for level in [Level::Feature, Level::Object] {
        let mut modality = solid.modality(&camera, EdgeParams { level, ..EdgeParams::default() }, FREE);
        let prior = prior(&truth(), &tangent([0.002; 3], [2.0; 3]), 0.002, 2.0);
        let z = modality.measure(&evidence, &prior).unwrap().unwrap();
        for_each(poses(), |pose| check_measurement(z, &pose, MeasurementTolerance::default()));
        check_measurement(z, &truth(), MeasurementTolerance::default());
    }
}

/// The modality at pixel level, with the evidence it needs from a picture at the truth.
fn pixels(solid: &Solid, truth: &SE3) -> (EdgePixelModality<SE3, Se3Warp, MeshView>, Evidence) {
    let camera = camera();
    let (warp, view, size) = (Se3Warp::new(camera), solid.view(&camera), solid.mesh().diameter());
    let modality = EdgePixelModality::new(EdgeParams::default(), SENSOR, warp, view, size);
    let processing = modality.processing();
    let key = processing.key().clone();
    let mut evidence = Evidence::default();
    evidence.add(Box::new(processing));
    show(&mut evidence, solid.draw(&camera, truth));
    evidence.prepare(&key, None).unwrap();
    (modality, evidence)
}

fn likelihood(z: &dyn Measurement<SE3>, pose: &SE3) -> f64 {
    let mut l = [f64::NAN];
    z.log_likelihoods(&[*pose], &mut l);
    l[0]
}

fn equations(z: &dyn Measurement<SE3>, pose: &SE3) -> NormalEquations<SE3> {
    let mut e = NormalEquations::empty(pose);
    z.normal_equations(pose, &mut e);
    e
}

/// At pixel level the picture is looked at anew at every pose, so the likelihood is piecewise: as a normal slides
/// over the map it meets other pixels of the same edge, whose sub-pixel positions differ by some hundredths of a
/// pixel, and where it passes a corner it loses its edge. The likelihood jumps there and the gradient cannot know; a
/// difference quotient over a small step shows jumps alone. On a contour without corners the jumps cancel over
/// a path of a pixel: there the likelihood is the integral of its gradient.
#[test]
fn the_likelihood_of_pixels_is_the_integral_of_its_gradient() {
    let (beam, truth) = (plate(2.0, 0.05), pose([0.0, 0.0, 20.0], [0.0, 0.0, 0.4]));
    let (mut modality, evidence) = pixels(&beam, &truth);
    let z = modality.measure(&evidence, &prior(&truth, &Vector6::zeros(), 0.002, 2.0)).unwrap().unwrap();
    let pixel = 0.4 / 500.0;
    for d in [
        tangent([0.0, pixel, 0.0], [0.0; 3]),
        tangent([0.0, 0.0, 16.0 * pixel], [0.0; 3]),
        tangent([0.0; 3], [0.0, 0.0, 1.0]),
        tangent([0.0, pixel, 8.0 * pixel], [0.0, 0.0, 0.5]),
    ] {
        for sign in [-1.2, 1.2] {
            const STEPS: u32 = 50;
            let along = |k: f64| truth.retract(&(d * (sign * k / f64::from(STEPS))));
            let slope = |k: u32| equations(z, &along(f64::from(k) + 0.5)).gradient.dot(&d) * sign;
            let integral = (0..STEPS).map(slope).sum::<f64>() / f64::from(STEPS);
            let change = likelihood(z, &along(f64::from(STEPS))) - likelihood(z, &truth);
            println!("change {change} integral {integral}");
            assert!(
                change < -5.0 && (change - integral).abs() < 0.1 * change.abs(),
                "{change}, not {integral}"
            );
        }
    }
}

/// What is exact at pixel level: the cost is the likelihood, and the rows have its gradient and information.
#[test]
fn rows_of_pixels_are_the_normal_equations() {
    let solid = Solid::cuboid([0.10, 0.07, 0.05]);
    let (mut modality, evidence) = pixels(&solid, &truth());
    let z = modality.measure(&evidence, &prior(&truth(), &Vector6::zeros(), 0.002, 2.0)).unwrap().unwrap();
    for_each(poses(), |pose| {
        let e = equations(z, &pose);
        let l = likelihood(z, &pose);
        assert!((e.cost + l).abs() <= 1e-9 * l.abs().max(1.0), "cost {} and log-likelihood {l}", e.cost);
        let (mut rows, mut sum) = (Linearized::default(), NormalEquations::empty(&pose));
        z.residuals(&pose, &mut rows);
        rows.accumulate(&mut sum);
        assert_eq!(sum.rows, e.rows);
        assert!((sum.information - e.information).amax() <= 1e-9 * e.information.amax());
        assert!((sum.gradient - e.gradient).amax() <= 1e-9 * e.gradient.amax());
    });
}
