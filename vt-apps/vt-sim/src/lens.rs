//! Where the lens takes each pixel from.

use nalgebra::Point2;
use vt_models::camera::Camera;

/// Ideal pixels, those of the camera without its lens, at the corners of the picture's pixels. Inside a pixel the lens
/// is taken as bilinear: it is smooth.
pub(crate) struct LensMap {
    /// By rows; empty without distortion.
    corners: Vec<[f32; 2]>,
    columns: usize,
    /// Pixels that the ideal picture must reach beyond the border.
    pub(crate) margin: f64,
}

impl LensMap {
    pub(crate) fn new(camera: &Camera) -> Self {
        let (width, height) = camera.size();
        let columns = width as usize + 1;
        if *camera == camera.without_lens() {
            return Self { corners: vec![], columns, margin: 0.0 };
        }
        let ((fx, fy), (cx, cy)) = (camera.focal(), camera.principal_point());
        let mut corners = Vec::with_capacity(columns * (height as usize + 1));
        let mut margin: f64 = 0.0;
        for y in 0..=height {
            for x in 0..=width {
                let corner = Point2::new(f64::from(x) - 0.5, f64::from(y) - 0.5);
                // Outside the valid part of the lens nothing of the scene is seen.
                let ideal =
                    camera.unproject(&corner).map_or([f64::NAN; 2], |r| [r.x * fx + cx, r.y * fy + cy]);
                if ideal[0].is_finite() {
                    let beyond = |v: f64, n: u32| (-0.5 - v).max(v - f64::from(n) + 0.5);
                    margin = margin.max(beyond(ideal[0], width)).max(beyond(ideal[1], height));
                }
                corners.push(ideal.map(|v| v as f32));
            }
        }
        Self { corners, columns, margin: margin.min(f64::from(width.max(height))).ceil() + 1.0 }
    }

    /// Whether there is no distortion.
    pub(crate) fn is_ideal(&self) -> bool {
        self.corners.is_empty()
    }

    /// Ideal pixel at a place inside a pixel, from its top left corner in 0 to 1; not a number outside the valid part
    /// of the lens.
    pub(crate) fn ideal(&self, x: usize, y: usize, dx: f64, dy: f64) -> [f64; 2] {
        if self.is_ideal() {
            return [x as f64 - 0.5 + dx, y as f64 - 0.5 + dy];
        }
        let node = |i: usize, j: usize| self.corners[(y + j) * self.columns + x + i];
        let (a, b, c, d) = (node(0, 0), node(1, 0), node(0, 1), node(1, 1));
        [0, 1].map(|k| {
            let [a, b, c, d] = [a[k], b[k], c[k], d[k]].map(f64::from);
            (a * (1.0 - dx) + b * dx) * (1.0 - dy) + (c * (1.0 - dx) + d * dx) * dy
        })
    }
}
