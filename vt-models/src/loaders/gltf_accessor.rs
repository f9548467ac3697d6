//! Numbers in glTF buffers, with every range checked.

use super::{LoadError, read};
use base64::Engine;
use gltf::accessor::DataType;
use gltf::buffer::{Source, View};
use gltf::{Accessor, Document};
use std::cell::Cell;
use std::path::Path;

/// Bytes of a `data:` URI, with its type; `None` for other URIs.
pub(super) fn data_uri(uri: &str) -> Option<Result<(String, Vec<u8>), base64::DecodeError>> {
    let (head, body) = uri.strip_prefix("data:")?.split_once(',')?;
    let mime = head.strip_suffix(";base64")?.to_owned();
    Some(base64::engine::general_purpose::STANDARD.decode(body).map(|bytes| (mime, bytes)))
}

/// A URI's path with `%20` and the like decoded (RFC 3986, 2.1).
pub(super) fn decoded(uri: &str) -> String {
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let Some((&first, tail)) = rest.split_first() {
        let hex = tail.get(..2).and_then(|h| u8::from_str_radix(std::str::from_utf8(h).ok()?, 16).ok());
        match hex.filter(|_| first == b'%') {
            Some(byte) => {
                bytes.push(byte);
                rest = &tail[2..];
            }
            None => {
                bytes.push(first);
                rest = tail;
            }
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

/// The bytes of all buffers.
pub(super) struct Buffers<'a> {
    path: &'a Path,
    bytes: Vec<Vec<u8>>,
    /// Numbers that may still be read: several primitives and nodes may refer to the same ones.
    left: Cell<usize>,
}

/// Most numbers of all accessors read.
const MAX_NUMBERS: usize = 30_000_000;

impl<'a> Buffers<'a> {
    /// Reads the buffers: the binary chunk, `data:` URIs, files beside the model.
    pub fn load(path: &'a Path, document: &Document, mut blob: Option<Vec<u8>>) -> Result<Self, LoadError> {
        let folder = path.parent().unwrap_or(Path::new(""));
        let mut bytes = Vec::new();
        for buffer in document.buffers() {
            let wrong = |found: String| LoadError::Element {
                file: path.to_owned(),
                element: format!("buffer {}", buffer.index()),
                found,
                expected: format!("{} bytes", buffer.length()),
            };
            let content = match buffer.source() {
                Source::Bin => blob.take().ok_or_else(|| wrong("no binary chunk".into()))?,
                Source::Uri(uri) => match data_uri(uri) {
                    Some(content) => content.map_err(|e| wrong(e.to_string()))?.1,
                    None => read(&folder.join(decoded(uri)))?,
                },
            };
            if content.len() < buffer.length() {
                return Err(wrong(format!("{} bytes", content.len())));
            }
            bytes.push(content);
        }
        Ok(Self { path, bytes, left: Cell::new(MAX_NUMBERS) })
    }

    /// The bytes of a view; `None` where it reaches beyond its buffer.
    pub fn view(&self, view: &View) -> Option<&[u8]> {
        let end = view.offset().checked_add(view.length())?;
        self.bytes.get(view.buffer().index())?.get(view.offset()..end)
    }

    /// All numbers of an accessor in a row; integers that are normalised as fractions. The accessor must have one of
    /// the `sizes`, numbers per element.
    pub fn numbers(
        &self,
        accessor: &Accessor,
        sizes: &[usize],
        element: &str,
    ) -> Result<Vec<f64>, LoadError> {
        let wrong = |found: String, expected: String| LoadError::Element {
            file: self.path.to_owned(),
            element: format!("{element}, accessor {}", accessor.index()),
            found,
            expected,
        };
        let width = accessor.dimensions().multiplicity();
        if !sizes.contains(&width) {
            return Err(wrong(format!("{width} numbers an element"), format!("one of {sizes:?}")));
        }
        let Some(view) = accessor.view().filter(|_| accessor.sparse().is_none()) else {
            return Err(wrong("a sparse accessor".into(), "one with a bufferView of its own".into()));
        };
        let kind = accessor.data_type();
        let size = width * kind.size();
        let stride = view.stride().unwrap_or(size);
        let count = accessor.count();
        let needed = count
            .saturating_sub(1)
            .checked_mul(stride)
            .and_then(|n| n.checked_add(size)?.checked_add(accessor.offset()));
        let bytes = self.view(&view).filter(|b| needed.is_some_and(|n| n <= b.len()) && stride >= size);
        let Some(bytes) = bytes else {
            return Err(wrong(
                format!("{count} elements"),
                "as many as its bufferView and buffer hold".into(),
            ));
        };
        let Some(left) = self.left.get().checked_sub(count * width) else {
            return Err(wrong(
                format!("{count} elements more"),
                format!("at most {MAX_NUMBERS} numbers in all"),
            ));
        };
        self.left.set(left);
        let mut out = Vec::with_capacity(count * width);
        for k in 0..count {
            let start = accessor.offset() + k * stride;
            out.extend(
                bytes[start..start + size]
                    .chunks_exact(kind.size())
                    .map(|b| number(kind, b, accessor.normalized())),
            );
        }
        Ok(out)
    }
}

fn number(kind: DataType, b: &[u8], normalized: bool) -> f64 {
    let (value, most) = match kind {
        DataType::I8 => (f64::from(b[0] as i8), 127.0),
        DataType::U8 => (f64::from(b[0]), 255.0),
        DataType::I16 => (f64::from(i16::from_le_bytes([b[0], b[1]])), 32_767.0),
        DataType::U16 => (f64::from(u16::from_le_bytes([b[0], b[1]])), 65_535.0),
        DataType::U32 => (f64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])), f64::from(u32::MAX)),
        DataType::F32 => return f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]])),
    };
    if normalized { (value / most).max(-1.0) } else { value }
}
