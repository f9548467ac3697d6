//! `vt eval` as users see it. The expected scores were made once with an independent program (NumPy) from the same
//! files.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

fn data(name: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/eval").join(name).display().to_string()
}

fn eval(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_vt")).arg("eval").args(arguments).output().unwrap()
}

fn scores(arguments: &[&str]) -> Value {
    let output = eval(arguments);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn golden(name: &str) -> Value {
    serde_json::from_str(&std::fs::read_to_string(data(name)).unwrap()).unwrap()
}

/// Every figure of `expected` is in `found`, to the printed digit.
fn agree(found: &Value, expected: &Value, at: &str) {
    match (found, expected) {
        (Value::Object(f), Value::Object(e)) => {
            e.iter().for_each(|(k, v)| agree(&f[k], v, &format!("{at}.{k}")))
        }
        (Value::Number(f), Value::Number(e)) => assert_eq!(f.as_f64(), e.as_f64(), "{at}"),
        _ => assert_eq!(found, expected, "{at}"),
    }
}

#[test]
fn the_scores_are_those_of_the_reference_program() {
    let (estimates, truth, cov) = (data("estimates.tum"), data("truth.tum"), data("covariances.csv"));
    let found = scores(&[&estimates, "--truth", &truth, "--cov", &cov, "--json"]);
    agree(&found, &golden("golden.json"), "");
    let matrices = data("matrices");
    agree(&scores(&[&estimates, "--truth", &matrices, "--json"]), &golden("golden_matrices.json"), "");
}

#[test]
fn a_model_adds_its_distances() {
    let dir = tempfile::tempdir().unwrap();
    let (truth, model) = (data("truth.tum"), data("box.obj"));
    let text = std::fs::read_to_string(&truth).unwrap();
    // Moved by 3 mm along the depth: so is every point; and one frame of 24 is missing.
    let moved: Vec<String> = text
        .lines()
        .filter(|l| !l.starts_with(['#', '5']))
        .map(|l| {
            let mut words: Vec<String> = l.split(' ').map(str::to_owned).collect();
            words[3] = format!("{:.9}", words[3].parse::<f64>().unwrap() + 0.003);
            words.join(" ")
        })
        .collect();
    let file = dir.path().join("moved.tum").display().to_string();
    std::fs::write(&file, moved.join("\n")).unwrap();
    let found = scores(&[&file, "--truth", &truth, "--model", &model, "--unit", "m", "--json"]);
    for name in ["add_mm", "add_s_mm"] {
        assert_eq!(
            (found[name]["mean"].as_f64(), found[name]["max"].as_f64()),
            (Some(3.0), Some(3.0)),
            "{name}"
        );
    }
    // 1 - 3 mm / 10 cm of the frames there are.
    let auc = found["add_auc_10cm"].as_f64().unwrap();
    assert!((auc - 0.97 * 23.0 / 24.0).abs() < 1e-4, "{auc}");
    let text = eval(&[&file, "--truth", &truth, "--model", &model, "--unit", "m"]);
    let text = String::from_utf8_lossy(&text.stdout).into_owned();
    assert!(text.contains("23 of 24 frames") && text.contains("ADD-S mm") && text.contains("AUC"), "{text}");
    assert_eq!(
        eval(&[&file, "--truth", &truth, "--model", &model]).status.code(),
        Some(2),
        "units are mandatory"
    );
}

#[test]
fn errors_are_plotted_as_png_and_svg() {
    let dir = tempfile::tempdir().unwrap();
    let (estimates, truth) = (data("estimates.tum"), data("truth.tum"));
    for (name, start) in [("e.png", b"\x89PNG".as_slice()), ("e.svg", b"<svg".as_slice())] {
        let path = dir.path().join(name).display().to_string();
        assert_eq!(eval(&[&estimates, "--truth", &truth, "--plot", &path]).status.code(), Some(0));
        assert!(std::fs::read(&path).unwrap().starts_with(start), "{name}");
    }
    let path = dir.path().join("e.gif").display().to_string();
    let output = eval(&[&estimates, "--truth", &truth, "--plot", &path]);
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains(".png or .svg"));
}

#[test]
fn files_that_cannot_be_scored_are_named_with_the_reason() {
    let dir = tempfile::tempdir().unwrap();
    let (estimates, truth) = (data("estimates.tum"), data("truth.tum"));
    let file = |name: &str, text: &str| -> PathBuf {
        let path = dir.path().join(name);
        std::fs::write(&path, text).unwrap();
        path
    };
    let empty = file("empty.tum", "# nothing\n").display().to_string();
    let far = file("far.tum", "200 0 0 1 0 0 0 1\n").display().to_string();
    let nan = file("nan.tum", "3 nan 0 1 0 0 0 1\n").display().to_string();
    let flat = file("flat.csv", &format!("3{}\n", ",-1".repeat(21))).display().to_string();
    let other = file("other.csv", &format!("99{}\n", ",1".repeat(21))).display().to_string();
    let cases: [(&[&str], &[&str]); 7] = [
        (&[&empty, "--truth", &truth], &["empty.tum", "no poses"]),
        (&[&estimates, "--truth", &empty], &["empty.tum", "no poses"]),
        (&[&far, "--truth", &truth], &["200", "0 to 23", "none in common"]),
        (&[&estimates, "--truth", &nan], &["nan.tum", "line 1", "finite"]),
        (
            &[&estimates, "--truth", &truth, "--cov", &flat],
            &["flat.csv", "line 1", "frame 3", "positive definite"],
        ),
        (&[&estimates, "--truth", &truth, "--cov", &other], &["other.csv", "no covariance"]),
        (&["nowhere.tum", "--truth", &truth], &["nowhere.tum"]),
    ];
    for (arguments, words) in cases {
        let output = eval(arguments);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
        words.iter().for_each(|w| assert!(message.contains(w), "{w} in {message}"));
    }
    // Frames that all failed are a score, not an error.
    let found = scores(&[&nan, "--truth", &truth, "--json"]);
    assert_eq!((found["estimated"].as_u64(), found["success_5cm_5deg"].as_f64()), (Some(0), Some(0.0)));
    assert!(found["t_mm"].is_null());
}
