//! Times the rasteriser and the visibility test on one core: `cargo run --release --example visibility_timing [MODEL]`.
//!
//! Without a model file it builds a field of boxes with 96 triangles. Prints the median and the fastest of many
//! runs over slowly turning views.

use nalgebra::{UnitQuaternion, Vector3};
use std::time::Instant;
use vt_core::lie::SE3;
use vt_models::camera::Camera;
use vt_models::edges::{EdgeModel, EdgeOptions};
use vt_models::mesh::{Mesh, MeshData, Polygon, Unit};
use vt_models::raster::{RasterOptions, Rasterizer};
use vt_models::visibility::{VisibilityOptions, VisibleEdges};

fn boxes() -> Result<Mesh, Box<dyn std::error::Error>> {
    let mut data = MeshData::default();
    for i in 0..8_u32 {
        let base = data.vertices.len() as u32;
        let corner = |k: u32, b: u32| f64::from(k >> b & 1);
        data.vertices.extend((0..8).map(|k| {
            let at = [0, 1, 2].map(|b| corner(i, b) * 0.12 + corner(k, b) * 0.08 - 0.1);
            nalgebra::Point3::from(at)
        }));
        let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        data.polygons.extend(
            faces.map(|f| Polygon { corners: f.iter().map(|c| c + base).collect(), ..Default::default() }),
        );
    }
    Ok(Mesh::new(data)?)
}

/// Median and minimum in microseconds over views on a slow turn, from this multiple of the diameter.
fn time(mesh: &Mesh, distance: f64, mut run: impl FnMut(&SE3)) -> (f64, f64) {
    let center = mesh.bounds().center();
    let mut micros: Vec<f64> = (0..2000)
        .map(|i| {
            let rotation = UnitQuaternion::from_scaled_axis(Vector3::new(0.5, 0.003 * f64::from(i), 0.1));
            let ahead = Vector3::new(0.0, 0.0, distance * mesh.diameter());
            let pose = SE3 { rotation, translation: ahead - rotation * center.coords };
            let start = Instant::now();
            run(&pose);
            start.elapsed().as_secs_f64() * 1e6
        })
        .collect();
    micros.sort_by(f64::total_cmp);
    (micros[micros.len() / 2], micros[0])
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mesh = match std::env::args().nth(1) {
        None => boxes()?,
        #[cfg(feature = "loaders")]
        Some(path) => vt_models::loaders::load_mesh(path, Unit::Metre)?,
        #[cfg(not(feature = "loaders"))]
        Some(_) => return Err(format!("built without loaders, unit {:?}", Unit::Metre).into()),
    };
    let start = Instant::now();
    let edges = EdgeModel::new(&mesh, &EdgeOptions::default())?;
    println!("{} triangles, {:?}", mesh.triangles().len(), edges.report());
    println!("edge model: {:.2} ms", start.elapsed().as_secs_f64() * 1e3);

    let small = Camera::new(350.0, 350.0, 159.5, 119.5, 320, 240)?;
    let mut raster = Rasterizer::default();
    for distance in [0.7, 1.35] {
        let (median, best) =
            time(&mesh, distance, |pose| raster.render(&mesh, &small, pose, &RasterOptions::default()));
        let drawn = raster.ids().iter().filter(|&&i| i != vt_models::raster::NONE).count();
        println!(
            "raster 320x240: median {median:.1} µs, best {best:.1} µs ({drawn} of 76800 pixels drawn last)"
        );
    }

    let camera = Camera::new(700.0, 700.0, 319.5, 239.5, 640, 480)?;
    for raster_scale in [0.5, 0.25] {
        let options = VisibilityOptions { raster_scale, ..Default::default() };
        let mut visible = VisibleEdges::default();
        let (median, best) = time(&mesh, 1.35, |pose| visible.update(&mesh, &edges, &camera, pose, &options));
        let sites = visible.sites().len();
        println!(
            "visibility 640x480, raster 1:{}: median {median:.1} µs, best {best:.1} µs, {sites} sites",
            1.0 / raster_scale
        );
    }
    Ok(())
}
