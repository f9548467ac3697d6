use crate::camera::Camera;
use nalgebra::Point3;

/// A triangle cut by the near plane and the sides of the guard band (Sutherland–Hodgman), at most 8 corners.
pub(super) struct Clipped {
    points: [Point3<f64>; 8],
    count: usize,
}

impl Clipped {
    pub fn new(corners: &[Point3<f64>; 3], ideal: &Camera, near: f64, origin: [f64; 2], guard: f64) -> Self {
        let mut out = Self { points: [Point3::origin(); 8], count: 3 };
        out.points[..3].copy_from_slice(corners);
        out.cut(|p| p.z - near);
        let ((fx, fy), (cx, cy)) = (ideal.focal(), ideal.principal_point());
        // |u - origin| <= guard with u = fx X/Z + cx, multiplied by Z > 0.
        let (x, y) = (cx - origin[0], cy - origin[1]);
        out.cut(|p| fx * p.x + (x + guard) * p.z);
        out.cut(|p| (guard - x) * p.z - fx * p.x);
        out.cut(|p| fy * p.y + (y + guard) * p.z);
        out.cut(|p| (guard - y) * p.z - fy * p.y);
        out
    }

    pub fn points(&self) -> &[Point3<f64>] {
        &self.points[..self.count]
    }

    /// Keeps the side where `height` is not negative. New corners are computed from the inner to the outer end, so
    /// that two triangles with a common side get the same one.
    fn cut(&mut self, height: impl Fn(&Point3<f64>) -> f64) {
        let (before, n) = (self.points, self.count);
        self.count = 0;
        for i in 0..n {
            let (a, b) = (before[i], before[(i + 1) % n]);
            let (ha, hb) = (height(&a), height(&b));
            if ha >= 0.0 {
                self.push(a);
            }
            if (ha >= 0.0) != (hb >= 0.0) {
                let (inner, outer, hi, ho) = if ha >= 0.0 { (a, b, ha, hb) } else { (b, a, hb, ha) };
                self.push(inner + (outer - inner) * (hi / (hi - ho)));
            }
        }
    }

    fn push(&mut self, p: Point3<f64>) {
        if self.count < self.points.len() {
            self.points[self.count] = p;
            self.count += 1;
        }
    }
}
