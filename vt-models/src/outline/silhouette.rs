//! The outline of a body as a camera sees it.

use nalgebra::Point2;
use vt_core::error::ConfigError;
use vt_core::lie::SE3;

use super::Outline;
use crate::camera::Camera;
use crate::mesh::Mesh;
use crate::raster::{NONE, RasterOptions, Rasterizer};

/// Pixels drawn for each pixel of the camera, along each axis.
const FINENESS: f64 = 4.0;

/// Passes of the binomial filter that takes the steps of pixels off: a deviation of half a pixel of the camera.
const PASSES: usize = 8;

impl Outline {
    /// Outer contour of the largest connected piece of the silhouette of `mesh` in the ideal image of `camera` (lens
    /// distortion left out), in its pixels; to about a tenth of a pixel where the silhouette is smooth.
    ///
    /// # Errors
    /// Where nothing of the mesh can be seen.
    pub fn silhouette(mesh: &Mesh, camera: &Camera, camera_from_object: &SE3) -> Result<Self, ConfigError> {
        let (width, height) = camera.size();
        let mut raster = Rasterizer::default();
        // As much around the picture as it is large, so that a body at its border is whole.
        let options = RasterOptions {
            scale: FINENESS,
            margin: f64::from(width.max(height)),
            ..RasterOptions::default()
        };
        raster.render(mesh, camera, camera_from_object, &options);
        let view = *raster.viewport();
        let mask = Mask { width: view.width, filled: raster.ids().iter().map(|&id| id != NONE).collect() };
        let Some(start) = mask.largest_piece() else {
            let expected = "a mesh before the camera, in or beside its picture";
            return Err(ConfigError::Mismatch {
                found: "an invisible mesh".into(),
                expected: expected.into(),
            });
        };
        let mut contour = mask.follow(start);
        for _ in 0..PASSES {
            smooth(&mut contour);
        }
        let camera_pixel = |p: &[f64; 2], axis: usize, origin: i32| {
            // Corners of the grid lie half a pixel before the centres.
            (p[axis] - 0.5 + f64::from(origin) + 0.5) / view.scale - 0.5
        };
        let points =
            contour.iter().map(|p| Point2::new(camera_pixel(p, 0, view.x), camera_pixel(p, 1, view.y)));
        Self::polygon(points.collect())
    }
}

/// Pixels that show the body.
struct Mask {
    width: usize,
    filled: Vec<bool>,
}

impl Mask {
    /// First pixel, by rows, of the largest piece of 4-connected pixels.
    fn largest_piece(&self) -> Option<usize> {
        let mut seen = vec![false; self.filled.len()];
        let mut stack = vec![];
        let mut best: Option<(usize, usize)> = None;
        for start in 0..self.filled.len() {
            if !self.filled[start] || seen[start] {
                continue;
            }
            let mut size = 0;
            seen[start] = true;
            stack.push(start);
            while let Some(k) = stack.pop() {
                size += 1;
                let x = k % self.width;
                let neighbours = [
                    (x > 0).then(|| k - 1),
                    (x + 1 < self.width).then(|| k + 1),
                    k.checked_sub(self.width),
                    Some(k + self.width).filter(|&below| below < self.filled.len()),
                ];
                for next in neighbours.into_iter().flatten() {
                    if self.filled[next] && !seen[next] {
                        seen[next] = true;
                        stack.push(next);
                    }
                }
            }
            if best.is_none_or(|(most, _)| size > most) {
                best = Some((size, start));
            }
        }
        best.map(|(_, start)| start)
    }

    fn at(&self, x: i64, y: i64) -> bool {
        x >= 0
            && (x as usize) < self.width
            && y >= 0
            && self.filled.get(y as usize * self.width + x as usize).is_some_and(|&f| f)
    }

    /// Middles of the pixel sides around the piece whose first pixel is `start`, the piece on the right hand; the grid's
    /// corner `(x, y)` is the upper left one of the pixel `(x, y)`.
    fn follow(&self, start: usize) -> Vec<[f64; 2]> {
        let first = ((start % self.width) as i64, (start / self.width) as i64);
        let (mut at, mut heading) = (first, (1_i64, 0_i64));
        let mut middles = vec![];
        loop {
            let next = (at.0 + heading.0, at.1 + heading.1);
            middles.push([0.5 * (at.0 + next.0) as f64, 0.5 * (at.1 + next.1) as f64]);
            at = next;
            // Pixels ahead, to the right and to the left of the heading `(dx, dy)`; right is `(−dy, dx)`.
            let (dx, dy) = heading;
            let pixel = |side: i64| {
                let corner = (2 * at.0 + dx - side * dy, 2 * at.1 + dy + side * dx);
                self.at((corner.0 - 1).div_euclid(2), (corner.1 - 1).div_euclid(2))
            };
            heading = match (pixel(1), pixel(-1)) {
                (false, _) => (-dy, dx),
                (true, false) => heading,
                (true, true) => (dy, -dx),
            };
            if at == first && heading == (1, 0) {
                return middles;
            }
        }
    }
}

/// One pass of the filter ¼ ½ ¼ around a closed chain.
fn smooth(points: &mut [[f64; 2]]) {
    let (Some(&first), Some(&last)) = (points.first(), points.last()) else { return };
    let mut before = last;
    for k in 0..points.len() {
        let (here, after) = (points[k], points.get(k + 1).copied().unwrap_or(first));
        points[k] = [0, 1].map(|i| 0.25 * (before[i] + after[i]) + 0.5 * here[i]);
        before = here;
    }
}
