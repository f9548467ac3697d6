//! Poses of the cube, which has no truth, beside ViSP's best mode: how far they lie apart, and on which of the two
//! contours the picture is steeper.

use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context, Result, ensure};
use clap::Parser;
use image::GrayImage;
use nalgebra::Point2;
use vt_core::agent::{Posed, Visibility, Warp};
use vt_core::lie::SE3;
use vt_io::truth::Truth;
use vt_models::camera::Camera;
use vt_models::edges::EdgeModel;
use vt_models::loaders::load_mesh;
use vt_models::mesh::Unit;
use vt_models::visibility::{MeshView, ViewCache, ViewThresholds, VisibilityOptions};
use vt_models::warp::Se3Warp;
use vt_tests::replay::Replay;

/// Compares our poses of the cube with those of `visp_mbt cube edgeklt`.
#[derive(Parser)]
struct Arguments {
    /// The program `visp_mbt` (built from the comparison sources).
    visp: PathBuf,
    /// Folder with the task files.
    #[arg(long, default_value = "vt-apps/tasks")]
    tasks: PathBuf,
    /// Folder of ViSP's pictures.
    #[arg(long, env = "VISP_IMAGES")]
    images: PathBuf,
    /// Where ViSP's poses are written.
    #[arg(long, default_value = "out/cube-visp.tum")]
    poses: PathBuf,
}

/// Grey value between pixels; `None` at the border.
fn grey(image: &GrayImage, at: Point2<f64>) -> Option<f64> {
    let (x, y) = (at.x.floor(), at.y.floor());
    let inside =
        x >= 0.0 && y >= 0.0 && x + 1.0 < f64::from(image.width()) && y + 1.0 < f64::from(image.height());
    let (u, v) = (at.x - x, at.y - y);
    let pixel = |dx: u32, dy: u32| f64::from(image.get_pixel(x as u32 + dx, y as u32 + dy)[0]);
    inside.then(|| {
        (1.0 - v) * ((1.0 - u) * pixel(0, 0) + u * pixel(1, 0))
            + v * ((1.0 - u) * pixel(0, 1) + u * pixel(1, 1))
    })
}

/// Mean difference of grey values one pixel on both sides of the contour.
fn steepness(image: &GrayImage, view: &mut MeshView, warp: &Se3Warp, pose: &SE3) -> f64 {
    let posed = warp.at(pose);
    let (mut sum, mut count) = (0.0, 0.0);
    for site in view.visible(pose) {
        let Some(y) = posed.locate(&site.p_in_object) else { continue };
        let Some(ahead) = posed.locate(&(site.p_in_object + site.tangent * 1e-4)) else { continue };
        let along = (ahead - y).normalize();
        let normal = nalgebra::Vector2::new(-along.y, along.x);
        if let (Some(a), Some(b)) = (grey(image, y - normal), grey(image, y + normal)) {
            sum += (a - b).abs();
            count += 1.0;
        }
    }
    sum / f64::max(count, 1.0)
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    if let Some(folder) = arguments.poses.parent() {
        std::fs::create_dir_all(folder)?;
    }
    let status = Command::new(&arguments.visp)
        .args(["cube", "edgeklt", "--repeat", "1", "--dump"])
        .arg(&arguments.poses)
        .status()
        .with_context(|| format!("cannot run {}", arguments.visp.display()))?;
    ensure!(status.success(), "ViSP failed");
    let theirs = Truth::read_tum(&arguments.poses)?;
    let replay = Replay::load(arguments.tasks.join("cube.toml"), &[])?;
    let run = replay.run()?;

    let camera = Camera::new(547.7367575, 542.0744058, 338.7036994, 234.5083345, 640, 480)?;
    let mesh = load_mesh(arguments.images.join("mbt/cube.wrl"), Unit::Metre)?;
    let edges = EdgeModel::new(&mesh, &Default::default())?;
    let options = VisibilityOptions { step: 1.0, max_sites: 5000, ..Default::default() };
    let cache = ViewCache::new(options, ViewThresholds::default());
    let mut view = MeshView::new(mesh.into(), edges.into(), camera, cache);
    let warp = Se3Warp::new(camera);

    let (mut compared, mut near, mut steeper) = (0, 0, 0);
    println!("| frame | mm apart | deg apart | steepness ours | ViSP |\n|---|---|---|---|---|");
    for (frame, report) in replay.frames().iter().zip(&run.reports) {
        let Some(visp) = theirs.poses.get(&frame.number) else { continue };
        let ours = report.posterior.get::<SE3>().context("not a rigid pose")?.mean;
        let millimetres = 1e3 * (ours.translation - visp.translation).norm();
        let degrees = ours.rotation.angle_to(&visp.rotation).to_degrees();
        let image = frame.grey()?;
        let own = steepness(image, &mut view, &warp, &ours);
        let other = steepness(image, &mut view, &warp, visp);
        compared += 1;
        steeper += usize::from(own > other);
        if millimetres <= 5.0 && degrees <= 2.0 {
            near += 1;
        } else {
            println!("| {} | {millimetres:.2} | {degrees:.2} | {own:.1} | {other:.1} |", frame.number);
        }
    }
    println!(
        "{near} of {compared} frames lie within 5 mm and 2 deg; our contour is the steeper one in {steeper}"
    );
    Ok(())
}
