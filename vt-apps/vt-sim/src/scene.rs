//! One view of a model in front of a background.

use nalgebra::{Point2, Vector3};
use rayon::prelude::*;
use vt_core::lie::SE3;
use vt_models::camera::Camera;
use vt_models::mesh::Mesh;
use vt_models::raster::{NONE, RasterOptions, Rasterizer};

use crate::texture::{Backdrop, Background, Colour, FaceAxes, Texture};

/// Samples along each side of a pixel.
const SAMPLES: usize = 4;

/// Light: an ambient part and a distant source.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Share that reaches every surface alike.
    pub ambient: f32,
    /// Share that falls in with the cosine of the angle to the source.
    pub diffuse: f32,
    /// Direction to the source in camera axes.
    pub direction: Vector3<f64>,
}

impl Default for Light {
    fn default() -> Self {
        Self { ambient: 0.65, diffuse: 0.35, direction: Vector3::new(-0.4, -0.7, -0.6).normalize() }
    }
}

/// A model, its surface, the light, the background and the camera that sees them.
pub struct Scene {
    mesh: Mesh,
    camera: Camera,
    seed: u64,
    /// Surface of the model.
    pub texture: Texture,
    /// Light.
    pub light: Light,
    /// Background of each pixel: it stands still, so it is drawn once.
    backdrop: Vec<Colour>,
    faces: Vec<Option<FaceAxes>>,
    /// Ideal pixels at the corners of the picture's pixels, by rows; empty without distortion.
    lens: Vec<[f32; 2]>,
    /// Pixels that the ideal picture must reach beyond the border.
    margin: f64,
    raster: Rasterizer,
    linear: Vec<Colour>,
}

impl Scene {
    /// A scene with squares on the model, clutter behind it and daylight; looks depend on `seed`.
    pub fn new(mesh: Mesh, camera: Camera, seed: u64) -> Self {
        let size = 0.12 * mesh.diameter();
        let faces =
            (0..mesh.polygons().len()).map(|k| mesh.normal(k).map(|n| FaceAxes::new(k as u32, &n))).collect();
        let (lens, margin) = lens_map(&camera);
        let width = camera.size().0;
        let background =
            Background::Clutter { size: 0.08 * f64::from(width), brightness: 0.4, contrast: 0.5 };
        let mut scene = Self {
            mesh,
            camera,
            seed,
            texture: Texture::Squares { size, contrast: 0.35 },
            light: Light::default(),
            backdrop: vec![],
            faces,
            lens,
            margin,
            raster: Rasterizer::default(),
            linear: vec![],
        };
        scene.draw_background(background);
        scene
    }

    /// The same scene with another background.
    #[must_use]
    pub fn with_background(mut self, background: Background) -> Self {
        self.draw_background(background);
        self
    }

    fn draw_background(&mut self, background: Background) {
        let (width, height) = self.camera.size();
        let backdrop = Backdrop::new(background, self.seed, width, height);
        let columns = width as usize;
        self.backdrop = (0..columns * height as usize)
            .into_par_iter()
            .map(|k| {
                average(|dx, dy| match self.ideal(k % columns, k / columns, dx, dy) {
                    [x, y] if x.is_finite() && y.is_finite() => backdrop.colour(x, y),
                    // Outside the valid part of the lens nothing is seen.
                    _ => [0.0; 3],
                })
            })
            .collect();
    }

    /// Pixel of the ideal picture at a place inside a pixel, from its top left corner in 0 to 1. The lens is smooth:
    /// inside a pixel it is taken as bilinear.
    fn ideal(&self, x: usize, y: usize, dx: f64, dy: f64) -> [f64; 2] {
        if self.lens.is_empty() {
            return [x as f64 - 0.5 + dx, y as f64 - 0.5 + dy];
        }
        let columns = self.camera.size().0 as usize + 1;
        let node = |i: usize, j: usize| self.lens[(y + j) * columns + x + i];
        let (a, b, c, d) = (node(0, 0), node(1, 0), node(0, 1), node(1, 1));
        [0, 1].map(|k| {
            let [a, b, c, d] = [a[k], b[k], c[k], d[k]].map(f64::from);
            (a * (1.0 - dx) + b * dx) * (1.0 - dy) + (c * (1.0 - dx) + d * dx) * dy
        })
    }

    /// The same scene with another surface.
    #[must_use]
    pub fn with_texture(mut self, texture: Texture) -> Self {
        self.texture = texture;
        self
    }

    /// The camera.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Draws the view under `camera_from_object`: brightness of red, green and blue in 0 to 1 by rows, averaged over
    /// each pixel's area.
    pub fn draw(&mut self, camera_from_object: &SE3) -> &[Colour] {
        let (width, height) = self.camera.size();
        let options = RasterOptions {
            scale: SAMPLES as f64,
            margin: self.margin,
            whole_image: !self.lens.is_empty(),
            ..RasterOptions::default()
        };
        self.raster.render(&self.mesh, &self.camera, camera_from_object, &options);
        let mut linear = core::mem::take(&mut self.linear);
        linear.resize(width as usize * height as usize, [0.0; 3]);
        let view = View::new(self, camera_from_object);
        linear.par_chunks_mut(width as usize).enumerate().for_each(|(y, row)| {
            for (x, pixel) in row.iter_mut().enumerate() {
                *pixel = view.pixel(x, y);
            }
        });
        self.linear = linear;
        &self.linear
    }
}

/// Where the lens comes from for each corner of a pixel, and how far outside the picture.
fn lens_map(camera: &Camera) -> (Vec<[f32; 2]>, f64) {
    if *camera == camera.without_lens() {
        return (vec![], 0.0);
    }
    let (width, height) = camera.size();
    let ((fx, fy), (cx, cy)) = (camera.focal(), camera.principal_point());
    let mut map = Vec::with_capacity((width as usize + 1) * (height as usize + 1));
    let mut margin: f64 = 0.0;
    for y in 0..=height {
        for x in 0..=width {
            let corner = Point2::new(f64::from(x) - 0.5, f64::from(y) - 0.5);
            // Outside the valid part of the lens nothing of the scene is seen.
            let ideal = camera.unproject(&corner).map_or([f64::NAN; 2], |r| [r.x * fx + cx, r.y * fy + cy]);
            if ideal[0].is_finite() {
                let beyond = |v: f64, n: u32| (-0.5 - v).max(v - f64::from(n) + 0.5);
                margin = margin.max(beyond(ideal[0], width)).max(beyond(ideal[1], height));
            }
            map.push(ideal.map(|v| v as f32));
        }
    }
    (map, margin.min(f64::from(width.max(height))).ceil() + 1.0)
}

/// A triangle as the samples need it.
struct Surface {
    /// `n · P = 1` on its plane, in camera coordinates.
    plane: Vector3<f64>,
    brightness: f32,
    face: FaceAxes,
}

/// Everything about one view that does not depend on the pixel.
struct View<'a> {
    scene: &'a Scene,
    object_from_camera: SE3,
    surfaces: Vec<Option<Surface>>,
}

impl<'a> View<'a> {
    fn new(scene: &'a Scene, pose: &SE3) -> Self {
        let surfaces = scene.mesh.triangles().iter().map(|t| {
            let face = scene.faces[t.polygon as usize]?;
            let [a, b, c] = scene.mesh.corners(t).map(|p| pose.act(&p));
            let normal = (b - a).cross(&(c - a));
            let distance = normal.dot(&a.coords);
            let unit = normal.try_normalize(0.0)?;
            // Both sides of a face are lit: the normal points to the camera.
            let facing = if distance > 0.0 { -unit } else { unit };
            let cosine = facing.dot(&scene.light.direction).max(0.0) as f32;
            let brightness = scene.light.ambient + scene.light.diffuse * cosine;
            (distance != 0.0).then(|| Surface { plane: normal / distance, brightness, face })
        });
        let inverse = pose.rotation.inverse();
        let object_from_camera = SE3::new(inverse, -(inverse * pose.translation));
        Self { scene, object_from_camera, surfaces: surfaces.collect() }
    }

    fn pixel(&self, x: usize, y: usize) -> Colour {
        let background = self.scene.backdrop[y * self.scene.camera.size().0 as usize + x];
        if !self.near_model(x, y) {
            return background;
        }
        average(|dx, dy| self.sample(x, y, dx, dy).unwrap_or(background))
    }

    /// False when no sample of the pixel can show the model.
    fn near_model(&self, x: usize, y: usize) -> bool {
        let viewport = self.scene.raster.viewport();
        let inside = |p: Point2<f64>| {
            let reach = 2.0 * SAMPLES as f64;
            let within = |v: f64, n: usize| v > -reach && v < n as f64 + reach;
            within(p.x, viewport.width) && within(p.y, viewport.height)
        };
        inside(viewport.buffer_from_image(&Point2::from(self.scene.ideal(x, y, 0.5, 0.5))))
    }

    /// Brightness of the model at a place inside a pixel; `None` where it shows the background.
    fn sample(&self, x: usize, y: usize, dx: f64, dy: f64) -> Option<Colour> {
        let scene = self.scene;
        let ideal = scene.ideal(x, y, dx, dy);
        let viewport = scene.raster.viewport();
        let p = viewport.buffer_from_image(&Point2::from(ideal));
        let (column, row) = ((p.x + 0.5).floor(), (p.y + 0.5).floor());
        // NaN, outside the valid part of the lens, fails here.
        if !(column >= 0.0 && row >= 0.0 && column < viewport.width as f64 && row < viewport.height as f64) {
            return None;
        }
        let id = scene.raster.ids()[row as usize * viewport.width + column as usize];
        let surface = if id == NONE { None } else { self.surfaces[id as usize].as_ref() }?;
        let ((fx, fy), (cx, cy)) = (scene.camera.focal(), scene.camera.principal_point());
        let ray = Vector3::new((ideal[0] - cx) / fx, (ideal[1] - cy) / fy, 1.0);
        let p_in_camera = nalgebra::Point3::from(ray / surface.plane.dot(&ray));
        let p_in_object = self.object_from_camera.act(&p_in_camera);
        Some(scene.texture.colour(scene.seed, &surface.face, &p_in_object).map(|c| c * surface.brightness))
    }
}

/// Mean over the samples of a pixel.
fn average(sample: impl Fn(f64, f64) -> Colour) -> Colour {
    let mut sum = [0.0_f32; 3];
    for j in 0..SAMPLES {
        for i in 0..SAMPLES {
            let at = |k: usize| (k as f64 + 0.5) / SAMPLES as f64;
            sum.iter_mut().zip(sample(at(i), at(j))).for_each(|(s, c)| *s += c);
        }
    }
    sum.map(|s| s / (SAMPLES * SAMPLES) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Point3, UnitQuaternion};
    use vt_models::camera::Lens;
    use vt_models::mesh::{MeshData, Polygon};

    fn flat(corners: [[f64; 2]; 4]) -> Mesh {
        let vertices = corners.iter().map(|c| Point3::new(c[0], c[1], 0.0)).collect();
        let polygons = vec![Polygon { corners: vec![0, 1, 2, 3], ..Polygon::default() }];
        Mesh::new(MeshData { vertices, polygons, ..MeshData::default() }).unwrap()
    }

    fn silhouette(mesh: Mesh, camera: Camera) -> Scene {
        let mut scene = Scene::new(mesh, camera, 1)
            .with_texture(Texture::Plain(1.0))
            .with_background(Background::Plain(0.0));
        scene.light = Light { ambient: 1.0, diffuse: 0.0, ..Light::default() };
        scene
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
        for camera in [plain, bent] {
            let mut scene = silhouette(flat(corners), camera);
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
                for (k, c) in scene.draw(&pose).iter().enumerate() {
                    ink += f64::from(c[0]);
                    seen += nalgebra::Vector2::new((k % 200) as f64, (k / 200) as f64) * f64::from(c[0]);
                }
                let perimeter: f64 = (0..400).map(|k| (outline[(k + 1) % 400] - outline[k]).norm()).sum();
                assert!((ink - area).abs() / perimeter < 0.05, "border off by {}", (ink - area) / perimeter);
                let off = seen / ink - center.coords;
                assert!(off.norm() < 0.1, "centre off by {off} at {angle}");
            }
        }
    }

    #[test]
    fn edges_lie_where_the_camera_projects_them() {
        let camera = Camera::new(250.0, 250.0, 80.2, 60.7, 160, 120).unwrap();
        let mut scene =
            silhouette(flat([[-0.05, -0.04], [0.05, -0.04], [0.05, 0.04], [-0.05, 0.04]]), camera);
        for shift in [0.0, 0.0007, 0.0031] {
            let pose = SE3::new(UnitQuaternion::identity(), Vector3::new(shift, 0.002, 0.3));
            let [low, high] =
                [-0.05, 0.05].map(|x| camera.project(&pose.act(&Point3::new(x, 0.0, 0.0))).unwrap().x);
            let row: Vec<f64> =
                scene.draw(&pose)[60 * 160..61 * 160].iter().map(|c| f64::from(c[0])).collect();
            let ink: f64 = row.iter().sum();
            let middle = row.iter().enumerate().map(|(x, v)| x as f64 * v).sum::<f64>() / ink;
            // A bar from `low` to `high` covers this much and has its centre here.
            assert!(
                (ink - (high - low)).abs() < 0.2 && (middle - 0.5 * (low + high)).abs() < 0.1,
                "{ink} {middle}"
            );
        }
    }
}
