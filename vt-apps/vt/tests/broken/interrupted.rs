//! What a run leaves when it is ended: every output is whole up to the last frame, or not there.

use std::path::Path;
use std::process::Command;

use crate::support::{TASK, furnish, pgm, start, wait};

/// A folder with a task of very many frames.
fn long(frames: usize) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    furnish(dir.path());
    for k in 4..frames {
        std::fs::hard_link(dir.path().join("frames/f0.pgm"), dir.path().join(format!("frames/f{k}.pgm")))
            .unwrap();
    }
    let gif = "kind = \"gif\"\nparams = { every = 1 }";
    let text = TASK.replace("last = 3", &format!("last = {}", frames - 1)).replace("kind = \"gif\"", gif);
    std::fs::write(dir.path().join("task.toml"), text).unwrap();
    dir
}

/// Lines of a text, all of which must have their end.
fn lines(path: &Path) -> Vec<String> {
    let text = std::fs::read_to_string(path).unwrap();
    assert!(text.is_empty() || text.ends_with('\n'), "{}: a line is not whole", path.display());
    text.lines().filter(|l| !l.starts_with('#')).map(str::to_owned).collect()
}

/// Checks everything in `out`; gives the number of frames that the steps have.
fn whole(out: &Path) -> usize {
    let numbers = |name: &str, n: usize| {
        let rows = lines(&out.join(name));
        for row in &rows {
            let found = row.split([' ', ',']).filter(|w| w.parse::<f64>().is_ok()).count();
            assert_eq!(found, n, "{name}: {row}");
        }
        rows.len()
    };
    let steps = lines(&out.join("steps.jsonl"));
    for (k, step) in steps.iter().enumerate() {
        let step: serde_json::Value = serde_json::from_str(step).unwrap();
        assert_eq!(step["frame"].as_u64(), Some(k as u64));
    }
    // Outputs are written one after the other: at most one is a step ahead.
    let poses = numbers("poses.tum", 8);
    assert!((steps.len()..=steps.len() + 1).contains(&poses), "{poses} poses, {} steps", steps.len());
    assert!(numbers("covariances.csv", 22).abs_diff(steps.len()) <= 1);
    let mut pictures = 0_usize;
    for entry in std::fs::read_dir(out.join("overlays")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|e| e == "png") {
            assert_eq!(image::open(&path).unwrap().width(), 64, "{}", path.display());
            pictures += 1;
        }
    }
    assert!(pictures.abs_diff(steps.len()) <= 1, "{pictures} pictures, {} steps", steps.len());
    use image::AnimationDecoder;
    let frames = match std::fs::File::open(out.join("overlays.gif")) {
        Ok(gif) => {
            let gif = image::codecs::gif::GifDecoder::new(std::io::BufReader::new(gif)).unwrap();
            gif.into_frames().collect_frames().unwrap().len()
        }
        // It comes with the first frame.
        Err(_) => 0,
    };
    assert!(frames.abs_diff(steps.len()) <= 1, "{frames} frames, {} steps", steps.len());
    steps.len()
}

/// What is written at the end of a run, also of one that was ended.
fn ended(out: &Path, steps: usize) {
    let report = std::fs::read(out.join("report.json")).unwrap();
    let report: serde_json::Value = serde_json::from_slice(&report).unwrap();
    assert_eq!(
        (report["interrupted"].as_bool(), report["frames"].as_u64()),
        (Some(true), Some(steps as u64))
    );
    assert!(image::open(out.join("contact_sheet.png")).unwrap().width() > 64);
    assert!(image::open(out.join("plot.png")).unwrap().width() > 64);
    assert!(std::fs::read_to_string(out.join("plot.svg")).unwrap().trim_end().ends_with("</svg>"));
}

/// Starts a run and sends it a signal once it has made some steps; gives its exit code.
fn signalled(dir: &Path, signal: &str, steps: usize) -> Option<i32> {
    let file = dir.join("out/steps.jsonl");
    // That of the run before.
    std::fs::remove_file(&file).ok();
    let mut child = start(dir, &["run", "task.toml", "--out", "out", "--quiet"]);
    while std::fs::read_to_string(&file).map_or(0, |t| t.lines().count()) < steps {
        assert!(child.try_wait().unwrap().is_none(), "the run ended by itself");
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    assert!(Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success());
    wait(&mut child, signal)
}

#[test]
fn a_killed_run_leaves_whole_files() {
    let dir = long(4000);
    for steps in [1, 2, 3, 5, 8, 13, 21, 34] {
        // Other files of the run before are in the folder.
        assert_eq!(signalled(dir.path(), "-KILL", steps), None);
        let out = dir.path().join("out");
        assert!(whole(&out) >= steps);
        for name in ["report.json", "contact_sheet.png", "plot.png", "plot.svg"] {
            assert!(!out.join(name).exists(), "{name} is written at the end of a run");
        }
        std::fs::remove_dir_all(out.join("overlays")).unwrap();
    }
}

#[test]
fn ctrl_c_ends_a_run_in_order_with_code_130() {
    for signal in ["-INT", "-TERM"] {
        let dir = long(4000);
        assert_eq!(signalled(dir.path(), signal, 5), Some(130));
        let out = dir.path().join("out");
        let steps = whole(&out);
        assert!((5..4000).contains(&steps));
        ended(&out, steps);
    }
}

#[test]
fn a_picture_that_cannot_be_read_ends_a_run_after_those_before_it() {
    for (name, bytes) in [("cut", pgm(64, 48)[..900].to_vec()), ("larger", pgm(80, 60))] {
        let dir = long(20);
        std::fs::remove_file(dir.path().join("frames/f10.pgm")).unwrap();
        std::fs::write(dir.path().join("frames/f10.pgm"), bytes).unwrap();
        let (code, said) = crate::support::run(dir.path(), &["run", "task.toml", "--out", "out"], name);
        assert_eq!(code, Some(2), "{said}");
        assert!(said.contains("f10.pgm") && said.contains("expected"), "{said}");
        let out = dir.path().join("out");
        assert_eq!(whole(&out), 10);
        ended(&out, 10);
    }
}
