//! The text of a VRML97 file: unpacked, and checked before the recursive parser sees it.

use super::{LoadError, read};
use flate2::read::GzDecoder;
use std::io::Read;
use std::path::Path;
use vrml97::Scene;
use vt_core::file::MOST;

/// Deepest nesting of braces and brackets we hand to the recursive parser.
pub(super) const MAX_NESTING: usize = 256;

/// Text of a file, which may be compressed.
pub(super) fn decode(path: &Path) -> Result<String, LoadError> {
    let bytes = read(path)?;
    if !bytes.starts_with(&[0x1f, 0x8b]) {
        return Ok(vrml97::decode_text(&bytes));
    }
    let wrong = |found: String, expected: String| LoadError::Element {
        file: path.to_owned(),
        element: "gzip".into(),
        found,
        expected,
    };
    let mut text = vec![];
    let unpacked = GzDecoder::new(&bytes[..]).take(MOST + 1).read_to_end(&mut text);
    unpacked.map_err(|e| wrong(e.to_string(), "a whole compressed file".into()))?;
    if text.len() as u64 > MOST {
        return Err(wrong("more bytes than that".into(), format!("at most {MOST} uncompressed")));
    }
    Ok(vrml97::decode_text(&text))
}

pub(super) fn parse(path: &Path, text: &str) -> Result<Scene, LoadError> {
    check_text(path, text)?;
    vrml97::Parser::new(text, "").parse().map_err(|e| LoadError::syntax(path, e.line, e.message, "VRML97"))
}

/// Header and nesting, before the recursive parser sees the text.
fn check_text(path: &Path, text: &str) -> Result<(), LoadError> {
    let first = text.lines().next().unwrap_or_default();
    if !first.starts_with("#VRML V2.0") && !first.starts_with("#X3D") {
        let shown: String = first.chars().take(40).collect();
        return Err(LoadError::syntax(path, 1, format!("`{shown}`"), "the header `#VRML V2.0 utf8`"));
    }
    let (mut depth, mut line) = (0_usize, 1_usize);
    let (mut in_comment, mut in_string, mut escaped) = (false, false, false);
    for c in text.chars() {
        match c {
            '\n' => {
                line += 1;
                in_comment = false;
            }
            _ if in_comment => {}
            '\\' if in_string => {
                escaped = !escaped;
                continue;
            }
            '"' if !escaped => in_string = !in_string,
            '#' if !in_string => in_comment = true,
            '{' | '[' if !in_string => depth += 1,
            '}' | ']' if !in_string => depth = depth.saturating_sub(1),
            _ => {}
        }
        escaped = false;
        if depth > MAX_NESTING {
            return Err(LoadError::syntax(
                path,
                line,
                format!("{depth} nested braces"),
                format!("at most {MAX_NESTING}"),
            ));
        }
    }
    Ok(())
}
