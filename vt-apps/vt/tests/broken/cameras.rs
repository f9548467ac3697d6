//! Intrinsic parameters.

use crate::support::{Case, check, task};

const FOCAL: &str = "focal = [\"60 px\", \"60 px\"]";
const CENTER: &str = "center = [\"31.5 px\", \"23.5 px\"]";
const SIZE: &str = "size = [64, 48]";

fn focal(what: &'static str, to: &'static str, words: &'static [&'static str]) -> Case {
    task(what, FOCAL, to, words)
}

#[test]
fn intrinsic_parameters_that_are_none() {
    const HERE: &str = "task.toml:8";
    check(vec![
        focal("NaN", "focal = [\"nan px\", \"60 px\"]", &[HERE, "nan px", "expected a number of pixels"]),
        focal("NaN without unit", "focal = [nan, 60.0]", &[HERE, "expected a finite number"]),
        focal(
            "infinite",
            "focal = [\"inf px\", \"60 px\"]",
            &[HERE, "inf px", "expected a number of pixels"],
        ),
        focal("zero", "focal = [\"0 px\", \"60 px\"]", &[HERE, "expected positive focal lengths"]),
        focal("negative", "focal = [\"60 px\", \"-60 px\"]", &[HERE, "expected positive focal lengths"]),
        focal("huge", "focal = [\"1e300 px\", \"60 px\"]", &[HERE, "1e-15 to 1e15 px"]),
        focal("in millimetres", "focal = [\"6 mm\", \"6 mm\"]", &[HERE, "6 mm", "with a unit (px)"]),
        focal("one", "focal = \"60 px\"", &[HERE, "expected an array of length 2"]),
        focal("three", "focal = [\"60 px\", \"60 px\", \"1 px\"]", &[HERE, "expected", "2"]),
        task("no focal length", "focal = [\"60 px\", \"60 px\"], ", "", &[HERE, "missing key `focal`"]),
        focal("misspelt", "focl = [\"60 px\", \"60 px\"]", &[HERE, "unknown key `focl`", "nearest: `focal`"]),
        task(
            "NaN centre",
            CENTER,
            "center = [\"nan px\", \"23.5 px\"]",
            &[HERE, "nan px", "number of pixels"],
        ),
        task("centre far away", CENTER, "center = [\"1e14 px\", \"23.5 px\"]", &[HERE, "center", "expected"]),
        task("centre without unit", CENTER, "center = [31.5, 23.5]", &[HERE, "31.5", "\"8 px\""]),
        task("no columns", SIZE, "size = [0, 48]", &[HERE, "columns and rows from 1"]),
        task("negative size", SIZE, "size = [-64, 48]", &[HERE, "-64", "expected u32"]),
        task("broken size", SIZE, "size = [64.5, 48]", &[HERE, "64.5", "expected u32"]),
        task("huge size", SIZE, "size = [99999, 48]", &[HERE, "from 1 to 32768"]),
        task("many pixels", SIZE, "size = [32768, 32768]", &[HERE, "at most 134217728 pixels"]),
        task("size with unit", SIZE, "size = [\"64 px\", \"48 px\"]", &[HERE, "64 px", "expected u32"]),
    ]);
}

#[test]
fn lenses_that_are_none() {
    let lens = |what, to, words| task(what, CENTER, to, words);
    check(vec![
        lens(
            "unknown kind",
            "center = [\"31.5 px\", \"23.5 px\"], distortion = { kind = \"brown\", params = {} }",
            &["task.toml:8", "brown-conrady", "kannala-brandt"],
        ),
        lens(
            "misspelt kind",
            "center = [\"31.5 px\", \"23.5 px\"], distortion = { kind = \"brown-conradi\", params = {} }",
            &["task.toml:8", "unknown word `brown-conradi`", "nearest: `brown-conrady`"],
        ),
        lens(
            "coefficient of another model",
            "center = [\"31.5 px\", \"23.5 px\"], distortion = { kind = \"kannala-brandt\", params = { p1 = 0.1 } }",
            &["task.toml:8", "unknown key `p1`", "k1, k2, k3, k4"],
        ),
        lens(
            "list of coefficients",
            "center = [\"31.5 px\", \"23.5 px\"], distortion = { kind = \"brown-conrady\", params = [0.1, 0.2] }",
            &["task.toml:8", "expected"],
        ),
        lens(
            "NaN coefficient",
            "center = [\"31.5 px\", \"23.5 px\"], distortion = { kind = \"brown-conrady\", params = { k1 = nan } }",
            &["task.toml:8", "expected a finite number"],
        ),
        lens(
            "coefficient of 1e300",
            "center = [\"31.5 px\", \"23.5 px\"], distortion = { kind = \"brown-conrady\", params = { k1 = 1e300 } }",
            &["task.toml:8", "k1", "expected"],
        ),
        lens(
            "text for a coefficient",
            "center = [\"31.5 px\", \"23.5 px\"], distortion = { kind = \"brown-conrady\", params = { k1 = \"0.1\" } }",
            &["task.toml:8", "\"0.1\"", "expected f64"],
        ),
        lens(
            "fisheye that folds back",
            "center = [\"31.5 px\", \"23.5 px\"], distortion = { kind = \"kannala-brandt\", params = { k1 = -20.0 } }",
            &["task.toml:8", "expected"],
        ),
    ]);
}
