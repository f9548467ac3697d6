//! Drawing views: which body is seen in each part of a pixel, and how bright it is.

use core::ops::Range;

use nalgebra::{Point2, Vector3};
use rayon::prelude::*;
use vt_core::lie::{LieGroup, SE3};
use vt_models::camera::Camera;
use vt_models::raster::{NONE, RasterOptions, Rasterizer, Viewport};

use crate::lens::LensMap;
use crate::light::Light;
use crate::scene::Body;
use crate::texture::{Colour, Coordinates, Skin};

/// Samples along each side of a pixel.
const SIDE: usize = 4;
/// Samples of a pixel.
const SAMPLES: usize = SIDE * SIDE;

/// Draws bodies before a background as one camera sees them. Buffers are used again.
pub struct Renderer {
    camera: Camera,
    lens: LensMap,
    backdrop: Vec<Colour>,
    layers: Vec<Layer>,
    /// What bodies add to the background, over all views since [`Renderer::start`].
    sum: Vec<Colour>,
    /// Columns and rows of the picture where `sum` may not be zero.
    touched: [Range<usize>; 2],
    /// Samples of each row and body: those it covers, those where it is seen.
    counts: Vec<[u32; 2]>,
    views: u32,
}

/// One body of a view.
#[derive(Default)]
struct Layer {
    raster: Rasterizer,
    /// A coarse view that reaches beyond the picture.
    around: Rasterizer,
    surfaces: Vec<Option<Surface>>,
    /// Covered samples, those where it is seen, and the share of the body that is within the picture: sums over views.
    covered: u64,
    seen: u64,
    within: f64,
}

/// A triangle as samples need it, in camera coordinates.
struct Surface {
    /// `n · P = 1` on its plane.
    plane: Vector3<f64>,
    /// Unit normal to the camera's side.
    normal: Vector3<f64>,
    brightness: f32,
    skin: Skin,
    coordinates: Option<Coordinates>,
}

/// What all samples of a view share.
#[derive(Clone, Copy)]
struct Shading {
    light: Light,
    focal: [f64; 2],
    center: [f64; 2],
}

impl Renderer {
    /// A camera before this background (brightness by rows, as many as the camera has pixels; missing ones are
    /// black).
    pub fn new(camera: Camera, mut backdrop: Vec<Colour>) -> Self {
        let lens = LensMap::new(&camera);
        let (width, height) = camera.size();
        let (w, h) = (width as usize, height as usize);
        backdrop.resize(w * h, [0.0; 3]);
        for (k, colour) in backdrop.iter_mut().enumerate() {
            if lens.ideal(k % w, k / w, 0.5, 0.5)[0].is_nan() {
                *colour = [0.0; 3];
            }
        }
        let sum = vec![[0.0; 3]; w * h];
        Self { camera, lens, backdrop, layers: vec![], sum, touched: [0..0, 0..0], counts: vec![], views: 0 }
    }

    /// The camera.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Forgets the views added so far.
    pub fn start(&mut self) {
        let width = self.camera.size().0 as usize;
        for row in self.touched[1].clone() {
            self.sum[row * width..][self.touched[0].clone()].fill([0.0; 3]);
        }
        self.touched = [0..0, 0..0];
        self.views = 0;
        for layer in &mut self.layers {
            (layer.covered, layer.seen, layer.within) = (0, 0, 0.0);
        }
    }

    /// Adds a view of bodies, each with its camera_from_object. Directions of the light are those of the camera.
    pub fn add(&mut self, bodies: &[(&Body, SE3)], light: &Light) {
        let (width, height) = self.camera.size();
        let (width, height) = (width as usize, height as usize);
        self.layers.resize_with(bodies.len(), Layer::default);
        self.views += 1;
        let (camera, lens) = (&self.camera, &self.lens);
        let direction = light.direction.try_normalize(0.0).unwrap_or_else(Vector3::zeros);
        let light = Light { direction, ..*light };
        self.layers.par_iter_mut().zip(bodies).for_each(|(layer, (body, pose))| {
            layer.prepare(body, pose, camera, lens, &light);
        });
        let view = self.layers.iter().map(|l| l.region(lens, width, height)).fold([0..0, 0..0], union);
        let [columns, rows] = view.clone();
        self.touched = union(self.touched.clone(), view);
        if columns.is_empty() || rows.is_empty() {
            return;
        }
        let ((fx, fy), (cx, cy)) = (camera.focal(), camera.principal_point());
        let shading = Shading { light, focal: [fx, fy], center: [cx, cy] };
        self.counts.clear();
        self.counts.resize(rows.len() * bodies.len(), [0; 2]);
        let (layers, backdrop) = (&self.layers, &self.backdrop);
        let sums = self.sum[rows.start * width..rows.end * width].par_chunks_mut(width);
        sums.zip(self.counts.par_chunks_mut(bodies.len())).enumerate().for_each(|(k, (sum, counts))| {
            let y = rows.start + k;
            let behind = &backdrop[y * width..][..width];
            for x in columns.clone() {
                let mut hits = Hits::default();
                for (l, layer) in layers.iter().enumerate() {
                    hits.test(l, layer, lens, x, y, &mut counts[l]);
                }
                if hits.any {
                    let more = hits.colour(layers, bodies, lens, &shading, x, y, &behind[x], counts);
                    sum[x].iter_mut().zip(more).for_each(|(s, m)| *s += m);
                }
            }
        });
        for counts in self.counts.chunks(bodies.len()) {
            for (layer, [covered, seen]) in self.layers.iter_mut().zip(counts) {
                layer.covered += u64::from(*covered);
                layer.seen += u64::from(*seen);
            }
        }
    }

    /// Mean brightness of the views added, by rows, and the rows' length. Red, green and blue, 0 to 1, averaged over
    /// each pixel's area.
    pub fn mean(&self) -> impl IndexedParallelIterator<Item = impl Iterator<Item = Colour>> {
        let width = self.camera.size().0 as usize;
        let share = 1.0 / self.views.max(1) as f32;
        self.backdrop.par_chunks(width).zip(self.sum.par_chunks(width)).map(move |(behind, sum)| {
            behind.iter().zip(sum).map(move |(b, s)| [0, 1, 2].map(|k| b[k] + s[k] * share))
        })
    }

    /// Share of each body's silhouette that is seen, 0 to 1, mean over the views added: what other bodies hide and
    /// what is outside the picture is not seen.
    pub fn visible(&self) -> impl Iterator<Item = f64> {
        let views = f64::from(self.views.max(1));
        self.layers.iter().map(move |l| match l.covered {
            0 => 0.0,
            covered => l.within / views * (l.seen as f64 / covered as f64),
        })
    }
}

/// The smallest region that contains two.
fn union([a, b]: [Range<usize>; 2], [c, d]: [Range<usize>; 2]) -> [Range<usize>; 2] {
    if a.is_empty() || b.is_empty() {
        return [c, d];
    }
    if c.is_empty() || d.is_empty() {
        return [a, b];
    }
    [a.start.min(c.start)..a.end.max(c.end), b.start.min(d.start)..b.end.max(d.end)]
}

impl Layer {
    fn prepare(&mut self, body: &Body, pose: &SE3, camera: &Camera, lens: &LensMap, light: &Light) {
        let options = RasterOptions {
            scale: SIDE as f64,
            margin: lens.margin,
            whole_image: !lens.is_ideal(),
            ..RasterOptions::default()
        };
        self.raster.render(body.mesh(), camera, pose, &options);
        self.within += self.within(body, pose, camera);
        let inverse = pose.inverse();
        self.surfaces.clear();
        self.surfaces.extend(body.mesh().triangles().iter().zip(body.skins()).map(|(t, skin)| {
            let skin = (*skin)?;
            let [a, b, c] = body.mesh().corners(t).map(|p| pose.act(&p));
            let normal = (b - a).cross(&(c - a));
            let distance = normal.dot(&a.coords);
            let unit = normal.try_normalize(0.0)?;
            // Both sides of a face are lit: the normal points to the camera.
            let facing = if distance > 0.0 { -unit } else { unit };
            let cosine = facing.dot(&light.direction).max(0.0) as f32;
            let brightness = light.ambient + light.diffuse * cosine;
            // The same coordinates as functions of the point in the camera's frame.
            let coordinates = skin.coordinates.map(|c| Coordinates {
                u: pose.rotation * c.u,
                v: pose.rotation * c.v,
                origin: [
                    c.origin[0] + c.u.dot(&inverse.translation),
                    c.origin[1] + c.v.dot(&inverse.translation),
                ],
            });
            let plane = normal / distance;
            (distance != 0.0).then_some(Surface { plane, normal: facing, brightness, skin, coordinates })
        }));
    }

    /// Share of the silhouette that is in the picture, distortion left out.
    fn within(&mut self, body: &Body, pose: &SE3, camera: &Camera) -> f64 {
        let (width, height) = camera.size();
        let inside = |p: &nalgebra::Point3<f64>| {
            let p = camera.without_lens().project(&pose.act(p));
            p.is_some_and(|p| camera.contains(&p, 0.0))
        };
        if body.mesh().vertices().iter().all(inside) {
            return 1.0;
        }
        let options =
            RasterOptions { scale: 0.25, margin: f64::from(width.max(height)), ..RasterOptions::default() };
        self.around.render(body.mesh(), camera, pose, &options);
        let viewport = *self.around.viewport();
        let picture = |v: f64, n: u32| v >= -0.5 && v < f64::from(n) - 0.5;
        let (mut all, mut within) = (0_u64, 0_u64);
        for (k, _) in self.around.ids().iter().enumerate().filter(|(_, id)| **id != NONE) {
            let at = |v: usize, from: i32| (v as f64 + f64::from(from) + 0.5) / viewport.scale - 0.5;
            let (x, y) = (at(k % viewport.width, viewport.x), at(k / viewport.width, viewport.y));
            all += 1;
            within += u64::from(picture(x, width) && picture(y, height));
        }
        if all == 0 { 1.0 } else { within as f64 / all as f64 }
    }

    /// Columns and rows of the picture in which the body may be seen.
    fn region(&self, lens: &LensMap, width: usize, height: usize) -> [Range<usize>; 2] {
        let v = self.raster.viewport();
        if v.width == 0 || v.height == 0 {
            return [0..0, 0..0];
        }
        if !lens.is_ideal() {
            return [0..width, 0..height];
        }
        let range = |from: i32, n: usize, all: usize| {
            let pixel = |sample: i64| (sample.div_euclid(SIDE as i64)).clamp(0, all as i64) as usize;
            pixel(from.into())..pixel(i64::from(from) + n as i64 + SIDE as i64 - 1)
        };
        [range(v.x, v.width, width), range(v.y, v.height, height)]
    }
}

/// The nearest surface in each sample of a pixel.
struct Hits {
    any: bool,
    /// Body and triangle; [`NONE`] shows the background.
    layer: [u16; SAMPLES],
    triangle: [u32; SAMPLES],
    inverse_depth: [f32; SAMPLES],
}

impl Default for Hits {
    fn default() -> Self {
        Self { any: false, layer: [0; SAMPLES], triangle: [NONE; SAMPLES], inverse_depth: [0.0; SAMPLES] }
    }
}

/// Place of a sample inside its pixel, 0 to 1 from the top left corner.
fn place(sample: usize) -> [f64; 2] {
    [sample % SIDE, sample / SIDE].map(|k| (k as f64 + 0.5) / SIDE as f64)
}

/// Position in a raster's buffer of a sample; `None` outside.
#[inline]
fn position(viewport: &Viewport, ideal: [f64; 2]) -> Option<usize> {
    let p = viewport.buffer_from_image(&Point2::from(ideal));
    let (column, row) = ((p.x + 0.5).floor(), (p.y + 0.5).floor());
    // NaN, outside the valid part of the lens, fails here.
    let inside =
        column >= 0.0 && row >= 0.0 && column < viewport.width as f64 && row < viewport.height as f64;
    inside.then(|| row as usize * viewport.width + column as usize)
}

impl Hits {
    /// Takes what is nearer of a body. Adds to the number of samples that it covers.
    #[inline]
    fn test(&mut self, l: usize, layer: &Layer, lens: &LensMap, x: usize, y: usize, count: &mut [u32; 2]) {
        let viewport = layer.raster.viewport();
        let (ids, depths) = (layer.raster.ids(), layer.raster.inverse_depth());
        let mut sample = |s: usize, at: usize| {
            let (Some(&id), Some(&depth)) = (ids.get(at), depths.get(at)) else { return };
            if id == NONE {
                return;
            }
            count[0] += 1;
            if depth > self.inverse_depth[s] {
                self.any = true;
                self.layer[s] = l as u16;
                self.triangle[s] = id;
                self.inverse_depth[s] = depth;
            }
        };
        if !lens.is_ideal() {
            for s in 0..SAMPLES {
                let [dx, dy] = place(s);
                if let Some(at) = position(viewport, lens.ideal(x, y, dx, dy)) {
                    sample(s, at);
                }
            }
            return;
        }
        // Without a lens samples are the pixels of the raster.
        let first = |pixel: usize, from: i32| (SIDE * pixel) as i64 - i64::from(from);
        let (left, top) = (first(x, viewport.x), first(y, viewport.y));
        for j in 0..SIDE {
            let row = top + j as i64;
            if row < 0 || row >= viewport.height as i64 {
                continue;
            }
            for i in 0..SIDE {
                let column = left + i as i64;
                if column >= 0 && column < viewport.width as i64 {
                    sample(j * SIDE + i, row as usize * viewport.width + column as usize);
                }
            }
        }
    }

    /// Difference to the background, mean over the pixel. Adds to the number of samples where bodies are seen.
    fn colour(
        &self,
        layers: &[Layer],
        bodies: &[(&Body, SE3)],
        lens: &LensMap,
        shading: &Shading,
        x: usize,
        y: usize,
        behind: &Colour,
        counts: &mut [[u32; 2]],
    ) -> Colour {
        let surface = |s: usize| match self.triangle[s] {
            NONE => None,
            id => layers.get(self.layer[s] as usize)?.surfaces.get(id as usize)?.as_ref(),
        };
        let shade = |s: usize, at: &Surface| {
            let [dx, dy] = place(s);
            shading.colour(at, bodies[self.layer[s] as usize].0, lens.ideal(x, y, dx, dy))
        };
        for s in 0..SAMPLES {
            if self.triangle[s] != NONE {
                counts[self.layer[s] as usize][1] += 1;
            }
        }
        let one =
            (1..SAMPLES).all(|s| self.triangle[s] == self.triangle[0] && self.layer[s] == self.layer[0]);
        if one && let Some(only) = surface(0) {
            // A surface that looks alike within the pixel is looked at once.
            if only.coordinates.is_none() && shading.light.specular == 0.0 {
                let colour = shade(0, only);
                return [0, 1, 2].map(|k| colour[k] - behind[k]);
            }
        }
        let mut sum = [0.0_f32; 3];
        for s in 0..SAMPLES {
            if let Some(at) = surface(s) {
                let colour = shade(s, at);
                (0..3).for_each(|k| sum[k] += colour[k] - behind[k]);
            }
        }
        sum.map(|v| v / SAMPLES as f32)
    }
}

impl Shading {
    /// Brightness of a surface at a pixel of the ideal picture.
    #[inline]
    fn colour(&self, surface: &Surface, body: &Body, ideal: [f64; 2]) -> Colour {
        let light = &self.light;
        if surface.coordinates.is_none() && light.specular == 0.0 {
            return surface.skin.base.map(|c| c * surface.brightness);
        }
        let [x, y] = [0, 1].map(|k| (ideal[k] - self.center[k]) / self.focal[k]);
        let ray = Vector3::new(x, y, 1.0);
        let reflectance = surface.coordinates.map_or(surface.skin.base, |c| {
            let depth = 1.0 / surface.plane.dot(&ray);
            let at = [c.origin[0] + c.u.dot(&ray) * depth, c.origin[1] + c.v.dot(&ray) * depth];
            body.texture().at(body.seed(), &surface.skin, at)
        });
        let mut highlight = 0.0;
        if light.specular > 0.0 {
            let half = (light.direction - ray / ray.norm()).try_normalize(0.0).unwrap_or_else(Vector3::zeros);
            let cosine = surface.normal.dot(&half).max(0.0) as f32;
            // Repeated squares.
            highlight = light.specular * (0..light.gloss.min(10)).fold(cosine, |c, _| c * c);
        }
        reflectance.map(|c| c * surface.brightness + highlight)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bodies::cuboid;
    use crate::texture::Texture;
    use nalgebra::{Point3, UnitQuaternion};
    use vt_models::camera::Lens;
    use vt_models::mesh::{Mesh, MeshData, Polygon};

    const FULL: Light = Light {
        ambient: 1.0,
        diffuse: 0.0,
        specular: 0.0,
        gloss: 0,
        direction: Vector3::new(0.0, 0.0, -1.0),
    };

    fn flat(corners: [[f64; 2]; 4]) -> Mesh {
        let vertices = corners.iter().map(|c| Point3::new(c[0], c[1], 0.0)).collect();
        let polygons = vec![Polygon { corners: vec![0, 1, 2, 3], ..Polygon::default() }];
        Mesh::new(MeshData { vertices, polygons, ..MeshData::default() }).unwrap()
    }

    fn draw(camera: Camera, bodies: &[(&Body, SE3)]) -> (Vec<f64>, Vec<f64>) {
        let mut renderer = Renderer::new(camera, vec![]);
        renderer.start();
        renderer.add(bodies, &FULL);
        let rows: Vec<Vec<f64>> = renderer.mean().map(|r| r.map(|c| f64::from(c[0])).collect()).collect();
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
        let (far, near) = (
            Body::new(square(0.05), Texture::Plain(0.5), 0),
            Body::new(square(0.02), Texture::Plain(1.0), 0),
        );
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
        for (pose, share) in [(at(-0.08, 0.0, 0.3), 0.5), (at(1.0, 0.0, 0.3), 0.0), (at(0.0, 0.0, -1.0), 0.0)]
        {
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
        let rows: Vec<Vec<f32>> = renderer.mean().map(|r| r.map(|c| c[0]).collect()).collect();
        // Light from behind the camera is mirrored back along the optical axis.
        assert!(rows[59][79] > 0.95 && rows[59][10] < 0.1, "{} {}", rows[59][79], rows[59][10]);
    }
}
