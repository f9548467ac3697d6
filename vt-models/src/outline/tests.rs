//! Known areas and lengths, sampling, silhouettes.

use core::f64::consts::PI;

use nalgebra::{Point3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use vt_core::lie::SE3;

use super::*;
use crate::camera::Camera;
use crate::contour::normal;
use crate::mesh::{Mesh, MeshData, Polygon};

fn close(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance * expected.abs().max(1.0), "{found}, not {expected}");
}

#[test]
fn shapes_have_their_areas() {
    let rectangle = Outline::rectangle(40.0, 30.0).unwrap();
    close(rectangle.area(), 1200.0, 1e-15);
    close(rectangle.length(), 140.0, 1e-15);
    assert!(rectangle.contains(&Point2::new(19.0, -14.0)) && !rectangle.contains(&Point2::new(21.0, 0.0)));
    let ellipse = Outline::ellipse(40.0, 30.0).unwrap();
    close(ellipse.area(), PI * 20.0 * 15.0, 1e-4);
    assert_eq!(ellipse.bounds().map(|p| p.x.round()), [-20.0, 20.0]);
    // A spline of equal control points on a circle is nearly a circle, of radius (4 + 2 cos(2π/n)) / 6.
    let control: Vec<_> = (0..12)
        .map(|k| {
            let (s, c) = math::sin_cos(f64::from(k) * PI / 6.0);
            Point2::new(3.0 + 10.0 * c, 4.0 + 10.0 * s)
        })
        .collect();
    let spline = Outline::spline(&control).unwrap();
    let radius = 10.0 * (4.0 + 2.0 * math::cos(PI / 6.0)) / 6.0;
    close(spline.area(), PI * radius * radius, 1e-3);
    assert!((spline.centroid() - Point2::new(3.0, 4.0)).norm() < 1e-12);
    let centred = spline.centred();
    assert!(centred.centroid().coords.norm() < 1e-12);
    close(centred.scaled(2.0).unwrap().area(), 4.0 * spline.area(), 1e-12);
    for bad in [
        Outline::rectangle(0.0, 3.0),
        Outline::ellipse(1.0, f64::NAN),
        Outline::polygon(vec![]),
        Outline::spline(&[]),
        Outline::new(vec![]),
        Outline::polygon([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]].map(Point2::from).to_vec()),
        Outline::polygon([[0.0, 0.0], [f64::INFINITY, 1.0], [2.0, 0.0]].map(Point2::from).to_vec()),
        rectangle.scaled(-1.0),
    ] {
        assert!(bad.is_err());
    }
}

#[test]
#[cfg(feature = "loaders")]
fn svg_paths_have_holes_and_curves() {
    // A square with a square hole, drawn in the same sense, relative and absolute.
    let frame = Outline::from_svg("M0,0 h10 v10 h-10 z M2 2 H8 V8 H2 Z").unwrap();
    close(frame.area(), 100.0 - 36.0, 1e-12);
    assert!(frame.contains(&Point2::new(1.0, 5.0)) && !frame.contains(&Point2::new(5.0, 5.0)));
    assert!((frame.centroid() - Point2::new(5.0, 5.0)).norm() < 1e-12);
    // A circle of two arcs, and a curve left open.
    close(Outline::from_svg("M-5 0 A5 5 0 0 1 5 0 A5 5 0 0 1 -5 0").unwrap().area(), PI * 25.0, 1e-3);
    close(Outline::from_svg("M0 0 Q5 10 10 0").unwrap().area(), 2.0 / 3.0 * 10.0 * 5.0, 5e-3);
    for bad in ["", "M0 0 L", "hello", "M0 0 H10", "M0 0 L1e999 0 L0 5"] {
        assert!(Outline::from_svg(bad).is_err(), "{bad}");
    }
}

proptest! {
    /// Samples lie at equal distances along the outline, and their normals point out of it.
    #[test]
    fn samples_are_uniform(width in 10.0..200.0_f64, aspect in 0.5..2.0_f64, count in 12..90_usize) {
        let height = width * aspect;
        for outline in [Outline::rectangle(width, height).unwrap(), Outline::ellipse(width, height).unwrap()] {
            let contour = outline.sample(count);
            prop_assert_eq!(contour.points().len(), count);
            let spacing = outline.length() / count as f64;
            for (p, &[before, after]) in contour.points().iter().zip(contour.links()) {
                let (a, b) = (contour.points()[before as usize], contour.points()[after as usize]);
                prop_assert!((b - p).norm() <= spacing * (1.0 + 1e-9));
                prop_assert!((b - p).norm() >= 0.6 * spacing);
                let n = normal(&a, &b).unwrap();
                prop_assert!(!outline.contains(&(p + n * 0.01)) && n.dot(&p.coords) > 0.0);
            }
        }
    }
}

#[test]
fn the_silhouette_of_a_plate_is_its_image() {
    let corners = [[-0.3, -0.2], [0.3, -0.2], [0.1, 0.2], [-0.3, 0.2]];
    let vertices = corners.map(|[x, y]| Point3::new(x, y, 0.0)).to_vec();
    let polygons = vec![Polygon { corners: vec![0, 1, 2, 3], ..Default::default() }];
    let mesh = Mesh::new(MeshData { vertices: vertices.clone(), polygons, ..Default::default() }).unwrap();
    let camera = Camera::new(300.0, 300.0, 159.5, 119.5, 320, 240).unwrap();
    // Half out of the picture, which does not matter.
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.1, 0.2, 0.7));
    let pose = SE3::new(turn, Vector3::new(0.4, 0.1, 1.0));
    let found = Outline::silhouette(&mesh, &camera, &pose).unwrap();
    let image = vertices.iter().map(|p| camera.project(&pose.act(p)).unwrap()).collect();
    let expected = Outline::polygon(image).unwrap();
    close(found.area(), expected.area(), 3e-3);
    assert!((found.centroid() - expected.centroid()).norm() < 0.05);
    for p in found.loops()[0].iter() {
        let distance = sides(&expected.loops()[0])
            .map(|(a, b)| {
                let t = ((p - a).dot(&(b - a)) / (b - a).norm_squared()).clamp(0.0, 1.0);
                (p - (a + (b - a) * t)).norm()
            })
            .fold(f64::INFINITY, f64::min);
        // Half a pixel where corners are rounded.
        assert!(distance < 0.6, "{p} is {distance} px from the plate");
    }
    let away = SE3::new(UnitQuaternion::identity(), Vector3::new(0.0, 0.0, -1.0));
    assert!(Outline::silhouette(&mesh, &camera, &away).is_err());
}
