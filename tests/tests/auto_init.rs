//! Initialisation from the model alone: the init `auto` and the re-initialiser `views` in whole tasks.

use std::path::PathBuf;

use vt_core::report::Status;
use vt_tests::data;
use vt_tests::replay::Replay;

fn file(path: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../vt-apps").join(path)
}

#[test]
fn the_castle_is_found_without_a_prior_and_then_tracked() {
    if data::root("VISP_IMAGES").is_none() {
        return;
    }
    let set = ["targets.castle.init={ kind = \"auto\" }", "sensors.camera.params.last=6"];
    let run = Replay::load(file("tasks/castle-simu.toml"), &set).unwrap().run().unwrap();
    let target = &run.summary.targets[0];
    assert_eq!(target.translation_errors.len(), 6, "tracked from the first picture on");
    let most = |v: &[f64]| v.iter().copied().fold(0.0, f64::max);
    assert!(most(&target.translation_errors) < 5e-3, "{:?}", target.translation_errors);
    assert!(most(&target.rotation_errors) < 2f64.to_radians(), "{:?}", target.rotation_errors);
}

#[test]
fn after_full_occlusion_the_house_is_back_within_ten_frames() {
    // From frame 63 on more of the house is seen than the plate hides; from frame 68 on all of it.
    // Nothing is said of re-initialisation: the default acts.
    let run = Replay::load(file("scenarios/full-occlusion.toml"), &[]).unwrap().run().unwrap();
    // While it is hidden, the plate's outline may be taken for that of its front: what counts is that this ends.
    let errors = &run.summary.targets[0];
    let late: Vec<_> = run.reports.iter().filter(|r| r.frame >= 78).collect();
    assert!(late.iter().all(|r| r.verdict.status != Status::Lost), "lost again or still");
    let last = errors.translation_errors.last().copied().unwrap_or(f64::INFINITY);
    assert!(last < 5e-3, "{last} m");
}
