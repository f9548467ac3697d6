//! Sensors of pictures without a camera: a simulated flat scene, a video.

use std::path::Path;

use vt_core::agent::Sensor;
use vt_core::frame::{Frame, Payload};
use vt_task::assembly::Scene;
use vt_task::{Document, Registry, check};

const TASK: &str = r#"
version = 1
[[sensors]]
name = "camera"
kind = "simulated-planar"
picture = "colour"
params = { model = "card", frames = 3, rate = "25 Hz", translation = "4 px", rotation = "2 deg", scale = 0.01, colours = 2 }
[[models]]
name = "card"
shape = { kind = "rectangle", params = { size = ["60 px", "40 px"] } }
warp = { kind = "sim2" }
dynamics = { kind = "brownian", params = { translation = "20 px/s^0.5", rotation = "10 deg/s^0.5", scale = "5 %/s^0.5" } }
[[targets]]
name = "card"
model = "card"
init = { kind = "box", params = { box = ["290 px", "220 px", "60 px", "40 px"], sigma = { translation = "2 px" } } }
modalities = [{ kind = "color", level = "pixel", sensor = "camera" }]
estimator = { kind = "particle" }
"#;

/// Checks nothing but the sensor: the rest of the task is there because a task has it.
fn frames(set: &[&str]) -> Result<Vec<Frame>, String> {
    let set: Vec<String> = set.iter().map(|s| (*s).to_owned()).collect();
    let document = Document::parse("task", TASK, Path::new("/"), &set, &|_| None).unwrap();
    let registry = Registry::standard();
    let task = document.task().map_err(|e| format!("{e:?}"))?;
    let mut scene = Scene::build(&document, &task, &registry).map_err(|e| format!("{e:?}"))?;
    let sensor: &mut Box<dyn Sensor> = &mut scene.sensors[0];
    Ok(std::iter::from_fn(|| sensor.next().unwrap()).collect())
}

#[test]
fn a_flat_scene_is_drawn() {
    let all = frames(&[]).unwrap();
    assert_eq!(all.len(), 3);
    assert!(all.iter().all(|f| matches!(&f.payload, Payload::Rgb(p) if p.dimensions() == (640, 480))));
    let e = frames(&["sensors.camera.params.size=[50, 50]"]).unwrap_err();
    assert!(e.contains("fits into 50x50"), "{e}");
    let e = frames(&["sensors.camera.params.contrast=300"]).unwrap_err();
    assert!(e.contains("contrast"), "{e}");
}

#[test]
fn a_video_that_is_none_is_an_error_before_the_first_frame() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("broken.mp4");
    std::fs::write(&file, "no video").unwrap();
    let sensor = format!("sensors.camera.params={{ file = '{}' }}", file.display());
    let e = frames(&["sensors.camera.kind='video'", &sensor]).unwrap_err();
    // Where the program is not installed it says that.
    assert!(e.contains("expected a video") || e.contains("install the package `ffmpeg`"), "{e}");
    let document = |params: &str| {
        let set = ["sensors.camera.kind='video'".to_owned(), format!("sensors.camera.params={params}")];
        let document = Document::parse("task", TASK, Path::new("/"), &set, &|_| None).unwrap();
        format!("{:?}", check(&document, &Registry::standard()).unwrap_err())
    };
    assert!(document("{ file = '/none.mp4' }").contains("none.mp4"));
    assert!(document(&format!("{{ file = '{}', frames = 0 }}", file.display())).contains("at least 1 frame"));
    assert!(document(&format!("{{ file = '{}', rate = '0 Hz' }}", file.display())).contains("positive rate"));
}

/// Wrong mass centres say what is wrong and what would be right.
#[test]
fn broken_mass_centres_are_refused_before_the_first_frame() {
    let problem = |modality: &str, set: &[&str]| {
        let text = TASK.replace(r#"{ kind = "color", level = "pixel", sensor = "camera" }"#, modality);
        let set: Vec<String> = set.iter().map(|s| (*s).to_owned()).collect();
        let document = Document::parse("task", &text, Path::new("/"), &set, &|_| None).unwrap();
        check(&document, &Registry::standard()).err().map(|e| format!("{e:?}"))
    };
    let centre = |kind: &str, level: &str, params: &str| {
        format!(r#"{{ kind = "{kind}", level = "{level}", sensor = "camera", params = {{ {params} }} }}"#)
    };
    for kind in ["motion-centre", "color-centre"] {
        assert_eq!(problem(&centre(kind, "object", ""), &[]), None);
        let e = problem(&centre(kind, "pixel", ""), &[]).unwrap();
        assert!(e.contains("object"), "{e}");
        let e = problem(&centre(kind, "object", "centre = { sharpness = 0.0 }"), &[]).unwrap();
        assert!(e.contains("a positive number"), "{e}");
        let e = problem(&centre(kind, "object", "centre = { shrpness = 2.0 }"), &[]).unwrap();
        assert!(e.contains("shrpness") && e.contains("sharpness"), "{e}");
    }
    let e = problem(&centre("motion-center", "object", ""), &[]).unwrap();
    assert!(e.contains("motion-centre"), "{e}");
    let e = problem(&centre("motion-centre", "object", "duration = '0 s'"), &[]).unwrap();
    assert!(e.contains("a positive number of seconds"), "{e}");
    let e = problem(&centre("motion-centre", "object", "compared = 'stil'"), &[]).unwrap();
    assert!(e.contains("still"), "{e}");
    let e = problem(&centre("color-centre", "object", "prior = 1.0"), &[]).unwrap();
    assert!(e.contains("between 0 and 1"), "{e}");
    let e = problem(&centre("color-centre", "object", "reference = 'none.png'"), &[]).unwrap();
    assert!(e.contains("none.png"), "{e}");
    let e = problem(&centre("color-centre", "object", ""), &["sensors.camera.picture=grey"]).unwrap();
    assert!(e.contains("colour"), "{e}");
    let fading = "models.card.dynamics={ kind = 'fading-velocity', params = { fades_in = '0 s', acceleration = { translation = '1 px/s^1.5' }, speed = { translation = '1 px/s' } } }";
    let e = problem(&centre("color-centre", "object", ""), &[fading]).unwrap();
    assert!(e.contains("a positive time"), "{e}");
}
