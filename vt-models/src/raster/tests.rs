use super::*;
use crate::mesh::{MeshData, Polygon};
use nalgebra::UnitQuaternion;
use proptest::prelude::*;

fn mesh(points: &[[f64; 3]], triangles: &[[u32; 3]]) -> Mesh {
    Mesh::new(MeshData {
        vertices: points.iter().map(|p| Point3::from(*p)).collect(),
        polygons: triangles.iter().map(|t| Polygon { corners: t.to_vec(), ..Default::default() }).collect(),
        ..Default::default()
    })
    .unwrap()
}

fn pose(turn: [f64; 3], shift: [f64; 3]) -> SE3 {
    SE3 { rotation: UnitQuaternion::from_scaled_axis(Vector3::from(turn)), translation: Vector3::from(shift) }
}

/// A camera whose pixel `(u, v)` at depth 1 is the point `(u, v, 1)`.
fn unit_camera(width: u32, height: u32) -> Camera {
    Camera::new(1.0, 1.0, 0.0, 0.0, width, height).unwrap()
}

const WHOLE: RasterOptions = RasterOptions { scale: 1.0, near: 1e-3, margin: 0.0, whole_image: true };

#[test]
fn top_left_rule_on_pixel_centres() {
    // A square with corners on pixel centres owns its top and left sides only.
    let m = mesh(&[[1., 1., 1.], [4., 1., 1.], [4., 3., 1.], [1., 3., 1.]], &[[0, 1, 2], [0, 2, 3]]);
    let mut r = Rasterizer::default();
    r.render(&m, &unit_camera(6, 5), &pose([0.; 3], [0.; 3]), &WHOLE);
    let drawn: Vec<bool> = r.ids().iter().map(|&i| i != NONE).collect();
    for y in 0..5 {
        for x in 0..6 {
            assert_eq!(drawn[y * 6 + x], (1..4).contains(&x) && (1..3).contains(&y), "({x}, {y})");
        }
    }
}

#[test]
fn nearer_triangle_wins_in_any_order() {
    let p = [[-9., -9., 2.], [30., -9., 2.], [-9., 30., 2.], [-9., -9., 1.], [30., -9., 1.], [-9., 30., 1.]];
    for order in [[[0, 1, 2], [3, 4, 5]], [[3, 4, 5], [0, 1, 2]]] {
        let m = mesh(&p, &order);
        let near = m.triangles().iter().position(|t| t.vertices[0] == 3).unwrap() as u32;
        let mut r = Rasterizer::default();
        r.render(&m, &unit_camera(4, 4), &pose([0.; 3], [0.; 3]), &WHOLE);
        assert!(r.ids().iter().all(|&i| i == near));
        assert!(r.inverse_depth().iter().all(|&w| w == 1.0));
        let mut depth = Vec::new();
        r.depth_into(&mut depth);
        assert_eq!(depth, [1.0; 16]);
    }
}

#[test]
fn near_plane_cuts_a_floor_that_passes_under_the_camera() {
    // Floor y = 1 m below the camera, from 5 m behind to 100 m ahead.
    let m =
        mesh(&[[-50., 1., -5.], [50., 1., -5.], [50., 1., 100.], [-50., 1., 100.]], &[[0, 1, 2], [0, 2, 3]]);
    let camera = Camera::new(100.0, 100.0, 49.5, 49.5, 100, 100).unwrap();
    let mut r = Rasterizer::default();
    r.render(&m, &camera, &pose([0.; 3], [0.; 3]), &WHOLE);
    for y in 0..100 {
        let slope = (f64::from(y) - 49.5) / 100.0;
        for x in [0, 37, 99] {
            let w = r.inverse_depth()[y as usize * 100 + x];
            let expected = if slope > 0.01 { slope } else { 0.0 };
            if (slope - 0.01).abs() > 0.01 {
                assert!((f64::from(w) - expected).abs() < 1e-6, "row {y}: {w} against {expected}");
            }
        }
    }
    // Everything behind the camera: nothing drawn, no panic.
    r.render(&m, &camera, &pose([0.; 3], [0., 0., -200.]), &RasterOptions::default());
    assert!(r.ids().iter().all(|&i| i == NONE));
}

#[test]
fn barycentrics_rebuild_the_point_on_the_ray() {
    let m = mesh(&[[-0.3, -0.2, 0.1], [0.4, -0.1, -0.2], [0.0, 0.3, 0.2]], &[[0, 1, 2]]);
    let camera = Camera::new(300.0, 310.0, 80.0, 60.0, 160, 120).unwrap();
    let t = pose([0.3, -0.5, 0.2], [0.02, 0.01, 0.9]);
    let mut r = Rasterizer::default();
    r.render(&m, &camera, &t, &RasterOptions::default());
    let mut weights = Vec::new();
    r.barycentrics_into(&m, &mut weights);
    let v = *r.viewport();
    let mut seen = 0;
    for (i, w) in weights.iter().enumerate() {
        if r.ids()[i] == NONE {
            assert!(w[0].is_nan());
            continue;
        }
        seen += 1;
        let [a, b, c] = [0, 1, 2].map(|k| t.act(&m.vertices()[k]).coords);
        let p = a * f64::from(1.0 - w[0] - w[1]) + b * f64::from(w[0]) + c * f64::from(w[1]);
        let q = camera.project(&Point3::from(p)).unwrap();
        let pixel = Point2::new((i % v.width) as f64 + f64::from(v.x), (i / v.width) as f64 + f64::from(v.y));
        assert!((q - pixel).norm() < 1e-2, "{q} {pixel}");
        assert!((1.0 / p.z - f64::from(r.inverse_depth()[i])).abs() < 1e-4);
    }
    assert!(seen > 1000, "{seen}");
}

/// A fan around a centre: neighbours share sides in all directions.
fn fan(n: u32, wobble: &[f64]) -> Mesh {
    let mut points = vec![[0.0, 0.0, 0.0]];
    for i in 0..n {
        let c = nalgebra::UnitComplex::new(std::f64::consts::TAU * f64::from(i) / f64::from(n));
        let r = wobble[i as usize % wobble.len()];
        points.push([r * c.re, r * c.im, 0.2 * r]);
    }
    let triangles: Vec<[u32; 3]> = (0..n).map(|i| [0, 1 + i, 1 + (i + 1) % n]).collect();
    mesh(&points, &triangles)
}

proptest! {
    /// No overlap and no gap: the triangles drawn one by one cover each pixel at most once, and together exactly
    /// the pixels inside the outline (judged in exact integers on the snapped corners by the crossing number).
    #[test]
    fn fans_neither_overlap_nor_crack(
        n in 3..20_u32,
        wobble in prop::collection::vec(0.2..1.0_f64, 1..20),
        turn in -0.8..0.8_f64,
        shift in (-0.2..0.2_f64, -0.2..0.2_f64),
    ) {
        let m = fan(n, &wobble);
        let camera = Camera::new(60.0, 60.0, 31.5, 31.5, 64, 64).unwrap();
        let t = pose([turn, 0.3, 0.1], [shift.0, shift.1, 2.0]);
        let mut count = vec![0; 64 * 64];
        let mut r = Rasterizer::default();
        for triangle in m.triangles() {
            let single = mesh(&m.corners(triangle).map(|p| p.into()), &[[0, 1, 2]]);
            r.render(&single, &camera, &t, &WHOLE);
            for (c, &id) in count.iter_mut().zip(r.ids()) {
                *c += usize::from(id != NONE);
            }
        }
        prop_assert!(count.iter().all(|&c| c <= 1));
        // Inside the one ring around the centre the fan is star-shaped: all pixels on a ray before a drawn one are drawn.
        r.render(&m, &camera, &t, &WHOLE);
        let ids = r.ids();
        prop_assert_eq!(ids.iter().filter(|&&i| i != NONE).count(), count.iter().sum::<usize>());
        let corner = |i: usize| {
            let q = image(&camera, &t.act(&m.vertices()[i]));
            q.map(|c| (c * 16.0 + 0.5).floor())
        };
        let ring: Vec<[f64; 2]> = (1..=n as usize).map(corner).collect();
        for y in 0..64_u32 {
            for x in 0..64_u32 {
                let (px, py) = (f64::from(x) * 16.0, f64::from(y) * 16.0);
                let mut inside = false;
                let mut near_border = false;
                for k in 0..ring.len() {
                    let (a, b) = (ring[k], ring[(k + 1) % ring.len()]);
                    let cross = (b[0] - a[0]) * (py - a[1]) - (b[1] - a[1]) * (px - a[0]);
                    near_border |= cross == 0.0;
                    if (a[1] > py) != (b[1] > py) && px < (b[0] - a[0]) * (py - a[1]) / (b[1] - a[1]) + a[0] {
                        inside = !inside;
                    }
                }
                if !near_border {
                    prop_assert_eq!(ids[(y * 64 + x) as usize] != NONE, inside, "({}, {})", x, y);
                }
            }
        }
    }

    /// The object's region is a window of the whole image.
    #[test]
    fn region_is_a_window_of_the_whole(turn in prop::array::uniform3(-2.0..2.0_f64), shift in (-1.5..1.5_f64, -1.5..1.5_f64)) {
        let m = fan(9, &[1.0, 0.4]);
        let camera = Camera::new(60.0, 60.0, 31.5, 31.5, 64, 64).unwrap();
        let t = pose(turn, [shift.0, shift.1, 3.0]);
        let (mut whole, mut part) = (Rasterizer::default(), Rasterizer::default());
        whole.render(&m, &camera, &t, &WHOLE);
        part.render(&m, &camera, &t, &RasterOptions::default());
        let v = *part.viewport();
        let mut seen = 0;
        for j in 0..v.height {
            for i in 0..v.width {
                let k = (j + v.y as usize) * 64 + i + v.x as usize;
                prop_assert_eq!(part.ids()[j * v.width + i], whole.ids()[k]);
                prop_assert!((part.inverse_depth()[j * v.width + i] - whole.inverse_depth()[k]).abs() < 1e-6);
                seen += usize::from(whole.ids()[k] != NONE);
            }
        }
        prop_assert_eq!(seen, whole.ids().iter().filter(|&&i| i != NONE).count());
    }
}

/// Rays against pixels; only pixels more than a pixel away from all projected triangle sides are compared.
#[cfg(feature = "raycast")]
fn agree_with_rays(m: &Mesh, camera: &Camera, t: &SE3, options: &RasterOptions) -> usize {
    let mut r = Rasterizer::default();
    r.render(m, camera, t, options);
    let caster = crate::raycast::RayCaster::new(m);
    let v = *r.viewport();
    let from_camera = t.rotation.inverse();
    let origin = Point3::from(-(from_camera * t.translation));
    let flat: Vec<Point2<f64>> = m
        .vertices()
        .iter()
        .map(|p| v.buffer_from_image(&camera.project(&t.act(p)).expect("in front of the camera")))
        .collect();
    let near_side = |q: Point2<f64>| {
        m.triangles()
            .iter()
            .flat_map(|t| [(0, 1), (1, 2), (2, 0)].map(|(i, j)| (t.vertices[i], t.vertices[j])))
            .any(|(a, b)| {
                let (a, d) = (flat[a as usize], flat[b as usize] - flat[a as usize]);
                let s = ((q - a).dot(&d) / d.norm_squared()).clamp(0.0, 1.0);
                (q - a - d * s).norm() < 1.0
            })
    };
    let mut compared = 0;
    for y in (1..v.height.saturating_sub(1)).step_by(2) {
        for x in (1..v.width.saturating_sub(1)).step_by(2) {
            let here = r.ids()[y * v.width + x];
            if near_side(Point2::new(x as f64, y as f64)) {
                continue;
            }
            let pixel = |c: usize, o: i32| (c as f64 + f64::from(o) + 0.5) / v.scale - 0.5;
            let ray = camera.without_lens().unproject(&Point2::new(pixel(x, v.x), pixel(y, v.y))).unwrap();
            let hit = caster.cast(&origin, &(from_camera * ray));
            let depth = 1.0 / f64::from(r.inverse_depth()[y * v.width + x]);
            match hit {
                None => assert_eq!(here, NONE, "ray misses at ({x}, {y})"),
                Some(hit) => {
                    assert!(
                        (hit.distance - depth).abs() < 1e-4 * depth,
                        "({x}, {y}): {} {depth}",
                        hit.distance
                    );
                    // Two triangles at one depth may swap names.
                    let tie = here != NONE && (hit.distance - depth).abs() < 1e-5 * depth;
                    assert!(hit.triangle == here || tie, "({x}, {y}): {} {here}", hit.triangle);
                }
            }
            compared += 1;
        }
    }
    compared
}

#[cfg(feature = "raycast")]
proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn rays_agree_on_generated_meshes(
        points in prop::collection::vec(prop::array::uniform3(-1.0..1.0_f64), 12..60),
        turn in prop::array::uniform3(-3.0..3.0_f64),
        scale in 0.4..1.0_f64,
    ) {
        let n = points.len() as u32 / 3;
        let triangles: Vec<[u32; 3]> = (0..n).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let m = mesh(&points, &triangles);
        let camera = Camera::new(150.0, 140.0, 80.2, 58.7, 160, 120).unwrap();
        let options = RasterOptions { scale, ..Default::default() };
        agree_with_rays(&m, &camera, &pose(turn, [0.1, -0.1, 4.0]), &options);
    }
}
