//! How often, how precisely and how fast a body is found in a single picture without any prior: castle and cube of the
//! ViSP data set, random simulated views, and pictures in which it is not.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result};
use clap::Parser;
use cpu_time::ProcessTime;
use image::RgbImage;
use nalgebra::UnitQuaternion;
use vt_core::frame::Frame;
use vt_core::lie::SE3;
use vt_core::metrics::PoseError;
use vt_io::canvas::Canvas;
use vt_models::camera::Camera;
use vt_models::edges::EdgeModel;
use vt_models::loaders::load_mesh;
use vt_models::mesh::{Mesh, Unit};
use vt_models::symmetry::Symmetries;
use vt_models::visibility::{VisibilityOptions, VisibleEdges};
use vt_sim::scenario::{Disturbance, Scenario};
use vt_tests::monte_carlo::body;
use vt_tests::replay::Replay;
use vt_vision::view_search::{FoundPose, TRUSTED, ViewSearch, ViewSearchParams};

/// Success of the search of views, per set of pictures: bodies `bracket`, `house`, `stairs`, `tee`, `wedge`, and
/// `castle` and `cube` of ViSP's data set.
#[derive(Parser)]
struct Arguments {
    /// Sets; the four bodies when none is named.
    sets: Vec<String>,
    /// Folder of ViSP's pictures, for `castle` and `cube`.
    #[arg(long, env = "VISP_IMAGES")]
    images: Option<PathBuf>,
    /// Views of each body.
    #[arg(long, default_value_t = 50)]
    views: u64,
    /// First seed.
    #[arg(long, default_value_t = 2000)]
    from: u64,
    /// Only every so many-th picture of the sequences.
    #[arg(long, default_value_t = 1)]
    every: usize,
    /// Looks for each body in the pictures of the next set.
    #[arg(long)]
    absent: bool,
    /// Folder for drawings of what failed (true contour green, found one orange).
    #[arg(long)]
    draw: Option<PathBuf>,
}

/// A picture with the true pose of the body in it.
struct Case {
    name: String,
    frame: Frame,
    truth: SE3,
}

/// Pictures of one body.
struct Set {
    name: String,
    mesh: Mesh,
    camera: Camera,
    cases: Vec<Case>,
}

fn sequence(name: &str, a: &Arguments) -> Result<Set> {
    let images = a.images.as_ref().context("--images or VISP_IMAGES")?;
    let castle = name == "castle";
    let (file, camera) = if castle {
        ("mbt-depth/Castle-simu/Models/chateau.wrl", Camera::new(700.0, 700.0, 319.5, 239.5, 640, 480)?)
    } else {
        let camera = Camera::new(547.7367575, 542.0744058, 338.7036994, 234.5083345, 640, 480)?;
        ("mbt/cube.wrl", camera)
    };
    let replay =
        Replay::load(if castle { "vt-apps/tasks/castle-simu.toml" } else { "vt-apps/tasks/cube.toml" }, &[])?;
    let reports = replay.run()?.reports;
    let mut cases = vec![];
    for (frame, report) in replay.frames().iter().zip(&reports).step_by(a.every) {
        // The tracker started at the truth is within half a millimetre of it on every frame.
        let truth = report.posterior.get::<SE3>().context("a rigid pose")?.mean;
        cases.push(Case { name: format!("{name} {}", frame.number), frame: frame.clone(), truth });
    }
    Ok(Set { name: name.into(), mesh: load_mesh(images.join(file), Unit::Metre)?, camera, cases })
}

fn simulated(name: &str, a: &Arguments) -> Result<Set> {
    let mesh = body(name)?;
    let mut cases = vec![];
    let mut camera = None;
    for seed in a.from..a.from + a.views {
        let scenario = Scenario::random(mesh.clone(), seed, Disturbance::None);
        let shot = scenario.sensor(0).and_then(|mut s| s.shot()).context("a first picture")?;
        camera = Some(scenario.cameras[0].0);
        cases.push(Case { name: format!("{name} {seed}"), frame: shot.frame, truth: shot.poses[0] });
    }
    Ok(Set { name: name.into(), mesh, camera: camera.context("no views")?, cases })
}

fn load(name: &str, a: &Arguments) -> Result<Set> {
    match name {
        "castle" | "cube" => sequence(name, a),
        _ => simulated(name, a),
    }
}

/// Motions of the object's frame that map the body onto itself: the group that its axes generate.
fn symmetries(mesh: &Mesh) -> Vec<SE3> {
    let found = Symmetries::find(mesh);
    let center = found.center.coords;
    let turn = |q: UnitQuaternion<f64>| SE3::new(q, center - q * center);
    let mut group = vec![UnitQuaternion::identity()];
    let generators: Vec<_> = found
        .rotational
        .iter()
        .filter_map(|r| {
            let angle = core::f64::consts::TAU / f64::from(r.order?);
            Some(UnitQuaternion::from_axis_angle(&r.axis, angle))
        })
        .collect();
    let mut k = 0;
    while k < group.len() && group.len() < 120 {
        for g in &generators {
            let next = group[k] * g;
            if group.iter().all(|q| q.angle_to(&next) > 0.05) {
                group.push(next);
            }
        }
        k += 1;
    }
    group.into_iter().map(turn).collect()
}

/// The smaller error of all equivalent poses, by their angle.
fn error(symmetries: &[SE3], found: &SE3, truth: &SE3) -> PoseError {
    let errors = symmetries.iter().map(|s| PoseError::new(&(*found * *s), truth));
    errors.min_by(|a, b| a.rotation.total_cmp(&b.rotation)).unwrap_or_else(|| PoseError::new(found, truth))
}

fn right(e: &PoseError) -> bool {
    e.translation < 5e-3 && e.rotation < 2f64.to_radians()
}

/// The picture with the contour found (orange) over the true one (green).
fn overlay(
    set: &Set,
    edges: &EdgeModel,
    case: &Case,
    truth: bool,
    found: Option<&FoundPose>,
) -> Result<RgbImage> {
    let mut canvas = Canvas::of_grey(case.frame.grey()?);
    let mut seen = VisibleEdges::default();
    let options = VisibilityOptions { step: 2.0, max_sites: 3000, ..VisibilityOptions::default() };
    let truth = truth.then_some(&case.truth);
    for (pose, colour) in [(truth, [0, 200, 80]), (found.map(|f| &f.pose.mean), [255, 140, 0])] {
        let Some(pose) = pose else { continue };
        seen.update(&set.mesh, edges, &set.camera, pose, &options);
        for site in seen.sites() {
            canvas.disc([site.pixel.x, site.pixel.y], 0.8, colour, 0.5);
        }
    }
    canvas.text(4, 4, &case.name, [255, 255, 0]);
    Ok(canvas.picture)
}

fn quantile(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get((share * values.len() as f64) as usize).copied().unwrap_or(f64::NAN)
}

fn measure(set: &Set, pictures: &Set, a: &Arguments) -> Result<()> {
    let absent = set.name != pictures.name;
    let edges = Arc::new(EdgeModel::new(&set.mesh, &Default::default())?);
    let symmetries = symmetries(&set.mesh);
    let begin = ProcessTime::now();
    let search =
        ViewSearch::new(Arc::new(set.mesh.clone()), edges.clone(), set.camera, ViewSearchParams::default())?;
    let prepared = 0.5 * begin.elapsed().as_secs_f64();
    let all: Vec<usize> = (0..search.sizes()).collect();
    let (mut good, mut wrong, mut none, mut ranked) = (0, 0, 0, 0);
    // Poses proposed as trusted, right and wrong.
    let mut trusted = [0, 0];
    let (mut walls, mut cpus) = (vec![], vec![]);
    for case in &pictures.cases {
        let begin = (Instant::now(), ProcessTime::now());
        let found = search.search(&case.frame, &all)?;
        walls.push(begin.0.elapsed().as_secs_f64());
        cpus.push(0.5 * begin.1.elapsed().as_secs_f64());
        let first = found.first();
        let errors: Vec<PoseError> =
            found.iter().map(|f| error(&symmetries, &f.pose.mean, &case.truth)).collect();
        let ok = !absent && errors.first().is_some_and(right);
        good += usize::from(ok);
        if first.is_some_and(|f| f.support.trust() >= TRUSTED) {
            trusted[usize::from(!ok)] += 1;
        }
        none += usize::from(first.is_none());
        wrong += usize::from(first.is_some() && !ok);
        ranked += usize::from(errors.iter().any(right));
        if ok || first.is_none() && absent {
            continue;
        }
        match (first, errors.first()) {
            (Some(f), Some(e)) => println!(
                "  {}: {:.1} mm {:.1} deg, trust {:.0}, support {:?}; right one: {:?} of {}",
                case.name,
                1e3 * e.translation,
                e.rotation.to_degrees(),
                f.support.trust(),
                f.support,
                errors.iter().position(right),
                found.len()
            ),
            _ => println!("  {}: nothing found", case.name),
        }
        if let Some(folder) = &a.draw {
            std::fs::create_dir_all(folder)?;
            overlay(set, &edges, case, !absent, first)?
                .save(folder.join(format!("{}.png", case.name.replace(' ', "-"))))?;
        }
    }
    println!(
        "{:<8} in {:<8} right {good:>3} of {:<3}  wrong {wrong:>3}  not found {none:>3}  among {ranked:>3}   \
         trusted: right {:>3} wrong {:>3}   \
         {:.2} / {:.2} s, CPU / 2 {:.2} / {:.2} s; prepared in {prepared:.2} s",
        set.name,
        pictures.name,
        pictures.cases.len(),
        trusted[0],
        trusted[1],
        quantile(&mut walls, 0.5),
        quantile(&mut walls, 0.9),
        quantile(&mut cpus, 0.5),
        quantile(&mut cpus, 0.9),
    );
    Ok(())
}

fn main() -> Result<()> {
    let a = Arguments::parse();
    let names = if a.sets.is_empty() {
        ["bracket", "house", "stairs", "tee"].map(String::from).to_vec()
    } else {
        a.sets.clone()
    };
    let sets = names.iter().map(|n| load(n, &a)).collect::<Result<Vec<_>>>()?;
    for (k, set) in sets.iter().enumerate() {
        let pictures = if a.absent { &sets[(k + 1) % sets.len()] } else { set };
        measure(set, pictures, &a)?;
    }
    Ok(())
}
