//! Procedural surfaces and backgrounds: functions of a place and a seed.

use nalgebra::{Point3, Vector3};
use vt_core::random::{Random, Stream};

/// Linear reflectance of red, green and blue in 0 to 1.
pub type Colour = [f32; 3];

/// What the surface of a model looks like.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Texture {
    /// One reflectance everywhere.
    Plain(f32),
    /// A random reflectance for each polygon.
    Faces,
    /// Each polygon is covered with squares of random reflectance.
    Squares {
        /// Edge length of a square in metres.
        size: f64,
        /// Range of reflectance about that of the polygon, 0 to 1.
        contrast: f32,
    },
}

/// What is behind the model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Background {
    /// One brightness everywhere.
    Plain(f32),
    /// Smooth random brightness with random rectangles in front.
    Clutter {
        /// Size of the rectangles in pixels.
        size: f64,
        /// Mean brightness, 0 to 1.
        brightness: f32,
        /// Range of brightness, 0 to 1.
        contrast: f32,
    },
}

/// Well-mixed bits of some integers (splitmix64 of Steele, Lea and Flood, 2014, fed with one integer after another).
/// It is called for each sample of each pixel, where a draw from [`Random`] would be too slow.
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
fn uniform(seed: u64, parts: [i64; 3]) -> [f32; 4] {
    let z = mixed(seed, parts);
    [0, 16, 32, 48].map(|shift| ((z >> shift) & 0xFFFF) as f32 / 65535.0)
}

/// Brightness with some of a random hue.
fn tinted(brightness: f32, hue: &[f32]) -> Colour {
    [0, 1, 2].map(|k| (brightness * (0.75 + 0.5 * hue[k])).clamp(0.02, 1.0))
}

/// A plane's own axes, for squares on a polygon.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FaceAxes {
    polygon: i64,
    u: Vector3<f64>,
    v: Vector3<f64>,
}

impl FaceAxes {
    /// Axes across `normal`.
    pub(crate) fn new(polygon: u32, normal: &Vector3<f64>) -> Self {
        let thin = normal.iamin();
        let mut axis = Vector3::zeros();
        axis[thin] = 1.0;
        let u = normal.cross(&axis).normalize();
        Self { polygon: i64::from(polygon), u, v: normal.cross(&u) }
    }
}

impl Texture {
    /// Reflectance of a point in object coordinates on a face.
    pub(crate) fn colour(&self, seed: u64, face: &FaceAxes, p: &Point3<f64>) -> Colour {
        match *self {
            Self::Plain(brightness) => [brightness; 3],
            Self::Faces => {
                let [b, hue @ ..] = uniform(seed, [face.polygon, 0, 0]);
                tinted(0.35 + 0.5 * b, &hue)
            }
            Self::Squares { size, contrast } => {
                let [base, ..] = uniform(seed, [face.polygon, 0, 0]);
                let cell = [&face.u, &face.v].map(|a| (p.coords.dot(a) / size).floor() as i64);
                let [b, hue @ ..] = uniform(seed, [face.polygon + 1, cell[0], cell[1]]);
                tinted(0.4 + 0.3 * base + contrast * (b - 0.5), &hue)
            }
        }
    }
}

/// A background that is ready to be drawn: rectangles are drawn once from the generator.
#[derive(Clone, Debug)]
pub(crate) struct Backdrop {
    seed: u64,
    plain: f32,
    contrast: f32,
    scale: f64,
    /// Left, top, right, bottom in pixels; brightness.
    rectangles: Vec<([f64; 4], Colour)>,
}

impl Backdrop {
    pub(crate) fn new(background: Background, seed: u64, width: u32, height: u32) -> Self {
        let (plain, contrast, size) = match background {
            Background::Plain(b) => (b, 0.0, 1.0),
            Background::Clutter { size, brightness, contrast } => (brightness, contrast, size),
        };
        let mut random = Random::new(seed, Stream::Sim, 1, 0, 0);
        let [w, h] = [width, height].map(f64::from);
        let count = if contrast > 0.0 { (0.35 * w * h / (size * size)) as usize } else { 0 };
        let rectangles = (0..count)
            .map(|_| {
                let (x, y) = (random.uniform() * w, random.uniform() * h);
                let (a, b) = (size * (0.4 + random.uniform()), size * (0.4 + random.uniform()));
                let hue = [0; 3].map(|_| random.uniform() as f32);
                let brightness = plain + contrast * (random.uniform() as f32 - 0.5);
                ([x - a, y - b, x + a, y + b], tinted(brightness, &hue))
            })
            .collect();
        Self { seed, plain, contrast, scale: 4.0 * size, rectangles }
    }

    /// Brightness at a pixel of the ideal picture.
    pub(crate) fn colour(&self, x: f64, y: f64) -> Colour {
        if self.contrast == 0.0 {
            return [self.plain; 3];
        }
        let front =
            self.rectangles.iter().rev().find(|(r, _)| x >= r[0] && y >= r[1] && x < r[2] && y < r[3]);
        if let Some((_, colour)) = front {
            return *colour;
        }
        // Bilinear interpolation of random numbers at the nodes of a grid.
        let (gx, gy) = (x / self.scale, y / self.scale);
        let (ix, iy) = (gx.floor(), gy.floor());
        let (fx, fy) = ((gx - ix) as f32, (gy - iy) as f32);
        let node = |dx: i64, dy: i64| uniform(self.seed, [-1, ix as i64 + dx, iy as i64 + dy])[0];
        let top = node(0, 0) * (1.0 - fx) + node(1, 0) * fx;
        let bottom = node(0, 1) * (1.0 - fx) + node(1, 1) * fx;
        [self.plain + self.contrast * (top * (1.0 - fy) + bottom * fy - 0.5); 3]
    }
}
