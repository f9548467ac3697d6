//! A step of the tracking loop takes no memory once it has warmed up; nor do sensors that need no decoder of pictures.

use std::alloc::System;
use std::path::PathBuf;

use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use vt_core::agent::Sensor;
use vt_core::error::DeviceError;
use vt_core::frame::{Frame, SensorId};
use vt_fusion::tracking::TrackingLoop;
use vt_io::images::Conversion;
use vt_io::video::{Settings, Video};
use vt_task::assembly::Scene;
use vt_task::{Document, Registry, check};
use vt_tests::data;
use vt_tests::replay::Replay;

#[global_allocator]
static GLOBAL: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

fn task(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../vt-apps/tasks").join(name)
}

/// One test, lest others take memory beside it. On a thread of the pool, since jobs from outside take some now and then, and on one alone, since each
/// warms up by itself, whenever it first gets something to do.
#[test]
fn steps_after_the_tenth_allocate_nothing() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("threads");
    pool.install(|| {
        flat_targets();
        if data::root("VISP_IMAGES").is_some() {
            rigid_bodies();
        }
        if let Some(root) = data::root("VT_DATA") {
            video(root.join("pets/View_001.mp4"));
        }
    });
}

/// Frames from the simulated camera to the posterior.
fn flat_targets() {
    let start = "targets.object.init.params.box=['90 px', '50 px', '60 px', '80 px']";
    let outline = "targets.object.init.params.picture_from_object.translation=['119.5 px', '89.5 px']";
    let small = "models.object.shape.params.width='60 px'";
    let adapt = "adapt = { time = '1 s', anchor = 0.5 }";
    let learnt = |modalities: &str| {
        let modalities = format!("targets.object.modalities={modalities}").replace("ADAPT", adapt);
        modalities.replace("LEVEL", "level = 'pixel', sensor = 'camera'")
    };
    let adapted = learnt(
        "[{ kind = 'color', LEVEL, params = { rows = 2, ADAPT } }, { kind = 'template', LEVEL, params = { ADAPT } }]",
    );
    let everything = learnt(
        "[{ kind = 'color', LEVEL }, { kind = 'template', LEVEL }, { kind = 'contour', LEVEL }, { kind = 'chamfer', LEVEL }]",
    );
    let search = format!("targets.object.reinit={{ kind = 'back-projection', params = {{ {adapt} }} }}");
    let (kalman, fused) = ("targets.object.estimator={ kind = 'kalman' }", |fusion: &str| {
        format!("targets.object.fusion={{ kind = '{fusion}' }}")
    });
    let (sequential, summed) = (fused("sequential"), fused("information-sum"));
    let (equivalent, intersection) = (fused("equivalent-measurements"), fused("intersection"));
    let cases: [(&str, &[&str]); 9] = [
        ("contour-condensation.toml", &[outline, small]),
        ("color-particle.toml", &[start]),
        ("color-particle.toml", &[start, &adapted, &search]),
        ("color-particle.toml", &[start, &everything, kalman]),
        ("color-particle.toml", &[start, &everything, kalman, &sequential]),
        ("color-particle.toml", &[start, &everything, kalman, &summed]),
        ("motion-color-kalman.toml", &[start]),
        ("motion-color-kalman.toml", &[start, &equivalent]),
        ("motion-color-kalman.toml", &[start, &intersection]),
    ];
    for (name, set) in cases {
        let short = ["sensors.camera.params.frames=40", "sensors.camera.params.size=[240, 180]"];
        let set: Vec<String> = short.iter().chain(set).map(|s| (*s).to_owned()).collect();
        let registry = Registry::standard();
        let document = Document::load(&task(name), &set).expect("the task loads");
        let task = check(&document, &registry).unwrap_or_else(|e| panic!("{name} {set:?}: {e:?}"));
        let mut scene = Scene::build(&document, &task, &registry).expect("a scene");
        let first = [scene.sensors[0].next().expect("a camera").expect("a frame")];
        let mut tracking = scene.tracking(&document, &task, &registry, &first).expect("a tracker");
        let [first] = first;
        let mut first = Some(first);
        takes_nothing(&format!("{name} {set:?}"), &mut tracking, || match first.take() {
            Some(frame) => Ok(Some(frame)),
            None => scene.sensors[0].next(),
        });
    }
}

/// Steps alone: files of pictures are decoded anew.
fn rigid_bodies() {
    let object = ["targets.cube.modalities.edges.level=object", "targets.cube.estimator.params.iterations=1"];
    for set in [&[][..], &object] {
        let replay = Replay::load(task("cube.toml"), set).expect("the task loads");
        let (mut tracking, _) = replay.start().expect("the task starts");
        let mut frames = replay.frames().iter().cloned();
        takes_nothing("cube", &mut tracking, || Ok(frames.next()));
    }
}

/// Frames of the decoder.
fn video(path: PathBuf) {
    for conversion in [Conversion::Grey, Conversion::Rgb] {
        let settings = Settings { conversion, frames: Some(30), ..Settings::default() };
        let mut video = Video::open(SensorId(0), &path, settings).expect("a video");
        let mut next = || video.next().expect("a frame").map(|frame| frame.number);
        (0..10).for_each(|_| assert!(next().is_some()));
        let region = Region::new(GLOBAL);
        // The end of the stream may take some.
        (10..28).for_each(|_| assert!(next().is_some()));
        assert_eq!((next(), region.change().allocations), (Some(28), 0), "{conversion:?}");
    }
}

fn takes_nothing(
    name: &str,
    tracking: &mut TrackingLoop,
    mut next: impl FnMut() -> Result<Option<Frame>, DeviceError>,
) {
    let (mut grown, mut steps) = (vec![], 0);
    loop {
        let region = Region::new(GLOBAL);
        let Some(frame) = next().expect("a frame") else { break };
        tracking.step([frame]).expect("a step");
        let change = region.change();
        if steps >= 10 && change.allocations + change.reallocations > 0 {
            grown.push((steps, change.allocations, change.reallocations));
        }
        steps += 1;
    }
    assert!(steps > 30, "{name}: {steps} steps");
    assert!(grown.is_empty(), "{name}: steps that took memory (step, allocations, growths): {grown:?}");
}
