//! The built-in task of mass centres where two who look alike cross.

use std::path::PathBuf;

use image::{Rgb, RgbImage};
use vt_core::frame::Frame;
use vt_core::lie::picture_from_plane;
use vt_core::random::{Random, Stream};
use vt_task::assembly::Scene;
use vt_task::{Document, Registry, check};

const FRAMES: u64 = 60;
const SIZE: [f64; 2] = [20.0, 50.0];

/// The target goes to the right, the other to the left and a little nearer to the camera.
fn walkers(frame: u64) -> [[f64; 2]; 2] {
    let k = frame as f64;
    [[50.0 + 3.0 * k, 80.0], [250.0 - 3.0 * k, 86.0]]
}

fn picture(frame: u64, alike: bool) -> RgbImage {
    let mut random = Random::new(11, Stream::Sim, 0, frame, 0);
    RgbImage::from_fn(320, 160, |x, y| {
        let on = |at: &[f64; 2]| {
            let d = [f64::from(x) - at[0], f64::from(y) - at[1]];
            // A body that is narrower than its box.
            4.0 * (d[0] / SIZE[0]).powi(2) + 4.0 * (d[1] / SIZE[1]).powi(2) <= 0.8
        };
        let [target, other] = walkers(frame).map(|at| on(&at));
        let texture = f64::from((x / 9 + y / 6) % 4) * 9.0;
        let base = match (target, other) {
            (_, true) if !alike => [40.0, 60.0, 150.0],
            (false, false) => [120.0 + texture, 125.0 + texture, 120.0],
            _ => [90.0, 35.0, 40.0],
        };
        Rgb(base.map(|c| (c + 3.0 * random.normal()).round().clamp(0.0, 255.0) as u8))
    })
}

/// Distance of the tracked centre from the true one in the last frame, and its covariance where both walkers meet over that before.
fn run(alike: bool, fusion: &str) -> (f64, f64) {
    let name = format!("walkers-{alike}-{}", fusion.split('\'').nth(1).unwrap_or_default());
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::create_dir_all(&folder).expect("a folder");
    for k in 0..FRAMES {
        picture(k, alike).save(folder.join(format!("{k:04}.png"))).expect("a picture");
    }
    let [x, y] = [0, 1].map(|k| walkers(0)[0][k] - 0.5 * SIZE[k] + 0.5);
    let set = [
        format!("sensors.camera.params={{folder='{}', rate='10 Hz'}}", folder.display()),
        format!("models.object.shape.params.size=['{} px', '{} px']", SIZE[0], SIZE[1]),
        format!("targets.object.init.params.box=['{x} px', '{y} px', '{} px', '{} px']", SIZE[0], SIZE[1]),
        format!("targets.object.fusion={fusion}"),
        "outputs=[]".into(),
    ];
    let task =
        PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../vt-apps/examples/src/own-motion-color.toml");
    let document = Document::load(&task, &set).expect("a task");
    let registry = Registry::standard();
    let task = check(&document, &registry).expect("a task");
    let mut scene = Scene::build(&document, &task, &registry).expect("a scene");
    let first: Frame = scene.sensors[0].next().expect("a picture").expect("a frame");
    let mut tracking =
        scene.tracking(&document, &task, &registry, core::slice::from_ref(&first)).expect("a tracker");
    let (mut next, mut error, mut spread) = (Some(first), f64::INFINITY, [0.0; 2]);
    for k in 0.. {
        let Some(frame) = next else { break };
        let report = &tracking.step([frame]).expect("a step")[0];
        assert!(report.failure.is_none(), "{:?}", report.failure);
        let pose = picture_from_plane(&report.posterior).expect("a flat pose");
        let [x, y] = walkers(k)[0];
        let apart = [pose.m13 - x, pose.m23 - y];
        error = (apart[0] * apart[0] + apart[1] * apart[1]).sqrt();
        // They overlap from frame 27 to 39.
        let part = usize::from((31..36).contains(&k));
        if (22..36).contains(&k) && !(26..31).contains(&k) {
            spread[part] += report.posterior.covariance[0].sqrt() / [4.0, 5.0][part];
        }
        next = scene.sensors[0].next().expect("a picture");
    }
    (error, spread[1] / spread[0])
}

#[test]
fn the_target_is_kept_when_one_who_looks_alike_crosses_its_way() {
    for alike in [false, true] {
        for fusion in ["{kind='stacked'}", "{kind='equivalent-measurements', params={feedback=true}}"] {
            let (error, wider) = run(alike, fusion);
            println!("{error:.2} px, {wider:.2} times as uncertain: alike {alike}, {fusion}");
            assert!(error < 0.5 * SIZE[0], "{error} px: alike {alike}, {fusion}");
            assert!(!alike || wider > 1.2, "{wider}: alike {alike}, {fusion}");
        }
    }
}
