//! Folders of sequences.

use crate::support::{Case, Change, TRUTH, check, file};

const RUN: &str = "run task.toml --out out --quiet --sequences data";

fn case(what: &'static str, camera: &str, words: &'static [&'static str]) -> Case {
    let changes =
        vec![Change::Folder("data/a"), file("data/a/camera.txt", camera), file("data/a/poses.tum", TRUTH)];
    Case { what, changes, command: RUN, words }
}

#[test]
fn sequences_that_are_none() {
    let good = "60 60 31.5 23.5 64 48\n";
    let mut poses = case("broken truth", good, &["sequence a", "poses.tum: line 1: 2 numbers; expected 8"]);
    poses.changes.push(file("data/a/poses.tum", "0 1\n"));
    let mut picture = case("broken picture", good, &["sequence a", "f1.pgm", "expected a whole PNG"]);
    picture.changes.push(file("frames/f1.pgm", "P5"));
    let mut task = case("broken task", good, &["sequence a", "task.toml:18", "no model named `cub`"]);
    task.changes.push(Change::Task("model = \"cube\"", "model = \"cub\""));
    check(vec![
        Case { what: "no folder", changes: vec![], command: RUN, words: &["data", "No such file"] },
        Case {
            what: "empty folder",
            changes: vec![Change::Folder("data")],
            command: RUN,
            words: &["data", "no sequence", "camera.txt and poses.tum"],
        },
        case("empty camera", "", &["camera.txt", "0 words", "six numbers: fx fy cx cy width height"]),
        case(
            "NaN focal length",
            "nan 60 31.5 23.5 64 48",
            &["camera.txt", "`nan`", "expected a finite number"],
        ),
        case("letters", "60 60 x 23.5 64 48", &["camera.txt", "`x`", "expected a finite number"]),
        case(
            "negative focal length",
            "60 -60 31.5 23.5 64 48",
            &["camera.txt", "`-60`", "a positive number"],
        ),
        case("no columns", "60 60 31.5 23.5 0 48", &["camera.txt", "the side `0`", "from 1"]),
        poses,
        picture,
        task,
    ]);
}
