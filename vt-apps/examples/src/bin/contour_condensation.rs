//! Contour Condensation (the paper's Fig. 5).
//!
//! Model: a flat outline under a roto-translation with scale, Brownian motion; points of the outline as features.
//! Measurement: all edges along the normals of every hypothesis, at pixel level.
//! Tracker: particle filter with deterministic resampling.
//!
//! Without options a simulated scene is tracked. Own pictures take `--images` and `--init`: the outline is then the ellipse
//! in the box, or what `--set models.object.shape=…` says.

use std::process::ExitCode;

use vt_examples::flat::Program;

fn main() -> ExitCode {
    let program = Program {
        name: "contour-condensation",
        simulated: include_str!("../../../tasks/contour-condensation.toml"),
        own: include_str!("../own-contour.toml"),
        references: &[],
    };
    program.main()
}
