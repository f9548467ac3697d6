//! Wavefront OBJ with MTL, through `tobj`.

use super::unique::Unique;
use super::{LoadError, Loader, finish, read};
use crate::mesh::{Material, Mesh, MeshData, Polygon, Segment, Unit};
use nalgebra::Point3;
use std::cell::Cell;
use std::collections::HashMap;
use std::path::Path;
use tobj::{LoadError as ObjError, LoadOptions, Model};

/// Reader of `.obj` files with their `.mtl` libraries.
///
/// Polygons, texture coordinates, normals and vertex colours are kept; vertices with identical coordinates become one. Objects and groups
/// are parts. A missing material library leaves the polygons without material, as other programs do.
pub struct ObjLoader;

impl Loader for ObjLoader {
    fn extensions(&self) -> &'static [&'static str] {
        &["obj"]
    }

    fn load(&self, path: &Path, unit: Unit) -> Result<Mesh, LoadError> {
        let text = String::from_utf8_lossy(&read(path)?).into_owned();
        let rows: Vec<String> = text.lines().map(polyline_as_pairs).collect();
        let folder = path.parent().unwrap_or(Path::new(""));
        let missing_library = Cell::new(false);
        let parsed = parse(&rows, |name| {
            let library = tobj::load_mtl(folder.join(name));
            missing_library.set(missing_library.get() || matches!(library, Err(ObjError::OpenFileFailed)));
            library
        });
        let (models, materials) = parsed.map_err(|error| locate(path, &text, &rows, error))?;
        let materials = match materials {
            Err(_) if missing_library.get() => Vec::new(),
            other => other.map_err(|e| LoadError::Element {
                file: path.to_owned(),
                element: "material library".into(),
                found: e.to_string(),
                expected: "newmtl, Kd r g b, map_Kd file".into(),
            })?,
        };
        finish(assemble(&models, materials), path, unit)
    }
}

type Library = Result<(Vec<tobj::Material>, HashMap<String, usize>), ObjError>;

fn parse(rows: &[String], library: impl Fn(&Path) -> Library) -> tobj::LoadResult {
    let text = rows.join("\n");
    tobj::load_obj_buf(&mut text.as_bytes(), &LoadOptions::default(), |p| library(p))
}

/// `l a b c` as `l a b`, `l b c`: the parser would return a polyline as a polygon.
fn polyline_as_pairs(line: &str) -> String {
    let mut words = line.split_whitespace();
    if words.next() != Some("l") {
        return line.to_owned();
    }
    let points: Vec<&str> = words.collect();
    let pairs = points.windows(2).map(|p| format!("l {} {}", p[0], p[1]));
    pairs.collect::<Vec<_>>().join("\n")
}

/// The parser reports no line: an error stays in every longer prefix, so the first bad line is found by bisection.
fn locate(path: &Path, text: &str, rows: &[String], error: ObjError) -> LoadError {
    let (mut good, mut bad) = (0, rows.len());
    while bad - good > 1 {
        let middle = usize::midpoint(good, bad);
        if parse(&rows[..middle], |_| Ok(Default::default())).is_ok() { good = middle } else { bad = middle }
    }
    let line: String = text.lines().nth(bad.saturating_sub(1)).unwrap_or_default().chars().take(60).collect();
    let expected = match error {
        ObjError::PositionParseError | ObjError::ColorParseError | ObjError::ScalingByZeroError => "v x y z",
        ObjError::NormalParseError => "vn x y z",
        ObjError::TexcoordParseError => "vt u v",
        ObjError::FaceParseError | ObjError::InvalidPolygon => "f v/vt/vn … with indices of earlier lines",
        ObjError::FaceVertexOutOfBounds => "indices of existing vertices",
        ObjError::FaceTexCoordOutOfBounds => "indices of existing texture coordinates",
        ObjError::FaceNormalOutOfBounds => "indices of existing normals",
        _ => "Wavefront OBJ",
    };
    LoadError::syntax(path, bad, format!("`{line}` ({error})"), expected)
}

fn assemble(models: &[Model], materials: Vec<tobj::Material>) -> MeshData {
    let mut data = MeshData::default();
    data.materials.extend(materials.into_iter().map(|m| {
        Material {
            name: m.name,
            // Without colour a texture shows as it is.
            diffuse: m
                .diffuse
                .unwrap_or(if m.diffuse_texture.is_some() { [1.0; 3] } else { [0.8; 3] })
                .map(|c| c as f32),
            texture: m.diffuse_texture,
        }
    }));
    let mut unique = Unique::default();
    for model in models {
        let part = data.parts.len() as u32;
        data.parts.push(model.name.clone());
        let material = model.mesh.material_id.map(|m| m as u32);
        let ids: Vec<u32> =
            model.mesh.positions.chunks_exact(3).map(|p| unique.id(&Point3::new(p[0], p[1], p[2]))).collect();
        let mesh = &model.mesh;
        let texture = |i: &u32| {
            let i = *i as usize * 2;
            mesh.texcoords.get(i..i + 2).map(|t| [t[0] as f32, t[1] as f32])
        };
        let three = |values: &[f64], i: u32| {
            let i = i as usize * 3;
            values.get(i..i + 3).map(|v| [v[0] as f32, v[1] as f32, v[2] as f32])
        };
        let arities = Some(&mesh.face_arities).filter(|a| !a.is_empty()).cloned();
        let mut at = 0;
        for arity in arities.unwrap_or_else(|| vec![3; mesh.indices.len() / 3]) {
            let range = at..at + arity as usize;
            at = range.end;
            let corners: Vec<u32> = mesh.indices[range.clone()].iter().map(|&i| ids[i as usize]).collect();
            match corners[..] {
                [_] => {}
                [a, b] => data.segments.push(Segment { ends: [a, b], material, part }),
                _ => {
                    let texcoords = mesh
                        .texcoord_indices
                        .get(range.clone())
                        .and_then(|t| t.iter().map(texture).collect());
                    let normals = mesh
                        .normal_indices
                        .get(range.clone())
                        .and_then(|n| n.iter().map(|i| three(&mesh.normals, *i)).collect());
                    let colours = mesh.indices[range].iter().map(|i| three(&mesh.vertex_color, *i)).collect();
                    data.polygons.push(Polygon {
                        corners,
                        texcoords,
                        colours,
                        normals,
                        material,
                        part,
                        name: None,
                    });
                }
            }
        }
    }
    data.vertices = unique.vertices;
    data
}
