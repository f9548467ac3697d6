//! Direct alignment beside ViSP's template tracker, on planar sequences with exact corners:
//! `cargo run --release -p vt-tests --bin template_vs_visp -- SEQUENCES [--visp VISP_TEMPLATE]`. The sequences are those of
//! `make_template_sequence.py`, one folder a variant. One thread; times are those of the process's CPU clock, from a picture in
//! memory to the pose. The template is that of the first frame, and every frame starts from the pose of the one before.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, ensure};
use clap::Parser;
use cpu_time::ProcessTime;
use image::GrayImage;
use nalgebra::Point2;
use vt_core::agent::{Posed, Warp};
use vt_core::lie::SL3;
use vt_core::robust::Robust;
use vt_models::warp::PlanarWarp;
use vt_tests::replay::median;
use vt_vision::alignment::{Aligner, AlignmentParams, Method, Similarity, Template};

/// Compares alignment with `visp_template`.
#[derive(Parser)]
struct Arguments {
    /// Folder with a folder for every variant.
    sequences: PathBuf,
    /// The program `visp_template` (built from the comparison sources).
    #[arg(long)]
    visp: Option<PathBuf>,
    /// Number of points of a level.
    #[arg(long, default_value_t = AlignmentParams::default().points)]
    points: usize,
    /// Number of pyramid levels.
    #[arg(long, default_value_t = AlignmentParams::default().levels)]
    levels: u32,
    /// Level at which the descent ends.
    #[arg(long, default_value_t = AlignmentParams::default().finest)]
    finest: u32,
    /// Smoothing, pixels.
    #[arg(long, default_value_t = AlignmentParams::default().smoothing)]
    smoothing: f64,
    /// Only this variant.
    #[arg(long)]
    variant: Option<String>,
    /// Last step, pixels.
    #[arg(long, default_value_t = AlignmentParams::default().tolerance)]
    tolerance: f64,
}

const VARIANTS: [&str; 5] = ["plain", "illumination", "inverted", "noise", "occluder"];

/// Corners of all frames, clockwise from the top left.
fn read_corners(path: &Path) -> Result<Vec<[Point2<f64>; 4]>> {
    let text = fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    let line = |line: &str| {
        let v: Vec<f64> = line.split_whitespace().map(str::parse).collect::<Result<_, _>>()?;
        ensure!(v.len() == 8, "{} values in a line of {}", v.len(), path.display());
        Ok([0, 1, 2, 3].map(|k| Point2::new(v[2 * k], v[2 * k + 1])))
    };
    text.lines().map(line).collect()
}

fn read_frames(folder: &Path) -> Result<Vec<GrayImage>> {
    let mut names: Vec<PathBuf> = fs::read_dir(folder)?
        .map(|entry| Ok(entry?.path()))
        .filter(|path: &Result<PathBuf>| {
            path.as_ref().map_or(true, |p| p.extension().is_some_and(|e| e == "png"))
        })
        .collect::<Result<_>>()?;
    names.sort();
    names.iter().map(|name| Ok(image::open(name)?.to_luma8())).collect()
}

/// Mean distance of the corners.
fn distance(a: &[Point2<f64>; 4], b: &[Point2<f64>; 4]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).norm()).sum::<f64>() / 4.0
}

/// Prints a row of the table.
fn row(variant: &str, name: &str, errors: &[f64], frames: usize, cpu: &[f64], rest: &str) {
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    let most = errors.iter().fold(0.0, |a: f64, &b| a.max(b));
    let close = errors.iter().filter(|e| **e < 5.0).count() as f64 / frames as f64;
    println!("| {variant} | {name} | {mean:.4} | {most:.3} | {close:.2} | {:.3} | {rest} |", median(cpu));
}

fn track(
    variant: &str,
    name: &str,
    params: AlignmentParams,
    frames: &[GrayImage],
    truth: &[[Point2<f64>; 4]],
) -> Result<()> {
    // The template stands upright in the first frame.
    let first = &truth[0];
    let size = [first[1].x - first[0].x, first[3].y - first[0].y];
    let corners = [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]
        .map(|[x, y]| Point2::new(x * size[0], y * size[1]));
    let mut pose = SL3::from_points(&corners, first).context("corners of the first frame")?;
    let template = Template::new(params, &frames[0], size, &pose)?;
    let points: Vec<String> = template.points().map(|n| n.to_string()).collect();
    let mut aligner = Aligner::new(template);
    let warp = PlanarWarp::<SL3>::default();
    let (mut errors, mut cpu, mut iterations, mut converged) = (vec![], vec![], 0, 0);
    for (frame, truth) in frames.iter().zip(truth) {
        let start = ProcessTime::now();
        let found = aligner.align(frame, &pose);
        cpu.push(start.elapsed().as_secs_f64() * 1e3);
        let Ok(found) = found else { break };
        iterations += found.iterations;
        converged += usize::from(found.converged());
        pose = found.pose;
        let posed = warp.at(&pose);
        let Some(seen) = corners.iter().map(|c| posed.locate(c)).collect::<Option<Vec<_>>>() else { break };
        let seen: [Point2<f64>; 4] = core::array::from_fn(|k| seen[k]);
        errors.push(distance(&seen, truth));
    }
    let rest = format!(
        "{:.1} steps, {converged} converged, points {}",
        f64::from(iterations) / errors.len() as f64,
        points.join("+")
    );
    row(variant, name, &errors, frames.len(), &cpu, &rest);
    Ok(())
}

fn visp(program: &Path, folder: &Path, variant: &str) -> Result<()> {
    for stop in ["0", "1"] {
        for algorithm in ["ssd", "zncc", "mi"] {
            let output = Command::new(program).arg(folder).args([algorithm, "--stop", stop]).output()?;
            let text = String::from_utf8(output.stdout)?;
            let answer: serde_json::Value = serde_json::from_str(&text).with_context(|| text.clone())?;
            let number = |key: &str| answer[key].as_f64();
            let name = format!("ViSP {algorithm} --stop {stop}");
            let lost = number("lost_at").map_or(String::new(), |k| format!("lost at {k}"));
            let cell =
                |key: &str, digits: usize| number(key).map_or("–".into(), |v| format!("{v:.digits$}"));
            println!(
                "| {variant} | {name} | {} | {} | {} | {} | {lost} |",
                cell("corner_px_mean", 4),
                cell("corner_px_max", 3),
                cell("within_5px", 2),
                cell("cpu_ms_median", 3)
            );
        }
    }
    Ok(())
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    println!("| variant | tracker | corner px mean | corner px max | within 5 px | CPU ms median | |");
    println!("|---|---|---|---|---|---|---|");
    for variant in VARIANTS.into_iter().filter(|v| arguments.variant.as_deref().is_none_or(|only| only == *v))
    {
        let folder = arguments.sequences.join(variant);
        let (frames, truth) = (read_frames(&folder)?, read_corners(&folder.join("corners.txt"))?);
        ensure!(!frames.is_empty() && truth.len() >= frames.len(), "no frames in {}", folder.display());
        for method in [Method::InverseCompositional, Method::Esm] {
            for similarity in Similarity::ALL {
                for robust in [None, Some(Robust::TUKEY)] {
                    if robust.is_some() && similarity.is_information() {
                        continue;
                    }
                    let params = AlignmentParams {
                        similarity,
                        method,
                        robust,
                        points: arguments.points,
                        levels: arguments.levels,
                        finest: arguments.finest,
                        smoothing: arguments.smoothing,
                        tolerance: arguments.tolerance,
                        ..AlignmentParams::default()
                    };
                    let way = if method == Method::Esm { "ESM" } else { "IC" };
                    let weights = if robust.is_some() { " Tukey" } else { "" };
                    track(variant, &format!("{similarity:?} {way}{weights}"), params, &frames, &truth)?;
                }
            }
        }
        if let Some(program) = &arguments.visp {
            visp(program, &folder, variant)?;
        }
    }
    Ok(())
}
