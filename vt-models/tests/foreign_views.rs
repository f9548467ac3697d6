//! Rasteriser and visibility against ray casts, on models of others (`VISP_IMAGES`, `VT_DATA`) from many sides.
#![cfg(all(feature = "loaders", feature = "raycast"))]

use nalgebra::{Point2, Point3, UnitQuaternion, Vector3};
use std::path::PathBuf;
use vt_core::lie::SE3;
use vt_models::camera::Camera;
use vt_models::edges::{EdgeModel, EdgeOptions};
use vt_models::loaders::load_mesh;
use vt_models::mesh::{Mesh, Unit};
use vt_models::raster::{NONE, RasterOptions, Rasterizer};
use vt_models::raycast::RayCaster;
use vt_models::visibility::{VisibilityOptions, VisibleEdges};

fn model(variable: &str, name: &str) -> Option<Mesh> {
    let Some(root) = std::env::var_os(variable).map(PathBuf::from).filter(|p| p.is_dir()) else {
        assert!(
            std::env::var("VT_REQUIRE_DATA").as_deref() != Ok("1"),
            "VT_REQUIRE_DATA=1 but {variable} is no folder"
        );
        eprintln!("skipped {name}: {variable} is not set to a folder");
        return None;
    };
    Some(load_mesh(root.join(name), Unit::Metre).unwrap_or_else(|e| panic!("{e}")))
}

const CASTLE: &str = "mbt-depth/Castle-simu/Models/chateau.wrl";

fn camera() -> Camera {
    Camera::new(350.0, 345.0, 160.2, 118.9, 320, 240).unwrap()
}

/// Views spread over all directions by the golden angle.
fn views(mesh: &Mesh, n: u32) -> impl Iterator<Item = SE3> {
    let (center, distance) = (mesh.bounds().center(), 1.2 * mesh.diameter());
    (0..n).map(move |i| {
        let turn = Vector3::new(0.7 * f64::from(i), 2.399_963 * f64::from(i), 0.3);
        let rotation = UnitQuaternion::from_scaled_axis(turn);
        SE3::new(rotation, Vector3::new(0.02, -0.01, 1.0) * distance - rotation * center.coords)
    })
}

/// Compares every `stride`-th pixel that is more than a pixel away from all projected triangle sides.
fn compare(mesh: &Mesh, pose: &SE3, scale: f64, stride: usize) -> usize {
    let camera = camera();
    let mut r = Rasterizer::default();
    r.render(mesh, &camera, pose, &RasterOptions { scale, ..Default::default() });
    let v = *r.viewport();
    let flat: Vec<Point2<f64>> =
        mesh.vertices().iter().map(|p| v.buffer_from_image(&camera.project(&pose.act(p)).unwrap())).collect();
    let caster = RayCaster::new(mesh);
    let back = pose.rotation.inverse();
    let eye = Point3::from(back * -pose.translation);
    let mut compared = 0;
    for (x, y) in
        (0..v.height).step_by(stride).flat_map(|y| (0..v.width).step_by(stride).map(move |x| (x, y)))
    {
        let q = Point2::new(x as f64, y as f64);
        let near_side = mesh.triangles().iter().any(|t| {
            (0..3).any(|k| {
                let (a, b) = (flat[t.vertices[k] as usize], flat[t.vertices[(k + 1) % 3] as usize]);
                let d = b - a;
                let s = ((q - a).dot(&d) / d.norm_squared().max(1e-12)).clamp(0.0, 1.0);
                (q - a - d * s).norm() < 1.0
            })
        });
        if near_side {
            continue;
        }
        compared += 1;
        let id = r.ids()[y * v.width + x];
        let depth = 1.0 / f64::from(r.inverse_depth()[y * v.width + x]);
        let pixel = |c: usize, o: i32| (c as f64 + f64::from(o) + 0.5) / v.scale - 0.5;
        let ray = camera.unproject(&Point2::new(pixel(x, v.x), pixel(y, v.y))).unwrap();
        match caster.cast(&eye, &(back * ray)) {
            None => assert_eq!(id, NONE),
            Some(hit) => {
                let error = (hit.distance - depth).abs() / depth;
                assert!(id != NONE && error < 1e-4, "({x}, {y}): {} {depth}", hit.distance);
                assert!(hit.triangle == id || error < 1e-5, "({x}, {y}): {} {id}", hit.triangle);
            }
        }
    }
    compared
}

#[test]
fn rays_agree_with_the_raster() {
    for (variable, name, n, stride) in [
        ("VISP_IMAGES", CASTLE, 20, 3),
        ("VISP_IMAGES", "mbt/cube_and_cylinder.cao", 20, 5),
        ("VT_DATA", "models/vrml/crystal.wrl", 10, 5),
        ("VT_DATA", "models/teapot.obj", 2, 3),
    ] {
        let Some(mesh) = model(variable, name) else { continue };
        let compared: usize = views(&mesh, n)
            .enumerate()
            .map(|(i, pose)| compare(&mesh, &pose, [1.0, 0.5][i % 2], stride))
            .sum();
        assert!(compared > 200, "{name}: only {compared} pixels compared");
    }
}

#[test]
fn rays_confirm_the_visible_sites_of_the_castle() {
    let Some(mesh) = model("VISP_IMAGES", CASTLE) else { return };
    let edges = EdgeModel::new(&mesh, &EdgeOptions::default()).unwrap();
    let caster = RayCaster::new(&mesh);
    let options = VisibilityOptions::default();
    let camera = Camera::new(700.0, 700.0, 319.5, 239.5, 640, 480).unwrap();
    let mut visible = VisibleEdges::default();
    let (mut sites, mut hidden) = (0, 0);
    for pose in views(&mesh, 100) {
        visible.update(&mesh, &edges, &camera, &pose, &options);
        let back = pose.rotation.inverse();
        let eye = Point3::from(back * -pose.translation);
        for s in visible.sites() {
            // The site itself or a place within 3.5 px of it is in sight.
            let free = (0..25).any(|k| {
                let depth = (s.p_in_object - eye).norm();
                let shift =
                    Vector3::new(f64::from(k % 5 - 2), f64::from(k / 5 - 2), 0.0) * (1.75 / 700.0 * depth);
                let hit = caster.cast(&eye, &(s.p_in_object + back * shift - eye));
                hit.is_none_or(|h| h.distance > 1.0 - 2.0 * options.depth_bias)
            });
            sites += 1;
            hidden += usize::from(!free);
        }
    }
    assert!(sites > 10_000, "{sites}");
    // The 25 rays may all miss a gap between surfaces that a depth pixel happens to hit.
    assert!(1000 * hidden <= sites, "{hidden} of {sites} hidden");
}
