//! The command line.

use crate::support::{Case, check};

fn command(command: &'static str, words: &'static [&'static str]) -> Case {
    Case { what: command, changes: vec![], command, words }
}

#[test]
fn commands_and_arguments() {
    check(vec![
        command("", &["subcommand"]),
        command("rum task.toml", &["rum", "similar", "'run'"]),
        command("run", &["<TASK>"]),
        command("run task.toml --ouf out", &["--ouf", "'--out'"]),
        command("run task.toml --threads 0", &["--threads", "1..=1024"]),
        command("run task.toml --threads 9999999", &["--threads", "9999999"]),
        command("run task.toml --threads two", &["--threads", "two"]),
        command("run task.toml --max-frames -1", &["-1"]),
        command("run task.toml --seed 4294967296", &["--seed", "4294967296"]),
        command("run task.toml --reset-on-failure 5cm,5deg", &["--truth"]),
        command(
            "run task.toml --truth truth.tum --reset-on-failure 5,5",
            &["--reset-on-failure", "with a unit"],
        ),
        command("run task.toml --truth truth.tum --sequences frames", &["cannot be used with"]),
        command("run task.toml --truth a=truth.tum --truth cube=truth.tum", &["--truth", "second truth"]),
        command("eval estimates.tum", &["--truth"]),
        command("eval estimates.tum --truth truth.tum --model cube.obj", &["--unit"]),
        command("eval estimates.tum --truth truth.tum --plot a.gif", &["--plot", ".png or .svg"]),
        command("model inspec cube.obj", &["inspec", "'inspect'"]),
        command("sim stil", &["stil", "nearest: still"]),
        command("sim no.toml", &["no.toml", "No such file"]),
        command("sim task.toml --out out", &["task.toml", "at least one sensor of kind `simulated`"]),
        command("sim still --frames 0 --out out", &["expected", "frame"]),
        command("sim still --frames 99999999999 --out out", &["99999999999", "expected", "1000000"]),
    ]);
}

#[test]
fn settings() {
    check(vec![
        command("explain task.toml --set title", &["--set title", "no `=`", "expected KEY=VALUE"]),
        command("explain task.toml --set =1", &["--set =1", "empty key"]),
        command(
            "explain task.toml --set titel=a",
            &["--set titel=a", "unknown key `titel`", "nearest: `title`"],
        ),
        command("explain task.toml --set targets.cub.model=cube", &["no element `cub`", "nearest: `cube`"]),
        command("explain task.toml --set targets.9.model=cube", &["no element `9`", "cube"]),
        command("explain task.toml --set title.a.b=1", &["`title` is a value, not a table"]),
        command(
            "explain task.toml --set targets.cube.estimator.kind=kalmann",
            &["unknown estimator `kalmann`", "nearest: `kalman`"],
        ),
        command(
            "explain task.toml --set sensors.camera.camera.focal=[nan,1]",
            &["--set sensors.camera.camera.focal", "expected a finite number"],
        ),
        command(deep(), &["more than 64 keys"]),
        command(nested(), &["--set sensors=[[[", "expected a sequence"]),
    ]);
}

fn deep() -> &'static str {
    format!("explain task.toml --set {}a=1", "a.".repeat(30_000)).leak()
}

fn nested() -> &'static str {
    format!("explain task.toml --set sensors={}", "[".repeat(5_000)).leak()
}
