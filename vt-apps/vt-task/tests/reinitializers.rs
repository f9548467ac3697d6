//! Flat targets that are hidden for a while come back, by every re-initialiser that a task can name.

use std::path::Path;

use vt_core::report::Status;
use vt_task::assembly::Scene;
use vt_task::{Document, Registry, check};

const FRAMES: usize = 60;

const TASK: &str = r#"
version = 1
seed = 3
[[sensors]]
name = "camera"
kind = "simulated-planar"
picture = "colour"
params = { model = "card", size = [240, 180], frames = 60, rate = "25 Hz", translation = "1 px", colours = 2, occlusions = [[20, 31]] }
[[models]]
name = "card"
shape = { kind = "rectangle", params = { size = ["60 px", "40 px"] } }
warp = { kind = "translation" }
dynamics = { kind = "brownian", params = { translation = "10 px/s^0.5" } }
[[targets]]
name = "card"
model = "card"
init = { kind = "box", params = { box = ["90 px", "70 px", "60 px", "40 px"], sigma = { translation = "1 px" } } }
modalities = [{ kind = "color", level = "pixel", sensor = "camera" }]
estimator = { kind = "particle" }
loss = { kind = "fused", params = { bias = -12.0, unsupported = 20.0, log_ratio = 0.0, misfit = 0.0, surprise = 0.0, spread = 0.0, least = -8.0, doubt = 0.5 } }
reinit = { kind = "none" }
"#;

fn document(reinit: &str) -> Document {
    let text = TASK.replace(r#"reinit = { kind = "none" }"#, &format!("reinit = {reinit}"));
    Document::parse("task", &text, Path::new("/"), &[], &|_| None).expect("a text")
}

/// Conditions, frame by frame.
fn conditions(reinit: &str) -> Vec<Status> {
    let (document, registry) = (document(reinit), Registry::standard());
    let task = check(&document, &registry).unwrap_or_else(|e| panic!("{reinit}: {e:?}"));
    let mut scene = Scene::build(&document, &task, &registry).expect("a scene");
    let mut frame = scene.sensors[0].next().expect("a frame");
    let frames: Vec<_> = frame.iter().cloned().collect();
    let mut tracking = scene.tracking(&document, &task, &registry, &frames).expect("a tracker");
    let mut out = vec![];
    while let Some(now) = frame.take() {
        let report = &tracking.step([now]).expect("a step")[0];
        assert_eq!(report.failure, None, "{reinit}");
        out.push(report.verdict.status);
        frame = scene.sensors[0].next().expect("a frame");
    }
    out
}

#[test]
fn a_hidden_target_is_lost_and_comes_back() {
    let all = [
        r#"{ kind = "prior" }"#,
        r#"{ kind = "centre", params = { sigma = { translation = "10 px" } } }"#,
        r#"{ kind = "chamfer" }"#,
        r#"{ kind = "back-projection" }"#,
    ];
    for reinit in all {
        let seen = conditions(reinit);
        assert_eq!(seen.len(), FRAMES);
        assert!(seen[25..=31].contains(&Status::Lost), "{reinit}: {seen:?}");
        assert!(seen[42..].iter().all(|s| *s == Status::Tracking), "{reinit}: {seen:?}");
    }
}

#[test]
fn broken_reinitializers_are_refused_before_the_first_frame() {
    let wrong = [
        (r#"{ kind = "chamfr" }"#, "chamfer"),
        (r#"{ kind = "chamfer", params = { turn = "200 deg" } }"#, "half a turn"),
        (r#"{ kind = "chamfer", params = { magnification = 0.5 } }"#, "a factor from 1 to 4"),
        (r#"{ kind = "chamfer", params = { proposals = 0 } }"#, "at least 1"),
        (r#"{ kind = "chamfer", params = { last_trusted = -1.0 } }"#, "a number from 0"),
        (r#"{ kind = "chamfer", params = { chamfer = { sigma = "0 px" } } }"#, "a positive number"),
        (r#"{ kind = "centre" }"#, "sigma"),
        (
            r#"{ kind = "centre", params = { sigma = { translation = "-1 px" } } }"#,
            "zero or a positive value",
        ),
        (r#"{ kind = "back-projection", params = { proposals = 0 } }"#, "1 to 100"),
        (r#"{ kind = "back-projection", params = { last_trusted = -1.0 } }"#, "a number from 0"),
        (r#"{ kind = "views" }"#, "se3"),
    ];
    for (reinit, expected) in wrong {
        let e = check(&document(reinit), &Registry::standard()).err().map(|e| format!("{e:?}"));
        let e = e.unwrap_or_else(|| panic!("{reinit} was taken"));
        assert!(e.contains(expected), "{reinit}: {e}");
    }
}
