use super::*;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use vt_core::lie::SE3;

fn mesh(points: &[[f64; 3]], polygons: &[&[u32]]) -> Result<Mesh, MeshError> {
    Mesh::new(MeshData {
        vertices: points.iter().map(|p| Point3::from(*p)).collect(),
        polygons: polygons.iter().map(|c| Polygon { corners: c.to_vec(), ..Default::default() }).collect(),
        ..Default::default()
    })
}

fn area(points: &[Point3<f64>], triangles: &[[u32; 3]]) -> f64 {
    let p = |i: u32| points[i as usize];
    triangles.iter().map(|t| (p(t[1]) - p(t[0])).cross(&(p(t[2]) - p(t[0]))).norm() / 2.0).sum()
}

#[test]
fn ear_clipping_covers_a_non_convex_polygon_with_collinear_and_repeated_corners() {
    // An L of area 3 with a collinear corner (0.5, 0), a repeated one (2, 0), tilted in space.
    let flat = [[0., 0.], [0.5, 0.], [2., 0.], [2., 0.], [2., 1.], [1., 1.], [1., 2.], [0., 2.]];
    let tilt = Isometry3::new(Vector3::new(1., 2., 3.), Vector3::new(0.4, -0.7, 0.2));
    let points: Vec<_> = flat.iter().map(|p| tilt * Point3::new(p[0], p[1], 0.0)).collect();
    let triangles = triangulate(&points);
    assert!((area(&points, &triangles) - 3.0).abs() < 1e-12);
    // The collinear corner stays in use, so that a neighbour with that corner does not crack.
    assert!(triangles.iter().flatten().any(|&c| c == 1));
    let n = unit_normal_of(&points);
    for t in &triangles {
        let [a, b, c] = t.map(|i| points[i as usize]);
        assert!((b - a).cross(&(c - a)).dot(&n) > 0.0, "triangle {t:?} turned over");
    }
}

fn unit_normal_of(points: &[Point3<f64>]) -> Vector3<f64> {
    triangulation::unit_normal(points).expect("has area")
}

#[test]
fn polygon_without_area_has_no_triangle() {
    let m =
        mesh(&[[0., 0., 0.], [1., 0., 0.], [2., 0., 0.], [0., 1., 0.]], &[&[0, 1, 2], &[0, 1, 3]]).unwrap();
    assert_eq!(m.triangles().len(), 1);
    assert_eq!(m.triangles()[0].polygon, 1);
    assert!(m.normal(0).is_none());
    assert_eq!(m.normal(1), Some(Vector3::z()));
}

#[test]
fn bad_data_is_named() {
    assert_eq!(mesh(&[], &[]).unwrap_err(), MeshError::Empty);
    let e = mesh(&[[0., 0., 0.], [1., f64::NAN, 0.], [0., 1., 0.]], &[&[0, 1, 2]]).unwrap_err();
    assert!(matches!(e, MeshError::NotFinite { vertex: 1, .. }), "{e}");
    let e = mesh(&[[0., 0., 0.]], &[&[0, 0, 7]]).unwrap_err();
    assert_eq!(e.to_string(), "polygon 0 refers to vertex 7, expected an index below 1");
    let e = mesh(&[[0., 0., 0.]], &[&[0, 0]]).unwrap_err();
    assert_eq!(e, MeshError::TooFewCorners { polygon: 0, found: 2 });
    let e = mesh(&[[1., 2., 3.], [1., 2., 3.]], &[&[0, 1, 0]]).unwrap_err();
    assert_eq!(e, MeshError::NoExtent { vertices: 2 });
    let e = mesh(&[[0., 0., 0.], [1e13, 0., 0.], [0., 1., 0.]], &[&[0, 1, 2]]).unwrap_err();
    assert!(e.to_string().contains("vertex 1") && e.to_string().contains("1e12 m"), "{e}");
    let ring: Vec<[f64; 3]> = (0..5000).map(|k| [f64::from(k), f64::from(k * k), 0.0]).collect();
    let all: Vec<u32> = (0..5000).collect();
    let e = mesh(&ring, &[&all]).unwrap_err();
    assert_eq!(e, MeshError::TooManyCorners { polygon: 0, found: 5000 });
}

#[test]
fn shape_flattens_with_part_ids_and_transforms() {
    let m = mesh(&[[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]], &[&[0, 1, 2]]).unwrap();
    let flat = Shape::default()
        .with("base", m.clone(), SE3 { rotation: UnitQuaternion::identity(), translation: Vector3::zeros() })
        .with("arm", m, SE3 { rotation: UnitQuaternion::identity(), translation: Vector3::new(0., 0., 5.) })
        .flatten()
        .unwrap();
    assert_eq!(flat.parts(), ["base", "arm"]);
    assert_eq!(flat.polygons()[1].part, 1);
    assert_eq!(flat.vertices()[flat.polygons()[1].corners[0] as usize], Point3::new(0., 0., 5.));
    assert_eq!(flat.bounds().max, Point3::new(1., 1., 5.));
    assert!((flat.diameter() - 27.0_f64.sqrt()).abs() < 1e-12);
    assert_eq!(Shape::default().flatten().unwrap_err(), MeshError::Empty);
}

#[test]
fn diameter_of_many_points_is_close() {
    let n = 3000;
    let points: Vec<[f64; 3]> = (0..n)
        .map(|i| {
            let a = f64::from(i) * 0.618_034;
            let turn = nalgebra::UnitComplex::new(a);
            let h = f64::from(i) / f64::from(n) * 2.0 - 1.0;
            let r = (1.0 - h * h).sqrt();
            [r * turn.re, r * turn.im, h]
        })
        .collect();
    let d = mesh(&points, &[&[0, 1, 2]]).unwrap().diameter();
    assert!((1.96..=2.0 + 1e-12).contains(&d), "{d}");
}

proptest! {
    /// A star-shaped polygon is simple, so its triangulation has exactly its area (shoelace as the oracle).
    #[test]
    fn star_polygons_keep_their_area(radii in prop::collection::vec(0.1..1.0_f64, 3..24)) {
        let n = radii.len() as f64;
        let points: Vec<_> = radii.iter().enumerate().map(|(i, r)| {
            let c = nalgebra::UnitComplex::new(std::f64::consts::TAU * i as f64 / n);
            Point3::new(r * c.re, r * c.im, 0.5)
        }).collect();
        let shoelace: f64 = (0..points.len()).map(|i| {
            let (p, q) = (points[i], points[(i + 1) % points.len()]);
            (p.x * q.y - q.x * p.y) / 2.0
        }).sum();
        let triangles = triangulate(&points);
        prop_assert!((area(&points, &triangles) - shoelace.abs()).abs() < 1e-9);
        prop_assert!(triangles.len() <= points.len() - 2);
    }

    /// Any points at all: no panic, indices in range.
    #[test]
    fn any_loop_is_survived(points in prop::collection::vec((-1.0..1.0_f64, -1.0..1.0_f64, -0.1..0.1_f64), 0..16)) {
        let points: Vec<_> = points.iter().map(|p| Point3::new(p.0, p.1, p.2)).collect();
        for t in triangulate(&points) {
            prop_assert!(t.iter().all(|&i| (i as usize) < points.len()));
        }
    }
}
