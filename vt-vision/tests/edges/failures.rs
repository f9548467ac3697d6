//! What cannot be measured is said so, and nothing panics.

use std::sync::Arc;

use image::{GrayImage, Luma, RgbImage};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use vt_core::belief::Gaussian;
use vt_core::error::MeasureError;
use vt_core::evidence::{Evidence, Processing};
use vt_core::frame::{Frame, Payload};
use vt_core::lie::SE3;
use vt_core::manifold::Manifold;
use vt_core::measurement::{Level, Modality};
use vt_core::time::Timestamp;
use vt_models::camera::Camera;
use vt_models::warp::Se3Warp;
use vt_vision::edge::{EdgeParams, EdgePixelModality, Hypotheses};
use vt_vision::edge_map::EdgeMapProcessing;
use vt_vision::pyramid::PyramidProcessing;

use crate::scene::{FREE, SENSOR, Solid, pose, prior, show, tangent};
use crate::shapes::camera;

fn at(truth: &SE3) -> Gaussian<SE3> {
    prior(truth, &tangent([0.0; 3], [0.0; 3]), 0.002, 2.0)
}

fn frame(payload: Payload) -> Frame {
    Frame { sensor: SENSOR, number: 0, time: Timestamp(0), payload }
}

/// The box and every modality for it.
fn modalities(camera: &Camera) -> (Solid, Vec<Box<dyn Modality<SE3>>>) {
    let solid = Solid::cuboid([0.10, 0.07, 0.05]);
    let mut all: Vec<Box<dyn Modality<SE3>>> = vec![];
    for level in [Level::Feature, Level::Object] {
        for (hypotheses, coarse_levels) in [(Hypotheses::Single, 0), (Hypotheses::Multiple, 3)] {
            let params = EdgeParams { level, hypotheses, coarse_levels, ..EdgeParams::default() };
            all.push(Box::new(solid.modality(camera, params, FREE)));
        }
    }
    let (warp, view, size) = (Se3Warp::new(*camera), solid.view(camera), solid.mesh().diameter());
    all.push(Box::new(EdgePixelModality::new(EdgeParams::default(), SENSOR, warp, view, size)));
    (solid, all)
}

fn evidence() -> Evidence {
    let mut evidence = Evidence::default();
    evidence.add(Box::new(PyramidProcessing::new(SENSOR, 3)));
    evidence.add(Box::new(EdgeMapProcessing::new(SENSOR, EdgeParams::default().min_contrast)));
    evidence
}

fn prepare(evidence: &mut Evidence) {
    for key in [
        PyramidProcessing::key_for(SENSOR, 3),
        EdgeMapProcessing::key_for(SENSOR, EdgeParams::default().min_contrast),
    ] {
        evidence.prepare(&key, None).unwrap();
    }
}

#[test]
fn nothing_to_see_is_no_measurement() {
    let (solid, mut all) = modalities(&camera());
    let truth = pose([-35.0, 40.0, 20.0], [0.01, 0.0, 0.4]);
    let mut evidence = evidence();
    show(&mut evidence, solid.draw(&camera(), &truth));
    prepare(&mut evidence);
    for modality in &mut all {
        assert!(modality.measure(&evidence, &at(&truth)).unwrap().is_some());
        assert!(modality.last().is_some());
        // Behind the camera, and beside the picture.
        for translation in [[0.0, 0.0, -0.4], [2.0, 0.0, 0.4]] {
            assert!(modality.measure(&evidence, &at(&pose([0.0; 3], translation))).unwrap().is_none());
            assert!(modality.last().is_none(), "the measurement before is out of date");
        }
    }
    // A blank picture has no edge to match; a likelihood of missing edges is one all the same.
    show(&mut evidence, GrayImage::from_pixel(320, 240, Luma([90])));
    prepare(&mut evidence);
    let (pixels, features) = all.split_last_mut().unwrap();
    for modality in features {
        assert!(modality.measure(&evidence, &at(&truth)).unwrap().is_none());
    }
    let z = pixels.measure(&evidence, &at(&truth)).unwrap().unwrap();
    assert_eq!((z.quality(&truth).inliers, z.level()), (0, Level::Pixel));
}

#[test]
fn what_does_not_fit_is_a_typed_error() {
    let (solid, mut all) = modalities(&camera());
    let truth = pose([-35.0, 40.0, 20.0], [0.01, 0.0, 0.4]);
    let mut evidence = evidence();
    for (k, modality) in all.iter_mut().enumerate() {
        let mut result = |evidence: &Evidence, prior: &Gaussian<SE3>| {
            modality.measure(evidence, prior).map(|z| z.is_some())
        };
        evidence.begin([]);
        assert_eq!(result(&evidence, &at(&truth)), Err(MeasureError::MissingFrame { sensor: 0 }));
        show(&mut evidence, solid.draw(&camera(), &truth));
        // The pixel level reads a map; the others do without a pyramid.
        let unprepared = result(&evidence, &at(&truth));
        let missing = matches!(unprepared, Err(MeasureError::MissingEvidence { .. }));
        assert!(if k == 4 { missing } else { unprepared == Ok(true) }, "{unprepared:?}");
        prepare(&mut evidence);
        assert_eq!(result(&evidence, &at(&truth)), Ok(true));
        for place in 0..3 {
            let mut prior = at(&truth);
            match place {
                0 => prior.mean.translation.x = f64::NAN,
                1 => {
                    prior.mean.rotation =
                        nalgebra::Unit::new_unchecked(prior.mean.rotation.into_inner() * f64::NAN)
                }
                _ => prior.covariance[(2, 2)] = f64::INFINITY,
            }
            assert!(matches!(result(&evidence, &prior), Err(MeasureError::Prediction(_))));
        }
        evidence.begin([frame(Payload::Rgb(Arc::new(RgbImage::new(320, 240))))]);
        let colour = result(&evidence, &at(&truth));
        if k == 4 {
            // The map is made from the grey picture: its processing complains.
            assert!(matches!(colour, Err(MeasureError::MissingEvidence { .. })), "{colour:?}");
            let key = EdgeMapProcessing::new(SENSOR, EdgeParams::default().min_contrast).key().clone();
            assert!(matches!(evidence.prepare(&key, None), Err(MeasureError::Payload { .. })));
        } else {
            assert!(matches!(colour, Err(MeasureError::Payload { .. })), "{colour:?}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 256, rng_seed: RngSeed::Fixed(2), failure_persistence: None, ..Default::default() })]

    /// Any pose, in front of the camera, around it or behind it, and any size of picture, fitting the camera or not.
    #[test]
    fn no_pose_and_no_picture_panics(
        turn in prop::array::uniform3(-180.0..180.0f64),
        shift in prop::array::uniform3(-0.4..0.6f64),
        deviation in prop_oneof![Just(0.0), 1e-4..1.0f64],
        size in prop_oneof![Just((320u32, 240u32)), (0..40u32, 0..40u32), (0..3u32, 0..200u32)],
        grey in any::<u64>(),
    ) {
        let camera = camera();
        let (_, mut all) = modalities(&camera);
        let texture = |x: u32, y: u32| (grey.rotate_left((x / 5 + 7 * (y / 5)) % 64) & 255) as u8;
        let mut evidence = evidence();
        show(&mut evidence, GrayImage::from_fn(size.0, size.1, |x, y| Luma([texture(x, y)])));
        prepare(&mut evidence);
        let pose = pose(turn, shift);
        let prior = Gaussian::from_sigmas(pose, &tangent([deviation; 3], [deviation * 100.0; 3]));
        for modality in &mut all {
            let _ = modality.region(&prior);
            if let Some(z) = modality.measure(&evidence, &prior).unwrap() {
                let far = pose.retract(&tangent([0.5; 3], [90.0; 3]));
                let mut l = [f64::NAN; 2];
                z.log_likelihoods(&[pose, far], &mut l);
                prop_assert!(l.iter().all(|v| v.is_finite()), "{:?}", l);
                let mut equations = vt_core::measurement::NormalEquations::empty(&pose);
                z.normal_equations(&pose, &mut equations);
                prop_assert!(equations.information.iter().chain(&equations.gradient).all(|v| v.is_finite()));
            }
            modality.sketch(&pose, &mut vec![]);
        }
    }
}
