//! The good files, and a command in a folder of them with bounded time and memory.

use std::fs::File;
use std::path::Path;
use std::process::{Child, Command};
use std::time::{Duration, Instant};

/// A command that takes longer hangs.
const PATIENCE: Duration = Duration::from_secs(60);

/// Address space of a command in KiB; threads reserve some that they do not use.
const MEMORY: u32 = 3 << 20;

/// Pictures, a model, a truth and estimates, and a task that uses all roles.
pub const TASK: &str = r#"version = 1
title = "good"

[[sensors]]
name = "camera"
kind = "images"
params = { pattern = "frames/f%d.pgm", last = 3, rate = "25 Hz" }
camera = { size = [64, 48], focal = ["60 px", "60 px"], center = ["31.5 px", "23.5 px"] }

[[models]]
name = "cube"
shape = { kind = "mesh", params = { parts = [{ file = "cube.obj", unit = "cm" }] } }
warp = { kind = "se3" }
dynamics = { kind = "brownian", params = { translation = "20 mm/s^0.5", rotation = "5 deg/s^0.5" } }

[[targets]]
name = "cube"
model = "cube"
init = { kind = "pose", params = { camera_from_object = { translation = ["0 m", "0 m", "0.5 m"] }, sigma = { translation = "5 mm", rotation = "2 deg" } } }
modalities = [{ kind = "edges", level = "feature", sensor = "camera", params = { sigma = "0.5 px" } }]
estimator = { kind = "kalman", params = { iterations = 2 } }
loss = { kind = "fused" }
reinit = { kind = "prior" }

[[outputs]]
kind = "poses"
[[outputs]]
kind = "covariances"
[[outputs]]
kind = "steps"
[[outputs]]
kind = "report"
[[outputs]]
kind = "overlays"
[[outputs]]
kind = "gif"
[[outputs]]
kind = "plot"
"#;

/// A cube of 20 cm with its lengths in centimetres.
pub const CUBE: &str = "v -10 -10 -10\nv 10 -10 -10\nv -10 10 -10\nv 10 10 -10\nv -10 -10 10\nv 10 -10 10\nv -10 10 10\n\
                        v 10 10 10\nf 1 5 7 3\nf 2 4 8 6\nf 1 2 6 5\nf 3 7 8 4\nf 1 3 4 2\nf 5 6 8 7\n";

pub const TRUTH: &str = "# frame tx ty tz qx qy qz qw\n0 0 0 0.5 0 0 0 1\n1 0 0 0.5 0 0 0 1\n2 0 0 0.5 0 0 0 1\n\
                         3 0 0 0.5 0 0 0 1\n";

/// A grey picture of a dark square on a bright ground, as large as the near face of the cube is seen; dark all over where it is smaller.
pub fn pgm(width: usize, height: usize) -> Vec<u8> {
    let mut out = format!("P5\n{width} {height}\n255\n").into_bytes();
    let inside = |k: usize, n: usize| (2 * k + 1).abs_diff(n) < 30;
    let pixel = |k: usize| if inside(k % width, width) && inside(k / width, height) { 60 } else { 200 };
    out.extend((0..width * height).map(pixel));
    out
}

/// Writes the good files.
pub fn furnish(dir: &Path) {
    std::fs::create_dir(dir.join("frames")).unwrap();
    for k in 0..4 {
        std::fs::write(dir.join(format!("frames/f{k}.pgm")), pgm(64, 48)).unwrap();
    }
    for (name, text) in
        [("task.toml", TASK), ("cube.obj", CUBE), ("truth.tum", TRUTH), ("estimates.tum", TRUTH)]
    {
        std::fs::write(dir.join(name), text).unwrap();
    }
}

/// Starts `vt` in a folder with bounded memory; what it says goes to files.
pub fn start(dir: &Path, arguments: &[&str]) -> Child {
    let said = |name: &str| File::create(dir.join(name)).unwrap();
    Command::new("sh")
        .args(["-c", &format!("ulimit -v {MEMORY}; exec \"$@\""), "sh", env!("CARGO_BIN_EXE_vt")])
        .args(arguments)
        .current_dir(dir)
        .env("NO_COLOR", "1")
        .env("RAYON_NUM_THREADS", "2")
        .env_remove("RUST_BACKTRACE")
        .stdin(std::process::Stdio::null())
        .stdout(said("stdout"))
        .stderr(said("stderr"))
        .spawn()
        .unwrap()
}

/// The exit code of a command, `None` after a signal.
#[track_caller]
pub fn wait(child: &mut Child, what: &str) -> Option<i32> {
    let begin = Instant::now();
    loop {
        if let Some(status) = child.try_wait().unwrap() {
            return status.code();
        }
        if begin.elapsed() > PATIENCE {
            child.kill().unwrap();
            panic!("{what}: still running after {PATIENCE:?}");
        }
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Exit code and what was said on stderr, in one line without the frame around it.
#[track_caller]
pub fn run(dir: &Path, arguments: &[&str], what: &str) -> (Option<i32>, String) {
    let code = wait(&mut start(dir, arguments), what);
    let said = String::from_utf8_lossy(&std::fs::read(dir.join("stderr")).unwrap()).into_owned();
    let words = said.split(|c: char| c.is_whitespace() || "│╭╰─·▲┬".contains(c)).filter(|w| !w.is_empty());
    (code, words.collect::<Vec<_>>().join(" "))
}

/// Changes of a folder of good files.
pub enum Change {
    /// A file with other content.
    File(&'static str, Vec<u8>),
    /// A piece of the task replaced.
    Task(&'static str, &'static str),
    /// A file or folder that is gone.
    Gone(&'static str),
    /// A folder, in place of a file where there is one.
    Folder(&'static str),
    /// A pipe that nothing is written into.
    Pipe(&'static str),
}

impl Change {
    fn make(&self, dir: &Path, what: &str) {
        match self {
            Self::File(name, bytes) => std::fs::write(dir.join(name), bytes).unwrap(),
            Self::Task(from, to) => {
                let file = dir.join("task.toml");
                let text = std::fs::read_to_string(&file).unwrap();
                assert!(text.contains(from), "{what}: nothing to replace");
                std::fs::write(file, text.replacen(from, to, 1)).unwrap();
            }
            Self::Gone(name) if dir.join(name).is_dir() => std::fs::remove_dir_all(dir.join(name)).unwrap(),
            Self::Gone(name) => std::fs::remove_file(dir.join(name)).unwrap(),
            Self::Folder(name) => {
                std::fs::remove_file(dir.join(name)).ok();
                std::fs::create_dir_all(dir.join(name)).unwrap();
            }
            Self::Pipe(name) => {
                std::fs::remove_file(dir.join(name)).ok();
                assert!(Command::new("mkfifo").arg(dir.join(name)).status().unwrap().success());
            }
        }
    }
}

/// A file with a text.
pub fn file(name: &'static str, text: &str) -> Change {
    Change::File(name, text.as_bytes().to_vec())
}

/// What is wrong, the command, and words that its error must contain.
pub struct Case {
    pub what: &'static str,
    pub changes: Vec<Change>,
    pub command: &'static str,
    pub words: &'static [&'static str],
}

/// A case of a changed task.
pub fn task(
    what: &'static str,
    from: &'static str,
    to: &'static str,
    words: &'static [&'static str],
) -> Case {
    Case { what, changes: vec![Change::Task(from, to)], command: RUN, words }
}

pub const RUN: &str = "run task.toml --out out --quiet";

/// Runs all cases; every failed one is told.
#[track_caller]
pub fn check(cases: Vec<Case>) {
    let failed: Vec<String> = cases.iter().filter_map(|case| fault(case).err()).collect();
    assert!(failed.is_empty(), "{} of {} cases:\n{}", failed.len(), cases.len(), failed.join("\n"));
}

fn fault(case: &Case) -> Result<(), String> {
    let dir = tempfile::tempdir().unwrap();
    furnish(dir.path());
    case.changes.iter().for_each(|c| c.make(dir.path(), case.what));
    let arguments: Vec<&str> = case.command.split(' ').collect();
    let (code, said) = run(dir.path(), &arguments, case.what);
    let missing: Vec<_> = case.words.iter().filter(|w| !said.contains(*w)).collect();
    if code == Some(2) && missing.is_empty() && !said.contains("panicked") && said.len() < 20_000 {
        return Ok(());
    }
    let said: String = said.chars().take(1500).collect();
    Err(format!("- {}: exit code {code:?}, without {missing:?}: {said}", case.what))
}

#[test]
fn the_good_files_are_good() {
    let dir = tempfile::tempdir().unwrap();
    furnish(dir.path());
    for command in [
        RUN,
        "run task.toml --out out --truth truth.tum",
        "check task.toml",
        "explain task.toml",
        "eval estimates.tum --truth truth.tum --model cube.obj --unit cm",
        "model inspect cube.obj",
    ] {
        let (code, said) = run(dir.path(), &command.split(' ').collect::<Vec<_>>(), command);
        assert_eq!(code, Some(0), "{command}: {said}");
    }
}
