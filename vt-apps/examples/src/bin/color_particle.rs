//! Colour particle filter (the paper's Fig. 6).
//!
//! Model: a flat rectangle under translation and scale, Brownian motion; its colours as they are at the start or in a
//! reference picture.
//! Measurement: histograms of hue and saturation under every hypothesis, at pixel level.
//! Tracker: particle filter with deterministic resampling.
//!
//! Without options a simulated scene is tracked. Own pictures take `--images` and `--init`; there two parts know their colours, those of
//! the surroundings count less, a template of grey levels is a second measurement, both adapt to what is seen while the estimate is trusted,
//! and a lost object is looked for by its colours.

use std::process::ExitCode;

use vt_examples::flat::Program;

fn main() -> ExitCode {
    let program = Program {
        name: "color-particle",
        simulated: include_str!("../../../tasks/color-particle.toml"),
        own: include_str!("../own-color.toml"),
        references: &[
            "targets.object.modalities.0.params.reference",
            "targets.object.modalities.1.params.reference",
        ],
    };
    program.main()
}
