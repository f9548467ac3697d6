//! Every kind of broken task gives a typed error at the right place, with what was expected and the nearest name.

use std::path::Path;

use vt_task::{Document, Problem, Registry, TaskErrors, check};

/// A task without faults; faults are put in by replacing text.
const GOOD: &str = r#"version = 1
title = "good"

[variables]
ROOT = "data"

[[sensors]]
name = "camera"
kind = "simulated"
picture = "grey"
params = { model = "bracket", frames = 5, rate = "25 Hz", path = { start = { translation = ["0 m", "0 m", "0.5 m"] }, translation = ["1 mm", "1 mm", "1 mm"], rotation = ["1 deg", "1 deg", "1 deg"], period = "4 s" } }
camera = { size = [160, 120], focal = ["200 px", "200 px"], center = ["79.5 px", "59.5 px"] }

[[sensors]]
name = "bare"
kind = "images"
picture = "colour"
params = { folder = ".", rate = "25 Hz" }

[[models]]
name = "bracket"
shape = { kind = "bracket", params = { cell = "20 mm" } }
warp = { kind = "se3", params = { locked = ["rz"] } }
dynamics = { kind = "brownian", params = { translation = "20 mm/s^0.5", rotation = "5 deg/s^0.5" } }

[[targets]]
name = "one"
model = "bracket"
truth = { kind = "simulated", params = { sensor = "camera" } }
init = { kind = "truth", params = { sigma = { translation = "5 mm", rotation = "1 deg" } } }
modalities = [{ kind = "edges", level = "feature", sensor = "camera", params = { sigma = "0.5 px" } }]
estimator = { kind = "kalman", params = { iterations = 2 } }

[[outputs]]
kind = "poses"
"#;

fn read(text: &str, set: &[&str]) -> Result<vt_task::Task, TaskErrors> {
    let set: Vec<String> = set.iter().map(|s| (*s).to_owned()).collect();
    let document = Document::parse("task.toml", text, Path::new(""), &set, &|_| None)?;
    check(&document, &Registry::standard())
}

struct Case {
    name: &'static str,
    from: &'static str,
    to: &'static str,
    /// Text at the place of the error.
    place: &'static str,
    right: fn(&Problem) -> bool,
    nearest: Option<&'static str>,
    /// A part of what was expected.
    expected: &'static str,
}

macro_rules! cases {
    ($($name:literal: $from:literal => $to:literal, at $place:literal, $pattern:pat, nearest $near:expr, expected $exp:literal;)+) => {
        [$(Case {
            name: $name, from: $from, to: $to, place: $place,
            right: |p| matches!(p, $pattern), nearest: $near, expected: $exp,
        }),+]
    };
}

#[test]
fn every_fault_is_found_where_it_is() {
    use Problem as P;
    let cases = cases! {
        "syntax": "frames = 5" => "frames = ", at "", P::Syntax(_), nearest None, expected "TOML";
        "no version": "version = 1\n" => "\n", at "", P::Version { .. }, nearest None, expected "version = 1";
        "bad version": "version = 1\n" => "version = 2\n", at "2", P::Version { .. }, nearest None, expected "version = 1";
        "version as text": "version = 1\n" => "version = \"1\"\n", at "\"1\"", P::Version { .. }, nearest None, expected "version = 1";
        "unknown key at the top": "title =" => "titel =", at "titel", P::UnknownKey { .. }, nearest Some("title"), expected "title";
        "unknown key in a section": "picture = \"grey\"" => "pictur = \"grey\"", at "pictur", P::UnknownKey { .. }, nearest Some("picture"), expected "camera";
        "unknown parameter": "iterations = 2" => "iteration = 2", at "iteration", P::UnknownKey { .. }, nearest Some("iterations"), expected "iterations";
        "unknown nested parameter": "period = \"4 s\"" => "peroid = \"4 s\"", at "peroid", P::UnknownKey { .. }, nearest Some("period"), expected "period";
        "misspelt estimator": "kind = \"kalman\"" => "kind = \"kalmann\"", at "\"kalmann\"", P::UnknownKind { .. }, nearest Some("kalman"), expected "particle";
        "misspelt sensor": "kind = \"simulated\"\npicture" => "kind = \"simulatd\"\npicture", at "\"simulatd\"", P::UnknownKind { .. }, nearest Some("simulated"), expected "images";
        "misspelt dynamics": "kind = \"brownian\"" => "kind = \"browninan\"", at "\"browninan\"", P::UnknownKind { .. }, nearest Some("brownian"), expected "constant-velocity";
        "misspelt output": "kind = \"poses\"" => "kind = \"pose\"", at "\"pose\"", P::UnknownKind { .. }, nearest Some("poses"), expected "covariances";
        "a kind of another role": "kind = \"edges\"" => "kind = \"kalman\"", at "\"kalman\"", P::UnknownKind { .. }, nearest None, expected "edges";
        "misspelt word": "level = \"feature\"" => "level = \"featur\"", at "\"featur\"", P::UnknownWord { .. }, nearest Some("feature"), expected "pixel";
        "misspelt axis": "locked = [\"rz\"]" => "locked = [\"rzz\"]", at "\"rzz\"", P::UnknownWord { .. }, nearest Some("rz"), expected "tx";
        "misspelt colour": "picture = \"colour\"" => "picture = \"color\"", at "\"color\"", P::UnknownWord { .. }, nearest Some("colour"), expected "grey";
        "missing unit": "cell = \"20 mm\"" => "cell = \"20\"", at "\"20\"", P::Value { .. }, nearest None, expected "a length with a unit";
        "number for a quantity": "cell = \"20 mm\"" => "cell = 20", at "20", P::Value { .. }, nearest None, expected "a length with a unit";
        "wrong dimension": "cell = \"20 mm\"" => "cell = \"20 deg\"", at "\"20 deg\"", P::Value { .. }, nearest None, expected "mm";
        "misspelt unit": "rate = \"25 Hz\", path" => "rate = \"25 hz\", path", at "\"25 hz\"", P::Value { .. }, nearest None, expected "nearest: \"25 Hz\"";
        "wrong type": "frames = 5" => "frames = \"five\"", at "\"five\"", P::Value { .. }, nearest None, expected "u64";
        "negative count": "frames = 5" => "frames = -5", at "-5", P::Value { .. }, nearest None, expected "u64";
        "list of the wrong length": "size = [160, 120]" => "size = [160]", at "[160]", P::Value { .. }, nearest None, expected "length 2";
        "list that is too long": "size = [160, 120]" => "size = [160, 120, 3]", at "[160, 120, 3]", P::Value { .. }, nearest None, expected "2";
        "table for a text": "title = \"good\"" => "title = { a = 1 }", at "{ a = 1 }", P::Value { .. }, nearest None, expected "string";
        "number that is not finite": "frames = 5" => "frames = 5, noise = inf", at "inf", P::Value { .. }, nearest None, expected "finite";
        "parameter out of range": "iterations = 2" => "iterations = 0", at "0", P::Value { .. }, nearest None, expected "1 to 100";
        "zero frames": "frames = 5" => "frames = 0", at "0", P::Value { .. }, nearest None, expected "at least 1";
        "exposure above one": "frames = 5" => "frames = 5, exposure = 1.5", at "1.5", P::Value { .. }, nearest None, expected "from 0 to 1";
        "no bits": "frames = 5" => "frames = 5, bits = 0", at "0", P::Value { .. }, nearest None, expected "from 1 to 8";
        "gap that ends before it starts": "frames = 5" => "frames = 5, losses = { gaps = [[9, 3]] }", at "[[9, 3]]", P::Value { .. }, nearest None, expected "first and a last";
        "misspelt light": "frames = 5" => "frames = 5, light = { ambiant = 0.5 }", at "ambiant", P::UnknownKey { .. }, nearest Some("ambient"), expected "diffuse";
        "too much light": "frames = 5" => "frames = 5, light = { ambient = 1.5 }", at "1.5", P::Value { .. }, nearest None, expected "from 0 to 1";
        "light from nowhere": "frames = 5" => "frames = 5, light = { direction = [0.0, 0.0, 0.0] }", at "[0.0, 0.0, 0.0]", P::Value { .. }, nearest None, expected "not zero";
        "shadow without unit": "frames = 5" => "frames = 5, light = { shadow = { width = 9 } }", at "9", P::Value { .. }, nearest None, expected "8 px";
        "too dense": "frames = 5" => "frames = 5, background = { kind = \"clutter\", params = { size = \"9 px\", density = 99.0, brightness = 0.5, contrast = 0.5 } }", at "99.0", P::Value { .. }, nearest None, expected "from 0 to 10";
        "background that is not there": "frames = 5" => "frames = 5, background = { kind = \"picture\", params = { file = \"no.png\" } }", at "\"no.png\"", P::MissingFile { .. }, nearest None, expected "relative to the task file";
        "misspelt background": "frames = 5" => "frames = 5, background = { kind = \"cluter\" }", at "\"cluter\"", P::UnknownWord { .. }, nearest Some("clutter"), expected "plain";
        "scene beside a scene": "frames = 5" => "frames = 5, scene = \"camera\"", at "\"camera\"", P::Value { .. }, nearest None, expected "either `scene`";
        "no scene": "model = \"bracket\", frames" => "frames", at "", P::Value { .. }, nearest None, expected "or `scene`";
        "two motions": "period = \"4 s\"" => "period = \"4 s\", velocity = [\"1 m/s\", \"0 m/s\", \"0 m/s\"]", at "", P::Value { .. }, nearest None, expected "one of swings";
        "swing without period": ", period = \"4 s\"" => "", at "", P::Value { .. }, nearest None, expected "span of time";
        "keys out of order": "translation = [\"1 mm\", \"1 mm\", \"1 mm\"], rotation = [\"1 deg\", \"1 deg\", \"1 deg\"], period = \"4 s\"" => "keys = [{ time = \"0 s\", pose = {} }]", at "[{ time = \"0 s\", pose = {} }]", P::Value { .. }, nearest None, expected "rising order";
        "dangling model of another object": "frames = 5" => "frames = 5, others = [{ model = \"brackt\", path = {} }]", at "[{ model = \"brackt\", path = {} }]", P::UnknownName { .. }, nearest Some("bracket"), expected "model";
        "two objects of one name": "frames = 5" => "frames = 5, others = [{ model = \"bracket\", path = {} }]", at "[{ model = \"bracket\", path = {} }]", P::Value { .. }, nearest None, expected "of its own";
        "animation too large": "kind = \"poses\"" => "kind = \"gif\"\nparams = { scale = 2.0 }", at "2.0", P::Value { .. }, nearest None, expected "0.01 to 1";
        "animation of no frame": "kind = \"poses\"" => "kind = \"gif\"\nparams = { every = 0 }", at "0", P::Value { .. }, nearest None, expected "from 1";
        "animation without a limit": "kind = \"poses\"" => "kind = \"gif\"\nparams = { max_megabytes = 0.0 }", at "0.0", P::Value { .. }, nearest None, expected "above 0";
        "delay without a unit": "kind = \"poses\"" => "kind = \"gif\"\nparams = { delay = 0.1 }", at "0.1", P::Value { .. }, nearest None, expected "span of time";
        "sensor of an animation": "kind = \"poses\"" => "kind = \"gif\"\nparams = { sensor = \"camra\" }", at "\"camra\"", P::UnknownName { .. }, nearest Some("camera"), expected "sensor";
        "sites of no length": "sigma = \"0.5 px\"" => "min_length = \"0 px\"", at "\"0 px\"", P::Value { .. }, nearest None, expected "positive";
        "negative deviation": "sigma = \"0.5 px\"" => "sigma = \"-0.5 px\"", at "\"-0.5 px\"", P::Value { .. }, nearest None, expected "positive";
        "focal length of zero": "focal = [\"200 px\"" => "focal = [\"0 px\"", at "[\"0 px\", \"200 px\"]", P::Value { .. }, nearest None, expected "positive focal";
        "missing key": "model = \"bracket\"\ntruth" => "truth", at "[[targets]]", P::MissingKey { .. }, nearest None, expected "model";
        "missing parameter": "cell = \"20 mm\"" => "", at "{  }", P::MissingKey { .. }, nearest None, expected "cell";
        "missing variable": "title = \"good\"" => "title = \"${ROOTS}\"", at "\"${ROOTS}\"", P::Variable { .. }, nearest Some("ROOT"), expected "ROOTS";
        "variable without end": "title = \"good\"" => "title = \"${ROOT\"", at "\"${ROOT\"", P::Value { .. }, nearest None, expected "closing";
        "variable of itself": "ROOT = \"data\"" => "ROOT = \"${ROOT}\"", at "\"${ROOT}\"", P::Value { .. }, nearest None, expected "refer to themselves";
        "dangling model": "model = \"bracket\"\ntruth" => "model = \"brackt\"\ntruth", at "\"brackt\"", P::UnknownName { .. }, nearest Some("bracket"), expected "model";
        "dangling sensor": "sensor = \"camera\", params" => "sensor = \"camra\", params", at "\"camra\"", P::UnknownName { .. }, nearest Some("camera"), expected "sensor";
        "dangling sensor of the truth": "params = { sensor = \"camera\" }" => "params = { sensor = \"cam\" }", at "\"cam\"", P::UnknownName { .. }, nearest Some("camera"), expected "camera";
        "double name": "name = \"bare\"" => "name = \"camera\"", at "\"camera\"", P::Duplicate { .. }, nearest None, expected "another name";
        "name with a dot": "name = \"bare\"" => "name = \"b.c\"", at "\"b.c\"", P::Value { .. }, nearest None, expected "no dot";
        "missing folder": "folder = \".\"" => "folder = \"no/such/folder\"", at "\"no/such/folder\"", P::MissingFile { .. }, nearest None, expected "relative to the task file";
        "both of two choices": "folder = \".\"" => "folder = \".\", pattern = \"a%d.png\"", at "\"a%d.png\"", P::Value { .. }, nearest None, expected "either";
        "a fisheye too wide for the simulation": "focal = [\"200 px\", \"200 px\"]" => "distortion = { kind = \"kannala-brandt\", params = {} }, focal = [\"50 px\", \"50 px\"]", at "", P::Mismatch { .. }, nearest None, expected "at most 70";
        "a fisheye that folds back": "focal = [\"200 px\", \"200 px\"]" => "distortion = { kind = \"kannala-brandt\", params = { k1 = -20.0 } }, focal = [\"200 px\", \"200 px\"]", at "", P::Value { .. }, nearest None, expected "a camera";
        "uncalibrated and colour": "sensor = \"camera\", params" => "sensor = \"bare\", params", at "\"bare\"", P::Mismatch { .. }, nearest None, expected "camera";
        "boxes of a body in space": "{ kind = \"simulated\", params = { sensor = \"camera\" } }" => "{ kind = \"boxes\", params = { path = \"Cargo.toml\" } }", at "\"boxes\"", P::Mismatch { .. }, nearest None, expected "pose space se3";
        "no modality": "modalities = [{ kind = \"edges\", level = \"feature\", sensor = \"camera\", params = { sigma = \"0.5 px\" } }]" => "modalities = []", at "[]", P::Value { .. }, nearest None, expected "at least one";
        "two rotations": "start = {" => "start = { rotation = [\"1 deg\", \"1 deg\", \"1 deg\"], quaternion = [0.0, 0.0, 0.0, 1.0],", at "", P::Value { .. }, nearest None, expected "one of `rotation`";
        "locked twice": "locked = [\"rz\"]" => "locked = [\"rz\", \"rz\"]", at "[\"rz\", \"rz\"]", P::Value { .. }, nearest None, expected "at most once";
    };
    read(GOOD, &[]).expect("the task without faults");
    for case in cases {
        assert!(GOOD.contains(case.from), "{}: nothing to replace", case.name);
        let errors = read(&GOOD.replacen(case.from, case.to, 1), &[]).expect_err(case.name);
        let e = &errors.problems[0];
        assert!((case.right)(&e.problem), "{}: {:?}", case.name, e.problem);
        assert!(e.line().is_some() && e.column().is_some(), "{}: no place", case.name);
        if !case.place.is_empty() {
            assert_eq!(e.excerpt(), Some(case.place), "{}", case.name);
        }
        assert_eq!(e.problem.nearest().as_deref(), case.nearest, "{}", case.name);
        let expected = e.problem.expected().expect(case.name);
        assert!(expected.contains(case.expected), "{}: {expected}", case.name);
    }
}

/// What is found wrong when a task that passes the checks is built.
fn build(text: &str) -> vt_task::TaskError {
    let document = Document::parse("task.toml", text, Path::new(""), &[], &|_| None).unwrap();
    let task = check(&document, &Registry::standard()).unwrap();
    let errors = vt_task::assembly::Scene::build(&document, &task, &Registry::standard()).err().unwrap();
    errors.problems.into_iter().next().unwrap()
}

#[test]
fn scenes_and_objects_that_are_not_there_are_found_when_the_task_is_built() {
    let one = GOOD.find("[[sensors]]\nname = \"bare\"").unwrap()..GOOD.find("[[models]]").unwrap();
    let second = "[[sensors]]\nname = \"right\"\nkind = \"simulated\"\n\
                  params = { scene = \"SCENE\", frames = 5, rate = \"25 Hz\" }\n\
                  camera = { size = [160, 120], focal = [\"200 px\", \"200 px\"], center = [\"79.5 px\", \"59.5 px\"] }\n\n";
    let mut good = GOOD.to_owned();
    good.replace_range(one, second);
    let e = build(&good.replace("SCENE", "right"));
    assert!(e.problem.expected().unwrap().contains("earlier in the task"), "{e}");
    let e = build(
        &good
            .replace("SCENE", "camera")
            .replace("sensor = \"camera\" }", "sensor = \"right\", object = \"box\" }"),
    );
    assert_eq!(e.excerpt(), Some("\"box\""));
    assert!(e.problem.expected().unwrap().contains("`bracket`"), "{e}");
}

#[test]
fn line_and_column_count_from_one() {
    let errors = read(&GOOD.replace("iterations = 2", "iteratons = 2"), &[]).unwrap_err();
    let line = GOOD.lines().position(|l| l.contains("iterations")).unwrap() + 1;
    let column = GOOD.lines().nth(line - 1).unwrap().find("iterations").unwrap() + 1;
    assert_eq!((errors.problems[0].line(), errors.problems[0].column()), (Some(line), Some(column)));
}

#[test]
fn all_problems_are_reported_in_order_of_the_text() {
    let text =
        GOOD.replace("cell = \"20 mm\"", "cell = \"-20 mm\"").replace("iterations = 2", "iterations = 0");
    let errors = read(&text.replace("kind = \"poses\"", "kind = \"posse\""), &[]).unwrap_err();
    let lines: Vec<_> = errors.problems.iter().map(|p| p.line().unwrap()).collect();
    assert_eq!(lines.len(), 3);
    assert!(lines.is_sorted());
}

#[test]
fn overrides_reach_elements_by_name_kind_and_number() {
    let task = read(GOOD, &["targets.one.estimator.kind=particle", "sensors.0.params.frames=7", "title=new"])
        .unwrap();
    assert_eq!(task.targets[0].estimator.kind, "particle");
    assert!(task.targets[0].estimator.params.is_empty(), "the parameters of the old kind are gone");
    assert_eq!(task.sensors[0].params["frames"].as_integer(), Some(7));
    assert_eq!(task.title.as_deref(), Some("new"));
    let task =
        read(GOOD, &["outputs.poses.params.lost=true", "targets.one.modalities.edges.params.sigma=1 px"])
            .unwrap();
    assert_eq!(task.outputs[0].params["lost"].as_bool(), Some(true));
    assert_eq!(task.targets[0].modalities[0].params["sigma"].as_str(), Some("1 px"));
    let task = read(&GOOD.replace("\"good\"", "\"${ROOT} $${x}\""), &["variables.ROOT=/a b"]).unwrap();
    assert_eq!(task.title.as_deref(), Some("/a b ${x}"));
}

#[test]
fn wrong_overrides_are_shown_as_written() {
    for (set, word, nearest) in [
        ("targets.on.model=x", "no element `on`", Some("one")),
        ("title", "no `=`", None),
        ("a..b=1", "empty key", None),
        ("title.x=1", "is a value", None),
        ("targets.one.estimator.kind=kalmn", "unknown estimator `kalmn`", Some("kalman")),
        ("targets.one.estimatr.kind=kalman", "unknown key `estimatr`", Some("estimator")),
    ] {
        let errors = read(GOOD, &[set]).unwrap_err();
        let e = &errors.problems[0];
        assert!(e.to_string().contains(word), "{set}: {e}");
        assert_eq!(e.problem.nearest().as_deref(), nearest, "{set}");
        assert_eq!(e.text.name(), format!("--set {set}"));
        assert_eq!(e.line(), Some(1));
    }
}
