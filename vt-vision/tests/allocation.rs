//! Once its buffers have grown, a modality measures without a heap allocation. Alone in its program, since the
//! counter sees all threads.

use std::alloc::System;
use std::sync::Arc;

use image::{GrayImage, Rgb, RgbImage};
use nalgebra::Vector3;
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use vt_core::belief::Gaussian;
use vt_core::evidence::{Evidence, Processing};
use vt_core::frame::{Frame, Payload};
use vt_core::lie::{SE3, TranslationScale};
use vt_core::manifold::Manifold;
use vt_core::measurement::{Level, Modality};
use vt_core::time::Timestamp;
use vt_models::camera::Camera;
use vt_models::warp::{PlanarWarp, Se3Warp};
use vt_vision::adaptation::AdaptationParams;
use vt_vision::color_likelihood::{ColorModality, ColorParams};
use vt_vision::edge::{EdgeParams, EdgePixelModality};
use vt_vision::pyramid::PyramidProcessing;
use vt_vision::template::{TemplateModality, TemplateParams};

#[path = "edges/scene.rs"]
mod scene;

use scene::{FREE, SENSOR, Solid, pose, prior, show, tangent};

#[global_allocator]
static HEAP: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// Pose of a frame: a box that swings with a period of ten frames, through changes of view that compute the visible
/// edges anew.
fn truth(k: u32) -> SE3 {
    let swing = vt_core::math::sin(f64::from(k) * core::f64::consts::TAU / 10.0);
    let start = pose([-35.0, 40.0, 20.0], [0.01, 0.0, 0.4]);
    start.retract(&tangent([0.003 * swing, 0.002 * swing, 0.02 * swing], [3.0 * swing, -4.0 * swing, 0.0]))
}

#[test]
fn measuring_allocates_nothing_after_ten_frames() {
    let (solid, camera) =
        (Solid::cuboid([0.10, 0.07, 0.05]), Camera::new(500.0, 500.0, 159.5, 119.5, 320, 240).unwrap());
    let pictures: Vec<GrayImage> = (0..10).map(|k| solid.draw(&camera, &truth(k))).collect();
    for (level, coarse_levels) in
        [(Level::Feature, 0), (Level::Feature, 2), (Level::Object, 0), (Level::Object, 2), (Level::Pixel, 0)]
    {
        let params = EdgeParams { level, coarse_levels, ..EdgeParams::default() };
        let mut processing: Box<dyn Processing> = Box::new(PyramidProcessing::new(SENSOR, coarse_levels));
        let mut modality: Box<dyn Modality<SE3>> = Box::new(solid.modality(&camera, params, FREE));
        if level == Level::Pixel {
            let (warp, view, size) = (Se3Warp::new(camera), solid.view(&camera), solid.mesh().diameter());
            let pixels = EdgePixelModality::new(params, SENSOR, warp, view, size);
            processing = Box::new(pixels.processing());
            modality = Box::new(pixels);
        }
        let key = processing.key().clone();
        let mut evidence = Evidence::default();
        evidence.add(processing);
        let mut counts = vec![];
        for k in 0..30 {
            show(&mut evidence, pictures[k as usize % 10].clone());
            evidence.prepare(&key, None).unwrap();
            // A velocity that is not known: the prior is the pose of the frame before.
            let prior = prior(
                &truth(k).retract(&tangent([0.0; 3], [0.5; 3])),
                &truth(k).local(&truth(k + 9)),
                0.003,
                3.0,
            );
            let region = Region::new(HEAP);
            let seen = modality.measure(&evidence, &prior).unwrap().is_some();
            let change = region.change();
            assert!(seen, "frame {k}");
            counts.push(change.allocations + change.reallocations);
        }
        assert!(counts[0] > 0, "the counter does not count");
        assert!(counts[10..].iter().all(|&n| n == 0), "{level:?}, {coarse_levels} coarse: {counts:?}");
    }
    flat_targets_adapt_in_place();
}

/// Colours and template of a flat target, measured and adapted.
fn flat_targets_adapt_in_place() {
    let adapt = Some(AdaptationParams::default());
    let (size, warp) = ([40.0, 30.0], PlanarWarp::<TranslationScale>::default);
    let color = ColorParams { adapt, ..ColorParams::default() };
    let template = TemplateParams { adapt, ..TemplateParams::default() };
    let color = ColorModality::new(color, SENSOR, warp(), size).unwrap();
    let mut evidence = Evidence::default();
    let key = color.needs()[0].clone();
    evidence.add(Box::new(color.processing()));
    let template = TemplateModality::new(template, SENSOR, warp(), size).unwrap();
    let mut modalities: [Box<dyn Modality<TranslationScale>>; 2] = [Box::new(color), Box::new(template)];
    let sigma = Vector3::new(1.0, 1.0, 0.01);
    let mut counts = vec![];
    for k in 0..20_u32 {
        let shade = |x: u32, y: u32| Rgb([(5 * x) as u8, (7 * y + k) as u8, (x * y + 3 * k) as u8]);
        let payload = Payload::Rgb(Arc::new(RgbImage::from_fn(120, 90, shade)));
        let time = Timestamp(i64::from(k) * 40_000_000);
        evidence.begin([Frame { sensor: SENSOR, number: k.into(), time, payload }]);
        evidence.prepare(&key, None).unwrap();
        let pose = Gaussian::from_sigmas(TranslationScale::new(60.0, 45.0, 1.0), &sigma);
        let region = Region::new(HEAP);
        for modality in &mut modalities {
            assert!(modality.measure(&evidence, &pose).unwrap().is_some());
            modality.adapt(&evidence, &pose).unwrap();
        }
        let change = region.change();
        counts.push(change.allocations + change.reallocations);
    }
    assert!(counts[0] > 0 && counts[5..].iter().all(|&n| n == 0), "{counts:?}");
}
