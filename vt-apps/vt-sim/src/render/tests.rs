use super::*;
use crate::bodies::cuboid;
use crate::texture::Texture;
use nalgebra::{Point3, UnitQuaternion};
use vt_models::camera::Lens;
use vt_models::mesh::{Mesh, MeshData, Polygon};

const FULL: Light =
    Light { ambient: 1.0, diffuse: 0.0, specular: 0.0, gloss: 0, direction: Vector3::new(0.0, 0.0, -1.0) };

fn flat(corners: [[f64; 2]; 4]) -> Mesh {
    let vertices = corners.iter().map(|c| Point3::new(c[0], c[1], 0.0)).collect();
    let polygons = vec![Polygon { corners: vec![0, 1, 2, 3], ..Polygon::default() }];
    Mesh::new(MeshData { vertices, polygons, ..MeshData::default() }).unwrap()
}

fn draw(camera: Camera, bodies: &[(&Body, SE3)]) -> (Vec<f64>, Vec<f64>) {
    let mut renderer = Renderer::new(camera, vec![]);
    renderer.start();
    renderer.add(bodies, &FULL);
    let width = camera.size().0 as usize;
    let rows: Vec<Vec<f64>> =
        renderer.rows().map(|r| (0..width).map(|x| f64::from(r.at(x)[0])).collect()).collect();
    (rows.concat(), renderer.visible().collect())
}

fn at(x: f64, y: f64, z: f64) -> SE3 {
    SE3::new(UnitQuaternion::identity(), Vector3::new(x, y, z))
}

/// Area and centroid of a polygon (shoelace formula).
fn moments(points: &[Point2<f64>]) -> (f64, Point2<f64>) {
    let (mut area, mut center) = (0.0, nalgebra::Vector2::zeros());
    for k in 0..points.len() {
        let (a, b) = (points[k].coords, points[(k + 1) % points.len()].coords);
        let cross = a.x * b.y - a.y * b.x;
        area += 0.5 * cross;
        center += (a + b) * (cross / 6.0);
    }
    (area.abs(), Point2::from(center / area))
}

#[test]
fn silhouettes_agree_with_the_projection_of_the_camera() {
    let corners = [[-0.06, -0.05], [0.07, -0.04], [0.05, 0.06], [-0.04, 0.05]];
    let plain = Camera::new(300.0, 310.0, 101.3, 77.9, 200, 150).unwrap();
    let bent = plain.with_lens(Lens::new(-0.25, 0.08, 0.002, -0.001, 0.0).unwrap());
    let body = Body::new(flat(corners), Texture::Plain(1.0), 1);
    for camera in [plain, bent] {
        for angle in [0.0, 0.4, 0.9] {
            let rotation = UnitQuaternion::from_euler_angles(angle, 0.5 * angle, angle + 0.1);
            let pose = SE3::new(rotation, Vector3::new(0.008, -0.008, 0.36));
            // Edges bend under distortion, so the outline is projected finely.
            let outline: Vec<Point2<f64>> = (0..400)
                .map(|k| {
                    let (a, b) = (corners[k / 100], corners[(k / 100 + 1) % 4]);
                    let t = (k % 100) as f64 / 100.0;
                    let p = Point3::new(a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), 0.0);
                    camera.project(&pose.act(&p)).unwrap()
                })
                .collect();
            assert!(outline.iter().all(|p| camera.contains(p, -2.0)), "the outline is in the picture");
            let (area, center) = moments(&outline);
            let (mut ink, mut seen) = (0.0, nalgebra::Vector2::zeros());
            for (k, c) in draw(camera, &[(&body, pose)]).0.iter().enumerate() {
                ink += c;
                seen += nalgebra::Vector2::new((k % 200) as f64, (k / 200) as f64) * *c;
            }
            let perimeter: f64 = (0..400).map(|k| (outline[(k + 1) % 400] - outline[k]).norm()).sum();
            assert!((ink - area).abs() / perimeter < 0.05, "border off by {}", (ink - area) / perimeter);
            let off = seen / ink - center.coords;
            assert!(off.norm() < 0.1, "centre off by {off} at {angle}");
        }
    }
}

#[test]
fn borders_lie_where_the_camera_projects_them() {
    let camera = Camera::new(250.0, 250.0, 80.2, 60.7, 160, 120).unwrap();
    let mesh = flat([[-0.05, -0.04], [0.05, -0.04], [0.05, 0.04], [-0.05, 0.04]]);
    let body = Body::new(mesh, Texture::Plain(1.0), 1);
    for shift in [0.0, 0.0007, 0.0031] {
        let pose = at(shift, 0.002, 0.3);
        let [low, high] =
            [-0.05, 0.05].map(|x| camera.project(&pose.act(&Point3::new(x, 0.0, 0.0))).unwrap().x);
        let row = &draw(camera, &[(&body, pose)]).0[60 * 160..61 * 160];
        let ink: f64 = row.iter().sum();
        let middle = row.iter().enumerate().map(|(x, v)| x as f64 * v).sum::<f64>() / ink;
        // A bar from `low` to `high` covers this much and has its centre here.
        assert!(
            (ink - (high - low)).abs() < 0.2 && (middle - 0.5 * (low + high)).abs() < 0.1,
            "{ink} {middle}"
        );
    }
}

#[test]
fn what_is_in_front_hides_what_is_behind_whatever_the_order() {
    let camera = Camera::new(300.0, 300.0, 79.5, 59.5, 160, 120).unwrap();
    let square = |half: f64| flat([[-half, -half], [half, -half], [half, half], [-half, half]]);
    let (far, near) =
        (Body::new(square(0.05), Texture::Plain(0.5), 0), Body::new(square(0.02), Texture::Plain(1.0), 0));
    // The near square is 40 px wide, the far one 50 px; the near one hides the right part of the far one.
    let (behind, front) = (at(0.0, 0.0, 0.6), at(0.025, 0.0, 0.3));
    let (a, seen) = draw(camera, &[(&far, behind), (&near, front)]);
    let (b, turned) = draw(camera, &[(&near, front), (&far, behind)]);
    assert_eq!((a.clone(), seen[0], seen[1]), (b, turned[1], turned[0]));
    assert_eq!((a[60 * 160 + 100], a[60 * 160 + 60]), (1.0, 0.5));
    // Columns 54.5 to 104.5 are the far one's, those from 84.5 on hidden over 40 of 50 rows.
    assert!((seen[0] - (1.0 - 20.0 * 40.0 / 2500.0)).abs() < 0.02 && seen[1] == 1.0, "{seen:?}");
}

#[test]
fn a_body_that_leaves_the_picture_is_partly_visible_and_one_outside_is_not() {
    let camera = Camera::new(300.0, 300.0, 79.5, 59.5, 160, 120).unwrap();
    let body = Body::new(cuboid([0.1, 0.06, 1e-6]), Texture::Plain(1.0), 0);
    // 100 px wide; its middle on the left border, then far outside, then behind the camera.
    for (pose, share) in [(at(-0.08, 0.0, 0.3), 0.5), (at(1.0, 0.0, 0.3), 0.0), (at(0.0, 0.0, -1.0), 0.0)] {
        let (_, visible) = draw(camera, &[(&body, pose)]);
        assert!((visible[0] - share).abs() < 0.05, "{visible:?} instead of {share}");
    }
    assert!(draw(camera, &[]).0.iter().all(|v| *v == 0.0));
}

#[test]
fn textures_with_coordinates_stick_to_the_surface() {
    // A picture, left half black and right half white, on a turned plate: the border is where its middle is seen.
    let picture = image::RgbImage::from_fn(64, 2, |x, _| image::Rgb([if x < 32 { 0 } else { 255 }; 3]));
    let mesh = flat([[-0.05, -0.05], [0.05, -0.05], [0.05, 0.05], [-0.05, 0.05]]);
    let mut data = mesh.into_data();
    data.polygons[0].texcoords = Some(vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]);
    let texture = Texture::Picture(std::sync::Arc::new(picture));
    let body = Body::new(Mesh::new(data).unwrap(), texture, 0);
    let camera = Camera::new(300.0, 300.0, 79.5, 59.5, 160, 120).unwrap();
    let pose = SE3::new(UnitQuaternion::from_euler_angles(0.0, 0.9, 0.0), Vector3::new(0.01, 0.0, 0.3));
    let project = |x: f64| camera.project(&pose.act(&Point3::new(x, 0.0, 0.0))).unwrap().x;
    let row = &draw(camera, &[(&body, pose)]).0[60 * 160..61 * 160];
    let ink: f64 = row.iter().sum();
    assert!((ink - (project(0.05) - project(0.0)).abs()).abs() < 0.6, "{ink}");
}

#[test]
fn highlights_lie_where_the_mirror_direction_is() {
    let camera = Camera::new(300.0, 300.0, 79.5, 59.5, 160, 120).unwrap();
    let body = Body::new(cuboid([0.3, 0.3, 0.01]), Texture::Plain(0.0), 0);
    let light = Light { specular: 1.0, gloss: 9, ambient: 0.0, ..FULL };
    let mut renderer = Renderer::new(camera, vec![]);
    renderer.start();
    renderer.add(&[(&body, at(0.0, 0.0, 0.3))], &light);
    let rows: Vec<Vec<f32>> = renderer.rows().map(|r| (0..160).map(|x| r.at(x)[0]).collect()).collect();
    // Light from behind the camera is mirrored back along the optical axis.
    assert!(rows[59][79] > 0.95 && rows[59][10] < 0.1, "{} {}", rows[59][79], rows[59][10]);
}
