//! Whole files that come from outside: regular ones, of bounded size.

use std::fs::File;
use std::io::{Error, ErrorKind, Read, Result};
use std::path::Path;

/// Most bytes of a file of numbers, of a model or of a picture.
pub const MOST: u64 = 256 << 20;

/// All bytes of a regular file of at most `most` bytes. Pipes and devices might never end.
///
/// # Errors
/// That of the system, or what was found and expected.
pub fn read(path: &Path, most: u64) -> Result<Vec<u8>> {
    let wrong = |found: String, expected: String| {
        Error::new(ErrorKind::InvalidInput, format!("found {found}; expected {expected}"))
    };
    let about = std::fs::metadata(path)?;
    if !about.is_file() {
        let found = if about.is_dir() { "a folder" } else { "no regular file" };
        return Err(wrong(found.into(), "a file".into()));
    }
    let large = |bytes: u64| wrong(format!("{bytes} bytes"), format!("at most {most}"));
    if about.len() > most {
        return Err(large(about.len()));
    }
    let mut out = Vec::with_capacity(about.len() as usize);
    // It may have grown.
    File::open(path)?.take(most + 1).read_to_end(&mut out)?;
    if out.len() as u64 > most { Err(large(out.len() as u64)) } else { Ok(out) }
}

/// The text of such a file.
///
/// # Errors
/// As for [`read`]; for bytes that are no UTF-8 with line and column, from 1.
pub fn read_text(path: &Path, most: u64) -> Result<String> {
    String::from_utf8(read(path, most)?).map_err(|e| {
        let (good, rest) = e.as_bytes().split_at(e.utf8_error().valid_up_to());
        let line = 1 + good.iter().filter(|&&b| b == b'\n').count();
        let start = good.iter().rposition(|&b| b == b'\n').map_or(0, |k| k + 1);
        let column = 1 + String::from_utf8_lossy(&good[start..]).chars().count();
        let byte = rest.first().copied().unwrap_or_default();
        let why = format!("line {line}, column {column}: found the byte 0x{byte:02x}; expected UTF-8 text");
        Error::new(ErrorKind::InvalidData, why)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_regular_files_of_bounded_size_and_texts_are_read() {
        let dir = std::env::temp_dir().join(format!("vt-core-file-{}", std::process::id()));
        std::fs::create_dir_all(&dir).unwrap();
        let file = dir.join("a.txt");
        std::fs::write(&file, b"ab\n\xc3\xa4\xffz").unwrap();
        let e = read_text(&file, 100).unwrap_err().to_string();
        assert!(e.contains("line 2, column 2") && e.contains("0xff"), "{e}");
        assert_eq!(read(&file, 7).unwrap().len(), 7);
        assert!(read(&file, 6).unwrap_err().to_string().contains("7 bytes; expected at most 6"));
        assert!(read(&dir, 6).unwrap_err().to_string().contains("a folder"));
        assert_eq!(read(&dir.join("no"), 6).unwrap_err().kind(), ErrorKind::NotFound);
        std::fs::remove_dir_all(&dir).unwrap();
    }
}
