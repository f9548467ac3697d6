use super::*;
use crate::mesh::{MeshData, Polygon, Segment};
use proptest::prelude::*;

fn build(points: Vec<Point3<f64>>, polygons: &[Vec<u32>], lines: &[[u32; 2]]) -> EdgeModel {
    let mesh = Mesh::new(MeshData {
        vertices: points,
        polygons: polygons.iter().map(|c| Polygon { corners: c.clone(), ..Default::default() }).collect(),
        segments: lines.iter().map(|&ends| Segment { ends, material: None, part: 0 }).collect(),
        ..Default::default()
    })
    .unwrap();
    EdgeModel::new(&mesh, &EdgeOptions::default()).unwrap()
}

fn cube() -> (Vec<Point3<f64>>, Vec<Vec<u32>>) {
    let points = (0..8_u32).map(|i| Point3::from([0, 1, 2].map(|b| f64::from(i >> b & 1)))).collect();
    let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    (points, faces.map(|f| f.to_vec()).to_vec())
}

/// Splits quads into triangles, each `levels` times into four, without shared vertices.
fn soup(points: &[Point3<f64>], quads: &[Vec<u32>], levels: u32) -> Vec<[Point3<f64>; 3]> {
    let at = |i: u32| points[i as usize];
    let mut out: Vec<[Point3<f64>; 3]> =
        quads.iter().flat_map(|q| [[at(q[0]), at(q[1]), at(q[2])], [at(q[0]), at(q[2]), at(q[3])]]).collect();
    for _ in 0..levels {
        out = out
            .iter()
            .flat_map(|&[a, b, c]| {
                let m = |p: &Point3<f64>, q: &Point3<f64>| nalgebra::center(p, q);
                let (ab, bc, ca) = (m(&a, &b), m(&b, &c), m(&c, &a));
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    out
}

fn build_soup(triangles: &[[Point3<f64>; 3]]) -> EdgeModel {
    let points = triangles.iter().flatten().copied().collect();
    let polygons: Vec<Vec<u32>> =
        (0..triangles.len() as u32).map(|i| vec![3 * i, 3 * i + 1, 3 * i + 2]).collect();
    build(points, &polygons, &[])
}

#[test]
fn a_cube_has_twelve_creases() {
    let (points, faces) = cube();
    let model = build(points, &faces, &[]);
    assert_eq!(model.edges().len(), 12);
    assert_eq!(model.report().creases, 12);
    assert!(model.edges().iter().all(|e| e.sheets.len() == 2 && (e.length() - 1.0).abs() < 1e-12));
}

#[test]
fn inward_points_into_the_face_whatever_the_winding() {
    let (points, mut faces) = cube();
    faces[0].reverse();
    faces[3].reverse();
    let model = build(points, &faces, &[]);
    assert_eq!(model.report().creases, 12);
    let middle = Point3::new(0.5, 0.5, 0.5);
    for e in model.edges() {
        for s in &e.sheets {
            assert!((middle - e.ends[0]).dot(&s.inward) > 0.49, "{s:?} leaves the cube");
        }
    }
}

#[test]
fn a_knife_edge_is_a_crease_and_a_plane_is_none() {
    let points = [[0., 0., 0.], [1., 0., 0.], [0.5, 1., 0.], [0.5, 1., 0.1]].map(Point3::from).to_vec();
    let model = build(points, &[vec![0, 1, 2], vec![0, 1, 3]], &[]);
    assert_eq!((model.report().creases, model.report().boundaries), (1, 4));
    let points = [[0., 0., 0.], [1., 0., 0.], [0.5, 1., 0.], [0.5, -1., 0.01]].map(Point3::from).to_vec();
    // A fold of 0.57° is above the coplanar angle: a silhouette candidate, not a hard edge.
    let model = build(points, &[vec![0, 1, 2], vec![0, 1, 3]], &[]);
    assert_eq!((model.report().smooth, model.report().boundaries, model.hard().count()), (1, 4, 4));
}

#[test]
fn t_junctions_of_coplanar_polygons_vanish() {
    // A long rectangle above two short ones: the common line is interior though no side matches another.
    let p = [[0., 0.], [2., 0.], [2., 1.], [0., 1.], [0., -1.], [0.7, -1.], [0.7, 0.], [2., -1.]];
    let points = p.map(|q| Point3::new(q[0], q[1], 0.0)).to_vec();
    let model = build(points, &[vec![0, 1, 2, 3], vec![4, 5, 6, 0], vec![5, 7, 1, 6]], &[]);
    // The outline of a 2 x 2 square, its sides joined.
    assert_eq!(model.edges().len(), 4);
    assert!(model.edges().iter().all(|e| (e.length() - 2.0).abs() < 1e-12 && e.kind == EdgeKind::Boundary));
}

#[test]
fn coincident_edges_lines_and_non_manifold_edges() {
    // Three pages of a book share a spine; a fourth is drawn twice; a line repeats a boundary; a free line stays.
    let p = [
        [0., 0., 0.],
        [0., 0., 1.],
        [1., 0., 1.],
        [1., 0., 0.],
        [0., 1., 1.],
        [0., 1., 0.],
        [-1., -1., 1.],
        [-1., -1., 0.],
    ];
    let mut points = p.map(Point3::from).to_vec();
    points.extend([Point3::new(5., 0., 0.), Point3::new(5., 0., 1.)]);
    let pages = [vec![0, 1, 2, 3], vec![0, 1, 4, 5], vec![0, 1, 6, 7], vec![3, 2, 1, 0]];
    let model = build(points, &pages, &[[2, 3], [8, 9]]);
    let r = model.report();
    assert_eq!((r.non_manifold, r.boundaries, r.lines, r.creases), (1, 9, 1, 0));
}

#[test]
fn surfaces_that_pass_through_make_no_difference() {
    // A wall stands on a floor that is cut along the wall's foot, and on one that is not.
    let p = [
        [-1., -1., 0.],
        [1., -1., 0.],
        [1., 1., 0.],
        [-1., 1., 0.],
        [-1., 0., 0.],
        [1., 0., 0.],
        [-1., 0., 1.],
        [1., 0., 1.],
    ];
    let points = p.map(Point3::from).to_vec();
    let whole = build(points.clone(), &[vec![0, 1, 2, 3], vec![4, 5, 7, 6]], &[]);
    let cut = build(points.clone(), &[vec![0, 1, 5, 4], vec![4, 5, 2, 3], vec![4, 5, 7, 6]], &[]);
    for model in [&whole, &cut] {
        assert_eq!((model.edges().len(), model.report().boundaries), (8, 8), "{:?}", model.report());
    }
    // Two planes that cross, both cut along the crossing; a line drawn there stays.
    let mut points = points;
    points.extend([Point3::new(-1., 0., -1.), Point3::new(1., 0., -1.)]);
    let planes = [vec![0, 1, 5, 4], vec![4, 5, 2, 3], vec![4, 5, 7, 6], vec![4, 5, 9, 8]];
    assert_eq!(build(points.clone(), &planes, &[]).edges().len(), 8);
    assert_eq!(build(points, &planes, &[[4, 5]]).report().lines, 1);
}

#[test]
fn degenerate_input_is_counted() {
    let points =
        [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [1e-9, 0., 0.], [2., 0., 0.]].map(Point3::from).to_vec();
    let model = build(points, &[vec![0, 1, 2], vec![0, 3, 1], vec![0, 1, 4]], &[[0, 3]]);
    let r = model.report();
    assert_eq!((r.vertices, r.welded, r.degenerate_polygons, r.degenerate_sides), (5, 4, 2, 2));
    assert_eq!(r.boundaries, 3);
}

#[test]
fn a_fine_circle_does_not_become_straight() {
    let n = 1000;
    let points: Vec<_> = (0..n)
        .map(|i| {
            let c = nalgebra::UnitComplex::new(std::f64::consts::TAU * f64::from(i) / f64::from(n));
            Point3::new(c.re, c.im, 0.0)
        })
        .collect();
    let model = build(points, &[(0..n).collect()], &[]);
    assert_eq!(model.edges().len(), 1000);
}

#[test]
fn options_are_checked() {
    let (points, faces) = cube();
    let polygons = faces.into_iter().map(|corners| Polygon { corners, ..Default::default() }).collect();
    let mesh = Mesh::new(MeshData { vertices: points, polygons, ..Default::default() }).unwrap();
    let bad = EdgeOptions { weld: f64::NAN, ..Default::default() };
    assert_eq!(EdgeModel::new(&mesh, &bad).unwrap_err().name, "weld");
    let bad = EdgeOptions { crease_angle: 25.0, ..Default::default() };
    assert_eq!(EdgeModel::new(&mesh, &bad).unwrap_err().name, "crease_angle");
}

proptest! {
    /// Subdivision, order, winding and welding do not matter: always the cube's twelve edges of full length.
    #[test]
    fn cube_soups_give_the_cube(
        levels in 0..4_u32,
        keys in prop::collection::vec(any::<u32>(), 12 * 64),
        turn in prop::array::uniform3(-3.0..3.0_f64),
    ) {
        let (points, faces) = cube();
        let frame = nalgebra::Isometry3::new(Vector3::new(3.0, -1.0, 0.5), Vector3::from(turn));
        let points: Vec<_> = points.iter().map(|p| frame * p).collect();
        let mut triangles = soup(&points, &faces, levels);
        let mut order: Vec<usize> = (0..triangles.len()).collect();
        order.sort_by_key(|&i| keys[i]);
        triangles = order.iter().map(|&i| {
            let mut t = triangles[i];
            if keys[i] % 2 == 0 { t.reverse(); }
            t
        }).collect();
        let model = build_soup(&triangles);
        prop_assert_eq!(model.edges().len(), 12);
        for e in model.edges() {
            prop_assert!(e.kind == EdgeKind::Crease && (e.length() - 1.0).abs() < 1e-4);
        }
    }
}
