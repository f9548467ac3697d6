use super::quarter_turn;
use crate::camera::{Camera, Fisheye, Optics};
use crate::edges::Edge;
use nalgebra::{Matrix3, Point2, Point3, Vector2, Vector3};
use vt_core::lie::SE3;
use vt_core::math;

/// Rectangle of ideal pixels that the lens maps into the image.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Bounds {
    pub low: [f64; 2],
    pub high: [f64; 2],
}

/// The bounds of the last camera.
#[derive(Clone, Debug, Default)]
pub(super) struct Frame {
    camera: Option<Camera>,
    bounds: Bounds,
}

/// Border samples per side of the image.
const SAMPLES: u32 = 8;

/// Tangent of the largest angle to the optical axis at which edges are seen (75°). Visibility is tested in the ideal
/// image of a pinhole, which a fisheye would make infinitely large.
const WIDEST: f64 = 3.732;

impl Frame {
    pub fn update(&mut self, camera: &Camera) {
        if self.camera.as_ref() == Some(camera) {
            return;
        }
        self.camera = Some(*camera);
        let (w, h) = camera.size();
        let (right, bottom) = (f64::from(w) - 0.5, f64::from(h) - 0.5);
        self.bounds = Bounds { low: [-0.5; 2], high: [right, bottom] };
        let ideal = camera.without_lens();
        for i in 0..=SAMPLES {
            let s = f64::from(i) / f64::from(SAMPLES);
            let (u, v) = (-0.5 + s * (right + 0.5), -0.5 + s * (bottom + 0.5));
            for border in [[u, -0.5], [u, bottom], [-0.5, v], [right, v]] {
                let ray = match camera.optics() {
                    Optics::Perspective(_) => camera.unproject(&Point2::from(border)).ok(),
                    Optics::Fisheye(lens) => Some(widest_ray(camera, lens, &Point2::from(border))),
                };
                if let Some(q) = ray.and_then(|r| ideal.project(&Point3::from(r))) {
                    for k in 0..2 {
                        self.bounds.low[k] = self.bounds.low[k].min(q[k]);
                        self.bounds.high[k] = self.bounds.high[k].max(q[k]);
                    }
                }
            }
        }
    }

    pub fn bounds(&self) -> &Bounds {
        &self.bounds
    }

    /// How far the bounds reach beyond the image, pixels.
    pub fn overhang(&self, camera: &Camera) -> f64 {
        let (w, h) = camera.size();
        let Bounds { low, high } = self.bounds;
        let over = [-0.5 - low[0], -0.5 - low[1], high[0] - f64::from(w) + 0.5, high[1] - f64::from(h) + 0.5];
        over.into_iter().fold(0.0, f64::max)
    }
}

/// The ray seen at a pixel, drawn in to where edges are still seen; where nothing is seen, to the limit of the lens.
fn widest_ray(camera: &Camera, lens: &Fisheye, pixel: &Point2<f64>) -> Vector3<f64> {
    let ((fx, fy), (cx, cy)) = (camera.focal(), camera.principal_point());
    let aside = Vector2::new((pixel.x - cx) / fx, (pixel.y - cy) / fy)
        .try_normalize(0.0)
        .unwrap_or_else(Vector2::zeros);
    let beyond = |angle: f64| if angle < 1.57 { math::tan(angle).min(WIDEST) } else { WIDEST };
    let radius =
        camera.unproject(pixel).map_or_else(|_| beyond(lens.limit()), |r| math::hypot(r.x, r.y).min(WIDEST));
    Vector3::new(aside.x * radius, aside.y * radius, 1.0)
}

/// The visible part of a projected edge, in ideal pixels.
#[derive(Clone, Debug)]
pub(super) struct Line {
    pub start: Point2<f64>,
    pub direction: Vector2<f64>,
    pub length: f64,
    inverse_depth: [f64; 2],
    ends: [Point3<f64>; 2],
}

impl Line {
    /// Positive normal of the image line.
    pub fn normal(&self) -> Vector2<f64> {
        quarter_turn(&self.direction)
    }

    /// Ideal pixel, inverse depth and object point at fraction `t` of the image line.
    ///
    /// Inverse depth is linear in the image; the object point divides the edge at
    /// `λ = t w₁ / ((1 - t) w₀ + t w₁)`.
    pub fn at(&self, t: f64) -> (Point2<f64>, f64, Point3<f64>) {
        let [w0, w1] = self.inverse_depth;
        let w = (1.0 - t) * w0 + t * w1;
        let [a, b] = self.ends;
        (self.start + self.direction * (self.length * t), w, a + (b - a) * (t * w1 / w))
    }
}

/// A line that has sites, for the search of ambiguous neighbours.
#[derive(Clone, Copy, Debug)]
pub(super) struct Span {
    pub start: Point2<f64>,
    pub direction: Vector2<f64>,
    pub length: f64,
    pub first: u32,
    pub end: u32,
}

impl Span {
    pub fn new(line: &Line, first: u32, end: u32) -> Self {
        Self { start: line.start, direction: line.direction, length: line.length, first, end }
    }

    /// The span of one site on a chain.
    pub fn about(middle: &Point2<f64>, direction: Vector2<f64>, length: f64, site: u32) -> Self {
        Self { start: middle - direction * (0.5 * length), direction, length, first: site, end: site + 1 }
    }
}

/// Camera and pose prepared for projecting many edges.
pub(super) struct View {
    pub camera_from_object: SE3,
    rotation: Matrix3<f64>,
    camera_in_object: Point3<f64>,
    focal: (f64, f64),
    center: (f64, f64),
    near: f64,
}

impl View {
    pub fn new(camera: &Camera, camera_from_object: &SE3, near: f64) -> Self {
        let rotation = camera_from_object.rotation.to_rotation_matrix().into_inner();
        let camera_in_object = Point3::from(-(rotation.transpose() * camera_from_object.translation));
        Self {
            camera_from_object: *camera_from_object,
            rotation,
            camera_in_object,
            focal: camera.focal(),
            center: camera.principal_point(),
            near,
        }
    }

    /// Whether one of the two surfaces faces the camera and the other does not.
    pub fn is_silhouette(&self, edge: &Edge) -> bool {
        let [a, b] = edge.sheets[..] else { return false };
        let along = edge.ends[1] - edge.ends[0];
        let to_camera = self.camera_in_object - edge.ends[0];
        // Normals turned from the inward directions agree in orientation whatever the authored winding.
        let (fa, fb) = (along.cross(&a.inward).dot(&to_camera), -along.cross(&b.inward).dot(&to_camera));
        (fa > 0.0) != (fb > 0.0)
    }

    fn ideal(&self, p: &Point3<f64>) -> Point2<f64> {
        Point2::new(self.focal.0 * p.x / p.z + self.center.0, self.focal.1 * p.y / p.z + self.center.1)
    }

    /// Projects an edge and clips it to the near plane and the bounds; `None` where nothing is left.
    pub fn project(&self, edge: &Edge, bounds: &Bounds, cut: &mut bool) -> Option<Line> {
        let mut in_object = edge.ends;
        let mut in_camera =
            edge.ends.map(|p| Point3::from(self.rotation * p.coords + self.camera_from_object.translation));
        let heights = in_camera.map(|p| p.z - self.near);
        if heights[0] < 0.0 || heights[1] < 0.0 {
            *cut = true;
            let (i, o) = match heights {
                [a, b] if a < 0.0 && b < 0.0 => return None,
                [a, _] if a < 0.0 => (1, 0),
                _ => (0, 1),
            };
            let s = heights[i] / (heights[i] - heights[o]);
            in_object[o] = in_object[i] + (in_object[o] - in_object[i]) * s;
            in_camera[o] = in_camera[i] + (in_camera[o] - in_camera[i]) * s;
            in_camera[o].z = self.near;
        }
        let [a, b] = in_camera.map(|p| self.ideal(&p));
        let whole = b - a;
        let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
        for k in 0..2 {
            for (height, slope) in [(a[k] - bounds.low[k], whole[k]), (bounds.high[k] - a[k], -whole[k])] {
                let at = -height / slope;
                if slope > 0.0 {
                    enter = enter.max(at);
                } else if slope < 0.0 {
                    leave = leave.min(at);
                } else if height < 0.0 {
                    leave = -1.0;
                }
            }
        }
        *cut |= enter > 0.0 || leave < 1.0;
        let length = whole.norm() * (leave - enter);
        if enter >= leave || length.is_nan() || length <= 0.0 {
            return None;
        }
        let uncut = Line {
            start: a,
            direction: whole.normalize(),
            length: whole.norm(),
            inverse_depth: in_camera.map(|p| 1.0 / p.z),
            ends: in_object,
        };
        let ((start, w0, p0), (_, w1, p1)) = (uncut.at(enter), uncut.at(leave));
        Some(Line { start, length, inverse_depth: [w0, w1], ends: [p0, p1], ..uncut })
    }

    /// Whether a surface of the edge lies on the positive and on the negative side of a line through one of its points
    /// in the image, given by its normal; `w` is the point's inverse depth.
    pub fn covered_sides(
        &self,
        edge: &Edge,
        w: f64,
        p_in_object: &Point3<f64>,
        normal: &Vector2<f64>,
    ) -> [bool; 2] {
        let p = self.rotation * p_in_object.coords + self.camera_from_object.translation;
        let mut covered = [false; 2];
        for sheet in &edge.sheets {
            let d = self.rotation * sheet.inward;
            // Image motion of a point that moves into the surface, up to the factor 1/Z.
            let du = self.focal.0 * (d.x - d.z * p.x * w);
            let dv = self.focal.1 * (d.y - d.z * p.y * w);
            let across = normal.x * du + normal.y * dv;
            covered[0] |= across > 0.0;
            covered[1] |= across < 0.0;
        }
        covered
    }
}
