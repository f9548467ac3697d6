//! Colour alone, motion alone, and both in one filter or in two: the paper's Fig. 7 on real sequences with truth.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::Parser;
use image::{Rgb, RgbImage};
use vt_core::agent::Sensor;
use vt_core::frame::{Frame, Payload};
use vt_core::metrics::Rectangle;
use vt_core::random::{Random, Stream};
use vt_fusion::tracking::TrackingLoop;
use vt_task::assembly::Scene;
use vt_task::{Document, Registry, check};

/// Mean error of the centre and lost frames of each way to fuse, and how often of 1,000 resamples the fused error is the least. Start boxes are the
/// truth of a target's first frame; nothing is learnt from later truth.
#[derive(Parser)]
struct Arguments {
    /// Folder with `sot`, `pets` and `mot`.
    #[arg(long, env = "VT_DATA")]
    data: PathBuf,
    /// The task, with its two modalities: colour, then motion.
    #[arg(long, default_value = "vt-apps/examples/src/own-motion-color.toml")]
    task: PathBuf,
    /// Sets a value of the task in all variants, as in `vt run`.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Frames of a block, which are drawn together: errors of neighbours are alike.
    #[arg(long, default_value_t = 10)]
    block: usize,
    /// Only sequences whose name has this.
    #[arg(long)]
    only: Option<String>,
    /// Folder for pictures with the truth (green) and the variants, every `--every` frames.
    #[arg(long)]
    pictures: Option<PathBuf>,
    /// Distance of frames that are drawn.
    #[arg(long, default_value_t = 10)]
    every: u64,
    /// Prints the errors of every frame.
    #[arg(long)]
    frames: bool,
}

/// Name, settings and colour of a variant. The first two are single modules.
const VARIANTS: [(&str, &str, [u8; 3]); 6] = [
    ("colour", "targets.object.modalities=[{MODALITY0}]", [255, 60, 60]),
    ("motion", "targets.object.modalities=[{MODALITY1}]", [60, 120, 255]),
    ("static", "targets.object.fusion={kind='stacked'}", [255, 255, 0]),
    ("equivalent", "targets.object.fusion={kind='equivalent-measurements'}", [255, 0, 255]),
    ("intersection", "targets.object.fusion={kind='intersection'}", [0, 255, 255]),
    ("campo", "targets.object.fusion={kind='bar-shalom-campo'}", [255, 255, 255]),
];
/// Number of the variant that is judged.
const FUSED: usize = 2;

/// A target with its true boxes by frame number.
struct Track {
    name: String,
    boxes: Vec<(u64, Rectangle)>,
}

/// A sequence of pictures with targets.
struct Sequence {
    /// Settings of the task's sensor.
    sensor: String,
    tracks: Vec<Track>,
}
