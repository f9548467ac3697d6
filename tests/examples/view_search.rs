//! How often, how precisely and how fast a body is found in a single picture without any prior: castle and cube of the
//! ViSP data set, and random simulated views of four bodies.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result};
use clap::Parser;
use cpu_time::ProcessTime;
use image::RgbImage;
use nalgebra::{Point2, Quaternion, UnitQuaternion, Vector3};
use vt_core::agent::Sensor;
use vt_core::frame::{Frame, SensorId};
use vt_core::lie::SE3;
use vt_core::random::{Random, Stream};
use vt_io::canvas::Canvas;
use vt_io::truth::Truth;
use vt_models::camera::Camera;
use vt_models::edges::EdgeModel;
use vt_models::loaders::load_mesh;
use vt_models::mesh::{Mesh, Unit};
use vt_models::visibility::{VisibilityOptions, VisibleEdges};
use vt_sim::bracket::bracket;
use vt_sim::camera::{Settings, SimulatedCamera};
use vt_sim::path::SmoothPath;
use vt_sim::scene::Scene;
use vt_sim::texture::Texture;
use vt_tests::replay::{Replay, median};
use vt_vision::view_search::{FoundPose, ViewSearch, ViewSearchParams};

/// Measures the search of views.
#[derive(Parser)]
struct Arguments {
    /// Data sets: castle, cube, bracket, castle-views, teapot, head; all when none is named.
    sets: Vec<String>,
    /// Folder of ViSP's pictures.
    #[arg(long, env = "VISP_IMAGES")]
    images: PathBuf,
    /// Folder of other data.
    #[arg(long, env = "VT_DATA")]
    data: PathBuf,
    /// Views of each body.
    #[arg(long, default_value_t = 50)]
    views: u32,
    /// Only every so many-th picture of the real sequences.
    #[arg(long, default_value_t = 1)]
    every: usize,
    /// Where pictures go.
    #[arg(long, default_value = "out/view-search")]
    out: PathBuf,
}

/// A picture with the true pose of the body in it.
struct Case {
    name: String,
    frame: Frame,
    truth: SE3,
}

/// Cases of one body.
struct Set {
    name: String,
    mesh: Mesh,
    camera: Camera,
    cases: Vec<Case>,
    /// Rotations of the object's frame about the middle of the body that map its edges onto themselves.
    symmetries: Vec<UnitQuaternion<f64>>,
}

fn castle_mesh(images: &Path) -> Result<Mesh> {
    Ok(load_mesh(images.join("mbt-depth/Castle-simu/Models/chateau.wrl"), Unit::Metre)?)
}

fn replayed(
    name: &str,
    task: &str,
    mesh: Mesh,
    camera: Camera,
    every: usize,
    truth: Option<&Truth>,
) -> Result<Set> {
    let replay = Replay::load(Path::new("vt-apps/tasks").join(task), &[])?;
    let poses = match truth {
        Some(truth) => truth.0.clone(),
        None => {
            let reports = replay.run()?.reports;
            let pose = |r: &vt_core::report::StepReport| Some((r.frame, r.posterior.get::<SE3>()?.mean));
            reports.iter().filter_map(pose).collect()
        }
    };
    let case = |frame: &Frame| {
        let truth = *poses.get(&frame.number).context("no truth")?;
        Ok(Case { name: format!("{name} {}", frame.number), frame: frame.clone(), truth })
    };
    let cases = replay.frames().iter().step_by(every).map(case).collect::<Result<_>>()?;
    Ok(Set { name: name.into(), mesh, camera, cases, symmetries: vec![UnitQuaternion::identity()] })
}

/// The 24 rotations of a cube.
fn rotations_of_a_cube() -> Vec<UnitQuaternion<f64>> {
    let quarter = |axis: Vector3<f64>, k: i32| {
        UnitQuaternion::from_scaled_axis(axis * (f64::from(k) * core::f64::consts::FRAC_PI_2))
    };
    let mut all: Vec<UnitQuaternion<f64>> = vec![];
    for (a, b, c) in (0..64).map(|k| (k % 4, k / 4 % 4, k / 16)) {
        let q = quarter(Vector3::x(), a) * quarter(Vector3::y(), b) * quarter(Vector3::z(), c);
        if all.iter().all(|p| p.angle_to(&q) > 0.1) {
            all.push(q);
        }
    }
    all
}

fn scaled_to(mesh: Mesh, diameter: f64) -> Result<Mesh> {
    let factor = diameter / mesh.diameter();
    let mut data = mesh.into_data();
    data.vertices.iter_mut().for_each(|p| *p *= factor);
    Ok(Mesh::new(data)?)
}

/// Largest side of the body's box in the picture, its corner and its far corner.
fn extent(mesh: &Mesh, camera: &Camera, pose: &SE3) -> Option<[Point2<f64>; 2]> {
    let mut ends = [Point2::new(f64::INFINITY, f64::INFINITY), Point2::new(-f64::INFINITY, -f64::INFINITY)];
    for p in mesh.vertices() {
        let y = camera.project(&pose.act(p))?;
        ends = [ends[0].inf(&y), ends[1].sup(&y)];
    }
    Some(ends)
}

/// A pose from all directions alike, the body 80 to 250 pixels large and anywhere in the picture as a whole.
fn random_pose(mesh: &Mesh, camera: &Camera, random: &mut Random) -> SE3 {
    let center = mesh.bounds().center().coords;
    loop {
        let q = Quaternion::new(random.normal(), random.normal(), random.normal(), random.normal());
        let rotation = UnitQuaternion::from_quaternion(q);
        let wanted = 80.0 + 170.0 * random.uniform();
        let at = Point2::new(640.0 * random.uniform(), 480.0 * random.uniform());
        let ray = Vector3::new((at.x - 319.5) / 600.0, (at.y - 239.5) / 600.0, 1.0);
        let mut depth = mesh.diameter() * 600.0 / wanted;
        for _ in 0..20 {
            let pose = SE3::new(rotation, ray * depth - rotation * center);
            let Some([low, high]) = extent(mesh, camera, &pose) else { break };
            let size = (high.x - low.x).max(high.y - low.y);
            if (size / wanted - 1.0).abs() < 0.01 {
                if camera.contains(&low, -4.0) && camera.contains(&high, -4.0) {
                    return pose;
                }
                break;
            }
            depth *= size / wanted;
        }
    }
}

fn simulated(name: &str, mesh: Mesh, texture: Texture, views: u32) -> Result<Set> {
    let camera = Camera::new(600.0, 600.0, 319.5, 239.5, 640, 480)?;
    let mut cases = vec![];
    for view in 0..views {
        let mut random = Random::new(11, Stream::Sim, 77, u64::from(view), 0);
        let truth = random_pose(&mesh, &camera, &mut random);
        let seed = 1000 + u64::from(view);
        let scene = Scene::new(mesh.clone(), camera, seed).with_texture(texture);
        let path = SmoothPath { start: truth, translation: [0.0; 3], rotation: [0.0; 3], period: 1.0 };
        let settings = Settings { frames: 1, noise: 3.0, seed, ..Settings::default() };
        let mut sensor = SimulatedCamera::new(SensorId(0), scene, path, settings);
        let frame = sensor.next()?.context("a simulated camera has a first frame")?;
        cases.push(Case { name: format!("{name} {view}"), frame, truth });
    }
    Ok(Set { name: name.into(), mesh, camera, cases, symmetries: vec![UnitQuaternion::identity()] })
}

fn load(name: &str, arguments: &Arguments) -> Result<Set> {
    let images = &arguments.images;
    match name {
        "castle" => {
            let folder = images.join("mbt-depth/Castle-simu/CameraPose");
            let camera = Camera::new(700.0, 700.0, 319.5, 239.5, 640, 480)?;
            let truth = Truth::read_matrices(&folder)?;
            replayed(name, "castle-simu.toml", castle_mesh(images)?, camera, arguments.every, Some(&truth))
        }
        "cube" => {
            let camera = Camera::new(547.7367575, 542.0744058, 338.7036994, 234.5083345, 640, 480)?;
            let mesh = load_mesh(images.join("mbt/cube.wrl"), Unit::Metre)?;
            let set = replayed(name, "cube.toml", mesh, camera, arguments.every, None)?;
            Ok(Set { symmetries: rotations_of_a_cube(), ..set })
        }
        "bracket" => {
            let mesh = bracket(0.04);
            let size = 0.12 * mesh.diameter();
            // The arms of the L are alike.
            let swap = Vector3::new(1.0, 1.0, 0.0).normalize() * core::f64::consts::PI;
            let symmetries = vec![UnitQuaternion::identity(), UnitQuaternion::from_scaled_axis(swap)];
            let texture = Texture::Squares { size, contrast: 0.35 };
            Ok(Set { symmetries, ..simulated(name, mesh, texture, arguments.views)? })
        }
        "castle-views" => simulated(name, castle_mesh(images)?, Texture::Faces, arguments.views),
        "teapot" => {
            let mesh = load_mesh(arguments.data.join("models/teapot.obj"), Unit::Metre)?;
            simulated(name, scaled_to(mesh, 0.2)?, Texture::Plain(0.75), arguments.views)
        }
        "head" => {
            let mesh = load_mesh(arguments.data.join("models/head/head_180mm.obj"), Unit::Metre)?;
            simulated(name, mesh, Texture::Plain(0.75), arguments.views)
        }
        _ => anyhow::bail!("unknown data set {name}"),
    }
}

/// Millimetres between the middles of the bodies and degrees between the rotations, modulo symmetry.
fn errors(set: &Set, found: &SE3, truth: &SE3) -> [f64; 2] {
    let center = set.mesh.bounds().center();
    let millimetres = 1e3 * (found.act(&center) - truth.act(&center)).norm();
    let angle = |s: &UnitQuaternion<f64>| (found.rotation * s).angle_to(&truth.rotation).to_degrees();
    [millimetres, set.symmetries.iter().map(angle).fold(f64::INFINITY, f64::min)]
}

/// The frame with the contour found (orange) over the true one (green).
fn overlay(set: &Set, edges: &EdgeModel, case: &Case, found: Option<&FoundPose>) -> Result<RgbImage> {
    let mut canvas = Canvas::of_grey(case.frame.grey()?);
    let mut seen = VisibleEdges::default();
    let options = VisibilityOptions { step: 3.0, max_sites: 3000, ..VisibilityOptions::default() };
    for (pose, colour) in [(Some(&case.truth), [0, 200, 80]), (found.map(|f| &f.pose.mean), [255, 140, 0])] {
        let Some(pose) = pose else { continue };
        seen.update(&set.mesh, edges, &set.camera, pose, &options);
        for site in seen.sites() {
            canvas.disc([site.pixel.x, site.pixel.y], 1.2, colour, 1.0);
        }
    }
    Ok(canvas.picture)
}

/// Pictures at half size, side by side.
fn sheet(pictures: &[RgbImage], columns: u32) -> RgbImage {
    let (w, h) = (320, 240);
    let rows = (pictures.len() as u32).div_ceil(columns).max(1);
    let mut out = RgbImage::new(columns * w, rows * h);
    for (k, picture) in pictures.iter().enumerate() {
        let (left, top) = (k as u32 % columns * w, k as u32 / columns * h);
        for (x, y) in (0..h).flat_map(|y| (0..w).map(move |x| (x, y))) {
            let mut sum = [0_u32; 3];
            for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                let p = picture
                    .get_pixel((2 * x + dx).min(picture.width() - 1), (2 * y + dy).min(picture.height() - 1));
                (0..3).for_each(|c| sum[c] += u32::from(p[c]));
            }
            out.put_pixel(left + x, top + y, image::Rgb(sum.map(|s| (s / 4) as u8)));
        }
    }
    out
}

fn measure(set: &Set, out: &Path) -> Result<()> {
    let edges = Arc::new(EdgeModel::new(&set.mesh, &Default::default())?);
    let begin = (Instant::now(), ProcessTime::now());
    let search =
        ViewSearch::new(Arc::new(set.mesh.clone()), edges.clone(), set.camera, ViewSearchParams::default())?;
    let (prepared, prepared_cpu) = (begin.0.elapsed().as_secs_f64(), begin.1.elapsed().as_secs_f64());
    let all: Vec<usize> = (0..search.sizes()).collect();
    let (mut good, mut among, mut wrong) = (0, 0, 0);
    let (mut walls, mut cpus, mut fails, mut passes) = (vec![], vec![], vec![], vec![]);
    for case in &set.cases {
        let begin = (Instant::now(), ProcessTime::now());
        let found = search.search(&case.frame, &all)?;
        walls.push(begin.0.elapsed().as_secs_f64());
        cpus.push(0.5 * begin.1.elapsed().as_secs_f64());
        let right = |f: &FoundPose| {
            let [mm, deg] = errors(set, &f.pose.mean, &case.truth);
            mm < 5.0 && deg < 2.0
        };
        let near = |f: &FoundPose| {
            let [mm, deg] = errors(set, &f.pose.mean, &case.truth);
            mm < 50.0 && deg < 15.0
        };
        let first = found.first();
        good += usize::from(first.is_some_and(right));
        among += usize::from(found.iter().any(right));
        wrong += usize::from(first.is_some_and(|f| !near(f)));
        if first.is_some_and(right) {
            if passes.len() < 8 {
                passes.push(overlay(set, &edges, case, first)?);
            }
            continue;
        }
        if let Some(f) = first {
            let e = errors(set, &f.pose.mean, &case.truth);
            let rank = found.iter().position(right);
            println!(
                "  {}: {:.1} mm {:.1} deg, {:.0} nats, share {:.2}; the right one is {rank:?} of {}",
                case.name,
                e[0],
                e[1],
                f.support.log_ratio,
                f.support.share,
                found.len()
            );
        } else {
            println!("  {}: nothing found", case.name);
        }
        if fails.len() < 24 {
            fails.push(overlay(set, &edges, case, first)?);
        }
    }
    std::fs::create_dir_all(out)?;
    if !fails.is_empty() {
        sheet(&fails, 4).save(out.join(format!("{}-failures.png", set.name)))?;
    }
    sheet(&passes, 4).save(out.join(format!("{}.png", set.name)))?;
    let n = set.cases.len();
    println!(
        "| {} | {good}/{n} ({:.1} %) | {among} | {wrong} | {:.2} s | {:.2} s | {prepared:.2} s ({:.2} s) |",
        set.name,
        100.0 * good as f64 / n.max(1) as f64,
        median(&walls),
        median(&cpus),
        0.5 * prepared_cpu,
    );
    Ok(())
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    let names = ["castle", "cube", "bracket", "castle-views", "teapot", "head"].map(String::from);
    let chosen = if arguments.sets.is_empty() { names.to_vec() } else { arguments.sets.clone() };
    println!(
        "| set | first is right | among those found | wrong | wall | CPU / 2 | preparation (CPU / 2) |\n|---|---|---|---|---|---|---|"
    );
    for name in &chosen {
        measure(&load(name, &arguments)?, &arguments.out)?;
    }
    Ok(())
}
