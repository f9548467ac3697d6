//! Colour alone, motion alone, and both in one filter or in two: the paper's Fig. 7 on real sequences with truth.

mod tracks;

use std::fmt::Write as _;
use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use clap::Parser;
use image::{Rgb, RgbImage};
use rayon::prelude::*;
use vt_core::frame::Frame;
use vt_core::lie::picture_from_plane;
use vt_core::metrics::Rectangle;
use vt_core::random::{Random, Stream};
use vt_fusion::tracking::TrackingLoop;
use vt_task::assembly::Scene;
use vt_task::language::Choice;
use vt_task::{Document, Registry, check};

use tracks::Track;

/// Mean error of the centre and lost frames of each way to fuse, and in how many of 1,000 resamples fusion has the least error. A target
/// starts at the true box of its first frame; nothing is learnt from later truth, and all sequences have the same parameters.
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
    /// Targets that parameters are chosen on, instead of those that are judged.
    #[arg(long)]
    develop: bool,
    /// Starts in the life of each target of development.
    #[arg(long, default_value_t = 3)]
    starts: usize,
    /// Without dynamic fusion.
    #[arg(long)]
    quick: bool,
    /// Only targets with this in their name.
    #[arg(long)]
    only: Option<String>,
    /// Folder for pictures with the truth (green), colour (red), motion (blue), static (yellow) and dynamic (magenta, cyan) fusion.
    #[arg(long)]
    pictures: Option<PathBuf>,
    /// Folder for tables of the errors, frame by frame.
    #[arg(long)]
    tables: Option<PathBuf>,
    /// Distance of the frames that are drawn.
    #[arg(long, default_value_t = 10)]
    every: usize,
}

/// Name, modalities, fusion, colour in pictures.
type Variant = (&'static str, &'static [usize], &'static str, [u8; 3]);

const VARIANTS: [Variant; 5] = [
    ("colour alone", &[0], "stacked", [255, 60, 60]),
    ("motion alone", &[1], "stacked", [60, 120, 255]),
    ("static", &[0, 1], "stacked", [255, 255, 0]),
    ("dynamic, equivalent measurements", &[0, 1], "equivalent-measurements", [255, 0, 255]),
    ("dynamic, intersection", &[0, 1], "intersection", [0, 255, 255]),
];

const RESAMPLES: u64 = 1000;

/// The sensor and the tracking loops of all variants of a target.
fn loops(track: &Track, a: &Arguments) -> Result<(Scene, Vec<Document>)> {
    let Rectangle { x, y, width, height } = track.boxes[0].context("no first box")?;
    let mut set = track.sensor.clone();
    set.push(format!("models.object.shape.params.size=['{width} px', '{height} px']"));
    set.push(format!("targets.object.init.params.box=['{x} px', '{y} px', '{width} px', '{height} px']"));
    set.extend(a.set.iter().cloned());
    let document = Document::load(&a.task, &set)?;
    let registry = Registry::standard();
    let task = check(&document, &registry)?;
    let variants = VARIANTS.iter().take(if a.quick { 3 } else { 5 }).map(|(_, modalities, fusion, _)| {
        let mut task = task.clone();
        task.outputs.clear();
        let target = &mut task.targets[0];
        target.modalities = modalities.iter().map(|&k| target.modalities[k].clone()).collect();
        let mut fusion = Choice::of(fusion);
        if fusion.kind != VARIANTS[0].2 {
            fusion.params.insert("feedback".into(), true.into());
        }
        target.fusion = Some(fusion);
        Ok(Document::of(&task, document.base())?)
    });
    let variants = variants.collect::<Result<Vec<_>>>()?;
    Ok((Scene::build(&document, &task, &registry)?, variants))
}

fn start(documents: &[Document], scene: &Scene, first: &Frame) -> Result<Vec<TrackingLoop>> {
    let registry = Registry::standard();
    let build = |document: &Document| {
        let task = check(document, &registry)?;
        Ok(scene.tracking(document, &task, &registry, core::slice::from_ref(first))?)
    };
    documents.iter().map(build).collect()
}

/// Errors of one frame: distance of the centres, and whether the centre is outside of the true box.
type Errors = [(f64, bool); VARIANTS.len()];

/// What was measured of the motion and colours of one target.
struct Outcome {
    errors: Vec<Errors>,
    /// Sum of NIS and of degrees of freedom of the corrections that kept the target.
    surprise: [[f64; 2]; VARIANTS.len()],
}

fn follow(track: &Track, a: &Arguments) -> Result<Outcome> {
    let (mut scene, documents) = loops(track, a)?;
    let mut tracking: Option<Vec<TrackingLoop>> = None;
    let mut out = Outcome { errors: vec![], surprise: Default::default() };
    for (k, truth) in track.boxes.iter().enumerate() {
        let Some(frame) = scene.sensors[0].next()? else { break };
        if tracking.is_none() {
            tracking = Some(start(&documents, &scene, &frame)?);
        }
        let mut errors = [(0.0, false); VARIANTS.len()];
        let mut picture = frame.rgb()?.clone();
        for (v, tracking) in tracking.iter_mut().flatten().enumerate() {
            let report = tracking.step([frame.clone()])?.first().context("no report")?;
            ensure!(report.failure.is_none(), "{:?}", report.failure);
            let pose = picture_from_plane(&report.posterior).context("no flat pose")?;
            let (x, y) = (pose.m13, pose.m23);
            if let Some(t) = truth {
                // Pixel centres are at whole coordinates, borders of boxes half a pixel off.
                let apart = [x - (t.x + 0.5 * (t.width - 1.0)), y - (t.y + 0.5 * (t.height - 1.0))];
                let outside = 2.0 * apart[0].abs() > t.width || 2.0 * apart[1].abs() > t.height;
                if let Some(innovation) = report.assessment.innovation.filter(|_| !outside) {
                    out.surprise[v][0] += innovation.nis;
                    out.surprise[v][1] += innovation.dof as f64;
                }
                errors[v] = ((apart[0] * apart[0] + apart[1] * apart[1]).sqrt(), outside);
                let own = Rectangle { x: x - 0.5 * t.width, y: y - 0.5 * t.height, ..*t };
                draw(&mut picture, &own, VARIANTS[v].3);
            }
        }
        if let Some(t) = truth {
            out.errors.push(errors);
            draw(&mut picture, t, [0, 255, 0]);
        }
        if let Some(folder) = a.pictures.as_ref().filter(|_| k % a.every == 0) {
            picture.save(folder.join(format!("{}-{k:04}.png", track.name.replace(' ', "-"))))?;
        }
    }
    Ok(out)
}

/// Draws the sides of a box.
fn draw(picture: &mut RgbImage, r: &Rectangle, colour: [u8; 3]) {
    let (w, h) = picture.dimensions();
    let mut dot = |x: f64, y: f64| {
        if x >= 0.0 && y >= 0.0 && x < f64::from(w) && y < f64::from(h) {
            picture.put_pixel(x as u32, y as u32, Rgb(colour));
        }
    };
    (0..=r.width as u32).for_each(|k| [0.0, r.height].iter().for_each(|d| dot(r.x + f64::from(k), r.y + d)));
    (0..=r.height as u32).for_each(|k| [0.0, r.width].iter().for_each(|d| dot(r.x + d, r.y + f64::from(k))));
}

/// Sum of the errors of each variant over the frames of a block.
fn sums(block: &[Errors]) -> [f64; VARIANTS.len()] {
    core::array::from_fn(|v| block.iter().map(|e| e[v].0).sum())
}

/// Share of resamples, of as many blocks as there are, in which variant `v` has a lower error than both modules.
fn best(blocks: &[[f64; VARIANTS.len()]], v: usize) -> f64 {
    let wins = (0..RESAMPLES).filter(|&k| {
        let random = &mut Random::new(1, Stream::Sim, 0, k, 0);
        let mut total = [0.0; VARIANTS.len()];
        for _ in blocks {
            let block = &blocks[random.index(blocks.len())];
            total.iter_mut().zip(block).for_each(|(t, b)| *t += b);
        }
        total[v] < total[0].min(total[1])
    });
    wins.count() as f64 / RESAMPLES as f64
}

fn print(name: &str, outcome: &Outcome, block: usize) {
    let frames = outcome.errors.len();
    println!("{name}, {frames} frames");
    let blocks: Vec<_> = outcome.errors.chunks(block).map(sums).collect();
    for (v, (variant, ..)) in VARIANTS.iter().enumerate() {
        let mean = outcome.errors.iter().map(|e| e[v].0).sum::<f64>() / frames as f64;
        let lost = outcome.errors.iter().filter(|e| e[v].1).count();
        let [nis, dof] = outcome.surprise[v];
        let wins = if v < 2 { String::new() } else { format!("  {:.3}", best(&blocks, v)) };
        // A rule without a filter of its own has no innovation; a measurement has two numbers.
        let nis = if dof > 0.0 {
            format!("NIS {:.2} of 1, {:4.0} %", nis / dof, 50.0 * dof / (frames - lost) as f64)
        } else {
            String::new()
        };
        println!("  {variant:<34}{mean:8.2} px{lost:6} lost  {nis}{wins}");
    }
}

fn main() -> Result<()> {
    let a = Arguments::parse();
    ensure!(a.block > 0 && a.starts > 0, "nothing to do");
    let mut tracks =
        if a.develop { tracks::development(&a.data, a.starts)? } else { tracks::judged(&a.data)? };
    tracks.retain(|t| a.only.as_ref().is_none_or(|only| t.name.contains(only)));
    ensure!(!tracks.is_empty(), "no such target");
    println!(
        "error of the centre, frames with the centre outside of the true box; in the others NIS per degree"
    );
    println!(
        "of freedom and measurements a frame; share of {RESAMPLES} resamples in which it is better than both modules"
    );
    let outcomes: Vec<Outcome> = tracks.par_iter().map(|t| follow(t, &a)).collect::<Result<_>>()?;
    let mut all = Outcome { errors: vec![], surprise: Default::default() };
    for (track, outcome) in tracks.iter().zip(&outcomes) {
        print(&track.name, outcome, a.block);
        if let Some(folder) = &a.tables {
            let mut table = String::new();
            for e in &outcome.errors {
                e.iter().try_for_each(|(error, _)| write!(table, "{error:.1},"))?;
                table.push('\n');
            }
            std::fs::write(folder.join(format!("{}.csv", track.name.replace(' ', "-"))), table)?;
        }
        all.errors.extend(&outcome.errors);
        for (sum, part) in all.surprise.iter_mut().zip(outcome.surprise) {
            *sum = [sum[0] + part[0], sum[1] + part[1]];
        }
    }
    print("all", &all, a.block);
    Ok(())
}
