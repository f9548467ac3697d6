//! PLY (Stanford polygon format), ASCII and binary of either byte order, through `ply-rs-bw`.

use super::{LoadError, Loader, finish, read};
use crate::mesh::{Material, Mesh, MeshData, Polygon, Segment, Unit};
use nalgebra::Point3;
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{ElementDef, Encoding, Property, PropertyAccess, PropertyAccessResult};
use ply_rs_bw::ply::{PropertyType, ScalarType};
use std::path::Path;

/// Reader of `.ply` files.
///
/// Of vertices it takes `x y z`, normals `nx ny nz`, colours `red green blue` (bytes, or fractions as floats) and
/// texture coordinates `s t`, `u v` or `texture_u texture_v`; of faces `vertex_indices` or `vertex_index`, `texcoord`
/// and colours; of edges `vertex1 vertex2`. A comment `TextureFile NAME` names the texture. Other elements and
/// properties are passed over.
pub struct PlyLoader;

impl Loader for PlyLoader {
    fn extensions(&self) -> &'static [&'static str] {
        &["ply"]
    }

    fn recognizes(&self, head: &[u8]) -> bool {
        head.starts_with(b"ply\n") || head.starts_with(b"ply\r")
    }

    fn load(&self, path: &Path, unit: Unit) -> Result<Mesh, LoadError> {
        finish(parse(path, &read(path)?)?, path, unit)
    }
}

/// An element of any kind, with what we take of it.
#[derive(Default)]
struct Row {
    position: [f64; 3],
    normal: [Option<f32>; 3],
    colour: [Option<f32>; 3],
    texture: [Option<f32>; 2],
    corners: Vec<u32>,
    texcoords: Vec<f32>,
    ends: [Option<u32>; 2],
    /// An index that is no vertex number, for the error message.
    bad_index: bool,
}

impl PropertyAccess for Row {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, value: Property) -> PropertyAccessResult {
        match name {
            "vertex_indices" | "vertex_index" => match value.to_u32_list() {
                Some(list) => self.corners = list,
                None => self.bad_index = true,
            },
            "texcoord" => match value {
                Property::ListFloat(v) => self.texcoords = v,
                Property::ListDouble(v) => self.texcoords = v.into_iter().map(|x| x as f32).collect(),
                _ => return PropertyAccessResult::Ignored,
            },
            "vertex1" => self.ends[0] = index(&value),
            "vertex2" => self.ends[1] = index(&value),
            _ => {
                let Some((number, fraction)) = scalar(&value) else { return PropertyAccessResult::Ignored };
                let slot = match name {
                    "nx" => &mut self.normal[0],
                    "ny" => &mut self.normal[1],
                    "nz" => &mut self.normal[2],
                    "s" | "u" | "texture_u" => &mut self.texture[0],
                    "t" | "v" | "texture_v" => &mut self.texture[1],
                    "x" | "y" | "z" => {
                        self.position[usize::from(name.as_bytes()[0] - b'x')] = number;
                        return PropertyAccessResult::Set;
                    }
                    "red" | "green" | "blue" | "diffuse_red" | "diffuse_green" | "diffuse_blue" => {
                        let channel = match name.trim_start_matches("diffuse_") {
                            "red" => 0,
                            "green" => 1,
                            _ => 2,
                        };
                        self.colour[channel] = Some(fraction.clamp(0.0, 1.0));
                        return PropertyAccessResult::Set;
                    }
                    _ => return PropertyAccessResult::Ignored,
                };
                *slot = Some(number as f32);
            }
        }
        PropertyAccessResult::Set
    }
}

/// Value of a scalar, and the fraction of the type's range that integers stand for as colours.
fn scalar(value: &Property) -> Option<(f64, f32)> {
    Some(match *value {
        Property::Char(v) => (f64::from(v), f32::from(v) / 127.0),
        Property::UChar(v) => (f64::from(v), f32::from(v) / 255.0),
        Property::Short(v) => (f64::from(v), f32::from(v) / 32_767.0),
        Property::UShort(v) => (f64::from(v), f32::from(v) / 65_535.0),
        Property::Int(v) => (f64::from(v), v as f32 / 255.0),
        Property::UInt(v) => (f64::from(v), v as f32 / 255.0),
        // The shortest decimal that reads as this f32, so that an authored 0.084 stays 0.084.
        Property::Float(v) => (v.to_string().parse().unwrap_or(f64::from(v)), v),
        Property::Double(v) => (v, v as f32),
        _ => return None,
    })
}

fn index(value: &Property) -> Option<u32> {
    scalar(value)
        .map(|v| v.0)
        .filter(|v| v.fract() == 0.0 && (0.0..f64::from(u32::MAX)).contains(v))
        .map(|v| v as u32)
}

fn parse(path: &Path, bytes: &[u8]) -> Result<MeshData, LoadError> {
    let wrong = |e: ply_rs_bw::parser::ParseError| {
        let message = e.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
        LoadError::syntax(path, e.line().unwrap_or(1), message, "PLY as its header declares")
    };
    let parser = Parser::<Row>::new();
    let mut reader = Reader::new(bytes);
    let header = parser.read_header(&mut reader).map_err(wrong)?;
    let mut data = MeshData::default();
    let texture = header.comments.iter().find_map(|c| {
        let name = c.trim_start_matches("comment").trim().strip_prefix("TextureFile")?;
        Some(name.trim().to_owned())
    });
    if texture.is_some() {
        data.materials.push(Material { name: String::new(), diffuse: [1.0; 3], texture });
    }
    let mut vertices: Vec<Row> = Vec::new();
    let mut faces: Vec<Row> = Vec::new();
    for (_, element) in &header.elements {
        check_count(path, reader.line(), element, header.encoding, reader.get_ref().len())?;
        let rows = parser.read_payload_for_element(&mut reader, element, &header).map_err(wrong)?;
        match element.name.as_str() {
            "vertex" => vertices = rows,
            "face" => faces = rows,
            "edge" => data.segments.extend(rows.iter().filter_map(|r| {
                let [Some(a), Some(b)] = r.ends else { return None };
                Some(Segment { ends: [a, b], material: None, part: 0 })
            })),
            _ => {}
        }
    }
    data.vertices = vertices.iter().map(|v| Point3::from(v.position)).collect();
    for (k, face) in faces.into_iter().enumerate() {
        data.polygons.push(polygon(path, k, face, &vertices, !data.materials.is_empty())?);
    }
    Ok(data)
}

/// A declared number of elements that the rest of the file cannot hold is refused before anything is read.
fn check_count(
    path: &Path,
    line: usize,
    element: &ElementDef,
    encoding: Encoding,
    rest: usize,
) -> Result<(), LoadError> {
    let size = |t: &ScalarType| match t {
        _ if encoding == Encoding::Ascii => 2,
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    };
    let least: usize = element
        .properties
        .iter()
        .map(|(_, p)| match &p.data_type {
            PropertyType::Scalar(t) | PropertyType::List(t, _) => size(t),
        })
        .sum();
    // The last line of a text may end with the file.
    let most = (rest + 1).checked_div(least).unwrap_or(0);
    if element.count > most {
        let found = format!("{} elements `{}`", element.count, element.name);
        return Err(LoadError::syntax(
            path,
            line,
            found,
            format!("at most the {most} that the file has room for"),
        ));
    }
    Ok(())
}

fn polygon(
    path: &Path,
    face: usize,
    row: Row,
    vertices: &[Row],
    textured: bool,
) -> Result<Polygon, LoadError> {
    let wrong = |found: String| LoadError::Element {
        file: path.to_owned(),
        element: format!("face {face}"),
        found,
        expected: format!("vertex_indices below {}", vertices.len()),
    };
    let bad = row.corners.iter().find(|&&c| c as usize >= vertices.len());
    if let Some(bad) = bad {
        return Err(wrong(format!("vertex index {}", *bad as i32)));
    }
    if row.bad_index {
        return Err(wrong("a list of other entries than whole numbers from 0".into()));
    }
    let corner = |c: &u32| &vertices[*c as usize];
    let complete = |v: [Option<f32>; 3]| Some([v[0]?, v[1]?, v[2]?]);
    let own = complete(row.colour).map(|c| vec![c; row.corners.len()]);
    let colours = own.or_else(|| row.corners.iter().map(|c| complete(corner(c).colour)).collect());
    let normals = row.corners.iter().map(|c| complete(corner(c).normal)).collect();
    let texcoords = if row.texcoords.len() == 2 * row.corners.len() && !row.corners.is_empty() {
        Some(row.texcoords.chunks_exact(2).map(|t| [t[0], t[1]]).collect())
    } else {
        let at = |c: &u32| Some([corner(c).texture[0]?, corner(c).texture[1]?]);
        row.corners.iter().map(at).collect()
    };
    let material = textured.then_some(0);
    Ok(Polygon { corners: row.corners, texcoords, colours, normals, material, ..Polygon::default() })
}
