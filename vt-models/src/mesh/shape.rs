use super::{Mesh, MeshData, MeshError};
use nalgebra::Vector3;
use vt_core::lie::SE3;

/// One rigid part of a shape.
#[derive(Clone, Debug)]
pub struct Part {
    /// Name, shown in reports.
    pub name: String,
    /// Its surface, in the part frame.
    pub mesh: Mesh,
    /// Maps part coordinates into the object frame.
    pub object_from_part: SE3,
}

/// Rigid shape made of named parts (for instance an assembly whose files are separate).
#[derive(Clone, Debug, Default)]
pub struct Shape {
    /// Parts in order; their position is the part id of the flattened mesh.
    pub parts: Vec<Part>,
}

impl Shape {
    /// Adds a part.
    #[must_use]
    pub fn with(mut self, name: &str, mesh: Mesh, object_from_part: SE3) -> Self {
        self.parts.push(Part { name: name.to_owned(), mesh, object_from_part });
        self
    }

    /// One mesh in the object frame; polygons and lines carry the part's position as part id. Images of a part take
    /// its number into their names; shading normals are turned along; skins stay behind, since the whole is rigid.
    ///
    /// # Errors
    /// [`MeshError::Empty`] without parts; [`MeshError::NotFinite`] where a transform is not finite.
    pub fn flatten(&self) -> Result<Mesh, MeshError> {
        let mut all = MeshData::default();
        for (id, part) in self.parts.iter().enumerate() {
            let (vertex, material) = (all.vertices.len() as u32, all.materials.len() as u32);
            let id = id as u32;
            all.parts.push(part.name.clone());
            all.vertices.extend(part.mesh.vertices().iter().map(|p| part.object_from_part.act(p)));
            let named = |image: &str| format!("{id}/{image}");
            all.materials.extend(part.mesh.materials().iter().cloned().map(|mut m| {
                m.texture = m.texture.map(|t| if part.mesh.image(&t).is_some() { named(&t) } else { t });
                m
            }));
            all.images.extend(part.mesh.images().iter().cloned().map(|mut i| {
                i.name = named(&i.name);
                i
            }));
            all.polygons.extend(part.mesh.polygons().iter().cloned().map(|mut p| {
                p.corners.iter_mut().for_each(|c| *c += vertex);
                p.material = p.material.map(|m| m + material);
                p.part = id;
                for normal in p.normals.iter_mut().flatten() {
                    let n = Vector3::from(normal.map(f64::from));
                    *normal = (part.object_from_part.rotation * n).cast::<f32>().into();
                }
                p
            }));
            all.segments.extend(part.mesh.segments().iter().map(|s| super::Segment {
                ends: s.ends.map(|e| e + vertex),
                material: s.material.map(|m| m + material),
                part: id,
            }));
        }
        Mesh::new(all)
    }
}
