//! Files of poses: truth, estimates, covariances, starts.

use crate::support::{Case, Change, RUN, TRUTH, check, file, task};

const EVAL: &str = "eval estimates.tum --truth truth.tum";
const AGAINST: &str = "run task.toml --out out --quiet --truth truth.tum";

/// The same wrong truth for a run and for a score.
fn truth(what: &'static str, content: impl AsRef<[u8]>, words: &'static [&'static str]) -> [Case; 2] {
    [EVAL, AGAINST].map(|command| {
        let changes = vec![Change::File("truth.tum", content.as_ref().to_vec())];
        Case { what, changes, command, words }
    })
}

#[test]
fn truth_that_is_none() {
    let line = |text: &str| TRUTH.replace("1 0 0 0.5 0 0 0 1", text);
    let cases = [
        truth(
            "NaN",
            line("1 0 nan 0.5 0 0 0 1"),
            &["truth.tum: line 3: found NaN; expected a finite number"],
        ),
        truth(
            "infinite",
            line("1 0 inf 0.5 0 0 0 1"),
            &["truth.tum: line 3: found inf; expected a finite number"],
        ),
        truth("seven columns", line("1 0 0 0.5 0 0 1"), &["truth.tum: line 3: 7 numbers; expected 8"]),
        truth("nine columns", line("1 0 0 0.5 0 0 0 1 0"), &["truth.tum: line 3: 9 numbers; expected 8"]),
        truth("letters", line("1 0 0 0.5 0 0 0 w"), &["truth.tum: line 3: found `w`; expected a number"]),
        truth(
            "quaternion of length 2",
            line("1 0 0 0.5 0 0 0 2"),
            &["truth.tum: line 3: a quaternion of length 2; expected 1"],
        ),
        truth(
            "quaternion of zero",
            line("1 0 0 0.5 0 0 0 0"),
            &["truth.tum: line 3: a quaternion of length 0; expected 1"],
        ),
        truth(
            "frame with a fraction",
            line("1.5 0 0 0.5 0 0 0 1"),
            &["truth.tum: line 3: frame 1.5; expected a whole number"],
        ),
        truth(
            "negative frame",
            line("-1 0 0 0.5 0 0 0 1"),
            &["truth.tum: line 3: frame -1; expected a whole number"],
        ),
        truth(
            "frame of 1e300",
            line("1e300 0 0 0.5 0 0 0 1"),
            &["truth.tum: line 3", "expected a whole number from 0 to 9e15"],
        ),
        truth(
            "two poses of a frame",
            line("0 0 0 0.9 0 0 0 1"),
            &["truth.tum: line 3: another pose of frame 0"],
        ),
        truth(
            "binary",
            [0xff; 64],
            &["truth.tum: line 1, column 1: found the byte 0xff; expected UTF-8 text"],
        ),
    ];
    check(cases.into_iter().flatten().collect());
}

#[test]
fn truth_that_does_not_fit() {
    let against = |what, text: &str, words| Case {
        what,
        changes: vec![file("truth.tum", text)],
        command: AGAINST,
        words,
    };
    let score =
        |what, text: &str, words| Case { what, changes: vec![file("truth.tum", text)], command: EVAL, words };
    let folder = |what, name: &'static str, text: &str, words| {
        let changes = vec![Change::Folder("truth.tum"), file(name, text)];
        Case { what, changes, command: EVAL, words }
    };
    check(vec![
        against("empty", "", &["truth without frame 0", "expected the true pose of frame 0"]),
        score("empty", "", &["truth.tum", "no poses"]),
        score("of other frames", "70 0 0 0.5 0 0 0 1\n", &["0 to 3", "70 to 70", "none in common"]),
        against("of other frames", "70 0 0 0.5 0 0 0 1\n", &["truth without frame 0"]),
        Case {
            what: "of too few frames for resets",
            changes: vec![file("truth.tum", "0 0 0 0.5 0 0 0 1\n1 0 0 0.5 0 0 0 1\n")],
            command: "run task.toml --out out --truth truth.tum --reset-on-failure 5cm,5deg",
            words: &["target `cube`", "no frame 2", "needs every frame"],
        },
        Case {
            what: "missing",
            changes: vec![Change::Gone("truth.tum")],
            command: EVAL,
            words: &["truth.tum", "No such file"],
        },
        Case {
            what: "missing",
            changes: vec![Change::Gone("truth.tum")],
            command: AGAINST,
            words: &["truth.tum does not exist"],
        },
        Case {
            what: "pipe",
            changes: vec![Change::Pipe("truth.tum")],
            command: EVAL,
            words: &["truth.tum", "no regular file"],
        },
        Case {
            what: "empty folder",
            changes: vec![Change::Folder("truth.tum")],
            command: EVAL,
            words: &["truth.tum", "no poses", "a 4x4 matrix"],
        },
        folder(
            "matrix of nine numbers",
            "truth.tum/pose_0.txt",
            "1 0 0\n0 1 0\n0 0 1\n",
            &["pose_0.txt", "9 numbers", "expected a pose of 6, 7, 8, 12 or 16"],
        ),
        folder(
            "matrix that shears",
            "truth.tum/pose_0.txt",
            "1 5 0 0\n0 1 0 0\n0 0 1 0\n",
            &["pose_0.txt", "no rotation", "expected a unit quaternion or a rotation matrix"],
        ),
        folder(
            "matrix with NaN",
            "truth.tum/pose_0.txt",
            "1 0 0 0\n0 nan 0 0\n0 0 1 0\n",
            &["pose_0.txt: line 2", "expected a finite number"],
        ),
    ]);
}

#[test]
fn estimates_and_covariances() {
    let score = |what, name, text: &str, words| {
        let command = if name == "c.csv" { "eval estimates.tum --truth truth.tum --cov c.csv" } else { EVAL };
        Case { what, changes: vec![file(name, text)], command, words }
    };
    let row = |frame: &str, n: usize, value: &str| format!("{frame}{}\n", format!(",{value}").repeat(n));
    check(vec![
        score("empty", "estimates.tum", "# none\n", &["estimates.tum", "no poses"]),
        score(
            "frame twice",
            "estimates.tum",
            "0 0 0 1 0 0 0 1\n0 0 0 1 0 0 0 1\n",
            &["estimates.tum: line 2: second pose of frame 0"],
        ),
        score("letters", "estimates.tum", "0 a 0 1 0 0 0 1\n", &["estimates.tum: line 1: found `a`"]),
        score(
            "20 values",
            "c.csv",
            &row("0", 20, "1e-6"),
            &["c.csv: line 1: 21 numbers; expected 22: frame 21 values"],
        ),
        score("NaN", "c.csv", &row("0", 21, "nan"), &["c.csv: line 1: found NaN; expected a finite number"]),
        score(
            "not positive definite",
            "c.csv",
            &row("0", 21, "-1"),
            &["c.csv: line 1: the covariance of frame 0 is not positive definite"],
        ),
        score("of no frame", "c.csv", &row("70", 21, "1"), &["c.csv", "no covariance belongs to a frame"]),
        score("empty", "c.csv", "", &["c.csv", "no covariance belongs to a frame"]),
        Case {
            what: "missing",
            changes: vec![],
            command: "eval no.tum --truth truth.tum",
            words: &["no.tum", "No such file"],
        },
        Case {
            what: "missing",
            changes: vec![],
            command: "eval estimates.tum --truth truth.tum --cov no.csv",
            words: &["no.csv", "No such file"],
        },
    ]);
}

#[test]
fn starts_out_of_files() {
    let start = |what, text: &str, words| {
        let from = "kind = \"pose\", params = { camera_from_object = { translation = [\"0 m\", \"0 m\", \"0.5 m\"] },";
        let mut case = task(what, from, "kind = \"file\", params = { path = \"start.txt\",", words);
        case.changes.push(file("start.txt", text));
        case
    };
    let mut missing = start("missing", "", &["task.toml:19", "start.txt does not exist"]);
    missing.changes.push(Change::Gone("start.txt"));
    check(vec![
        missing,
        start(
            "empty",
            "",
            &["task.toml:19", "start.txt", "0 numbers", "expected a pose of 6, 7, 8, 12 or 16"],
        ),
        start("NaN", "0 0 nan 0 0 0", &["task.toml:19", "start.txt: line 1", "expected a finite number"]),
        start("quaternion of length 3", "0 0 1 0 0 0 3", &["task.toml:19", "start.txt", "unit quaternion"]),
        Case {
            what: "truth of the task",
            changes: vec![
                Change::Task(
                    "init = {",
                    "truth = { kind = \"tum\", params = { path = \"truth.tum\" } }\ninit = {",
                ),
                file("truth.tum", "0 1\n"),
            ],
            command: RUN,
            words: &["task.toml:19", "truth.tum: line 1: 2 numbers; expected 8"],
        },
    ]);
}
