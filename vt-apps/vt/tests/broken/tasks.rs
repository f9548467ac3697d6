//! The text of a task: syntax, keys, names, references, variables, size.

use crate::support::{Case, Change, RUN, TASK, check, file, task};

fn whole(what: &'static str, text: impl AsRef<[u8]>, words: &'static [&'static str]) -> Case {
    Case { what, changes: vec![Change::File("task.toml", text.as_ref().to_vec())], command: RUN, words }
}

#[test]
fn texts_that_are_no_tasks() {
    let bad = TASK.replace("title = \"good\"", "title = \"go");
    let mut latin = TASK.as_bytes().to_vec();
    latin[20] = 0xe4;
    check(vec![
        whole("empty", "", &["task.toml", "version", "expected `version = 1`"]),
        whole("version alone", "version = 1\n", &["task.toml:1", "missing key `sensors`"]),
        whole(
            "other version",
            TASK.replace("version = 1", "version = 7"),
            &["task.toml:1", "version 7", "expected version 1"],
        ),
        whole("open quote", &bad, &["task.toml:2", "syntax", "expected a TOML document"]),
        whole("open bracket", TASK.replace("size = [64, 48]", "size = [64, 48"), &["task.toml:8", "syntax"]),
        whole("key twice", TASK.replace("title", "version"), &["task.toml:2", "syntax", "duplicate"]),
        whole("no TOML", "<xml/>", &["task.toml:1", "syntax"]),
        whole("Latin 1", &latin, &["task.toml", "line 2, column", "0xe4", "expected UTF-8"]),
        whole("rubbish", [0xfe; 200], &["task.toml", "line 1, column 1", "0xfe"]),
        whole("zeros", [0; 200], &["task.toml:1", "syntax"]),
        whole("17 MB", vec![b'#'; 17_000_000], &["task.toml", "17000000 bytes", "at most 16777216"]),
        whole(
            "deep lists",
            format!("version = 1\na = {}", "[".repeat(1_000_000)),
            &["task.toml, line 2", "syntax"],
        ),
        whole(
            "deep tables",
            format!("version = 1\na = {}", "{a=".repeat(500_000)),
            &["task.toml, line 2", "syntax"],
        ),
        whole(
            "deep keys",
            format!("version = 1\n{}a = 1", "a.".repeat(500_000)),
            &["task.toml, line 2", "syntax"],
        ),
        whole(
            "many sensors",
            format!("{TASK}{}", "[[sensors]]\nname = \"a\"\nkind = \"images\"\n".repeat(100_000)),
            &["task.toml", "100001 sections", "at most 256"],
        ),
        Case {
            what: "no file",
            changes: vec![Change::Gone("task.toml")],
            command: RUN,
            words: &["task.toml", "No such file"],
        },
        Case {
            what: "folder",
            changes: vec![Change::Folder("task.toml")],
            command: RUN,
            words: &["task.toml", "found a folder; expected a file"],
        },
        Case {
            what: "pipe",
            changes: vec![Change::Pipe("task.toml")],
            command: RUN,
            words: &["task.toml", "no regular file"],
        },
    ]);
}

#[test]
fn keys_at_every_depth() {
    check(vec![
        task("top", "title =", "titel =", &["task.toml:2", "unknown key `titel`", "nearest: `title`"]),
        task(
            "list of sections",
            "[[outputs]]",
            "[[output]]",
            &["unknown key `output`", "nearest: `outputs`"],
        ),
        task(
            "section",
            "name = \"camera\"",
            "nam = \"camera\"",
            &["task.toml:5", "unknown key `nam`", "nearest: `name`"],
        ),
        task("parameter", "last = 3", "lats = 3", &["task.toml:7", "unknown key `lats`", "nearest: `last`"]),
        task("camera", "center =", "centre =", &["task.toml:8", "unknown key `centre`", "nearest: `center`"]),
        task(
            "element of a list",
            "unit = \"cm\"",
            "units = \"cm\"",
            &["task.toml:12", "unknown key `units`", "nearest: `unit`"],
        ),
        task(
            "pose in parameters",
            "camera_from_object",
            "camera_from_objekt",
            &["task.toml:19", "nearest: `camera_from_object`"],
        ),
        task(
            "part of a pose",
            "{ translation = [\"0 m\"",
            "{ tranlation = [\"0 m\"",
            &["task.toml:19", "unknown key `tranlation`", "nearest: `translation`"],
        ),
        task("modality", "level =", "levle =", &["task.toml:20", "unknown key `levle`", "nearest: `level`"]),
        task(
            "choice",
            "kind = \"fused\"",
            "kind = \"fused\", param = {}",
            &["task.toml:22", "unknown key `param`", "nearest: `params`"],
        ),
        task(
            "table for a text",
            "title = \"good\"",
            "title = { a = 1 }",
            &["task.toml:2", "expected a string"],
        ),
        task(
            "text for a list",
            "[{ kind = \"edges\"",
            "\"edges\"#",
            &["task.toml:20", "expected a sequence"],
        ),
        task("text for a number", "last = 3", "last = \"3\"", &["task.toml:7", "\"3\"", "expected u64"]),
        task(
            "date for a text",
            "title = \"good\"",
            "title = 5\nseed = 1979-05-27",
            &["task.toml:2", "expected a string"],
        ),
        task("missing reference", "model = \"cube\"\n", "", &["task.toml", "missing key `model`"]),
        task("missing warp", "warp = { kind = \"se3\" }\n", "", &["task.toml:10", "missing key `warp`"]),
        task(
            "missing init",
            "init = {",
            "ini = {",
            &["task.toml:19", "unknown key `ini`", "nearest: `init`"],
        ),
        task("negative seed", "title =", "seed = -1\ntitle =", &["task.toml:2", "-1", "expected u32"]),
    ]);
}

#[test]
fn names_and_references() {
    let second = |name: &str| {
        TASK.replace("[[outputs]]\nkind = \"plot\"\n", "")
            + &TASK[TASK.find("[[targets]]").unwrap()..TASK.find("[[outputs]]").unwrap()]
                .replacen("\"cube\"", name, 1)
    };
    check(vec![
        task(
            "undeclared sensor",
            "sensor = \"camera\"",
            "sensor = \"camra\"",
            &["task.toml:20", "no sensor named `camra`", "nearest: `camera`"],
        ),
        task(
            "undeclared model",
            "model = \"cube\"",
            "model = \"cub\"",
            &["task.toml:18", "no model named `cub`", "nearest: `cube`"],
        ),
        task(
            "undeclared sensor of an output",
            "kind = \"overlays\"",
            "kind = \"overlays\"\nparams = { sensor = \"cam\" }",
            &["task.toml:35", "no sensor named `cam`", "camera"],
        ),
        task(
            "undeclared sensor of a truth",
            "init = {",
            "truth = { kind = \"simulated\", params = { sensor = \"camera2\" } }\ninit = {",
            &["task.toml:19", "no sensor named `camera2`", "nearest: `camera`"],
        ),
        task(
            "truth of a sensor that knows none",
            "init = {",
            "truth = { kind = \"simulated\", params = { sensor = \"camera\" } }\ninit = {",
            &["task.toml:19", "knows no truth", "a simulated sensor"],
        ),
        whole(
            "target twice",
            second("\"cube\""),
            &["task.toml:38", "second target named `cube`", "names must differ"],
        ),
        whole(
            "targets of the same files",
            second("\"c?\"")
                .replace("name = \"cube\"\nmodel = \"cube\"\ninit", "name = \"c_\"\nmodel = \"cube\"\ninit"),
            &["task.toml:38", "\"c?\"", "those of `c_`"],
        ),
        task(
            "name with a dot",
            "name = \"camera\"",
            "name = \"cam.era\"",
            &["task.toml:5", "cam.era", "has no dot"],
        ),
        task("empty name", "name = \"camera\"", "name = \"\"", &["task.toml:5", "a name that is not empty"]),
        task(
            "two outputs on the same files",
            "kind = \"covariances\"",
            "kind = \"poses\"",
            &["task.toml:28", "second output of kind named `poses`"],
        ),
        whole(
            "no sensor",
            TASK.replace("[[sensors]]", "[[sensors_]]"),
            &["task.toml", "unknown key `sensors_`", "nearest: `sensors`"],
        ),
        task(
            "no modality",
            "modalities = [{",
            "modalities = [] #",
            &["task.toml:20", "at least one modality"],
        ),
        task(
            "modality without camera",
            "\ncamera = {",
            "#",
            &["task.toml:19", "uncalibrated sensor `camera`", "`camera` section"],
        ),
        task(
            "start at a truth that is not there",
            "kind = \"pose\", params = { camera_from_object = { translation = [\"0 m\", \"0 m\", \"0.5 m\"] },",
            "kind = \"truth\", params = {",
            &["task.toml:19", "a target without `truth`", "expected the true pose of frame 0"],
        ),
        Case {
            what: "scenes that show each other",
            changes: vec![file("task.toml", &circle())],
            command: RUN,
            words: &["task.toml:7", "right", "earlier in the task"],
        },
    ]);
}

/// Two simulated sensors, each with the scene of the other.
fn circle() -> String {
    let sensor = |name: &str, scene: &str| {
        format!(
            "[[sensors]]\nname = \"{name}\"\nkind = \"simulated\"\nparams = {{ scene = \"{scene}\", frames = 3, rate = \"25 Hz\" }}\n\
             camera = {{ size = [64, 48], focal = [\"60 px\", \"60 px\"], center = [\"31.5 px\", \"23.5 px\"] }}\n"
        )
    };
    let models = &TASK[TASK.find("[[models]]").unwrap()..];
    format!("version = 1\n\n\n{}{}{models}", sensor("camera", "right"), sensor("right", "camera"))
}

#[test]
fn variables() {
    let with = |what, value: &str, words| {
        let text = TASK.replace("title = \"good\"", &format!("title = {value}"));
        whole(what, text, words)
    };
    let mut laughs = TASK.replace("title = \"good\"", "title = \"${V0}\"") + "[variables]\n";
    let mut silence = laughs.clone();
    for k in 0..12 {
        laughs += &format!("V{k} = \"{}\"\n", format!("${{V{}}}", k + 1).repeat(10));
        silence += &format!("V{k} = \"{}\"\n", format!("${{V{}}}", k + 1).repeat(10));
    }
    laughs += "V12 = \"ha\"\n";
    silence += "V12 = \"\"\n";
    check(vec![
        with("not given", "\"${NOWHERE}\"", &["task.toml:2", "variable `NOWHERE` has no value", "NOWHERE=…"]),
        with("without end", "\"${A\"", &["task.toml:2", "a closing `}`"]),
        with("of itself", "\"${A}\"\n[variables]\nA = \"${B}\"\nB = \"${A}\"\n#", &["refer to themselves"]),
        with(
            "misspelt",
            "\"${ROTO}\"\n[variables]\nROOT = \"a\"\n#",
            &["task.toml:2", "`ROTO`", "nearest: `ROOT`"],
        ),
        with("number", "\"good\"\n[variables]\nROOT = 3\n#", &["task.toml:4", "expected a string"]),
        whole("that multiply", laughs, &["task.toml", "too often", "16777216 bytes"]),
        whole("of nothing that multiply", silence, &["task.toml", "too often", "16777216 bytes"]),
    ]);
}
