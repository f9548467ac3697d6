//! Runs against truth: the start, the resets, the table of several sequences.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn task() -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tasks/edge-pose.toml").display().to_string()
}

fn vt(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_vt")).args(arguments).env("NO_COLOR", "1").output().unwrap()
}

/// Runs a small version of the simulated scene; gives what is printed.
fn run(out: &Path, more: &[&str]) -> String {
    let (task, out) = (task(), out.display().to_string());
    let small = ["--set", "sensors.camera.params.frames=12", "--set", "outputs.overlays.params.every=0"];
    let arguments: Vec<&str> =
        ["run", &task, "--out", &out].into_iter().chain(small).chain(more.iter().copied()).collect();
    let output = vt(&arguments);
    let error = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{error}");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Lines without comments, as words.
fn lines(file: &Path) -> Vec<Vec<String>> {
    let text = std::fs::read_to_string(file).unwrap();
    let lines = text.lines().filter(|l| !l.starts_with('#'));
    lines.map(|l| l.split(' ').map(str::to_owned).collect()).collect()
}

fn numbers(line: &[String]) -> Vec<f64> {
    line.iter().map(|w| w.parse().unwrap()).collect()
}

/// Poses of the scene that are good enough to be taken for true, with frame `wrong` moved by 10 cm along the depth.
fn truth(dir: &Path, wrong: Option<usize>) -> PathBuf {
    let out = dir.join("first");
    run(&out, &[]);
    let mut poses = lines(&out.join("poses.tum"));
    assert_eq!(poses.len(), 12);
    if let Some(k) = wrong {
        poses[k][3] = format!("{:.9e}", poses[k][3].parse::<f64>().unwrap() + 0.1);
    }
    let file = dir.join("truth.tum");
    std::fs::write(&file, poses.iter().map(|l| l.join(" ") + "\n").collect::<String>()).unwrap();
    file
}

#[test]
fn the_truth_gives_the_start_and_nothing_else() {
    let dir = tempfile::tempdir().unwrap();
    let file = truth(dir.path(), Some(6));
    let out = dir.path().join("out");
    let shown = run(&out, &["--truth", &file.display().to_string()]);
    assert!(shown.contains("success 90.9 % (10 of 11 frames, put to the truth 0 times)"), "{shown}");
    let (found, given) = (lines(&out.join("estimates.tum")), lines(&file));
    assert_eq!(found.len(), 12, "one line a frame");
    // Writing and reading normalises the quaternion again.
    for (a, b) in numbers(&found[0]).iter().zip(numbers(&given[0])) {
        assert!((a - b).abs() < 1e-9, "the first pose is {a}, not the given {b}");
    }
    // The task starts 5 mm beside it; this run does not.
    let steps = std::fs::read_to_string(out.join("steps.jsonl")).unwrap();
    let step: serde_json::Value = serde_json::from_str(steps.lines().next().unwrap()).unwrap();
    for k in 0..7 {
        let start = step["prediction"]["coordinates"][k].as_f64().unwrap();
        assert!((start - numbers(&given[0])[k + 1]).abs() < 1e-8);
    }
    // The wrong pose of frame 6 has moved nothing.
    for k in 7..12 {
        let error = numbers(&found[k])[3] - numbers(&given[k])[3];
        assert!(error.abs() < 2e-3, "frame {k}: {error} m");
    }
}

#[test]
fn a_failed_frame_is_written_before_the_reset_that_follows_it() {
    let dir = tempfile::tempdir().unwrap();
    let file = truth(dir.path(), Some(6));
    let out = dir.path().join("out");
    let shown = run(&out, &["--truth", &file.display().to_string(), "--reset-on-failure", "5cm,5deg"]);
    let (found, given) = (lines(&out.join("estimates.tum")), lines(&file));
    assert_eq!(found.len(), 12);
    let error = |k: usize| numbers(&found[k])[3] - numbers(&given[k])[3];
    // The tracker was right and the truth wrong by 10 cm: the file says where the tracker was.
    assert!((error(6) + 0.1).abs() < 2e-3, "{}", error(6));
    // It was put 10 cm away and at rest, from where the next frame starts.
    let steps = std::fs::read_to_string(out.join("steps.jsonl")).unwrap();
    let step: serde_json::Value = serde_json::from_str(steps.lines().nth(7).unwrap()).unwrap();
    for k in 0..7 {
        let start = step["prediction"]["coordinates"][k].as_f64().unwrap();
        assert!((start - numbers(&given[6])[k + 1]).abs() < 1e-8);
    }
    for k in (1..6).chain(9..12) {
        assert!(error(k).abs() < 2e-3, "frame {k}: {}", error(k));
    }
    assert!(shown.contains("put to the truth"), "{shown}");
    // Limits that hold for every frame reset nothing.
    let shown = run(&out, &["--truth", &file.display().to_string(), "--reset-on-failure", "20cm,5deg"]);
    assert!(shown.contains("success 100.0 % (11 of 11 frames, put to the truth 0 times)"), "{shown}");
}

#[test]
fn what_does_not_fit_is_said_before_or_while_running() {
    let dir = tempfile::tempdir().unwrap();
    let (task, out) = (task(), dir.path().join("out").display().to_string());
    let file = dir.path().join("t.tum");
    std::fs::write(&file, "0 0 0 0.45 0 0 0 1\n1 0 0 0.45 0 0 0 1\n").unwrap();
    let file = file.display().to_string();
    let late = dir.path().join("late.tum");
    std::fs::write(&late, "5 0 0 0.45 0 0 0 1\n").unwrap();
    let late = late.display().to_string();
    let cases: [(&[&str], i32, &[&str]); 7] = [
        (&["--truth", &file, "--reset-on-failure", "5,5"], 2, &["with a unit"]),
        (&["--reset-on-failure", "5cm,5deg"], 2, &["--truth"]),
        (&["--truth", &file, "--sequences", "x"], 2, &["cannot be used with"]),
        (&["--truth", "nowhere.tum"], 2, &["nowhere.tum"]),
        (&["--truth", "other=nowhere.tum"], 2, &["other=nowhere.tum"]),
        (&["--truth", &late], 2, &["truth without frame 0"]),
        (&["--truth", &file, "--reset-on-failure", "5cm,5deg"], 2, &["bracket", "no frame 2"]),
    ];
    for (arguments, code, words) in cases {
        let all: Vec<&str> =
            ["run", &task, "--out", &out, "--max-frames", "5"].iter().chain(arguments).copied().collect();
        let output = vt(&all);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {message}");
        words.iter().for_each(|w| assert!(message.contains(w), "{w} in {message}"));
    }
}

#[test]
fn sequences_give_a_file_each_and_a_table_in_three_forms() {
    let dir = tempfile::tempdir().unwrap();
    let good = std::fs::read_to_string(truth(dir.path(), None)).unwrap();
    let wrong = std::fs::read_to_string(truth(dir.path(), Some(6))).unwrap();
    let data = dir.path().join("data");
    for (name, poses) in [("b_calm", &good), ("a_calm", &wrong), ("notes", &good)] {
        std::fs::create_dir_all(data.join(name)).unwrap();
        std::fs::write(data.join(name).join("poses.tum"), poses).unwrap();
        if name != "notes" {
            std::fs::write(data.join(name).join("camera.txt"), "700 700 319.5 239.5 640 480\n").unwrap();
        }
    }
    let out = dir.path().join("out");
    let shown =
        run(&out, &["--sequences", &data.display().to_string(), "--set", "outputs=[{ kind = 'report' }]"]);
    assert_eq!(
        std::fs::read_to_string(out.join("table.txt")).unwrap(),
        shown.split("results are").next().unwrap()
    );
    assert!(shown.contains("online protocol") && shown.contains("mean calm"), "{shown}");
    let table: serde_json::Value =
        serde_json::from_slice(&std::fs::read(out.join("table.json")).unwrap()).unwrap();
    let rows = table["sequences"].as_array().unwrap();
    let of = |k: usize| {
        (rows[k]["sequence"].as_str(), rows[k]["frames"].as_u64(), rows[k]["first_failure"].as_u64())
    };
    assert_eq!((of(0), of(1)), ((Some("a_calm"), Some(11), Some(6)), (Some("b_calm"), Some(11), None)));
    assert!((rows[0]["success_percent"].as_f64().unwrap() - 1000.0 / 11.0).abs() < 1e-9);
    assert!(rows[1]["median_mm"].as_f64().unwrap() < 1.0 && rows[1]["cpu_ms"].as_f64().unwrap() > 0.0);
    let csv = std::fs::read_to_string(out.join("table.csv")).unwrap();
    assert!(
        csv.starts_with("sequence,frames,success_percent,") && csv.contains("\na_calm,11,90.9,"),
        "{csv}"
    );
    for name in ["a_calm", "b_calm"] {
        assert_eq!(lines(&out.join(format!("{name}.tum"))).len(), 12);
        assert!(out.join(name).join("report.json").exists());
    }
    let empty = vt(&["run", &task(), "--sequences", &out.display().to_string()]);
    assert_eq!(empty.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&empty.stderr).contains("no sequence"));
}
