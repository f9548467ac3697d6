//! Both forms of the measurements say the same.

use proptest::strategy::Strategy;
use vt_core::evidence::{Evidence, Processing};
use vt_core::laws::{MeasurementTolerance, check_measurement, for_each};
use vt_core::lie::SE3;
use vt_core::manifold::Manifold;
use vt_core::measurement::{Level, Linearized, Modality, NormalEquations};
use vt_models::warp::Se3Warp;
use vt_vision::edge::{EdgeParams, EdgePixelModality};

use crate::scene::{FREE, SENSOR, Solid, pose, prior, show, tangent};
use crate::shapes::camera;

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

/// The pixel level looks at the picture anew at every pose. Its likelihood is piecewise: as a normal slides over the
/// map it meets other pixels of the same edge, whose sub-pixel positions differ by a few hundredths of a pixel. So
/// the likelihood jumps by small amounts where the gradient cannot see them, and a difference quotient over a small
/// step shows the jumps alone. Over a path of a pixel they cancel: the law is the integral of the gradient.
#[test]
fn the_likelihood_of_pixels_is_the_integral_of_its_gradient() {
    let (solid, camera) = (Solid::cuboid([0.10, 0.07, 0.05]), camera());
    let mut modality = EdgePixelModality::new(
        EdgeParams { level: Level::Pixel, ..EdgeParams::default() },
        SENSOR,
        Se3Warp::new(camera),
        solid.view(&camera),
        solid.mesh().diameter(),
    );
    let processing = modality.processing();
    let key = processing.key().clone();
    let mut evidence = Evidence::default();
    evidence.add(Box::new(processing));
    show(&mut evidence, solid.draw(&camera, &truth()));
    evidence.prepare(&key, None).unwrap();
    let z = modality.measure(&evidence, &prior(&truth(), &tangent([0.0; 3], [0.0; 3]), 0.002, 2.0)).unwrap().unwrap();
    let likelihood = |pose: SE3| {
        let mut l = [0.0];
        z.log_likelihoods(&[pose], &mut l);
        l[0]
    };
    let equations = |pose: &SE3| {
        let mut e = NormalEquations::empty(pose);
        z.normal_equations(pose, &mut e);
        e
    };
    let steps = 40;
    for axis in 0..6 {
        // From the truth to 1.2 px away.
        let mut direction = tangent([0.0; 3], [0.0; 3]);
        direction[axis] = if axis < 3 { 1.2 * 0.4 / 500.0 } else { 1.2 / 60.0 };
        for sign in [-1.0, 1.0] {
            let d = direction * sign;
            let mut integral = 0.0;
            for k in 0..steps {
                let at = truth().retract(&(d * ((f64::from(k) + 0.5) / f64::from(steps))));
                integral += equations(&at).gradient.dot(&d) / f64::from(steps);
            }
            let change = likelihood(truth().retract(&d)) - likelihood(truth());
            println!("axis {axis} {sign}: change {change} integral {integral}");
        }
    }
    for_each(poses(), |pose| {
        let e = equations(&pose);
        let l = likelihood(pose);
        assert!((e.cost + l).abs() <= 1e-9 * l.abs().max(1.0), "cost {} and log-likelihood {l}", e.cost);
        let (mut rows, mut sum) = (Linearized::default(), NormalEquations::empty(&pose));
        z.residuals(&pose, &mut rows);
        rows.accumulate(&mut sum);
        assert_eq!(sum.rows, e.rows);
        assert!((sum.information - e.information).amax() <= 1e-9 * e.information.amax());
        assert!((sum.gradient - e.gradient).amax() <= 1e-9 * e.gradient.amax());
    });
}
