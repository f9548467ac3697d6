//! Solids with little or nothing to tell some motions by.

use nalgebra::Point3;
use vt_models::camera::Camera;

use crate::scene::Solid;

/// A camera of a quarter megapixel with square pixels.
pub fn camera() -> Camera {
    Camera::new(500.0, 500.0, 159.5, 119.5, 320, 240).unwrap()
}

/// A dark rectangle of this width and height across its z axis.
pub fn plate(width: f64, height: f64) -> Solid {
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
    let vertices = corners.map(|[x, y]| Point3::new(0.5 * x * width, 0.5 * y * height, 0.0)).to_vec();
    Solid::new(vertices, vec![(vec![0, 1, 2, 3], 30.0)])
}

/// A cylinder about its z axis with `n` facets of one grey level.
pub fn cylinder(radius: f64, height: f64, n: u32) -> Solid {
    let rim = |k: u32| {
        let (s, c) = vt_core::math::sin_cos(f64::from(k) * core::f64::consts::TAU / f64::from(n));
        [-0.5, 0.5].map(|z| Point3::new(radius * c, radius * s, z * height))
    };
    let vertices = (0..n).flat_map(rim).collect();
    let side = |k: u32| (vec![2 * k, 2 * k + 1, (2 * k + 3) % (2 * n), (2 * k + 2) % (2 * n)], 40.0);
    let mut faces: Vec<_> = (0..n).map(side).collect();
    faces.extend([0, 1].map(|end| ((0..n).map(|k| 2 * k + end).collect(), 200.0)));
    Solid::new(vertices, faces)
}
