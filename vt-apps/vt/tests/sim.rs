//! `vt sim` as users see it: recordings that `vt run` tracks.

use std::path::Path;
use std::process::{Command, Output};

fn vt(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_vt")).args(arguments).env("NO_COLOR", "1").output().unwrap()
}

fn succeed(arguments: &[&str]) -> String {
    let output = vt(arguments);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {errors}");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn numbers(path: &Path) -> Vec<f64> {
    let text = std::fs::read_to_string(path).unwrap();
    let lines = text.lines().filter(|l| !l.starts_with('#'));
    lines.flat_map(str::split_whitespace).map(|w| w.parse().unwrap()).collect()
}

#[test]
fn every_scenario_is_recorded_and_its_recording_is_a_task_that_runs() {
    let dir = tempfile::tempdir().unwrap();
    let list = succeed(&["sim", "--list"]);
    let names: Vec<&str> = list.lines().map(|l| l.split_whitespace().next().unwrap()).collect();
    assert!(names.len() >= 12, "{list}");
    for name in names {
        let folder = dir.path().join(name);
        let (out, task) = (folder.display().to_string(), folder.join("task.toml").display().to_string());
        let shown = succeed(&["sim", name, "--out", &out, "--frames", "3"]);
        assert!(shown.contains("frames in"), "{shown}");
        let results = folder.join("results").display().to_string();
        let shown = succeed(&["run", &task, "--out", &results, "--set", "outputs.overlays.params.every=9"]);
        assert!(shown.contains("translation error"), "{name}: {shown}");
    }
    let camera = dir.path().join("two-objects/camera");
    for file in ["truth-house.tum", "truth-stairs.tum", "timestamps.txt", "camera.toml", "images/000002.png"]
    {
        assert!(camera.join(file).exists(), "{file}");
    }
    let visible = std::fs::read_to_string(camera.join("visible.csv")).unwrap();
    assert!(visible.starts_with("frame,house,stairs\n0,0.") && visible.lines().count() == 4, "{visible}");
}

#[test]
fn a_recording_is_tracked_as_the_simulation_itself() {
    let dir = tempfile::tempdir().unwrap();
    let place = |name: &str| dir.path().join(name).display().to_string();
    let scenario =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/smooth.toml").display().to_string();
    let fewer = ["--set", "sensors.camera.params.frames=8", "--seed", "5"];
    succeed(&[&["sim", &scenario, "--out", &place("recorded")], &fewer[..]].concat());
    succeed(&[&["run", &scenario, "--out", &place("direct")], &fewer[..]].concat());
    succeed(&["run", &place("recorded/task.toml"), "--out", &place("again")]);
    let [a, b] = ["direct", "again"].map(|name| numbers(&dir.path().join(name).join("poses.tum")));
    assert_eq!((a.len(), b.len()), (64, 64));
    // The truth, from which both start, is written with ten digits.
    assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-6), "{a:?} {b:?}");
    // A second recording in the same folder would mix the pictures of both.
    let refused = vt(&["sim", &scenario, "--out", &place("recorded")]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("not empty"));
}

#[test]
fn wrong_names_and_values_end_with_code_2() {
    for (arguments, word) in [
        (&["sim", "smoth"][..], "nearest: smooth"),
        (&["sim", "no/file.toml"], "no/file.toml"),
        (&["sim", "still", "--set", "sensors.camera.params.exposure=2"], "from 0 to 1"),
        (&["sim", "still", "--frames", "0"], "at least 1 frame"),
        (&["sim"], "SCENARIO"),
    ] {
        let output = vt(arguments);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {errors}");
        assert!(errors.contains(word), "{word} in {errors}");
    }
}
