//! A crate depends on nothing of this project but what the plan in `ARCHITECTURE.md` allows.

use std::collections::{BTreeMap, BTreeSet};
use std::process::Command;

fn allowed() -> BTreeMap<&'static str, BTreeSet<&'static str>> {
    let table: [(&str, &[&str]); 12] = [
        ("vt-core", &[]),
        ("vt-models", &["vt-core"]),
        ("vt-vision", &["vt-core", "vt-models"]),
        ("vt-estimators", &["vt-core"]),
        ("vt-fusion", &["vt-core", "vt-estimators"]),
        ("vt-io", &["vt-core"]),
        ("vt-sim", &["vt-core", "vt-models"]),
        ("vt-task", &["vt-core", "vt-models", "vt-vision", "vt-estimators", "vt-fusion", "vt-io", "vt-sim"]),
        ("vt", &["vt-core", "vt-models", "vt-fusion", "vt-io", "vt-task"]),
        ("vt-examples", &["vt", "vt-task"]),
        (
            "vt-tests",
            &[
                "vt-core",
                "vt-models",
                "vt-vision",
                "vt-estimators",
                "vt-fusion",
                "vt-io",
                "vt-sim",
                "vt-task",
            ],
        ),
        ("vt-benches", &[]),
    ];
    table.into_iter().map(|(name, on)| (name, on.iter().copied().collect())).collect()
}

fn metadata() -> serde_json::Value {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--no-deps", "--offline"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo runs");
    serde_json::from_slice(&output.stdout).expect("cargo prints JSON")
}

#[test]
fn crates_know_only_whom_the_plan_allows() {
    let allowed = allowed();
    let metadata = metadata();
    let packages = metadata["packages"].as_array().expect("packages");
    assert_eq!(packages.len(), allowed.len(), "a crate is missing in the table or in the workspace");
    for package in packages {
        let name = package["name"].as_str().expect("name");
        let may = allowed.get(name).unwrap_or_else(|| panic!("`{name}` is not in the plan"));
        for dependency in package["dependencies"].as_array().expect("dependencies") {
            let on = dependency["name"].as_str().expect("name");
            let inside = allowed.contains_key(on) && dependency["kind"].is_null();
            assert!(!inside || may.contains(on), "`{name}` must not depend on `{on}`");
        }
    }
}

/// Who only wants filters gets no image, no mesh and no window.
#[test]
fn estimators_alone_pull_in_no_pictures() {
    let output = Command::new(env!("CARGO"))
        .args(["tree", "-p", "vt-estimators", "-e", "normal", "--prefix", "none", "--offline"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo runs");
    let tree = String::from_utf8_lossy(&output.stdout);
    assert!(tree.contains("nalgebra"), "{tree}");
    for unwanted in ["image ", "parry3d", "vt-models", "vt-vision", "png "] {
        assert!(!tree.lines().any(|l| l.starts_with(unwanted)), "{unwanted} in {tree}");
    }
}
