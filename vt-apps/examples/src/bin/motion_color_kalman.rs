//! Kalman filter by motion and colour (the paper's Fig. 7).
//!
//! Model: a flat rectangle that is moved; its colours as they are at the start or in a reference picture.
//! Measurement: mass centres of what moves and of what has its colours (Fisher's discriminant), at object level.
//! Tracker: Kalman filter of both measurements, stacked; with `--set targets.object.fusion.kind=equivalent-measurements` one filter
//! for each.
//!
//! Without options a simulated scene is tracked. Own pictures, of a camera that stands still, take `--images` and `--init`.

use std::process::ExitCode;

use vt_examples::flat::Program;

fn main() -> ExitCode {
    let program = Program {
        name: "motion-color-kalman",
        simulated: include_str!("../../../tasks/motion-color-kalman.toml"),
        own: include_str!("../own-motion-color.toml"),
        references: &["targets.object.modalities.0.params.reference"],
    };
    program.main()
}
