//! Model files to [`Mesh`]: VRML97, Wavefront OBJ and ViSP CAO, behind one trait.

mod cao;
mod error;
mod obj;
mod primitives;
mod vrml;
mod vrml_geometry;

pub use cao::CaoLoader;
pub use error::LoadError;
pub use obj::ObjLoader;
pub use vrml::VrmlLoader;

use crate::mesh::{Mesh, MeshData, MeshError, Unit};
use std::path::Path;

/// Reader of one file format.
pub trait Loader: Sync {
    /// File name extensions, lower case, without the dot.
    fn extensions(&self) -> &'static [&'static str];

    /// Reads a file whose lengths are in `unit`; the mesh is in metres.
    ///
    /// # Errors
    /// [`LoadError`] where the file cannot be read, is not of the format, or its content is no mesh.
    fn load(&self, path: &Path, unit: Unit) -> Result<Mesh, LoadError>;
}

/// The formats [`load_mesh`] knows; a new format is one more line here.
pub static LOADERS: &[&dyn Loader] = &[&VrmlLoader, &ObjLoader, &CaoLoader];

/// Reads a model file, choosing the format by the file name extension.
///
/// # Errors
/// [`LoadError::UnknownExtension`] lists the known extensions; otherwise the chosen loader's error.
pub fn load_mesh(path: impl AsRef<Path>, unit: Unit) -> Result<Mesh, LoadError> {
    let path = path.as_ref();
    let found = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let loader = LOADERS.iter().find(|l| l.extensions().contains(&found.as_str()));
    let loader = loader.ok_or_else(|| LoadError::UnknownExtension {
        file: path.to_owned(),
        found,
        known: LOADERS
            .iter()
            .flat_map(|l| l.extensions())
            .map(|e| format!(".{e}"))
            .collect::<Vec<_>>()
            .join(", "),
    })?;
    loader.load(path, unit)
}

/// Scales loose data to metres and checks it, with the file's name in the error.
fn finish(mut data: MeshData, file: &Path, unit: Unit) -> Result<Mesh, LoadError> {
    data.vertices.iter_mut().for_each(|p| *p *= unit.metres());
    Mesh::new(data).map_err(|source: MeshError| LoadError::Mesh { file: file.to_owned(), source })
}

fn read(path: &Path) -> Result<Vec<u8>, LoadError> {
    std::fs::read(path).map_err(|source| LoadError::Read { file: path.to_owned(), source })
}

#[cfg(test)]
mod tests;
