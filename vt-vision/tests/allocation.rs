//! Once its buffers have grown, a modality measures without a heap allocation. Alone in its program, since the
//! counter sees all threads.

use std::alloc::System;

use image::GrayImage;
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use vt_core::evidence::{Evidence, Processing};
use vt_core::lie::SE3;
use vt_core::manifold::Manifold;
use vt_core::measurement::{Level, Modality};
use vt_models::camera::Camera;
use vt_models::warp::Se3Warp;
use vt_vision::edge::{EdgeParams, EdgePixelModality};
use vt_vision::pyramid::PyramidProcessing;

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
}
