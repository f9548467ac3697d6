//! glTF 2.0, text and binary: the `gltf` crate parses and validates, we walk the scene and read the buffers.

use super::gltf_accessor::{Buffers, data_uri, decoded};
use super::unique::Unique;
use super::{LoadError, Loader, MAX_ELEMENTS, finish, read};
use crate::mesh::{Image, ImageContent, Joint, Material, Mesh, MeshData, Polygon, Segment, Unit};
use gltf::mesh::Mode;
use gltf::{Document, Gltf, Node, Primitive, Semantic};
use nalgebra::{Matrix4, Point3, Vector3};
use std::collections::HashMap;
use std::path::Path;

/// Reader of `.gltf` and `.glb` files.
///
/// Reads the meshes of the default scene under the transforms of their nodes: triangles and lines with texture
/// coordinates, normals, colours, base colours and their textures (files beside the model, or images inside it).
/// Each node with a mesh is a part. A skinned mesh takes the rest pose of its joints, and its [`Skin`](crate::mesh::Skin) is kept.
/// Morph targets, cameras, lights and animations are passed over. Identical vertices become one.
pub struct GltfLoader;

/// Extensions that may be required without changing what we read.
const KNOWN: [&str; 3] =
    ["KHR_materials_unlit", "KHR_materials_pbrSpecularGlossiness", "KHR_lights_punctual"];
/// Deepest nesting of nodes, against cycles.
const MAX_DEPTH: usize = 256;
/// Most nodes visited, against graphs whose references multiply.
const MAX_VISITS: usize = 1_000_000;

impl Loader for GltfLoader {
    fn extensions(&self) -> &'static [&'static str] {
        &["gltf", "glb"]
    }

    fn recognizes(&self, head: &[u8]) -> bool {
        head.starts_with(b"glTF")
    }

    fn load(&self, path: &Path, unit: Unit) -> Result<Mesh, LoadError> {
        let bytes = read(path)?;
        let wrong = |e: gltf::Error| LoadError::Element {
            file: path.to_owned(),
            element: "glTF".into(),
            found: e.to_string(),
            expected: "glTF 2.0 as its specification describes".into(),
        };
        // The validation would call an extension that is not supported simply invalid.
        let loose = Gltf::from_slice_without_validation(&bytes).map_err(wrong)?;
        if let Some(extension) = loose.extensions_required().find(|e| !KNOWN.contains(e)) {
            return Err(LoadError::Extension {
                file: path.to_owned(),
                extension: extension.to_owned(),
                known: KNOWN.join(", "),
            });
        }
        let json = loose.as_json();
        if !json.asset.version.starts_with("2.") {
            return Err(LoadError::Element {
                file: path.to_owned(),
                element: "asset".into(),
                found: format!("version `{}`", json.asset.version.chars().take(20).collect::<String>()),
                expected: "version 2.0".into(),
            });
        }
        // The validation takes for granted that these accessors exist.
        let attributes = json.meshes.iter().flat_map(|m| &m.primitives).flat_map(|p| p.attributes.values());
        if let Some(bad) = attributes.map(|a| a.value()).find(|a| *a >= json.accessors.len()) {
            return Err(LoadError::Element {
                file: path.to_owned(),
                element: "mesh".into(),
                found: format!("accessor {bad}"),
                expected: format!("an accessor below {}", json.accessors.len()),
            });
        }
        let Gltf { document, blob } = Gltf::from_slice(&bytes).map_err(wrong)?;
        let buffers = Buffers::load(path, &document, blob)?;
        let mut reading = Reading::new(path, &document, buffers)?;
        reading.walk()?;
        let mut data = reading.data;
        data.vertices = reading.unique.vertices;
        if let Some(skin) = &mut data.skin {
            skin.weights = reading.weights;
        }
        finish(data, path, unit)
    }
}

struct Reading<'a> {
    path: &'a Path,
    document: &'a Document,
    buffers: Buffers<'a>,
    data: MeshData,
    unique: Unique,
    /// Weights of each unique vertex.
    weights: Vec<[(u32, f64); 4]>,
    /// Frame and parent of each node that the scene reaches.
    nodes: Vec<Option<(Matrix4<f64>, Option<usize>)>>,
    /// First joint of each skin that is used.
    skins: Vec<Option<u32>>,
    visits: usize,
}

/// Joints of a skin as a mesh refers to them.
struct Bones {
    first: u32,
    /// Maps file vertices to the rest pose, per joint.
    object_from_file: Vec<Matrix4<f64>>,
}

impl<'a> Reading<'a> {
    fn new(path: &'a Path, document: &'a Document, buffers: Buffers<'a>) -> Result<Self, LoadError> {
        let mut reading = Self {
            path,
            document,
            buffers,
            data: MeshData::default(),
            unique: Unique::default(),
            weights: Vec::new(),
            nodes: vec![None; document.nodes().len()],
            skins: vec![None; document.skins().len()],
            visits: 0,
        };
        for material in document.materials() {
            let base = material.pbr_metallic_roughness();
            let [r, g, b, _] = base.base_color_factor();
            let texture = base.base_color_texture();
            let texture = texture.map(|t| reading.texture(t.texture().source().index())).transpose()?;
            let name = material.name().unwrap_or_default().to_owned();
            reading.data.materials.push(Material { name, diffuse: [r, g, b], texture });
        }
        Ok(reading)
    }

    fn wrong(&self, element: String, found: impl Into<String>, expected: impl Into<String>) -> LoadError {
        LoadError::Element {
            file: self.path.to_owned(),
            element,
            found: found.into(),
            expected: expected.into(),
        }
    }

    /// Name of an image, which is taken in where it lies inside the model.
    fn texture(&mut self, index: usize) -> Result<String, LoadError> {
        let element = || format!("image {index}");
        let Some(image) = self.document.as_json().images.get(index) else {
            return Err(self.wrong(element(), "none", "an image"));
        };
        let mime = image.mime_type.as_ref().map(|m| m.0.clone()).unwrap_or_default();
        let (mime, bytes) = match (&image.uri, image.buffer_view) {
            (Some(uri), _) => match data_uri(uri) {
                None => return Ok(decoded(uri)),
                Some(Ok(image)) => image,
                Some(Err(e)) => return Err(self.wrong(element(), e.to_string(), "base64")),
            },
            (None, Some(view)) => {
                let view = self.document.views().nth(view.value());
                let bytes = view.and_then(|v| self.buffers.view(&v));
                let Some(bytes) = bytes else {
                    return Err(self.wrong(element(), "a view beyond its buffer", "bytes of an image"));
                };
                (mime, bytes.to_vec())
            }
            (None, None) => return Err(self.wrong(element(), "nothing", "a uri or a bufferView")),
        };
        let name = format!("#image{index}");
        if self.data.images.iter().all(|i| i.name != name) {
            self.data
                .images
                .push(Image { name: name.clone(), content: ImageContent::Encoded { mime, bytes } });
        }
        Ok(name)
    }

    /// Frames of all nodes first, since joints may come after the meshes that hang on them; then the meshes.
    fn walk(&mut self) -> Result<(), LoadError> {
        let document = self.document;
        let scene = document.default_scene().or_else(|| document.scenes().next());
        let roots: Vec<Node> = match scene {
            Some(scene) => scene.nodes().collect(),
            None => {
                let mut child = vec![false; document.nodes().len()];
                for c in document.nodes().flat_map(|n| n.children().collect::<Vec<_>>()) {
                    child.iter_mut().skip(c.index()).take(1).for_each(|c| *c = true);
                }
                document.nodes().filter(|n| child.get(n.index()) == Some(&false)).collect()
            }
        };
        let mut order = Vec::new();
        for root in roots {
            self.frame(&root, None, &Matrix4::identity(), 0, &mut order)?;
        }
        for (node, object_from_node) in order {
            self.mesh(&node, &object_from_node)?;
        }
        Ok(())
    }

    fn frame(
        &mut self,
        node: &Node<'a>,
        parent: Option<usize>,
        object_from_parent: &Matrix4<f64>,
        depth: usize,
        order: &mut Vec<(Node<'a>, Matrix4<f64>)>,
    ) -> Result<(), LoadError> {
        self.visits += 1;
        if depth > MAX_DEPTH || self.visits > MAX_VISITS {
            let found = format!("nesting {depth} at visit {}", self.visits);
            let expected = format!("a tree within {MAX_DEPTH} levels and {MAX_VISITS} nodes");
            return Err(self.wrong(format!("node {}", node.index()), found, expected));
        }
        let local = Matrix4::from(node.transform().matrix()).cast::<f64>();
        let object_from_node = object_from_parent * local;
        if let Some(slot) = self.nodes.get_mut(node.index()) {
            *slot = Some((object_from_node, parent));
        }
        if node.mesh().is_some() {
            order.push((node.clone(), object_from_node));
        }
        node.children()
            .try_for_each(|child| self.frame(&child, Some(node.index()), &object_from_node, depth + 1, order))
    }

    fn mesh(&mut self, node: &Node<'a>, object_from_node: &Matrix4<f64>) -> Result<(), LoadError> {
        let Some(mesh) = node.mesh() else { return Ok(()) };
        let part = self.data.parts.len() as u32;
        self.data.parts.push(node.name().or(mesh.name()).unwrap_or_default().to_owned());
        let bones = node.skin().map(|skin| self.bones(&skin)).transpose()?;
        for primitive in mesh.primitives() {
            self.primitive(&primitive, part, object_from_node, bones.as_ref())?;
        }
        Ok(())
    }

    /// Takes in the joints of a skin, once.
    fn bones(&mut self, skin: &gltf::Skin<'a>) -> Result<Bones, LoadError> {
        let element = || format!("skin {}", skin.index());
        let joints: Vec<Node> = skin.joints().collect();
        let inverse: Vec<Matrix4<f64>> = match skin.inverse_bind_matrices() {
            None => vec![Matrix4::identity(); joints.len()],
            Some(accessor) => {
                let flat = self.buffers.numbers(&accessor, &[16], &element())?;
                flat.chunks_exact(16).map(Matrix4::from_column_slice).collect()
            }
        };
        let mut frames = Vec::with_capacity(joints.len());
        for joint in &joints {
            let Some((frame, _)) = self.nodes.get(joint.index()).copied().flatten() else {
                return Err(self.wrong(
                    element(),
                    format!("joint node {}", joint.index()),
                    "a node of the scene",
                ));
            };
            frames.push(frame);
        }
        if inverse.len() < frames.len() {
            let found = format!("{} inverse bind matrices", inverse.len());
            return Err(self.wrong(element(), found, format!("those of {} joints", frames.len())));
        }
        let object_from_file = frames.iter().zip(&inverse).map(|(frame, inverse)| frame * inverse).collect();
        let known = self.skins.get(skin.index()).copied().flatten();
        let first = match known {
            Some(first) => first,
            None => {
                let mut all = self.data.skin.take().unwrap_or_default();
                let first = all.joints.len() as u32;
                let places: HashMap<usize, u32> = joints.iter().map(Node::index).zip(0..).collect();
                for (joint, frame) in joints.iter().zip(&frames) {
                    let Some(joint_from_object) = frame.try_inverse() else {
                        let found = format!("joint node {} without an inverse", joint.index());
                        return Err(self.wrong(element(), found, "a transform other than zero"));
                    };
                    let parent = self.parent_joint(joint.index(), &places).map(|p| first + p);
                    let name = joint.name().unwrap_or_default().to_owned();
                    all.joints.push(Joint { name, parent, object_from_joint: *frame, joint_from_object });
                }
                self.data.skin = Some(all);
                if let Some(slot) = self.skins.get_mut(skin.index()) {
                    *slot = Some(first);
                }
                first
            }
        };
        Ok(Bones { first, object_from_file })
    }

    /// The nearest ancestor of a node that is a joint, too.
    fn parent_joint(&self, node: usize, joints: &HashMap<usize, u32>) -> Option<u32> {
        let mut at = node;
        for _ in 0..MAX_DEPTH {
            at = self.nodes.get(at)?.as_ref()?.1?;
            if let Some(k) = joints.get(&at) {
                return Some(*k);
            }
        }
        None
    }

    fn primitive(
        &mut self,
        primitive: &Primitive<'a>,
        part: u32,
        object_from_node: &Matrix4<f64>,
        bones: Option<&Bones>,
    ) -> Result<(), LoadError> {
        let element = format!("part {part}, primitive {}", primitive.index());
        let read = |semantic: Semantic, sizes: &[usize], buffers: &Buffers| {
            let accessor = primitive.get(&semantic);
            accessor
                .map(|a| Ok((a.dimensions().multiplicity(), buffers.numbers(&a, sizes, &element)?)))
                .transpose()
        };
        let Some((_, flat)) = read(Semantic::Positions, &[3], &self.buffers)? else { return Ok(()) };
        let mut positions: Vec<Point3<f64>> = flat.chunks_exact(3).map(Point3::from_slice).collect();
        let mut normals = read(Semantic::Normals, &[3], &self.buffers)?.map(|n| n.1);
        let material = primitive.material();
        let texture = material.pbr_metallic_roughness().base_color_texture();
        let set = texture.map_or(0, |t| t.tex_coord());
        let texcoords = read(Semantic::TexCoords(set), &[2], &self.buffers)?.map(|t| t.1);
        let colours = read(Semantic::Colors(0), &[3, 4], &self.buffers)?;
        let joints = read(Semantic::Joints(0), &[4], &self.buffers)?.map(|j| j.1);
        let weights = read(Semantic::Weights(0), &[4], &self.buffers)?.map(|w| w.1);
        let mut influences = vec![[(0, 0.0); 4]; positions.len()];
        for (k, position) in positions.iter_mut().enumerate() {
            let mut object_from_file = *object_from_node;
            if let (Some(bones), Some(joints), Some(weights)) = (bones, &joints, &weights) {
                let four = |v: &[f64]| v.get(4 * k..4 * k + 4).map(|v| [v[0], v[1], v[2], v[3]]);
                let (Some(j), Some(w)) = (four(joints), four(weights)) else { continue };
                let sum: f64 = w.iter().sum();
                if sum > 0.0 {
                    object_from_file = Matrix4::zeros();
                    for i in 0..4 {
                        let Some(frame) = bones.object_from_file.get(j[i] as usize).filter(|_| j[i] >= 0.0)
                        else {
                            let expected = format!("a joint below {}", bones.object_from_file.len());
                            return Err(self.wrong(element, format!("joint {}", j[i]), expected));
                        };
                        object_from_file += frame * (w[i] / sum);
                        influences[k][i] = (bones.first + j[i] as u32, w[i] / sum);
                    }
                }
            }
            *position = object_from_file.transform_point(position);
            if let Some(normal) = normals.as_mut().and_then(|n| n.get_mut(3 * k..3 * k + 3)) {
                // Normals go by the inverse transpose; without one the transform is flat and so is the shading.
                let n = Vector3::from_column_slice(normal);
                let linear = object_from_file.fixed_view::<3, 3>(0, 0).into_owned();
                let turned = linear.try_inverse().map_or(n, |i| i.transpose() * n);
                let unit = turned.try_normalize(0.0).unwrap_or_else(Vector3::zeros);
                normal.copy_from_slice(unit.as_slice());
            }
        }
        let indices = match primitive.indices() {
            Some(accessor) => self.buffers.numbers(&accessor, &[1], &element)?,
            None => (0..positions.len()).map(|i| i as f64).collect(),
        };
        if let Some(bad) = indices.iter().find(|i| **i as usize >= positions.len()) {
            return Err(self.wrong(
                element,
                format!("index {bad}"),
                format!("indices below {}", positions.len()),
            ));
        }
        let indices: Vec<usize> = indices.into_iter().map(|i| i as usize).collect();
        let ids: Vec<u32> = positions.iter().map(|p| self.unique.id(p)).collect();
        self.weights.resize(self.unique.vertices.len(), [(0, 0.0); 4]);
        for (id, influence) in ids.iter().zip(&influences) {
            self.weights[*id as usize] = *influence;
        }
        let material = material.index().map(|m| m as u32);
        let elements = self.data.polygons.len() + self.data.segments.len() + indices.len();
        if elements > MAX_ELEMENTS {
            let expected = format!("at most {MAX_ELEMENTS} triangles and lines");
            return Err(self.wrong(element, format!("up to {elements} with this primitive"), expected));
        }
        let lines = |ends: [usize; 2]| Segment { ends: ends.map(|i| ids[i]), material, part };
        let at = |k: usize| indices[k];
        let n = indices.len();
        let triangles: Vec<[usize; 3]> =
            match primitive.mode() {
                Mode::Points => Vec::new(),
                Mode::Lines => {
                    self.data.segments.extend(indices.chunks_exact(2).map(|c| lines([c[0], c[1]])));
                    Vec::new()
                }
                mode @ (Mode::LineStrip | Mode::LineLoop) => {
                    self.data.segments.extend(indices.windows(2).map(|c| lines([c[0], c[1]])));
                    if mode == Mode::LineLoop && n > 2 {
                        self.data.segments.push(lines([at(n - 1), at(0)]));
                    }
                    Vec::new()
                }
                Mode::Triangles => indices.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect(),
                Mode::TriangleStrip => (2..n)
                    .map(|k| {
                        if k % 2 == 0 { [at(k - 2), at(k - 1), at(k)] } else { [at(k - 1), at(k - 2), at(k)] }
                    })
                    .collect(),
                Mode::TriangleFan => (2..n).map(|k| [at(0), at(k - 1), at(k)]).collect(),
            };
        // A transform that mirrors turns the winding round.
        let mirrored = object_from_node.fixed_view::<3, 3>(0, 0).determinant() < 0.0 && bones.is_none();
        let pick = |values: &Option<Vec<f64>>, stride: usize, k: usize| {
            let range = stride * k..stride * k + stride;
            values
                .as_ref()
                .and_then(|v| v.get(range))
                .map(|v| v.iter().map(|x| *x as f32).collect::<Vec<_>>())
        };
        let (channels, colours) = colours.map_or((3, None), |(n, c)| (n, Some(c)));
        self.data.polygons.extend(triangles.into_iter().map(|mut c| {
            if mirrored {
                c.swap(1, 2);
            }
            let three = |values: &Option<Vec<f64>>, stride| {
                c.iter().map(|&k| pick(values, stride, k).map(|v| [v[0], v[1], v[2]])).collect()
            };
            Polygon {
                corners: c.iter().map(|&k| ids[k]).collect(),
                // glTF counts v downwards.
                texcoords: c.iter().map(|&k| pick(&texcoords, 2, k).map(|t| [t[0], 1.0 - t[1]])).collect(),
                colours: three(&colours, channels),
                normals: three(&normals, 3),
                material,
                part,
                name: None,
            }
        }));
        Ok(())
    }
}
