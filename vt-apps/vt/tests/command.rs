//! The command as users see it: exit codes, messages, results.

use std::path::Path;
use std::process::{Command, Output};

fn vt(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_vt")).args(arguments).env("NO_COLOR", "1").output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn task() -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tasks/edge-pose.toml").display().to_string()
}

/// A small version of the simulated scene.
const SMALL: [&str; 4] =
    ["--set", "sensors.camera.params.frames=12", "--set", "outputs.overlays.params.every=6"];

fn run(out: &Path, more: &[&str]) -> Output {
    let out = out.display().to_string();
    let task = task();
    let arguments: Vec<&str> =
        ["run", &task, "--out", &out].into_iter().chain(SMALL).chain(more.iter().copied()).collect();
    vt(&arguments)
}

#[test]
fn a_run_writes_all_results_and_says_how_good_they_are() {
    let dir = tempfile::tempdir().unwrap();
    let output = run(dir.path(), &[]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let shown = text(&output.stdout);
    assert!(shown.contains("12 frames") && shown.contains("translation error: mean"), "{shown}");
    assert!(text(&output.stderr).is_empty(), "no progress bar without a terminal");
    for name in
        ["poses.tum", "covariances.csv", "steps.jsonl", "report.json", "contact_sheet.png", "overlays"]
    {
        assert!(dir.path().join(name).exists(), "{name}");
    }
    let report: serde_json::Value =
        serde_json::from_slice(&std::fs::read(dir.path().join("report.json")).unwrap()).unwrap();
    assert_eq!((report["frames"].as_u64(), report["interrupted"].as_bool()), (Some(12), Some(false)));
    let error = report["targets"][0]["errors"]["translation_mm"]["mean"].as_f64().unwrap();
    assert!(error < 1.0, "mean error {error} mm");
}

#[test]
fn results_are_the_same_bytes_at_any_number_of_threads_and_differ_by_seed() {
    let read = |more: &[&str]| {
        let dir = tempfile::tempdir().unwrap();
        let output = run(dir.path(), more);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        ["poses.tum", "covariances.csv", "steps.jsonl"].map(|n| std::fs::read(dir.path().join(n)).unwrap())
    };
    let one = read(&["--threads", "1"]);
    assert_eq!(one, read(&["--threads", "4"]));
    assert_ne!(one, read(&["--seed", "99"]));
}

#[test]
fn max_frames_ends_early_and_quiet_says_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let output = run(dir.path(), &["--max-frames", "3", "--quiet"]);
    assert_eq!((output.status.code(), text(&output.stdout)), (Some(0), String::new()));
    assert_eq!(std::fs::read_to_string(dir.path().join("steps.jsonl")).unwrap().lines().count(), 3);
}

#[test]
fn a_wrong_task_ends_with_code_2_and_shows_the_line() {
    let task = task();
    let output = vt(&["check", &task, "--set", "targets.bracket.estimator.kind=kalmn"]);
    assert_eq!(output.status.code(), Some(2));
    let shown = text(&output.stderr);
    for word in ["unknown estimator `kalmn`", "nearest: `kalman`", "particle"] {
        assert!(shown.contains(word), "{word} in {shown}");
    }
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("broken.toml");
    std::fs::write(&file, std::fs::read_to_string(&task).unwrap().replace("frames = 150", "frame = 150"))
        .unwrap();
    let output = vt(&["run", &file.display().to_string()]);
    assert_eq!(output.status.code(), Some(2));
    let shown = text(&output.stderr);
    assert!(shown.contains("broken.toml:12") && shown.contains("nearest: `frames`"), "{shown}");
    assert_eq!(vt(&["check", "no-such-file.toml"]).status.code(), Some(2));
    assert_eq!(vt(&["chekc"]).status.code(), Some(2));
}

#[test]
fn a_picture_that_cannot_be_read_ends_with_code_2_and_complete_outputs() {
    let dir = tempfile::tempdir().unwrap();
    for k in 0..3 {
        image_file(&dir.path().join(format!("f{k}.pgm")), k < 2);
    }
    let own = "sensors.camera={ name = 'camera', kind = 'images', \
               params = { pattern = 'PLACE/f%d.pgm', last = 2, rate = '25 Hz' }, \
               camera = { size = [64, 48], focal = ['60 px', '60 px'], center = ['31.5 px', '23.5 px'] } }";
    let own = own.replace("PLACE", &dir.path().display().to_string());
    let init = "targets.bracket.init={ kind = 'pose', params = { camera_from_object = { translation = ['0 m', '0 m', \
                '0.5 m'] }, sigma = { translation = '1 mm', rotation = '1 deg' } } }";
    let out = dir.path().join("out").display().to_string();
    let task = dir.path().join("t.toml");
    let text_of = std::fs::read_to_string(self::task()).unwrap();
    let without_truth: Vec<&str> = text_of.lines().filter(|l| !l.starts_with("truth")).collect();
    std::fs::write(&task, without_truth.join("\n")).unwrap();
    let output = vt(&["run", &task.display().to_string(), "--out", &out, "--set", &own, "--set", init]);
    assert_eq!(output.status.code(), Some(2), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("f2.pgm"));
    let report = std::fs::read_to_string(Path::new(&out).join("report.json")).unwrap();
    assert!(report.contains("\"interrupted\": true"));
}

/// A grey picture in the PGM format, or a file that is none.
fn image_file(path: &Path, good: bool) {
    let mut bytes = b"P5\n64 48\n255\n".to_vec();
    bytes.extend([90_u8; 64 * 48]);
    std::fs::write(path, if good { bytes } else { b"nothing".to_vec() }).unwrap();
}

#[test]
fn explain_schema_and_list_print() {
    let task = task();
    let sheet = text(&vt(&["explain", &task]).stdout);
    for row in [
        "Shape & appearance",
        "Features",
        "Warp",
        "State",
        "Dynamics",
        "Sensor",
        "Processing & measurement",
        "Likelihood",
        "Tracker",
        "Output",
        "Loss detection",
        "Re-initialisation",
    ] {
        assert!(sheet.contains(row), "{row} in {sheet}");
    }
    let schema: serde_json::Value = serde_json::from_slice(&vt(&["schema"]).stdout).unwrap();
    let kinds = schema["$defs"]["role-estimator"]["oneOf"].as_array().unwrap();
    assert!(kinds.iter().any(|k| k["properties"]["kind"]["const"] == "kalman"));
    assert!(text(&vt(&["list"]).stdout).contains("constant-velocity"));
}

#[cfg(unix)]
#[test]
fn ctrl_c_ends_the_run_with_complete_outputs() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().display().to_string();
    let task = task();
    let mut child = Command::new(env!("CARGO_BIN_EXE_vt"))
        .args(["run", &task, "--out", &out, "--set", "sensors.camera.params.frames=100000"])
        .stdout(std::process::Stdio::null())
        .spawn()
        .unwrap();
    let steps = dir.path().join("steps.jsonl");
    while std::fs::read_to_string(&steps).map_or(0, |t| t.lines().count()) < 2 {
        assert!(child.try_wait().unwrap().is_none(), "the run ended by itself");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    let killed = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(killed.success());
    assert_eq!(child.wait().unwrap().code(), Some(130));
    let report = std::fs::read_to_string(dir.path().join("report.json")).unwrap();
    assert!(report.contains("\"interrupted\": true"));
    assert!(dir.path().join("contact_sheet.png").exists());
}

#[test]
fn model_inspect_reports_and_draws() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("cube.obj");
    let corners = (0..8).map(|i| format!("v {} {} {}\n", i & 1, i >> 1 & 1, i >> 2));
    let faces = "f 1 5 7 3\nf 2 4 8 6\nf 1 2 6 5\nf 3 7 8 4\nf 1 3 4 2\nf 5 6 8 7\n";
    std::fs::write(&file, corners.collect::<String>() + faces).unwrap();
    let (file, sheet) = (file.display().to_string(), dir.path().join("sheet.png"));
    let output = vt(&["model", "inspect", &file, "--unit", "cm", "--out", &sheet.display().to_string()]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let shown = text(&output.stdout);
    for part in ["obj, lengths in cm", "10.0000 mm x 10.0000 mm", "12 creases", "no problems", "4-fold about"]
    {
        assert!(shown.contains(part), "{part} in {shown}");
    }
    let picture = image::open(&sheet).unwrap().to_rgb8();
    let count = |colour: [u8; 3]| picture.pixels().filter(|p| p.0 == colour).count();
    assert!(count([220, 60, 20]) > 1000 && count([30, 90, 200]) > 1000, "contours and creases");
    let output = vt(&["model", "inspect", &file, "--json"]);
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((json["edges"]["creases"].as_u64(), json["polygons"].as_u64()), (Some(12), Some(6)));
    assert_eq!(json["symmetries"]["rotational"][0]["order"].as_u64(), Some(4));
    std::fs::write(dir.path().join("bad.stl"), "no model").unwrap();
    for (bad, reason) in
        [("bad.stl", "header of 84 bytes"), ("absent.ply", "cannot be read"), ("a.step", "expected one of")]
    {
        let output = vt(&["model", "inspect", &dir.path().join(bad).display().to_string()]);
        assert_eq!(output.status.code(), Some(2), "{bad}");
        assert!(text(&output.stderr).contains(reason), "{bad}: {}", text(&output.stderr));
    }
}
