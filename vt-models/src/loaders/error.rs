use crate::mesh::MeshError;
use std::path::{Path, PathBuf};

/// Why a model file gives no mesh.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LoadError {
    /// Neither the content nor the file name extension is of a known format.
    #[error("{}: found extension `{found}`, expected one of {known}", file.display())]
    UnknownExtension {
        /// The file.
        file: PathBuf,
        /// Its extension, lower case.
        found: String,
        /// Known extensions.
        known: String,
    },
    /// The file needs an extension of its format that we do not have.
    #[error("{}: needs the extension `{extension}`, expected none but {known}", file.display())]
    Extension {
        /// The file.
        file: PathBuf,
        /// Name of the extension.
        extension: String,
        /// Extensions that may be required.
        known: String,
    },
    /// The file cannot be read.
    #[error("{}: cannot be read: {source}", file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The text is not of the format.
    #[error("{}:{line}: found {found}, expected {expected}", file.display())]
    Syntax {
        /// The file.
        file: PathBuf,
        /// Line, from 1.
        line: usize,
        /// What is there.
        found: String,
        /// What should be there.
        expected: String,
    },
    /// An element of a format whose parser keeps no lines is wrong.
    #[error("{}: {element}: found {found}, expected {expected}", file.display())]
    Element {
        /// The file.
        file: PathBuf,
        /// The element, by type and name.
        element: String,
        /// What is there.
        found: String,
        /// What should be there.
        expected: String,
    },
    /// The content was read but is no mesh.
    #[error("{}: {source}", file.display())]
    Mesh {
        /// The file.
        file: PathBuf,
        /// What is wrong with the mesh.
        source: MeshError,
    },
}

impl LoadError {
    pub(super) fn syntax(
        file: &Path,
        line: usize,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Self {
        Self::Syntax { file: file.to_owned(), line, found: found.into(), expected: expected.into() }
    }
}
