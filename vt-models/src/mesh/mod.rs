//! Ground shape: polygons as authored, their triangulation, explicit lines and materials.
//!
//! A [`Mesh`] is built once from loose [`MeshData`], checked, and then immutable. Polygons keep the author's
//! corners, because edges of a polygon mean more to a tracker than edges of its triangles; triangles serve the
//! rasteriser and know the polygon they came from.

mod error;
mod shape;
mod skin;
mod triangulation;

pub use error::MeshError;
pub use shape::{Part, Shape};
pub use skin::{Joint, Skin};
pub use triangulation::triangulate;
pub(crate) use triangulation::unit_normal;

use nalgebra::{Point3, Vector3};

/// Length unit of authored coordinates; every loader converts to metres.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Unit {
    /// 1 m.
    #[default]
    Metre,
    /// 0.01 m.
    Centimetre,
    /// 0.001 m.
    Millimetre,
    /// 0.0254 m.
    Inch,
}

impl Unit {
    /// Metres per unit.
    #[must_use]
    pub fn metres(self) -> f64 {
        match self {
            Self::Metre => 1.0,
            Self::Centimetre => 0.01,
            Self::Millimetre => 0.001,
            Self::Inch => 0.0254,
        }
    }
}

/// Surface description of polygons.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Authored name, possibly empty.
    pub name: String,
    /// Diffuse colour, linear RGB in 0..=1 as authored.
    pub diffuse: [f32; 3],
    /// Texture file name as written in the model file, or the name of one of the mesh's own [`Image`]s.
    pub texture: Option<String>,
}

/// A picture that came inside the model file; materials refer to it by its name.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Name, different from those of the mesh's other images.
    pub name: String,
    /// The picture.
    pub content: ImageContent,
}

/// A picture in a model file.
#[derive(Clone, Debug, PartialEq)]
pub enum ImageContent {
    /// A whole picture file.
    Encoded {
        /// Its kind, such as `image/png`; empty where the model file does not say.
        mime: String,
        /// Its bytes.
        bytes: Vec<u8>,
    },
    /// Pixels.
    Pixels {
        /// Columns.
        width: u32,
        /// Red, green, blue and opacity, row by row from the top.
        rgba: Vec<[u8; 4]>,
    },
}

/// One authored polygon (planar or nearly so, convex or not).
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Polygon {
    /// Corner indices into the vertices, in loop order; the loop closes itself.
    pub corners: Vec<u32>,
    /// Texture coordinates per corner (u right, v up), same length as `corners`.
    pub texcoords: Option<Vec<[f32; 2]>>,
    /// Red, green and blue in 0..=1 per corner, same length as `corners`; they replace the material's diffuse colour.
    pub colours: Option<Vec<[f32; 3]>>,
    /// Unit normals for shading per corner, same length as `corners`; geometry takes [`Mesh::normal`].
    pub normals: Option<Vec<[f32; 3]>>,
    /// Index into the materials.
    pub material: Option<u32>,
    /// Index into the part names.
    pub part: u32,
    /// Authored name, if the format has one.
    pub name: Option<String>,
}

/// One explicit line segment, drawn by the author where no polygon edge is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Segment {
    /// End vertices.
    pub ends: [u32; 2],
    /// Index into the materials.
    pub material: Option<u32>,
    /// Index into the part names.
    pub part: u32,
}

/// A triangle of a polygon's triangulation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Triangle {
    /// Vertex indices.
    pub vertices: [u32; 3],
    /// The polygon it belongs to.
    pub polygon: u32,
    /// Position of the three vertices among the polygon's corners (for texture coordinates).
    pub corners: [u32; 3],
}

/// Unchecked contents of a [`Mesh`].
#[derive(Clone, Debug, Default)]
pub struct MeshData {
    /// Vertices, metres, object frame.
    pub vertices: Vec<Point3<f64>>,
    /// Polygons.
    pub polygons: Vec<Polygon>,
    /// Explicit lines.
    pub segments: Vec<Segment>,
    /// Materials.
    pub materials: Vec<Material>,
    /// Part names; empty means one unnamed part.
    pub parts: Vec<String>,
    /// Pictures that materials refer to.
    pub images: Vec<Image>,
    /// Skeleton and weights, where the file has them.
    pub skin: Option<Skin>,
}

/// Axis-aligned box, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoundingBox {
    /// Smallest coordinates.
    pub min: Point3<f64>,
    /// Largest coordinates.
    pub max: Point3<f64>,
}

impl BoundingBox {
    /// Length of the space diagonal, metres.
    #[must_use]
    pub fn diagonal(&self) -> f64 {
        (self.max - self.min).norm()
    }

    /// Middle of the box.
    #[must_use]
    pub fn center(&self) -> Point3<f64> {
        nalgebra::center(&self.min, &self.max)
    }
}

/// A checked, triangulated surface with explicit lines, in metres.
#[derive(Clone, Debug)]
pub struct Mesh {
    data: MeshData,
    triangles: Vec<Triangle>,
    normals: Vec<Option<Vector3<f64>>>,
    bounds: BoundingBox,
}

impl Mesh {
    /// Checks and triangulates.
    ///
    /// Polygons without area are kept in the list but have neither triangle nor normal.
    ///
    /// # Errors
    /// [`MeshError`] for an empty mesh, a non-finite vertex, an index out of range, a polygon of fewer than three
    /// corners, or texture coordinates, colours, normals or skin weights that do not match the corners or vertices.
    pub fn new(mut data: MeshData) -> Result<Self, MeshError> {
        if data.parts.is_empty() {
            data.parts.push(String::new());
        }
        error::check(&data)?;
        let mut triangles = Vec::with_capacity(data.polygons.len() * 2);
        let mut normals = Vec::with_capacity(data.polygons.len());
        let mut loop_points = Vec::new();
        for (index, polygon) in data.polygons.iter().enumerate() {
            loop_points.clear();
            loop_points.extend(polygon.corners.iter().map(|&c| data.vertices[c as usize]));
            normals.push(triangulation::unit_normal(&loop_points));
            for corners in triangulate(&loop_points) {
                triangles.push(Triangle {
                    vertices: corners.map(|c| polygon.corners[c as usize]),
                    polygon: index as u32,
                    corners,
                });
            }
        }
        let first = data.vertices[0];
        let bounds = data.vertices.iter().fold(BoundingBox { min: first, max: first }, |b, p| BoundingBox {
            min: b.min.inf(p),
            max: b.max.sup(p),
        });
        Ok(Self { data, triangles, normals, bounds })
    }

    /// Vertices, metres.
    #[must_use]
    pub fn vertices(&self) -> &[Point3<f64>] {
        &self.data.vertices
    }

    /// Polygons as authored.
    #[must_use]
    pub fn polygons(&self) -> &[Polygon] {
        &self.data.polygons
    }

    /// Triangulation, grouped by polygon in polygon order.
    #[must_use]
    pub fn triangles(&self) -> &[Triangle] {
        &self.triangles
    }

    /// Explicit lines.
    #[must_use]
    pub fn segments(&self) -> &[Segment] {
        &self.data.segments
    }

    /// Materials.
    #[must_use]
    pub fn materials(&self) -> &[Material] {
        &self.data.materials
    }

    /// The picture inside the model that a material's texture names; `None` where it names a file.
    #[must_use]
    pub fn image(&self, texture: &str) -> Option<&Image> {
        self.data.images.iter().find(|i| i.name == texture)
    }

    /// Pictures inside the model.
    #[must_use]
    pub fn images(&self) -> &[Image] {
        &self.data.images
    }

    /// Skeleton and weights, where the model has them.
    #[must_use]
    pub fn skin(&self) -> Option<&Skin> {
        self.data.skin.as_ref()
    }

    /// Names of the rigid parts.
    #[must_use]
    pub fn parts(&self) -> &[String] {
        &self.data.parts
    }

    /// Unit normal of a polygon by its winding; `None` without area or out of range.
    #[must_use]
    pub fn normal(&self, polygon: usize) -> Option<Vector3<f64>> {
        self.normals.get(polygon).copied().flatten()
    }

    /// Axis-aligned bounds of all vertices.
    #[must_use]
    pub fn bounds(&self) -> BoundingBox {
        self.bounds
    }

    /// Corner points of a triangle.
    #[must_use]
    pub fn corners(&self, triangle: &Triangle) -> [Point3<f64>; 3] {
        triangle.vertices.map(|v| self.data.vertices[v as usize])
    }

    /// Largest distance between two vertices, metres.
    ///
    /// Exact up to 2000 vertices; above that the farthest pair among the extremes of 74 directions, which is at
    /// most about 2 % too small.
    #[must_use]
    pub fn diameter(&self) -> f64 {
        let all = &self.data.vertices;
        let extremes: Vec<Point3<f64>>;
        let points = if all.len() <= 2000 {
            all
        } else {
            extremes = direction_extremes(all);
            &extremes
        };
        let mut best = 0.0_f64;
        for (i, a) in points.iter().enumerate() {
            for b in &points[i + 1..] {
                best = best.max((a - b).norm_squared());
            }
        }
        best.sqrt()
    }

    /// Takes the contents apart again, to edit and rebuild.
    #[must_use]
    pub fn into_data(self) -> MeshData {
        self.data
    }
}

/// Extreme points along the directions of a coarse integer half sphere.
fn direction_extremes(points: &[Point3<f64>]) -> Vec<Point3<f64>> {
    let mut out = Vec::new();
    for x in -2_i32..=2 {
        for y in -2_i32..=2 {
            for z in 0_i32..=2 {
                let d = Vector3::new(f64::from(x), f64::from(y), f64::from(z));
                if d.norm_squared() == 0.0 {
                    continue;
                }
                let (mut lo, mut hi) = (points[0], points[0]);
                for p in points {
                    let h = p.coords.dot(&d);
                    if h < lo.coords.dot(&d) {
                        lo = *p;
                    }
                    if h > hi.coords.dot(&d) {
                        hi = *p;
                    }
                }
                out.extend([lo, hi]);
            }
        }
    }
    out
}

#[cfg(test)]
mod tests;
