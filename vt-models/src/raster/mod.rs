//! Deterministic software rasteriser: inverse depth and triangle id of a mesh under a pose.
//!
//! It draws the *ideal* image of the camera (lens distortion left out): depth tests of model points need no lens,
//! only the same centre of projection, and straight edges stay straight. Coverage is decided in integers at
//! 1/16 pixel with the top-left rule, so triangles that share an edge neither overlap nor leave a gap, whatever
//! the platform. Inverse depth is linear in the image and taken from the exact plane of each triangle.

mod barycentric;
mod clip;
mod span;

use crate::camera::Camera;
use crate::mesh::Mesh;
use clip::Clipped;
use nalgebra::{Point2, Point3, Vector3};
use vt_core::lie::SE3;

/// Id of pixels that show no triangle.
pub const NONE: u32 = u32::MAX;

/// How to draw.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RasterOptions {
    /// Size of the drawn image relative to the camera's; 0.5 draws every second pixel.
    pub scale: f64,
    /// Distance of the clipping plane, metres.
    pub near: f64,
    /// Pixels of the camera image to draw beyond its border on each side.
    pub margin: f64,
    /// Whether to draw the whole image instead of the object's bounding box in it.
    pub whole_image: bool,
}

impl Default for RasterOptions {
    /// Full scale, 1 mm, no margin, only the object's region.
    fn default() -> Self {
        Self { scale: 1.0, near: 1e-3, margin: 0.0, whole_image: false }
    }
}

/// The drawn rectangle: buffer pixel `(i, j)` is pixel `(x + i, y + j)` of the camera image scaled by `scale`.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Viewport {
    /// Left column in the scaled image.
    pub x: i32,
    /// Top row in the scaled image.
    pub y: i32,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Scaled pixels per camera pixel.
    pub scale: f64,
}

impl Viewport {
    /// Position in the buffer of a pixel of the ideal camera image.
    #[must_use]
    pub fn buffer_from_image(&self, pixel: &Point2<f64>) -> Point2<f64> {
        let scaled = |c: f64| (c + 0.5) * self.scale - 0.5;
        Point2::new(scaled(pixel.x) - f64::from(self.x), scaled(pixel.y) - f64::from(self.y))
    }
}

/// Reusable buffers of the rasteriser; no allocation once they have grown.
#[derive(Clone, Debug, Default)]
pub struct Rasterizer {
    viewport: Viewport,
    inverse_depth: Vec<f32>,
    ids: Vec<u32>,
    p_in_camera: Vec<Point3<f64>>,
    ideal: Option<Camera>,
    barycentric: barycentric::Cache,
}

/// Vertices farther outside the viewport than this are clipped first, so that integers stay small, pixels.
const GUARD: f64 = 16_384.0;
/// Units of the sub-pixel grid per pixel.
const SUBPIXEL: f64 = 16.0;

impl Rasterizer {
    /// Draws a mesh; `camera_from_object` maps its vertices into the camera frame.
    pub fn render(
        &mut self,
        mesh: &Mesh,
        camera: &Camera,
        camera_from_object: &SE3,
        options: &RasterOptions,
    ) {
        let ideal = camera.without_lens().scaled(options.scale);
        self.ideal = Some(ideal);
        let rotation = camera_from_object.rotation.to_rotation_matrix();
        let translation = camera_from_object.translation;
        self.p_in_camera.clear();
        self.p_in_camera.extend(mesh.vertices().iter().map(|p| rotation * p + translation));
        self.viewport = self.object_viewport(&ideal, options);
        let pixels = self.viewport.width * self.viewport.height;
        self.inverse_depth.clear();
        self.ids.clear();
        // Room for the whole image, so that an object that comes nearer takes no memory.
        let (width, height) = camera.size();
        let whole = f64::from(width) * f64::from(height) * options.scale * options.scale;
        self.inverse_depth.reserve((whole as usize).max(pixels));
        self.ids.reserve((whole as usize).max(pixels));
        self.inverse_depth.resize(pixels, 0.0);
        self.ids.resize(pixels, NONE);
        if pixels == 0 {
            return;
        }
        for (id, triangle) in mesh.triangles().iter().enumerate() {
            let corners = triangle.vertices.map(|v| self.p_in_camera[v as usize]);
            self.triangle(id as u32, &corners, &ideal, options.near);
        }
    }

    /// The object's bounding box in the image, or all of the image where some vertex is behind the near plane.
    fn object_viewport(&self, ideal: &Camera, options: &RasterOptions) -> Viewport {
        let (w, h) = ideal.size();
        let margin = (options.margin * options.scale).ceil();
        let (mut low, mut high) = ([-margin; 2], [f64::from(w) + margin, f64::from(h) + margin]);
        if !options.whole_image && self.p_in_camera.iter().all(|p| p.z > options.near) {
            let (mut min, mut max) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
            for p in &self.p_in_camera {
                for (i, c) in image(ideal, p).into_iter().enumerate() {
                    min[i] = c.min(min[i]);
                    max[i] = c.max(max[i]);
                }
            }
            for i in 0..2 {
                low[i] = low[i].max(min[i].floor() - 1.0);
                high[i] = high[i].min(max[i].ceil() + 2.0);
            }
        }
        let size = |i: usize| (high[i] - low[i]).max(0.0) as usize;
        Viewport { x: low[0] as i32, y: low[1] as i32, width: size(0), height: size(1), scale: options.scale }
    }

    fn triangle(&mut self, id: u32, corners: &[Point3<f64>; 3], ideal: &Camera, near: f64) {
        let [a, b, c] = corners;
        let normal = (b - a).cross(&(c - a));
        let distance = normal.dot(&a.coords);
        // Seen exactly from the side, or without area.
        if distance == 0.0 {
            return;
        }
        let plane = Plane::new(normal / distance, ideal, &self.viewport);
        let origin = [f64::from(self.viewport.x), f64::from(self.viewport.y)];
        let flat = corners.map(|p| image(ideal, &p));
        let inside = corners.iter().all(|p| p.z >= near)
            && flat.iter().flatten().zip(origin.iter().cycle()).all(|(c, o)| (c - o).abs() < GUARD);
        let fixed = |q: [f64; 2]| [0, 1].map(|i| ((q[i] - origin[i]) * SUBPIXEL + 0.5).floor() as i64);
        if inside {
            let far = corners.iter().map(|p| p.z).fold(0.0, f64::max);
            let close = corners.iter().map(|p| p.z).fold(f64::INFINITY, f64::min);
            self.fill(id, &flat.map(fixed), &plane, (1.0 / far, 1.0 / close));
            return;
        }
        let clipped = Clipped::new(corners, ideal, near, origin, GUARD);
        let Some((first, rest)) = clipped.points().split_first() else { return };
        let depths = || clipped.points().iter().map(|p| p.z);
        let range = (1.0 / depths().fold(0.0, f64::max), 1.0 / depths().fold(f64::INFINITY, f64::min));
        for pair in rest.windows(2) {
            let corners = [*first, pair[0], pair[1]].map(|p| fixed(image(ideal, &p)));
            self.fill(id, &corners, &plane, range);
        }
    }

    fn fill(&mut self, id: u32, corners: &[[i64; 2]; 3], plane: &Plane, (far, close): (f64, f64)) {
        let Viewport { width, height, .. } = self.viewport;
        let Some(spans) = span::Spans::new(corners, width, height) else { return };
        let (far, close) = (far as f32, close as f32);
        for (row, start, end) in spans {
            let base = row * width;
            let depth = &mut self.inverse_depth[base + start..base + end];
            let ids = &mut self.ids[base + start..base + end];
            let first = (plane.origin + plane.dy * row as f64 + plane.dx * start as f64) as f32;
            let step = plane.dx as f32;
            for (i, (d, t)) in depth.iter_mut().zip(ids).enumerate() {
                let w = first + step * i as i32 as f32;
                let w = if w < far { far } else { w };
                let w = if w > close { close } else { w };
                let closer = w > *d;
                *d = if closer { w } else { *d };
                *t = if closer { id } else { *t };
            }
        }
    }

    /// The rectangle drawn last.
    #[must_use]
    pub fn viewport(&self) -> &Viewport {
        &self.viewport
    }

    /// Inverse depth in 1/m, row by row; 0 where nothing is.
    #[must_use]
    pub fn inverse_depth(&self) -> &[f32] {
        &self.inverse_depth
    }

    /// Triangle ids, row by row; [`NONE`] where nothing is.
    #[must_use]
    pub fn ids(&self) -> &[u32] {
        &self.ids
    }

    /// Writes depth in metres, row by row; infinite where nothing is.
    pub fn depth_into(&self, out: &mut Vec<f32>) {
        out.clear();
        out.extend(self.inverse_depth.iter().map(|w| 1.0 / w));
    }

    /// Inverse depth at a buffer position rounded to the nearest pixel; 0 outside the viewport.
    #[must_use]
    pub fn inverse_depth_at(&self, p_in_buffer: &Point2<f64>) -> f32 {
        let (x, y) = (p_in_buffer.x + 0.5, p_in_buffer.y + 0.5);
        let Viewport { width, height, .. } = self.viewport;
        // Truncation is rounding down for positive numbers; NaN becomes 0 and fails the first test.
        if x >= 0.0 && y >= 0.0 && (x as usize) < width && (y as usize) < height {
            self.inverse_depth[y as usize * width + x as usize]
        } else {
            0.0
        }
    }

    /// Writes perspective-correct barycentric weights of the second and third corner of each pixel's triangle (the
    /// first has the rest), row by row; NaN where nothing is. For the mesh drawn last.
    pub fn barycentrics_into(&mut self, mesh: &Mesh, out: &mut Vec<[f32; 2]>) {
        let Some(ideal) = self.ideal else { return out.clear() };
        self.barycentric.fill(mesh, &self.p_in_camera, &ideal, &self.viewport, &self.ids, out);
    }
}

/// Ideal projection without any test.
fn image(ideal: &Camera, p: &Point3<f64>) -> [f64; 2] {
    let ((fx, fy), (cx, cy)) = (ideal.focal(), ideal.principal_point());
    let inverse = 1.0 / p.z;
    [fx * p.x * inverse + cx, fy * p.y * inverse + cy]
}

/// Inverse depth as an affine function of the buffer pixel.
struct Plane {
    origin: f64,
    dx: f64,
    dy: f64,
}

impl Plane {
    /// From `n·P = 1`: `1/Z = n_x (u - cx)/fx + n_y (v - cy)/fy + n_z`.
    fn new(n: Vector3<f64>, ideal: &Camera, viewport: &Viewport) -> Self {
        let ((fx, fy), (cx, cy)) = (ideal.focal(), ideal.principal_point());
        let (dx, dy) = (n.x / fx, n.y / fy);
        let origin = n.z + dx * (f64::from(viewport.x) - cx) + dy * (f64::from(viewport.y) - cy);
        Self { origin, dx, dy }
    }
}

#[cfg(test)]
mod tests;
