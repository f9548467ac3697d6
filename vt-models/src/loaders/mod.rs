//! Model files to [`Mesh`]: VRML97, Wavefront OBJ, PLY, STL, glTF and ViSP CAO, behind one trait.

mod cao;
mod error;
mod gltf;
mod gltf_accessor;
mod obj;
mod ply;
mod primitives;
mod stl;
mod unique;
mod vrml;
mod vrml_geometry;
mod vrml_text;

pub use cao::CaoLoader;
pub use error::LoadError;
pub use gltf::GltfLoader;
pub use obj::ObjLoader;
pub use ply::PlyLoader;
pub use stl::StlLoader;
pub use vrml::VrmlLoader;

use crate::mesh::{Mesh, MeshData, MeshError, Unit};
use std::io::Read;
use std::path::Path;
use vt_core::file::MOST;

/// Reader of one file format.
pub trait Loader: Sync {
    /// File name extensions, lower case, without the dot.
    fn extensions(&self) -> &'static [&'static str];

    /// Whether the first bytes of a file (up to 1024) can be of this format only.
    fn recognizes(&self, head: &[u8]) -> bool {
        let _ = head;
        false
    }

    /// Reads a file whose lengths are in `unit`; the mesh is in metres.
    ///
    /// # Errors
    /// [`LoadError`] where the file cannot be read, is not of the format, or its content is no mesh.
    fn load(&self, path: &Path, unit: Unit) -> Result<Mesh, LoadError>;
}

/// The formats [`load_mesh`] knows; a new format is one more line here.
pub static LOADERS: &[&dyn Loader] =
    &[&VrmlLoader, &ObjLoader, &CaoLoader, &PlyLoader, &StlLoader, &GltfLoader];

/// Most points, polygons and lines together of a file whose references multiply.
const MAX_ELEMENTS: usize = 4_000_000;

/// Reads a model file. What its first bytes say about its format counts more than the file name extension.
///
/// # Errors
/// [`LoadError::UnknownExtension`] lists the known extensions; otherwise the chosen loader's error.
pub fn load_mesh(path: impl AsRef<Path>, unit: Unit) -> Result<Mesh, LoadError> {
    loader(path.as_ref())?.load(path.as_ref(), unit)
}

/// The loader for a file, as [`load_mesh`] chooses it.
///
/// # Errors
/// [`LoadError::UnknownExtension`] where neither content nor name tell.
pub fn loader(path: &Path) -> Result<&'static dyn Loader, LoadError> {
    let mut head = Vec::new();
    // A file that cannot be read shows no content; its loader will say why.
    // To open a pipe would wait for its writer.
    if path.is_file()
        && let Ok(file) = std::fs::File::open(path)
    {
        file.take(1024).read_to_end(&mut head).ok();
    }
    let found = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let by_name = || LOADERS.iter().find(|l| l.extensions().contains(&found.as_str()));
    let loader = LOADERS.iter().find(|l| l.recognizes(&head)).or_else(by_name);
    loader.copied().ok_or_else(|| LoadError::UnknownExtension {
        file: path.to_owned(),
        found: found.clone(),
        known: LOADERS
            .iter()
            .flat_map(|l| l.extensions())
            .map(|e| format!(".{e}"))
            .collect::<Vec<_>>()
            .join(", "),
    })
}

/// Scales loose data to metres and checks it, with the file's name in the error.
fn finish(mut data: MeshData, file: &Path, unit: Unit) -> Result<Mesh, LoadError> {
    data.vertices.iter_mut().for_each(|p| *p *= unit.metres());
    data.skin.iter_mut().for_each(|s| s.scale(unit.metres()));
    Mesh::new(data).map_err(|source: MeshError| LoadError::Mesh { file: file.to_owned(), source })
}

/// All bytes of a regular file of bounded size.
fn read(path: &Path) -> Result<Vec<u8>, LoadError> {
    vt_core::file::read(path, MOST).map_err(|source| LoadError::Read { file: path.to_owned(), source })
}

#[cfg(test)]
mod tests;
