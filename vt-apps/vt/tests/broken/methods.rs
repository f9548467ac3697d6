//! Kinds, levels, units and parameters of the methods that a task chooses.

use crate::support::{Case, check, task};

/// A misspelt kind of a role.
fn kind(what: &'static str, from: &'static str, to: &'static str, words: &'static [&'static str]) -> Case {
    task(what, from, to, words)
}

#[test]
fn unknown_kinds_of_every_role() {
    check(vec![
        kind(
            "sensor",
            "kind = \"images\"",
            "kind = \"image\"",
            &["task.toml:6", "unknown sensor `image`", "nearest: `images`", "simulated"],
        ),
        kind(
            "shape",
            "kind = \"mesh\"",
            "kind = \"mehs\"",
            &["task.toml:12", "unknown shape `mehs`", "nearest: `mesh`"],
        ),
        kind(
            "warp",
            "kind = \"se3\"",
            "kind = \"se3d\"",
            &["task.toml:13", "unknown warp `se3d`", "nearest: `se3`"],
        ),
        kind(
            "dynamics",
            "kind = \"brownian\"",
            "kind = \"brownain\"",
            &["task.toml:14", "unknown dynamics `brownain`", "nearest: `brownian`"],
        ),
        kind(
            "init",
            "kind = \"pose\", params",
            "kind = \"poes\", params",
            &["task.toml:19", "unknown init `poes`", "nearest: `pose`"],
        ),
        kind(
            "modality",
            "kind = \"edges\"",
            "kind = \"edgse\"",
            &["task.toml:20", "unknown modality `edgse`", "nearest: `edges`"],
        ),
        kind(
            "estimator",
            "kind = \"kalman\"",
            "kind = \"kalmna\"",
            &["task.toml:21", "unknown estimator `kalmna`", "nearest: `kalman`", "particle"],
        ),
        kind(
            "loss detector",
            "kind = \"fused\"",
            "kind = \"fuesd\"",
            &["task.toml:22", "unknown loss detector `fuesd`", "nearest: `fused`"],
        ),
        kind(
            "re-initialiser",
            "kind = \"prior\"",
            "kind = \"pior\"",
            &["task.toml:23", "unknown re-initialiser `pior`", "nearest: `prior`"],
        ),
        kind(
            "output",
            "kind = \"overlays\"",
            "kind = \"overlay\"",
            &["task.toml:34", "unknown output `overlay`", "nearest: `overlays`"],
        ),
        kind(
            "truth",
            "init = {",
            "truth = { kind = \"tumm\" }\ninit = {",
            &["task.toml:19", "unknown truth `tumm`", "nearest: `tum`", "matrices"],
        ),
        kind(
            "fusion",
            "init = {",
            "fusion = { kind = \"stakced\" }\ninit = {",
            &["task.toml:19", "unknown fusion `stakced`"],
        ),
        kind(
            "appearance",
            "warp = {",
            "appearance = { kind = \"texure\" }\nwarp = {",
            &["task.toml:13", "unknown appearance `texure`"],
        ),
        kind(
            "association",
            "[[sensors]]",
            "association = { kind = \"one-to-on\" }\n[[sensors]]",
            &["task.toml:4", "unknown association `one-to-on`", "nearest: `one-to-one`"],
        ),
        kind(
            "kind of another role",
            "kind = \"kalman\"",
            "kind = \"edges\"",
            &["task.toml:21", "unknown estimator `edges`", "kalman"],
        ),
        kind(
            "empty kind",
            "kind = \"kalman\"",
            "kind = \"\"",
            &["task.toml:21", "unknown estimator ``", "kalman"],
        ),
        kind("number for a kind", "kind = \"kalman\"", "kind = 3", &["task.toml:21", "expected a string"]),
        kind("no kind", "kind = \"kalman\", ", "", &["task.toml:21", "missing key `kind`"]),
    ]);
}

#[test]
fn wrong_levels() {
    const LEVEL: &str = "level = \"feature\"";
    check(vec![
        task(
            "misspelt level",
            LEVEL,
            "level = \"featrue\"",
            &["task.toml:20", "unknown word `featrue`", "nearest: `feature`", "pixel"],
        ),
        task("number for a level", LEVEL, "level = 2", &["task.toml:20", "expected a word"]),
        task("no level", "level = \"feature\", ", "", &["task.toml:20", "missing key `level`"]),
    ]);
}

#[test]
fn wrong_units() {
    const SIGMA: &str = "rotation = \"2 deg\"";
    const NOISE: &str = "translation = \"20 mm/s^0.5\"";
    check(vec![
        task(
            "millimetres for degrees",
            SIGMA,
            "rotation = \"2 mm\"",
            &["task.toml:19", "2 mm", "expected an angle with a unit (rad, deg, mrad)"],
        ),
        task(
            "degrees for metres",
            "[\"0 m\", \"0 m\", \"0.5 m\"]",
            "[\"0 m\", \"0 deg\", \"0.5 m\"]",
            &["task.toml:19", "0 deg", "expected a length"],
        ),
        task("no unit", SIGMA, "rotation = \"2\"", &["task.toml:19", "\"2\"", "with a unit"]),
        task("number", SIGMA, "rotation = 2", &["task.toml:19", "expected an angle with a unit"]),
        task(
            "misspelt unit",
            SIGMA,
            "rotation = \"2 degs\"",
            &["task.toml:19", "2 degs", "nearest: \"2 deg\""],
        ),
        task("unit alone", SIGMA, "rotation = \"deg\"", &["task.toml:19", "expected an angle"]),
        task(
            "two numbers",
            SIGMA,
            "rotation = \"2 3 deg\"",
            &["task.toml:19", "2 3 deg", "expected an angle"],
        ),
        task(
            "decimal comma",
            SIGMA,
            "rotation = \"2,5 deg\"",
            &["task.toml:19", "2,5 deg", "expected an angle"],
        ),
        task("NaN", SIGMA, "rotation = \"NaN deg\"", &["task.toml:19", "NaN deg", "expected an angle"]),
        task("huge", SIGMA, "rotation = \"1e99 deg\"", &["task.toml:19", "1e99 deg", "1e15 rad"]),
        task("tiny", SIGMA, "rotation = \"1e-99 deg\"", &["task.toml:19", "1e-99 deg", "1e-15"]),
        task(
            "velocity for a diffusion",
            NOISE,
            "translation = \"20 mm/s\"",
            &["task.toml:14", "20 mm/s", "a diffusion of position"],
        ),
        task(
            "rate in seconds",
            "rate = \"25 Hz\"",
            "rate = \"40 ms\"",
            &["task.toml:7", "40 ms", "expected a rate with a unit (Hz"],
        ),
        task(
            "rate of zero",
            "rate = \"25 Hz\"",
            "rate = \"0 Hz\"",
            &["task.toml:7", "expected a positive rate"],
        ),
    ]);
}

#[test]
fn wrong_parameters() {
    const SIGMA: &str = "sigma = \"0.5 px\"";
    const ITERATIONS: &str = "iterations = 2";
    let estimator = |what, to, words| task(what, "kind = \"kalman\", params = { iterations = 2 }", to, words);
    let dynamics = |what, to, words| {
        let from =
            "kind = \"brownian\", params = { translation = \"20 mm/s^0.5\", rotation = \"5 deg/s^0.5\" }";
        task(what, from, to, words)
    };
    check(vec![
        task(
            "negative deviation",
            SIGMA,
            "sigma = \"-1 px\"",
            &["task.toml:20", "expected a positive number"],
        ),
        task("no iteration", ITERATIONS, "iterations = 0", &["task.toml:21", "1 to 100"]),
        task("endless iterations", ITERATIONS, "iterations = 4000000000", &["task.toml:21", "1 to 100"]),
        task(
            "iterations beyond 64 bits",
            ITERATIONS,
            "iterations = 99999999999999999999",
            &["task.toml:21", "99999999999999999999", "expected"],
        ),
        task("half an iteration", ITERATIONS, "iterations = 2.5", &["task.toml:21", "2.5", "expected u32"]),
        task(
            "unknown parameter",
            ITERATIONS,
            "iteration = 2",
            &["task.toml:21", "unknown key `iteration`", "nearest: `iterations`"],
        ),
        task(
            "list for parameters",
            "params = { iterations = 2 }",
            "params = [2]",
            &["task.toml:21", "expected"],
        ),
        estimator(
            "no particle",
            "kind = \"particle\", params = { particles = 0 }",
            &["task.toml:21", "at least 1 particle"],
        ),
        estimator(
            "a trillion particles",
            "kind = \"particle\", params = { particles = 1000000000000 }",
            &["task.toml:21", "at most 1000000"],
        ),
        estimator(
            "share of particles",
            "kind = \"particle\", params = { effective_share = 1.5 }",
            &["task.toml:21", "from 0 to 1"],
        ),
        estimator(
            "unknown resampling",
            "kind = \"particle\", params = { resampling = \"sistematic\" }",
            &["task.toml:21", "nearest: `systematic`"],
        ),
        dynamics(
            "dynamics without parameters",
            "kind = \"brownian\"",
            &["task.toml:14", "missing key `translation`"],
        ),
        dynamics(
            "dynamics of another kind",
            "kind = \"constant-velocity\", params = { translation = \"20 mm/s^0.5\" }",
            &["task.toml:14", "expected a diffusion of velocity"],
        ),
        task(
            "a good step that speaks for a loss",
            "kind = \"fused\"",
            "kind = \"fused\", params = { least = 1.0 }",
            &["task.toml:22", "expected a negative number"],
        ),
        task(
            "doubt beyond certainty",
            "kind = \"fused\"",
            "kind = \"fused\", params = { doubt = 1.5 }",
            &["task.toml:22", "expected a probability"],
        ),
        task("range of a search", SIGMA, "range = [\"9 px\", \"3 px\"]", &["task.toml:20", "ascending"]),
        task("sites without number", SIGMA, "max_sites = 0", &["task.toml:20", "at least 1 site"]),
        task(
            "sites without end",
            SIGMA,
            "max_sites = 9223372036854775807",
            &["task.toml:20", "at most 100000"],
        ),
        task("too many candidates", SIGMA, "max_candidates = 1000000000", &["task.toml:20", "1 to 32"]),
        task(
            "locked axis",
            "kind = \"se3\" }",
            "kind = \"se3\", params = { locked = [\"tw\"] } }",
            &["task.toml:13", "unknown word `tw`", "nearest: `tx`"],
        ),
        task(
            "quaternion of length 2",
            "translation = [\"0 m\", \"0 m\", \"0.5 m\"]",
            "quaternion = [0.0, 0.0, 0.0, 2.0]",
            &["task.toml:19", "of length 2", "of length 1"],
        ),
        task(
            "matrix that mirrors",
            "translation = [\"0 m\", \"0 m\", \"0.5 m\"]",
            "matrix = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]]",
            &["task.toml:19", "not orthonormal", "determinant +1"],
        ),
    ]);
}
