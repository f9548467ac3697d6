//! A step of the tracking loop takes no memory once it has warmed up.

use std::alloc::System;
use std::path::PathBuf;

use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use vt_tests::data;
use vt_tests::replay::Replay;

#[global_allocator]
static GLOBAL: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

#[test]
fn steps_after_the_tenth_allocate_nothing() {
    let tasks = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../vt-apps/tasks");
    let short = ["sensors.camera.params.frames=40", "sensors.camera.params.size=[240, 180]"];
    let start = "targets.object.init.params.box=['90 px', '50 px', '60 px', '80 px']";
    let flat = Replay::load(tasks.join("motion-color-kalman.toml"), &[short[0], short[1], start]);
    takes_nothing("mass centres", &flat.expect("the task loads"));
    if data::root("VISP_IMAGES").is_none() {
        return;
    }
    let cube = Replay::load(tasks.join("cube.toml"), &[]).expect("the task loads");
    let object = ["targets.cube.modalities.edges.level=object", "targets.cube.estimator.params.iterations=1"];
    let loose = Replay::load(tasks.join("cube.toml"), &object).expect("the task loads");
    for (name, replay) in [("tight", cube), ("loose", loose)] {
        takes_nothing(name, &replay);
    }
}

fn takes_nothing(name: &str, replay: &Replay) {
    let (mut tracking, _) = replay.start().expect("the task starts");
    let mut grown = vec![];
    for (k, frame) in replay.frames().iter().enumerate() {
        let frame = [frame.clone()];
        let region = Region::new(GLOBAL);
        tracking.step(frame).expect("a step");
        let change = region.change();
        if k >= 10 && change.allocations + change.reallocations > 0 {
            grown.push((k, change.allocations, change.reallocations));
        }
    }
    assert!(grown.is_empty(), "{name}: steps that took memory (step, allocations, growths): {grown:?}");
}
