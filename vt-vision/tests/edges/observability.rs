//! Motions that the contour does not show have no information, and the measured pose does not invent them.

use nalgebra::Vector6;
use vt_core::evidence::Evidence;
use vt_core::lie::SE3;
use vt_core::manifold::Manifold;
use vt_core::measurement::{Level, Modality, NormalEquations};
use vt_vision::edge::EdgeParams;

use crate::scene::{FREE, Solid, pose, prior, show, tangent};
use crate::shapes::{camera, cylinder, plate};

/// Information of both levels at the pose measured, and how far that pose is from the prior.
fn measured(
    solid: &Solid,
    truth: &SE3,
    offset: &Vector6<f64>,
    params: EdgeParams,
) -> Vec<(NormalEquations<SE3>, Vector6<f64>)> {
    let camera = camera();
    let mut evidence = Evidence::default();
    show(&mut evidence, solid.draw(&camera, truth));
    let prior = prior(truth, offset, 0.002, 2.0);
    let mut object = solid.modality(&camera, EdgeParams { level: Level::Object, ..params }, FREE);
    object.measure(&evidence, &prior).unwrap().expect("edges");
    let pose = *object.object().unwrap().pose();
    let mut features = solid.modality(&camera, params, FREE);
    features.measure(&evidence, &prior).unwrap().expect("edges");
    let last = [object.last().unwrap(), features.last().unwrap()];
    last.map(|z| {
        let mut equations = NormalEquations::empty(truth);
        z.normal_equations(&pose, &mut equations);
        (equations, prior.mean.local(&pose))
    })
    .to_vec()
}

/// Only the two long edges of a beam are in the picture: it may slide along itself unseen.
#[test]
fn a_beam_without_visible_ends_has_no_information_along_itself() {
    let beam = plate(2.0, 0.05);
    let truth = pose([0.0, 0.0, 20.0], [0.0, 0.0, 0.4]);
    let offset = tangent([0.004, 0.002, 0.0], [0.0, 0.0, 2.0]);
    for (equations, moved) in measured(&beam, &truth, &offset, EdgeParams::default()) {
        let a = &equations.information;
        assert!(equations.rows > 0);
        // Normals are those of the last search, which ended less than a thousandth of a radian from the pose.
        assert!(a[(0, 0)] <= 1e-6 * a[(1, 1)], "{} along, {} across", a[(0, 0)], a[(1, 1)]);
        assert!(a[(2, 2)] > 1e-3 * a[(1, 1)], "two edges of known distance show the depth");
        assert!(moved[0].abs() < 1e-4, "moved {} m along itself", moved[0]);
        assert!((moved[1] + 0.002).abs() < 3e-4 && (moved[5].to_degrees() + 2.0).abs() < 0.1);
    }
}

#[test]
fn a_cylinder_has_almost_no_information_about_its_axis() {
    let radius = 0.04;
    let solid = cylinder(radius, 0.06, 64);
    let truth = pose([60.0, 0.0, 15.0], [0.0, 0.0, 0.3]);
    let offset = tangent([0.002, 0.001, 0.0], [2.0, 1.0, 2.0]);
    // The claim scales with the length over which errors are correlated, the rest must not.
    let long = EdgeParams { correlation_length: 48.0, ..Default::default() };
    let facet = core::f64::consts::TAU / 64.0;
    for params in [long, EdgeParams::default()] {
        for (equations, moved) in measured(&solid, &truth, &offset, params) {
            let a = &equations.information;
            // A turn by 1 rad moves the surface by one radius.
            let share = a[(5, 5)] / (radius * radius * a[(0, 0)]);
            assert!(equations.rows > 0 && share < 0.01, "share {share}");
            // The facets alone show the turn, and all of them look the same.
            let facets = (moved[5] + 2f64.to_radians()) / facet;
            let deviation = 1.0 / a[(5, 5)].sqrt() / facet;
            assert!(
                (facets - facets.round()).abs() < 3.0 * deviation && facets.abs() < 2.0,
                "off by {facets} facets, claimed {deviation}"
            );
            assert!((moved[3].to_degrees() + 2.0).abs() < 0.2, "tilted {}", moved[3]);
        }
    }
}
