//! Programs that follow flat models, run on the first frames of their scenes.

use std::process::Command;

#[test]
fn flat_programs_write_a_box_a_frame() {
    let programs = [
        (env!("CARGO_BIN_EXE_contour-condensation"), "contour"),
        (env!("CARGO_BIN_EXE_color-particle"), "color"),
        (env!("CARGO_BIN_EXE_motion-color-kalman"), "motion-color"),
    ];
    for (program, name) in programs {
        let out = tempfile::tempdir().expect("a folder");
        let run = Command::new(program)
            .args(["--max-frames", "3", "--out"])
            .arg(out.path())
            .output()
            .expect("a program");
        let said = String::from_utf8_lossy(&run.stderr);
        assert!(run.status.success(), "{name}: {said}");
        let boxes = std::fs::read_to_string(out.path().join("boxes.txt")).expect("boxes");
        assert_eq!(boxes.lines().filter(|l| !l.starts_with('#')).count(), 3, "{name}: {boxes}");
    }
}
