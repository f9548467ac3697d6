//! Instructions of the hot paths of flat targets, counted by callgrind: the same on a busy machine and a quiet one.
//! `.ci/instructions` runs them and compares with the counts of `instructions.txt`.

// What the macros make has no documentation.
#![allow(missing_docs)]

use std::hint::black_box;
use std::path::Path;

use gungraun::prelude::*;
use image::{GrayImage, RgbImage};
use vt_core::frame::Frame;
use vt_core::lie::Sim2;
use vt_core::report::StepReport;
use vt_fusion::tracking::TrackingLoop;
use vt_tests::planar::{Flat, PlanarScene};
use vt_tests::replay::Replay;
use vt_vision::canny::{Canny, CannyParams, Thresholds};
use vt_vision::color::{Hsv, HueRange};
use vt_vision::distance_transform::DistanceTransform;

/// The modality of this number with its measurement made, and 200 hypotheses.
fn hypotheses(modality: usize) -> (Flat, Vec<Sim2>, Vec<f64>) {
    let (scene, mut modalities) = PlanarScene::new().expect("a scene");
    let (_, mut modality) = modalities.swap_remove(modality);
    modality.measure(&scene.evidence, &scene.prior).expect("a measurement");
    let poses = scene.particles(200);
    // Threads have their scratch space.
    let mut out = vec![0.0; poses.len()];
    modality.last().expect("something seen").log_likelihoods(&poses, &mut out);
    (modality, poses, out)
}

#[library_benchmark]
#[bench::contour(args = (0), setup = hypotheses)]
#[bench::chamfer(args = (1), setup = hypotheses)]
#[bench::color_400_samples(args = (2), setup = hypotheses)]
#[bench::color_every_pixel(args = (3), setup = hypotheses)]
#[bench::template(args = (4), setup = hypotheses)]
fn likelihood((modality, poses, mut out): (Flat, Vec<Sim2>, Vec<f64>)) -> (Flat, Vec<f64>) {
    if let Some(z) = modality.last() {
        z.log_likelihoods(black_box(&poses), &mut out);
    }
    (modality, out)
}

fn picture() -> RgbImage {
    PlanarScene::new().expect("a scene").0.picture.as_ref().clone()
}

fn canny_params() -> CannyParams {
    CannyParams::new(Thresholds::Fixed { low: 12.5, high: 37.5 }).expect("thresholds")
}

fn grey() -> (GrayImage, CannyParams, Canny) {
    let (picture, params) = (image::DynamicImage::ImageRgb8(picture()).into_luma8(), canny_params());
    let mut canny = Canny::default();
    canny.compute(&picture, None, &params);
    (picture, params, canny)
}

#[library_benchmark]
#[bench::picture(setup = grey)]
fn canny((picture, params, mut canny): (GrayImage, CannyParams, Canny)) -> Canny {
    canny.compute(black_box(&picture), None, &params);
    canny
}

fn edges() -> (Canny, DistanceTransform) {
    let (_, _, canny) = grey();
    let mut transform = DistanceTransform::default();
    transform.compute(canny.mask());
    (canny, transform)
}

#[library_benchmark]
#[bench::picture(setup = edges)]
fn distance_transform((canny, mut transform): (Canny, DistanceTransform)) -> DistanceTransform {
    transform.compute(black_box(canny.mask()));
    transform
}

fn colors() -> (RgbImage, Hsv) {
    let (picture, mut hsv) = (picture(), Hsv::default());
    hsv.compute(&picture, None, HueRange::Half);
    (picture, hsv)
}

#[library_benchmark]
#[bench::picture(setup = colors)]
fn hsv((picture, mut hsv): (RgbImage, Hsv)) -> Hsv {
    hsv.compute(black_box(&picture), None, HueRange::Half);
    hsv
}

/// A task after ten steps, and its next frame.
fn warm(task: &str) -> (TrackingLoop, Frame) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../vt-apps/tasks").join(task);
    let replay = Replay::load(path, &["sensors.camera.params.frames=11"]).expect("a task");
    let (mut tracking, _) = replay.start().expect("a tracker");
    for frame in &replay.frames()[..10] {
        tracking.step([frame.clone()]).expect("a step");
    }
    (tracking, replay.frames()[10].clone())
}

#[library_benchmark]
#[bench::contour_condensation(args = ("contour-condensation.toml"), setup = warm)]
#[bench::color_particle(args = ("color-particle.toml"), setup = warm)]
#[bench::motion_color_kalman(args = ("motion-color-kalman.toml"), setup = warm)]
#[bench::edge_pose(args = ("edge-pose.toml"), setup = warm)]
fn step((mut tracking, frame): (TrackingLoop, Frame)) -> (TrackingLoop, Vec<StepReport>) {
    let reports = tracking.step([black_box(frame)]).expect("a step").to_vec();
    (tracking, reports)
}

library_benchmark_group!(name = flat, benchmarks = [likelihood, canny, distance_transform, hsv, step]);
// One thread: threads that look for work count instructions, too.
main!(
    config = LibraryBenchmarkConfig::default().env("RAYON_NUM_THREADS", "1"),
    library_benchmark_groups = flat
);
