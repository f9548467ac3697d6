//! VRML97 (ISO/IEC 14772-1): the `vrml97` crate parses, we walk the scene graph and compose the transforms.

use super::vrml_geometry::Geometry;
use super::vrml_text::{MAX_NESTING, decode, parse};
use super::{LoadError, Loader, MAX_ELEMENTS, finish};
use crate::mesh::{ImageContent, Material, Mesh, MeshData, Unit};
use nalgebra::{
    Affine3, Matrix4, Rotation2, Rotation3, Scale3, Translation3, Unit as Direction, Vector2, Vector3,
};
use std::path::Path;
use vrml97::Scene;
use vrml97::fields::{FieldValue, Image, NodeId};

/// Reader of `.wrl` files, plain or gzip-compressed.
///
/// Reads Transform, Group, Anchor, Billboard, Collision, Switch (the chosen child), LOD (the finest level), DEF/USE
/// and Shape with IndexedFaceSet, IndexedLineSet, ElevationGrid, Extrusion, Box, Cone, Cylinder and Sphere. Each
/// Shape is a part, named by its DEF name. Colours and normals per vertex or face, `creaseAngle`, texture coordinates,
/// ImageTexture, PixelTexture and TextureTransform are read; primitives and extrusions take the texture coordinates of
/// a face set without any. `Inline` files are followed when they lie in the file system. Lights, viewpoints and the
/// like are passed over; prototypes are not followed.
pub struct VrmlLoader;

/// Deepest chain of included files.
const MAX_INLINES: usize = 16;
/// Most scene-graph visits, against files whose USEs multiply.
const MAX_VISITS: usize = 1_000_000;

impl Loader for VrmlLoader {
    fn extensions(&self) -> &'static [&'static str] {
        &["wrl", "vrml"]
    }

    fn recognizes(&self, head: &[u8]) -> bool {
        head.starts_with(b"#VRML V2.0")
    }

    fn load(&self, path: &Path, unit: Unit) -> Result<Mesh, LoadError> {
        let text = decode(path)?;
        let scene = parse(path, &text)?;
        let data = MeshData::default();
        let mut walk = Walk { scene: &scene, file: path, data, visits: 0, elements: 0, inlines: 0 };
        walk.roots(&Affine3::identity())?;
        // What the parser passes over is told when nothing is left.
        if let (true, true, Some(warning)) =
            (walk.data.polygons.is_empty(), walk.data.segments.is_empty(), scene.warnings.first())
        {
            return Err(LoadError::Element {
                file: path.to_owned(),
                element: "scene without shape".into(),
                found: warning.clone(),
                expected: "nodes of VRML97".into(),
            });
        }
        finish(walk.data, path, unit)
    }
}

/// Typed access to a node's fields; a missing or unexpected field reads as its VRML default.
#[derive(Clone, Copy)]
pub(super) struct Fields<'a> {
    scene: &'a Scene,
    id: NodeId,
}

impl<'a> Fields<'a> {
    fn value(&self, name: &str) -> Option<&'a FieldValue> {
        let i = self.scene.get_predefined_field(self.id, name)?;
        Some(&self.scene.node(self.id).fields[i].value)
    }

    pub fn child(&self, name: &str) -> Option<Self> {
        match self.value(name)? {
            FieldValue::SFNode(id) => id.map(|id| Self { scene: self.scene, id }),
            _ => None,
        }
    }

    fn children(&self, name: &str) -> &'a [Option<NodeId>] {
        match self.value(name) {
            Some(FieldValue::MFNode(v)) => v,
            _ => &[],
        }
    }

    pub fn type_name(&self) -> String {
        self.scene.type_name(self.id)
    }

    pub fn name(&self) -> &'a str {
        &self.scene.node(self.id).name
    }

    pub fn flag(&self, name: &str) -> Option<bool> {
        match self.value(name)? {
            FieldValue::SFBool(b) => Some(*b),
            _ => None,
        }
    }

    pub fn integer(&self, name: &str) -> Option<i32> {
        match self.value(name)? {
            FieldValue::SFInt32(i) => Some(*i),
            _ => None,
        }
    }

    pub fn number(&self, name: &str) -> Option<f64> {
        match self.value(name)? {
            FieldValue::SFFloat(x) | FieldValue::SFDouble(x) => Some(*x),
            _ => None,
        }
    }

    pub fn vector(&self, name: &str) -> Option<Vector3<f64>> {
        match self.value(name)? {
            FieldValue::SFVec3f(v) => Some(Vector3::new(v.x, v.y, v.z)),
            _ => None,
        }
    }

    pub fn integers(&self, name: &str) -> &'a [i32] {
        match self.value(name) {
            Some(FieldValue::MFInt32(v)) => v,
            _ => &[],
        }
    }

    pub fn floats(&self, name: &str) -> Vec<f64> {
        match self.value(name) {
            Some(
                FieldValue::MFVec3f(v)
                | FieldValue::MFVec2f(v)
                | FieldValue::MFFloat(v)
                | FieldValue::MFColor(v),
            ) => v.iter().map(|&x| decimal(x)).collect(),
            Some(FieldValue::MFRotation(v) | FieldValue::MFVec3d(v)) => v.clone(),
            _ => Vec::new(),
        }
    }

    fn rotation(&self, name: &str) -> Option<Rotation3<f64>> {
        match self.value(name)? {
            FieldValue::SFRotation(r) => {
                let [x, y, z, angle] = r.raw();
                Some(axis_angle(x, y, z, angle))
            }
            _ => None,
        }
    }
}

/// Rotation about an axis, which VRML does not promise to be of unit length; a zero axis is no rotation.
pub(super) fn axis_angle(x: f64, y: f64, z: f64, angle: f64) -> Rotation3<f64> {
    Direction::try_new(Vector3::new(x, y, z), 1e-12)
        .map_or_else(Rotation3::identity, |axis| Rotation3::from_axis_angle(&axis, angle))
}

/// The shortest decimal number that reads as this f32, so that authored 0.084 stays 0.084.
fn decimal(x: f32) -> f64 {
    x.to_string().parse().unwrap_or(f64::from(x))
}

struct Walk<'a> {
    scene: &'a Scene,
    file: &'a Path,
    data: MeshData,
    visits: usize,
    /// Points, polygons, lines and what they have, over all shapes shown.
    elements: usize,
    /// Files that include this one.
    inlines: usize,
}

impl Walk<'_> {
    fn roots(&mut self, object_from_scene: &Affine3<f64>) -> Result<(), LoadError> {
        let scene = self.scene;
        let mut roots = scene.ctx(vrml97::scene::ROOT).root_nodes.iter().flatten();
        roots.try_for_each(|root| self.node(*root, object_from_scene, 0))
    }

    fn node(&mut self, id: NodeId, object_from_node: &Affine3<f64>, depth: usize) -> Result<(), LoadError> {
        let fields = Fields { scene: self.scene, id };
        self.visits += 1;
        if depth > MAX_NESTING || self.visits > MAX_VISITS {
            let found = format!("nesting {depth} at visit {}", self.visits);
            return Err(self.error(
                fields,
                found,
                format!("a scene within {MAX_NESTING} levels and {MAX_VISITS} nodes"),
            ));
        }
        match fields.type_name().as_str() {
            "Transform" => {
                let object_from_child = object_from_node * transform(fields);
                self.all(fields.children("children"), &object_from_child, depth)
            }
            "Group" | "Anchor" | "Billboard" | "Collision" | "StaticGroup" => {
                self.all(fields.children("children"), object_from_node, depth)
            }
            "LOD" => {
                self.all(fields.children("children").get(..1).unwrap_or_default(), object_from_node, depth)
            }
            "Switch" => {
                let children = fields.children("children");
                let which = fields.integer("whichChoice").and_then(|w| usize::try_from(w).ok());
                match which.and_then(|w| children.get(w)) {
                    Some(child) => self.all(std::slice::from_ref(child), object_from_node, depth),
                    None => Ok(()),
                }
            }
            "Inline" => self.inline(fields, object_from_node),
            "Shape" => self.shape(fields, object_from_node),
            _ => Ok(()),
        }
    }

    fn all(&mut self, ids: &[Option<NodeId>], frame: &Affine3<f64>, depth: usize) -> Result<(), LoadError> {
        ids.iter().flatten().try_for_each(|&id| self.node(id, frame, depth + 1))
    }

    fn shape(&mut self, shape: Fields, object_from_node: &Affine3<f64>) -> Result<(), LoadError> {
        let Some(node) = shape.child("geometry") else { return Ok(()) };
        let Some(mut geometry) =
            Geometry::read(node).map_err(|(found, expected)| self.error(node, found, expected))?
        else {
            return Ok(());
        };
        self.elements += geometry.elements;
        if self.elements > MAX_ELEMENTS {
            let expected = format!("at most {MAX_ELEMENTS} points, polygons and lines");
            return Err(self.error(node, format!("{} with this shape", self.elements), expected));
        }
        let appearance = shape.child("appearance");
        let material = appearance.map(|appearance| self.material(appearance, &mut geometry));
        let part = self.data.parts.len() as u32;
        let name = if shape.name().is_empty() { node.name() } else { shape.name() };
        self.data.parts.push(name.to_owned());
        geometry.append(&mut self.data, object_from_node, material, part);
        Ok(())
    }

    /// Index of the material of an appearance; its texture transform is applied to the geometry.
    fn material(&mut self, appearance: Fields, geometry: &mut Geometry) -> u32 {
        let material = appearance.child("material");
        let diffuse = material.and_then(|m| match m.value("diffuseColor")? {
            FieldValue::SFColor(c) => Some([c.r() as f32, c.g() as f32, c.b() as f32]),
            _ => None,
        });
        let texture = appearance.child("texture").and_then(|t| match (t.value("url"), t.value("image")) {
            (Some(FieldValue::MFString(urls)), _) => urls.first().cloned(),
            (_, Some(FieldValue::SFImage(image))) => self.pixels(t.id, image),
            _ => None,
        });
        if texture.is_some() {
            geometry.map_texture();
            if let Some(transform) = appearance.child("textureTransform") {
                geometry.transform_texture(texture_transform(transform));
            }
        }
        // 0.8 grey is the standard's default; without a Material node objects are unlit white.
        let default = if material.is_some() { [0.8; 3] } else { [1.0; 3] };
        let name = material.filter(|m| !m.name().is_empty()).unwrap_or(appearance).name().to_owned();
        let material = Material { name, diffuse: diffuse.unwrap_or(default), texture };
        let known = self.data.materials.iter().position(|k| *k == material);
        known.unwrap_or_else(|| {
            self.data.materials.push(material);
            self.data.materials.len() - 1
        }) as u32
    }

    /// Name of the pixels of a PixelTexture (6.33), which are taken in; `None` for an image without components.
    fn pixels(&mut self, id: NodeId, image: &Image) -> Option<String> {
        let name = format!("#pixels{id:?}");
        if self.data.images.iter().any(|i| i.name == name) {
            return Some(name);
        }
        let (width, height) = (u32::try_from(image.width).ok()?, u32::try_from(image.height).ok()?);
        let byte = |v: i32, shift: u32| (v >> shift) as u8;
        let rgba = |v: &i32| match image.comp {
            1 => [byte(*v, 0), byte(*v, 0), byte(*v, 0), 255],
            2 => [byte(*v, 8), byte(*v, 8), byte(*v, 8), byte(*v, 0)],
            3 => [byte(*v, 16), byte(*v, 8), byte(*v, 0), 255],
            _ => [byte(*v, 24), byte(*v, 16), byte(*v, 8), byte(*v, 0)],
        };
        let complete = image.array.len() as u64 == u64::from(width) * u64::from(height);
        if !complete || image.array.is_empty() || image.comp < 1 {
            return None;
        }
        // The file begins with the bottom row.
        let rows = image.array.chunks_exact(width as usize).rev();
        let rgba = rows.flatten().map(rgba).collect();
        self.data
            .images
            .push(crate::mesh::Image { name: name.clone(), content: ImageContent::Pixels { width, rgba } });
        Some(name)
    }

    /// The first file of an Inline node that lies beside this one; addresses of networks are passed over.
    fn inline(&mut self, fields: Fields, object_from_node: &Affine3<f64>) -> Result<(), LoadError> {
        let Some(FieldValue::MFString(urls)) = fields.value("url") else { return Ok(()) };
        let Some(url) = urls.iter().find(|u| !u.contains("://")) else { return Ok(()) };
        let file = self.file.parent().unwrap_or(Path::new("")).join(url);
        if self.inlines >= MAX_INLINES {
            let found = format!("`{url}` at depth {MAX_INLINES}");
            return Err(self.error(fields, found, "files that do not include each other in a circle"));
        }
        let text = decode(&file)?;
        let scene = parse(&file, &text)?;
        let data = std::mem::take(&mut self.data);
        let (elements, inlines) = (self.elements, self.inlines + 1);
        // A file costs as much as the nodes that it might have.
        let visits = self.visits + 100 + text.len() / 100;
        let mut walk = Walk { scene: &scene, file: &file, data, visits, elements, inlines };
        let walked = walk.roots(object_from_node);
        (self.data, self.visits, self.elements) = (walk.data, walk.visits, walk.elements);
        walked
    }

    fn error(&self, node: Fields, found: impl Into<String>, expected: impl Into<String>) -> LoadError {
        let name = if node.name().is_empty() { "without a DEF name" } else { node.name() };
        let element = format!("{} {name} (shape {})", node.type_name(), self.data.parts.len());
        LoadError::Element {
            file: self.file.to_owned(),
            element,
            found: found.into(),
            expected: expected.into(),
        }
    }
}

/// `−C S R C T` on texture coordinates (6.49).
fn texture_transform(fields: Fields) -> impl Fn([f32; 2]) -> [f32; 2] {
    let pair = |name| match fields.value(name) {
        Some(FieldValue::SFVec2f(v)) => Some(Vector2::new(v.x, v.y)),
        _ => None,
    };
    let center = pair("center").unwrap_or_default();
    let scale = pair("scale").unwrap_or_else(|| Vector2::repeat(1.0));
    let translation = pair("translation").unwrap_or_default();
    let rotation = Rotation2::new(fields.number("rotation").unwrap_or(0.0));
    move |t| {
        let moved = Vector2::from(t.map(f64::from)) + translation + center;
        ((rotation * moved).component_mul(&scale) - center).cast::<f32>().into()
    }
}

/// `T C R SR S SR⁻¹ C⁻¹` (ISO/IEC 14772-1, 6.52).
fn transform(fields: Fields) -> Affine3<f64> {
    let translation = fields.vector("translation").unwrap_or_default();
    let center = fields.vector("center").unwrap_or_default();
    let scale = fields.vector("scale").unwrap_or_else(|| Vector3::repeat(1.0));
    let rotation = fields.rotation("rotation").unwrap_or_else(Rotation3::identity).to_homogeneous();
    let orientation =
        fields.rotation("scaleOrientation").unwrap_or_else(Rotation3::identity).to_homogeneous();
    let matrix: Matrix4<f64> = Translation3::from(translation + center).to_homogeneous()
        * rotation
        * orientation
        * Scale3::from(scale).to_homogeneous()
        * orientation.transpose()
        * Translation3::from(-center).to_homogeneous();
    Affine3::from_matrix_unchecked(matrix)
}
