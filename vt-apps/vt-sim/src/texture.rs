//! Surfaces: functions of a place on a body and a seed.

use std::sync::Arc;

use image::RgbImage;
use nalgebra::Vector3;
use vt_models::mesh::{Mesh, Triangle};

/// Linear reflectance or brightness of red, green and blue in 0 to 1.
pub type Colour = [f32; 3];

/// What the surface of a body looks like. Polygons in one plane look alike, so that a mesh made of triangles shows no
/// edges that are not there.
#[derive(Clone, Debug, PartialEq)]
pub enum Texture {
    /// One reflectance everywhere.
    Plain(f32),
    /// A random reflectance for each plane, between these two.
    Faces {
        /// Smallest reflectance, 0 to 1.
        from: f32,
        /// Largest reflectance, 0 to 1.
        to: f32,
    },
    /// Each plane is covered with squares of random reflectance.
    Squares {
        /// Edge length of a square in metres.
        size: f64,
        /// Range of reflectance about that of the plane, 0 to 1.
        contrast: f32,
    },
    /// The colours of the mesh's materials; grey 0.6 where it has none.
    Materials,
    /// A picture at the mesh's texture coordinates; the colour of the material where it has none.
    Picture(Arc<RgbImage>),
}

/// Well-mixed bits of some integers (splitmix64 of Steele, Lea and Flood, 2014, fed with one integer after another).
/// It is called for each sample of each pixel, where a draw from `vt_core::random` would be too slow.
fn mixed(seed: u64, parts: [i64; 3]) -> u64 {
    let mut z = seed;
    for part in parts {
        z = z.wrapping_add(0x9E37_79B9_7F4A_7C15).wrapping_add(part as u64);
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^= z >> 31;
    }
    z
}

/// Four numbers in 0 to 1 of some integers.
pub(crate) fn uniform(seed: u64, parts: [i64; 3]) -> [f32; 4] {
    let z = mixed(seed, parts);
    [0, 16, 32, 48].map(|shift| ((z >> shift) & 0xFFFF) as f32 / 65535.0)
}

/// Brightness with some of a random hue.
pub(crate) fn tinted(brightness: f32, hue: &[f32]) -> Colour {
    [0, 1, 2].map(|k| (brightness * (0.75 + 0.5 * hue[k])).clamp(0.02, 1.0))
}

/// Two coordinates on the plane of a triangle as affine functions of a point of the object: those of the squares, or
/// those of the picture.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Coordinates {
    pub(crate) u: Vector3<f64>,
    pub(crate) v: Vector3<f64>,
    pub(crate) origin: [f64; 2],
}

/// Looks of one triangle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Skin {
    /// Reflectance where it is one everywhere, else that of the plane or the material.
    pub(crate) base: Colour,
    /// `None` where the reflectance is one everywhere.
    pub(crate) coordinates: Option<Coordinates>,
    plane: i64,
}

impl Texture {
    /// Looks of a triangle; `plane` is the number of its plane.
    pub(crate) fn skin(&self, seed: u64, mesh: &Mesh, triangle: &Triangle, plane: i64) -> Option<Skin> {
        let polygon = mesh.polygons().get(triangle.polygon as usize)?;
        let material = polygon.material.and_then(|m| mesh.materials().get(m as usize));
        let authored = material.map_or([0.6; 3], |m| m.diffuse.map(|v| v.clamp(0.0, 1.0)));
        let [b, hue @ ..] = uniform(seed, [plane, 0, 0]);
        let (base, coordinates) = match self {
            Self::Plain(brightness) => ([*brightness; 3], None),
            Self::Faces { from, to } => (tinted(from + (to - from) * b, &hue), None),
            Self::Squares { size, .. } => {
                let normal = mesh.normal(triangle.polygon as usize)?;
                let mut axis = Vector3::zeros();
                axis[normal.iamin()] = 1.0;
                let u = normal.cross(&axis).normalize();
                let (u, v) = (u / *size, normal.cross(&u) / *size);
                ([0.4 + 0.3 * b; 3], Some(Coordinates { u, v, origin: [0.0; 2] }))
            }
            Self::Materials => (authored, None),
            Self::Picture(_) => {
                let at = polygon.texcoords.as_ref().and_then(|all| texture_axes(mesh, triangle, all));
                (authored, at)
            }
        };
        Some(Skin { base, coordinates, plane })
    }

    /// Reflectance at two coordinates of a skin.
    #[inline]
    pub(crate) fn at(&self, seed: u64, skin: &Skin, [u, v]: [f64; 2]) -> Colour {
        match self {
            Self::Squares { contrast, .. } => {
                let [b, hue @ ..] = uniform(seed, [skin.plane + 1, u.floor() as i64, v.floor() as i64]);
                tinted(skin.base[0] + contrast * (b - 0.5), &hue)
            }
            Self::Picture(picture) => sampled(picture, u, v),
            Self::Plain(_) | Self::Faces { .. } | Self::Materials => skin.base,
        }
    }
}

/// Texture coordinates over the plane of a triangle as affine functions of the point; `None` without area.
fn texture_axes(mesh: &Mesh, triangle: &Triangle, all: &[[f32; 2]]) -> Option<Coordinates> {
    let [a, b, c] = mesh.corners(triangle);
    let [ta, tb, tc] = triangle.corners.map(|k| all.get(k as usize).map(|t| t.map(f64::from)));
    let (ta, tb, tc) = (ta?, tb?, tc?);
    let (e, f) = (b - a, c - a);
    let normal = e.cross(&f);
    let area = normal.norm_squared();
    if area <= 0.0 {
        return None;
    }
    // Dual basis of e and f in the plane.
    let (de, df) = (f.cross(&normal) / area, normal.cross(&e) / area);
    let axis = |k: usize| de * (tb[k] - ta[k]) + df * (tc[k] - ta[k]);
    let (u, v) = (axis(0), axis(1));
    Some(Coordinates { u, v, origin: [ta[0] - u.dot(&a.coords), ta[1] - v.dot(&a.coords)] })
}

/// Bilinear sample; u to the right, v up, the picture repeats.
fn sampled(picture: &RgbImage, u: f64, v: f64) -> Colour {
    let (w, h) = picture.dimensions();
    if w == 0 || h == 0 {
        return [0.0; 3];
    }
    let wrapped = |v: f64, n: u32| (v - v.floor()) * f64::from(n) - 0.5;
    let (x, y) = (wrapped(u, w), wrapped(1.0 - v, h));
    let (x0, y0) = (x.floor(), y.floor());
    let (fx, fy) = ((x - x0) as f32, (y - y0) as f32);
    let texel = |dx: i64, dy: i64| {
        let wrap = |v: i64, n: u32| v.rem_euclid(i64::from(n)) as u32;
        picture.get_pixel(wrap(x0 as i64 + dx, w), wrap(y0 as i64 + dy, h)).0.map(|v| f32::from(v) / 255.0)
    };
    let (a, b, c, d) = (texel(0, 0), texel(1, 0), texel(0, 1), texel(1, 1));
    [0, 1, 2].map(|k| (a[k] * (1.0 - fx) + b[k] * fx) * (1.0 - fy) + (c[k] * (1.0 - fx) + d[k] * fx) * fy)
}
