//! STL (stereolithography), binary and ASCII, through `stl_io`.

use super::unique::Unique;
use super::{LoadError, Loader, finish, read};
use crate::mesh::{Mesh, MeshData, Polygon, Unit};
use nalgebra::Point3;
use std::io::Cursor;
use std::path::Path;

/// Reader of `.stl` files; identical vertices become one. Normals in the file are not used: windings say the same.
///
/// A file is binary when its length is that which its triangle count makes, whatever its header says; several
/// `solid`s of a text are read as one.
pub struct StlLoader;

impl Loader for StlLoader {
    fn extensions(&self) -> &'static [&'static str] {
        &["stl"]
    }

    fn recognizes(&self, head: &[u8]) -> bool {
        head.starts_with(b"solid") && head.windows(5).any(|w| w == b"facet")
    }

    fn load(&self, path: &Path, unit: Unit) -> Result<Mesh, LoadError> {
        let bytes = read(path)?;
        let triangles = if is_binary(&bytes) { binary(path, bytes)? } else { text(path, &bytes)? };
        let mut unique = Unique::default();
        let mut data = MeshData::default();
        for triangle in triangles {
            let corners = triangle.map(|v| unique.id(&Point3::from(v.map(decimal)))).to_vec();
            data.polygons.push(Polygon { corners, ..Polygon::default() });
        }
        data.vertices = unique.vertices;
        finish(data, path, unit)
    }
}

const HEADER: usize = 84;
const RECORD: usize = 50;

/// The shortest decimal that reads as this f32, so that an authored 0.084 stays 0.084.
fn decimal(x: f32) -> f64 {
    x.to_string().parse().unwrap_or(f64::from(x))
}

/// Number of triangles that a binary file declares.
fn declared(bytes: &[u8]) -> Option<usize> {
    let count = bytes.get(HEADER - 4..HEADER)?;
    Some(u32::from_le_bytes(count.try_into().ok()?) as usize)
}

fn is_binary(bytes: &[u8]) -> bool {
    let fits =
        declared(bytes).is_some_and(|n| n.checked_mul(RECORD).is_some_and(|b| b + HEADER == bytes.len()));
    fits || !bytes.trim_ascii_start().get(..5).is_some_and(|w| w.eq_ignore_ascii_case(b"solid"))
}

type Corners = [[f32; 3]; 3];

fn binary(path: &Path, mut bytes: Vec<u8>) -> Result<Vec<Corners>, LoadError> {
    let wrong = |found: String, expected: String| LoadError::Element {
        file: path.to_owned(),
        element: "binary STL".into(),
        found,
        expected,
    };
    let Some(count) = declared(&bytes) else {
        return Err(wrong(format!("{} bytes", bytes.len()), format!("a header of {HEADER} bytes")));
    };
    let room = (bytes.len() - HEADER) / RECORD;
    if count > room {
        return Err(wrong(
            format!("{count} triangles"),
            format!("at most the {room} that the file has room for"),
        ));
    }
    // The reader takes a header that begins with `solid` for a text.
    bytes[..5].fill(b' ');
    let mut source = Cursor::new(bytes);
    let triangles =
        stl_io::create_stl_reader(&mut source).map_err(|e| wrong(e.to_string(), "binary STL".into()))?;
    let triangles = triangles.map(|t| t.map(|t| t.vertices.map(Into::into)));
    triangles.collect::<Result<_, _>>().map_err(|e| wrong(e.to_string(), format!("{count} triangles")))
}

fn text(path: &Path, bytes: &[u8]) -> Result<Vec<Corners>, LoadError> {
    let text = String::from_utf8_lossy(bytes).to_ascii_lowercase();
    let first = |line: &str| line.split_whitespace().next().unwrap_or_default().to_owned();
    let count = |word: &str| text.lines().filter(|l| first(l) == word).count();
    if count("solid") != count("endsolid") {
        let last = text.lines().count();
        return Err(LoadError::syntax(path, last, "the end of the file", "`endsolid`"));
    }
    // Several solids, and names of any form, as one solid.
    let body = text.lines().filter(|l| !matches!(first(l).as_str(), "solid" | "endsolid"));
    let one = std::iter::once("solid all").chain(body).chain(["endsolid all"]).collect::<Vec<_>>().join("\n");
    let mut source = Cursor::new(one.into_bytes());
    let syntax = |facets: usize, e: &std::io::Error| {
        let mut starts = text.lines().enumerate().filter(|(_, l)| first(l) == "facet").map(|(i, _)| i + 1);
        let line = starts.nth(facets).unwrap_or_else(|| text.lines().count());
        LoadError::syntax(
            path,
            line,
            e.to_string(),
            "facet normal, outer loop, 3 vertex x y z, endloop, endfacet",
        )
    };
    let mut out = Vec::new();
    for triangle in stl_io::create_stl_reader(&mut source).map_err(|e| syntax(0, &e))? {
        out.push(triangle.map_err(|e| syntax(out.len(), &e))?.vertices.map(Into::into));
    }
    Ok(out)
}
