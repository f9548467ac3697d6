use super::*;
use crate::camera::Lens;
use crate::edges::EdgeOptions;
use crate::mesh::{MeshData, Polygon, Segment};
use nalgebra::{Rotation3, UnitQuaternion};
#[cfg(feature = "raycast")]
use proptest::prelude::*;
use std::collections::BTreeMap;

fn model(points: &[[f64; 3]], polygons: &[Vec<u32>], lines: &[[u32; 2]]) -> (Mesh, EdgeModel) {
    let mesh = Mesh::new(MeshData {
        vertices: points.iter().map(|p| Point3::from(*p)).collect(),
        polygons: polygons.iter().map(|c| Polygon { corners: c.clone(), ..Default::default() }).collect(),
        segments: lines.iter().map(|&ends| Segment { ends, material: None, part: 0 }).collect(),
        ..Default::default()
    })
    .unwrap();
    let edges = EdgeModel::new(&mesh, &EdgeOptions::default()).unwrap();
    (mesh, edges)
}

/// Cube of 0.2 m about the origin; faces wound at random to show that winding does not matter.
fn cube() -> (Mesh, EdgeModel) {
    let points: Vec<[f64; 3]> =
        (0..8_u32).map(|i| [0, 1, 2].map(|b| f64::from(i >> b & 1) * 0.2 - 0.1)).collect();
    let faces = [[0, 4, 6, 2], [3, 7, 5, 1], [0, 1, 5, 4], [2, 6, 7, 3], [1, 3, 2, 0], [4, 5, 7, 6]];
    model(&points, &faces.map(|f| f.to_vec()), &[])
}

fn camera() -> Camera {
    Camera::new(500.0, 500.0, 319.5, 239.5, 640, 480).unwrap()
}

fn pose(turn: [f64; 3], shift: [f64; 3]) -> SE3 {
    SE3 { rotation: UnitQuaternion::from_scaled_axis(Vector3::from(turn)), translation: Vector3::from(shift) }
}

fn see(model: &(Mesh, EdgeModel), camera: &Camera, pose: &SE3, options: &VisibilityOptions) -> Vec<EdgeSite> {
    let mut v = VisibleEdges::default();
    v.update(&model.0, &model.1, camera, pose, options);
    v.sites().to_vec()
}

fn by_edge(sites: &[EdgeSite]) -> BTreeMap<u32, Vec<EdgeSite>> {
    let mut map: BTreeMap<u32, Vec<EdgeSite>> = BTreeMap::new();
    for s in sites {
        map.entry(s.edge).or_default().push(*s);
    }
    map
}

#[test]
fn corner_view_of_a_cube_shows_nine_edges_six_of_them_contour() {
    // Look along the space diagonal.
    let turn =
        Rotation3::rotation_between(&Vector3::new(1.0, 1.0, 1.0), &Vector3::new(0.05, 0.02, 1.0)).unwrap();
    let t = SE3 {
        rotation: UnitQuaternion::from_rotation_matrix(&turn),
        translation: Vector3::new(0.0, 0.0, 0.8),
    };
    let sites = see(&cube(), &camera(), &t, &VisibilityOptions::default());
    let edges = by_edge(&sites);
    assert_eq!(edges.len(), 9);
    let center = camera().project(&Point3::from(t.translation)).unwrap();
    let mut contours = 0;
    for list in edges.values() {
        let contour = list.iter().filter(|s| s.contour.is_some()).count();
        assert!(contour == 0 || contour == list.len(), "{contour} of {}", list.len());
        contours += usize::from(contour > 0);
        for s in list {
            let ahead = camera().project(&t.act(&(s.p_in_object + s.tangent * 0.01))).unwrap();
            let positive = quarter_turn(&(ahead - s.pixel)).dot(&(center - s.pixel)) > 0.0;
            if let Some(side) = s.contour {
                assert_eq!(side == Side::Positive, positive, "the object is around its centre");
            }
            assert_eq!(s.kind, SiteKind::Crease);
            assert!(!s.ambiguous && s.normals.iter().all(Option::is_some));
            assert!((camera().project(&t.act(&s.p_in_object)).unwrap() - s.pixel).norm() < 1e-9);
            assert!((s.weight - 8.0).abs() < 1.0);
        }
    }
    assert_eq!(contours, 6);
}

#[test]
fn face_view_shows_the_front_square_only() {
    let sites = see(&cube(), &camera(), &pose([0.; 3], [0., 0., 0.8]), &VisibilityOptions::default());
    assert_eq!(by_edge(&sites).len(), 4);
    assert!(sites.iter().all(|s| s.contour.is_some() && (s.p_in_object.z + 0.1).abs() < 1e-12));
}

/// A wall with a window 0.1 mm before it, and a small square behind.
fn house() -> (Mesh, EdgeModel) {
    let square = |r: f64, z: f64| [[-r, -r, z], [r, -r, z], [r, r, z], [-r, r, z]];
    let points: Vec<_> = [square(0.2, 0.0), square(0.05, -1e-4), square(0.1, 0.1)].concat();
    model(&points, &[vec![0, 1, 2, 3], vec![4, 5, 6, 7], vec![8, 9, 10, 11]], &[])
}

#[test]
fn a_window_before_a_wall_is_seen_and_what_is_behind_is_not() {
    for turn in [[0.0; 3], [0.5, 0.3, 0.0], [-0.9, 0.0, 0.4]] {
        let sites = see(&house(), &camera(), &pose(turn, [0., 0., 1.0]), &VisibilityOptions::default());
        let hidden = sites.iter().filter(|s| s.p_in_object.z > 0.05).count();
        let window: Vec<_> = sites.iter().filter(|s| s.p_in_object.z < 0.0).collect();
        let wall: Vec<_> = sites.iter().filter(|s| s.p_in_object.z == 0.0).collect();
        assert_eq!(hidden, 0, "{turn:?}");
        assert!(window.len() >= 16 && wall.len() >= 80, "{} {}", window.len(), wall.len());
        assert!(window.iter().all(|s| s.contour.is_none()), "the wall is right behind");
        assert!(wall.iter().all(|s| s.contour.is_some()));
    }
    // From behind, the window is hidden by less than the bias, the small square is in front.
    let back = see(
        &house(),
        &camera(),
        &pose([0., std::f64::consts::PI, 0.], [0., 0., 1.]),
        &VisibilityOptions::default(),
    );
    assert!(back.iter().filter(|s| s.p_in_object.z > 0.05).all(|s| s.contour.is_some()));
    assert!(back.iter().any(|s| s.p_in_object.z > 0.05));
}

#[test]
fn smooth_surface_shows_its_two_limbs() {
    // Open tube of 48 sides, 7.5° apart, axis vertical, seen from the side.
    let n = 48;
    let mut points = Vec::new();
    for y in [-0.1, 0.1] {
        for i in 0..n {
            let c = nalgebra::UnitComplex::new(std::f64::consts::TAU * (f64::from(i) + 0.3) / f64::from(n));
            points.push([0.05 * c.re, y, 0.05 * c.im]);
        }
    }
    let faces: Vec<Vec<u32>> =
        (0..n).map(|i| (i, (i + 1) % n)).map(|(i, j)| vec![i, j, n + j, n + i]).collect();
    let tube = model(&points, &faces, &[]);
    assert_eq!(tube.1.report().smooth, 48);
    let sites = see(&tube, &camera(), &pose([0.; 3], [0., 0., 0.6]), &VisibilityOptions::default());
    let limbs: Vec<_> = sites.iter().filter(|s| s.kind == SiteKind::Silhouette).copied().collect();
    assert_eq!(by_edge(&limbs).len(), 2);
    for s in &limbs {
        assert!((s.p_in_object.x.abs() - 0.05).abs() < 0.002, "{}", s.p_in_object);
        assert!(s.contour.is_some());
    }
}

/// Disc of `n` sides, radius 0.1, about the origin in the plane z = 0.
fn disc(n: u32) -> (Mesh, EdgeModel) {
    let rim = |i: u32| {
        let c = nalgebra::UnitComplex::new(std::f64::consts::TAU * f64::from(i) / f64::from(n));
        [0.1 * c.re, 0.1 * c.im, 0.0]
    };
    model(&(0..n).map(rim).collect::<Vec<_>>(), &[(0..n).collect()], &[])
}

#[test]
fn a_fine_rim_carries_sites_at_the_usual_spacing() {
    // Circumference 314 px: sides of 2.5 px with 128 of them, of 0.31 px with 1024.
    let t = pose([0.; 3], [0., 0., 1.]);
    for n in [128, 1024] {
        let sites = see(&disc(n), &camera(), &t, &VisibilityOptions::default());
        assert_eq!(sites.len(), 39, "314 px / 8 px");
        let total: f32 = sites.iter().map(|s| s.weight).sum();
        assert!((total - 314.0).abs() < 1.0, "{total}");
        for (a, b) in sites.iter().zip(sites.iter().cycle().skip(1)) {
            // Sites stand in the middle of sides, so that spacings differ by one side.
            let side = 314.0 / f64::from(n);
            assert!(((a.pixel - b.pixel).norm() - 8.0).abs() < side + 0.1, "{} {}", a.pixel, b.pixel);
        }
        for s in &sites {
            assert!((s.p_in_object.coords.norm() - 0.1).abs() < 1e-4);
            assert!(s.tangent.dot(&s.p_in_object.coords).abs() < 2e-4, "along the circle: {}", s.tangent);
            assert!(s.kind == SiteKind::Boundary && s.contour.is_some() && !s.ambiguous);
            let ahead = camera().project(&t.act(&(s.p_in_object + s.tangent * 0.01))).unwrap();
            let center = Point2::new(319.5, 239.5);
            let positive = quarter_turn(&(ahead - s.pixel)).dot(&(center - s.pixel)) > 0.0;
            assert_eq!(s.contour, Some(if positive { Side::Positive } else { Side::Negative }));
        }
    }
}

#[test]
fn chains_end_at_corners_and_specks_stay_without_sites() {
    // A square outline of 40 px sides, each cut into 20 lines that bend by 0.2° so that they are not joined.
    let mut points: Vec<[f64; 3]> = Vec::new();
    let corners = [[-0.04, -0.04], [0.04, -0.04], [0.04, 0.04], [-0.04, 0.04]];
    for k in 0..4 {
        let (a, b) = (corners[k], corners[(k + 1) % 4]);
        for i in 0..20 {
            let t = f64::from(i) / 20.0;
            let bow = 1e-3 * t * (1.0 - t);
            let out = [b[1] - a[1], a[0] - b[0]];
            points.push(
                [0, 1]
                    .map(|c| a[c] + (b[c] - a[c]) * t + out[c] * 12.5 * bow)
                    .into_iter()
                    .chain([0.0])
                    .collect::<Vec<_>>()
                    .try_into()
                    .unwrap(),
            );
        }
    }
    let lines: Vec<[u32; 2]> = (0..80).map(|i| [i, (i + 1) % 80]).collect();
    let outline = model(&points, &[], &lines);
    assert_eq!(outline.1.edges().len(), 80);
    let sites = see(&outline, &camera(), &pose([0.; 3], [0., 0., 1.]), &VisibilityOptions::default());
    assert_eq!(by_edge(&sites).len(), 4, "one chain a side");
    assert!(by_edge(&sites).values().all(|s| s.len() == 5));
    let speck = model(&[[0., 0., 0.], [0.002, 0., 0.], [0.004, 0.001, 0.]], &[], &[[0, 1], [1, 2]]);
    assert!(see(&speck, &camera(), &pose([0.; 3], [0., 0., 1.]), &VisibilityOptions::default()).is_empty());
}

#[test]
fn a_fine_sphere_shows_its_limb() {
    let (n, m) = (256_u32, 128_u32);
    let unit = |a: f64| nalgebra::UnitComplex::new(a);
    let mut points = vec![[0.0, -0.1, 0.0]];
    for k in 1..m {
        let c = unit(std::f64::consts::PI * f64::from(k) / f64::from(m));
        points.extend((0..n).map(|i| {
            let d = unit(std::f64::consts::TAU * f64::from(i) / f64::from(n));
            [0.1 * c.im * d.im, -0.1 * c.re, 0.1 * c.im * d.re]
        }));
    }
    points.push([0.0, 0.1, 0.0]);
    let at = |k: u32, i: u32| 1 + (k - 1) * n + i % n;
    let mut faces = Vec::new();
    for i in 0..n {
        faces.push(vec![0, at(1, i + 1), at(1, i)]);
        faces.extend((1..m - 1).map(|k| vec![at(k, i), at(k, i + 1), at(k + 1, i + 1), at(k + 1, i)]));
        faces.push(vec![at(m - 1, i), at(m - 1, i + 1), points.len() as u32 - 1]);
    }
    let ball = model(&points, &faces, &[]);
    let t = pose([0.4, 0.3, 0.2], [0., 0., 0.8]);
    let sites = see(&ball, &camera(), &t, &VisibilityOptions::default());
    // The limb is a circle of radius 500 · 0.1 / √(0.8² - 0.1²) = 63 px.
    let radius = 50.0 / (0.64_f64 - 0.01).sqrt();
    let expected = std::f64::consts::TAU * radius / 8.0;
    assert!((sites.len() as f64 - expected).abs() < 0.15 * expected, "{} of {expected}", sites.len());
    let center = Point2::new(319.5, 239.5);
    for s in &sites {
        assert!(s.kind == SiteKind::Silhouette && s.contour.is_some(), "{s:?}");
        let out = s.pixel - center;
        assert!((out.norm() - radius).abs() < 0.3, "{}", out.norm());
        let ahead = camera().project(&t.act(&(s.p_in_object + s.tangent * 1e-3))).unwrap() - s.pixel;
        assert!(ahead.normalize().dot(&out.normalize()).abs() < 0.15, "along the limb");
    }
}

#[test]
fn free_lines_and_close_parallels() {
    // Two lines 1 mm apart at 1 m (0.5 px) and one 20 mm away.
    let points =
        [[-0.1, 0., 0.], [0.1, 0., 0.], [-0.1, 1e-3, 0.], [0.1, 1e-3, 0.], [-0.1, 0.02, 0.], [0.1, 0.02, 0.]];
    let lines = model(&points, &[], &[[0, 1], [2, 3], [4, 5]]);
    let sites = see(&lines, &camera(), &pose([0.; 3], [0., 0., 1.]), &VisibilityOptions::default());
    let edges = by_edge(&sites);
    assert_eq!(edges.len(), 3);
    for s in &sites {
        assert_eq!(s.ambiguous, s.p_in_object.y < 0.01);
        assert!(s.kind == SiteKind::Line && s.contour.is_none() && s.normals == [None; 2]);
    }
}

#[test]
fn edges_that_leave_the_image_or_pass_the_camera_are_cut() {
    // Rails from 1 m behind the camera to 20 m ahead.
    let rails =
        model(&[[-0.7, 1., -1.], [-0.7, 1., 20.], [0.7, 1., -1.], [0.7, 1., 20.]], &[], &[[0, 1], [2, 3]]);
    let mut v = VisibleEdges::default();
    v.update(&rails.0, &rails.1, &camera(), &pose([0.; 3], [0.; 3]), &VisibilityOptions::default());
    assert!(v.is_cut() && v.sites().len() > 20, "{}", v.sites().len());
    for s in v.sites() {
        assert!(camera().contains(&s.pixel, -4.0));
        assert!((s.p_in_object.x.abs() - 0.7).abs() < 1e-12 && (s.p_in_object.y - 1.0).abs() < 1e-12);
    }
    // Evenly spaced in the image although not in space.
    let gaps: Vec<f64> = v
        .sites()
        .windows(2)
        .filter(|w| w[0].edge == w[1].edge)
        .map(|w| (w[1].pixel - w[0].pixel).norm())
        .collect();
    assert!(gaps.iter().all(|g| (g - gaps[0]).abs() < 1e-6));
    v.update(&rails.0, &rails.1, &camera(), &pose([0.; 3], [0., 0., -50.]), &VisibilityOptions::default());
    assert!(v.sites().is_empty());
}

#[test]
fn lens_moves_pixels_and_hides_nothing() {
    let lens = Lens::new(-0.25, 0.05, 1e-3, 0.0, 0.0).unwrap();
    let (plain, bent) = (camera(), camera().with_lens(lens));
    let t = pose([0.4, 0.7, 0.1], [0.02, 0.0, 0.45]);
    let edges = |c: &Camera| {
        by_edge(&see(&cube(), c, &t, &VisibilityOptions::default())).keys().copied().collect::<Vec<_>>()
    };
    assert_eq!(edges(&plain), edges(&bent));
    for s in see(&cube(), &bent, &t, &VisibilityOptions::default()) {
        assert!((bent.project(&t.act(&s.p_in_object)).unwrap() - s.pixel).norm() < 1e-9);
    }
    // Barrel distortion brings points from beyond the ideal frame into the image; they are tested, not lost.
    let near = pose([0.; 3], [0.225, 0., 0.35]);
    let seen = see(&cube(), &bent, &near, &VisibilityOptions { border: 0.0, ..Default::default() });
    let ideal = plain.size().0;
    assert!(seen.iter().any(|s| plain.project(&near.act(&s.p_in_object)).unwrap().x > f64::from(ideal)));
}

#[test]
fn a_fisheye_sees_the_edges_of_a_pinhole_and_more() {
    let lens = crate::camera::Fisheye::new(0.01, -0.002, 0.0, 0.0).unwrap();
    let bent = Camera::new(220.0, 220.0, 319.5, 239.5, 640, 480).unwrap().with_fisheye(lens);
    // Ahead, then 52° off the axis to the right, turned along.
    for angle in [0.0, 0.9] {
        let pan = UnitQuaternion::from_scaled_axis(Vector3::y() * angle);
        let near = pose([0.4, 0.7, 0.1], [0., 0., 0.6]);
        let t = SE3 { rotation: pan * near.rotation, translation: pan * near.translation };
        let sites = see(&cube(), &bent, &t, &VisibilityOptions::default());
        assert_eq!(by_edge(&sites).len(), 9, "at {angle}");
        let mut length = 0.0;
        for s in &sites {
            assert!((bent.project(&t.act(&s.p_in_object)).unwrap() - s.pixel).norm() < 1e-9);
            length += f64::from(s.weight);
        }
        // Weights are lengths in the picture: they add up to the visible edges, sampled finely.
        let mut expected = 0.0;
        for id in by_edge(&sites).keys() {
            let [a, b] = cube().1.edges()[*id as usize].ends;
            let at = |k: u32| bent.project(&t.act(&(a + (b - a) * (f64::from(k) / 50.0)))).unwrap();
            expected += (0..50).map(|k| (at(k + 1) - at(k)).norm()).sum::<f64>();
        }
        assert!((length / expected - 1.0).abs() < 0.05, "{length} of {expected} at {angle}");
    }
    // Behind the camera and at 80° nothing is seen, and nothing fails.
    for angle in [1.4, 1.6, 3.0] {
        let pan = UnitQuaternion::from_scaled_axis(Vector3::y() * angle);
        let t = SE3 { rotation: pan, translation: pan * Vector3::new(0., 0., 2.0) };
        assert!(see(&cube(), &bent, &t, &VisibilityOptions::default()).is_empty());
    }
}

#[test]
fn budget_thins_evenly_and_keeps_the_weight() {
    let t = pose([0.4, 0.7, 0.1], [0.0, 0.0, 0.6]);
    let all = see(&cube(), &camera(), &t, &VisibilityOptions { step: 2.0, ..Default::default() });
    let few =
        see(&cube(), &camera(), &t, &VisibilityOptions { step: 2.0, max_sites: 50, ..Default::default() });
    assert!(all.len() > 200);
    assert_eq!(few.len(), 50);
    let weight = |s: &[EdgeSite]| s.iter().map(|s| s.weight).sum::<f32>();
    assert!((weight(&few) / weight(&all) - 1.0).abs() < 0.05);
    let kept = by_edge(&few);
    assert!(by_edge(&all).iter().all(|(id, list)| list.len() < 10 || kept.contains_key(id)));
    assert!(
        see(&cube(), &camera(), &t, &VisibilityOptions { max_sites: 0, ..Default::default() }).is_empty()
    );
}

#[test]
fn cache_recomputes_when_the_view_changes() {
    let (mesh, edges) = cube();
    let mut cache = ViewCache::default();
    let base = [0.4, 0.7, 0.1];
    assert!(cache.update(&mesh, &edges, &camera(), &pose(base, [0., 0., 0.6])));
    let buffer = cache.sites().as_ptr();
    assert!(!cache.update(&mesh, &edges, &camera(), &pose(base, [0., 0., 0.6])));
    assert!(!cache.update(&mesh, &edges, &camera(), &pose(base, [0.001, 0., 0.61])));
    assert!(cache.update(&mesh, &edges, &camera(), &pose(base, [0., 0., 0.63])), "distance");
    assert!(cache.update(&mesh, &edges, &camera(), &pose([0.4, 0.75, 0.1], [0., 0., 0.63])), "direction");
    let rolled = SE3 {
        rotation: UnitQuaternion::from_scaled_axis(Vector3::z() * 0.2)
            * pose([0.4, 0.75, 0.1], [0.; 3]).rotation,
        translation: Vector3::new(0., 0., 0.63),
    };
    assert!(cache.update(&mesh, &edges, &camera(), &rolled), "roll");
    assert!(cache.update(&mesh, &edges, &camera().scaled_to_level(1), &rolled), "camera");
    assert_eq!(cache.sites().as_ptr(), buffer, "the buffer is reused");
    cache.invalidate();
    assert!(cache.update(&mesh, &edges, &camera().scaled_to_level(1), &rolled));
    // Half outside the image, with the camera turned so that only the position in the image changes.
    let turned = |a: f64| {
        let pan = UnitQuaternion::from_scaled_axis(Vector3::y() * a);
        let t = pose(base, [0.36, 0., 0.6]);
        SE3 { rotation: pan * t.rotation, translation: pan * t.translation }
    };
    assert!(cache.update(&mesh, &edges, &camera(), &turned(0.0)));
    assert!(cache.visible().is_cut());
    assert!(!cache.update(&mesh, &edges, &camera(), &turned(-0.005)));
    assert!(cache.update(&mesh, &edges, &camera(), &turned(-0.05)), "new edges come into the image");
}

#[test]
fn any_pose_is_survived() {
    let mut v = VisibleEdges::default();
    let (mesh, edges) = cube();
    for bad in [f64::NAN, f64::INFINITY, 1e300, -1e300, 1e-300] {
        let t = SE3 { rotation: UnitQuaternion::identity(), translation: Vector3::new(bad, 0.0, bad) };
        v.update(&mesh, &edges, &camera(), &t, &VisibilityOptions::default());
        assert!(v.sites().iter().all(|s| s.pixel.coords.iter().all(|c| c.is_finite())));
    }
    // From inside, all that is ahead is seen, nothing behind.
    v.update(&mesh, &edges, &camera(), &pose([0.; 3], [0.; 3]), &VisibilityOptions::default());
    assert!(v.sites().iter().all(|s| s.p_in_object.z > 0.0));
}

#[test]
fn mesh_view_serves_the_contract() {
    use vt_core::agent::Visibility;
    let (mesh, edges) = cube();
    let t = pose([0.4, 0.7, 0.1], [0., 0., 0.6]);
    let expected = see(&(mesh.clone(), edges.clone()), &camera(), &t, &VisibilityOptions::default());
    let mut view = MeshView::new(mesh.into(), edges.into(), camera(), ViewCache::default());
    assert_eq!(view.visible(&t), expected);
}

/// Every site has a free line of sight, and every unhidden, well separated edge point has a site.
#[cfg(feature = "raycast")]
fn agree_with_rays(model: &(Mesh, EdgeModel), t: &SE3) -> Result<(), TestCaseError> {
    let (mesh, edges) = model;
    let options = VisibilityOptions::default();
    let sites = see(model, &camera(), t, &options);
    let caster = crate::raycast::RayCaster::new(mesh);
    let eye = Point3::from(-(t.rotation.inverse() * t.translation));
    // Free where nothing is nearer than by twice (for all: half) the bias; tried around the point on a grid out to 3.6 px, as far as
    // the neighbours of a half-resolution pixel reach.
    let free = |p: &Point3<f64>, any: bool| {
        let depth = (p - eye).norm();
        let slack = if any { 2.0 } else { 0.5 };
        let mut around = (0..169).map(|k| {
            let shift =
                Vector3::new(f64::from(k % 13 - 6), f64::from(k / 13 - 6), 0.0) * (0.6 / 500.0 * depth);
            let hit = caster.cast(&eye, &(p + t.rotation.inverse() * shift - eye));
            hit.is_none_or(|h| h.distance > 1.0 - slack * options.depth_bias)
        });
        if any { around.any(|f| f) } else { around.all(|f| f) }
    };
    // A gap between surfaces narrower than the grid may still meet a depth pixel.
    let hidden: Vec<_> = sites.iter().filter(|s| !free(&s.p_in_object, true)).collect();
    prop_assert!(hidden.len() * 50 <= sites.len(), "hidden: {hidden:?} of {}", sites.len());
    for (id, edge) in edges.edges().iter().enumerate().filter(|(_, e)| e.kind != EdgeKind::Smooth) {
        let middle = nalgebra::center(&edge.ends[0], &edge.ends[1]);
        let length = edge.ends.map(|e| camera().project(&t.act(&e)));
        let [Some(a), Some(b)] = length else { continue };
        let inside = camera().contains(&camera().project(&t.act(&middle)).unwrap(), -20.0);
        if inside && (a - b).norm() > 20.0 && free(&middle, false) {
            prop_assert!(sites.iter().any(|s| s.edge == id as u32), "edge {id} at {middle} has no site");
        }
    }
    Ok(())
}

#[cfg(feature = "raycast")]
proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]
    #[test]
    fn rays_confirm_cubes_and_houses(turn in prop::array::uniform3(-3.0..3.0_f64), x in -0.2..0.2_f64, z in 0.5..1.5_f64) {
        for model in [cube(), house()] {
            agree_with_rays(&model, &pose(turn, [x, 0.05, z]))?;
        }
    }

    #[test]
    fn rays_confirm_random_boxes(
        boxes in prop::collection::vec(prop::array::uniform6(-0.15..0.15_f64), 2..5),
        turn in prop::array::uniform3(-3.0..3.0_f64),
    ) {
        let mut points = Vec::new();
        let mut faces = Vec::new();
        for b in &boxes {
            let base = points.len() as u32;
            points.extend((0..8_usize).map(|i| [0, 1, 2].map(|k| b[k] + if i >> k & 1 == 1 { 0.03 + b[k + 3].abs() } else { 0.0 })));
            let quads = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
            faces.extend(quads.map(|f| f.iter().map(|c| c + base).collect::<Vec<u32>>()));
        }
        agree_with_rays(&model(&points, &faces, &[]), &pose(turn, [0.0, 0.0, 1.0]))?;
    }
}
