//! Files of outputs: valid after every step, named in every error.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ImageEncoder, RgbImage};
use vt_core::error::DeviceError;

/// A text file that is on disk, up to its last line, after every step.
pub(crate) struct Lines {
    path: PathBuf,
    file: File,
    buffer: String,
}

impl Lines {
    pub(crate) fn create(path: PathBuf, header: &str) -> Result<Self, DeviceError> {
        folder_of(&path)?;
        let file = File::create(&path).map_err(|e| DeviceError::new(path.display(), e))?;
        let mut lines = Self { path, file, buffer: header.to_owned() };
        lines.flush()?;
        Ok(lines)
    }

    /// Text that the next `flush` writes.
    pub(crate) fn buffer(&mut self) -> &mut String {
        &mut self.buffer
    }

    pub(crate) fn flush(&mut self) -> Result<(), DeviceError> {
        let written = self.file.write_all(self.buffer.as_bytes()).and_then(|()| self.file.flush());
        self.buffer.clear();
        written.map_err(|e| DeviceError::new(self.path.display(), e))
    }
}

/// Writes a whole file under a temporary name and renames it, so that readers see the old or the new one.
///
/// # Errors
/// [`DeviceError`] that names the file.
pub fn replace(path: &Path, content: &[u8]) -> Result<(), DeviceError> {
    folder_of(path)?;
    let temporary = path.with_extension("partial");
    let fail = |e: std::io::Error| DeviceError::new(path.display(), e);
    std::fs::write(&temporary, content).map_err(fail)?;
    std::fs::rename(&temporary, path).map_err(fail)
}

/// Removes a file of an earlier run, if there is one: it would be mistaken for one of this run.
pub(crate) fn forget(path: &Path) -> Result<(), DeviceError> {
    match std::fs::remove_file(path) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(DeviceError::new(path.display(), e)),
        _ => Ok(()),
    }
}

/// Writes a picture as PNG as [`replace`] does; `buffer` is used again from call to call.
///
/// # Errors
/// [`DeviceError`] that names the file.
pub fn save_png(path: &Path, picture: &RgbImage, buffer: &mut Vec<u8>) -> Result<(), DeviceError> {
    buffer.clear();
    let encoder = PngEncoder::new_with_quality(&mut *buffer, CompressionType::Fast, FilterType::Sub);
    encoder
        .write_image(picture, picture.width(), picture.height(), image::ExtendedColorType::Rgb8)
        .map_err(|e| DeviceError::new(path.display(), e))?;
    replace(path, buffer)
}

pub(crate) fn folder_of(path: &Path) -> Result<(), DeviceError> {
    match path.parent() {
        Some(folder) => std::fs::create_dir_all(folder).map_err(|e| DeviceError::new(folder.display(), e)),
        None => Ok(()),
    }
}

/// `stem.ext` for the only target, `stem-NAME.ext` for one of several.
pub(crate) fn of_target(folder: &Path, stem: &str, extension: &str, targets: &[String], k: usize) -> PathBuf {
    match targets.len() {
        1 => folder.join(format!("{stem}.{extension}")),
        _ => folder.join(format!("{stem}-{}.{extension}", file_name(&targets[k]))),
    }
}

/// A name without characters that file systems refuse.
pub fn file_name(name: &str) -> String {
    name.chars().map(|c| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '_' }).collect()
}
