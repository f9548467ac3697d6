//! Damage anywhere in a small file of each format ends in a mesh that can be used, or in an error that names the file.

use super::features::{PLAIN, base64, binary_stl, glb, gltf, gltf_buffer, ply};
use super::*;
use crate::diagnostics::diagnose;
use crate::edges::{EdgeModel, EdgeOptions};
use crate::symmetry::Symmetries;
use vt_core::laws::{damage, for_cases};

const CAO: &str =
    "V1\n4\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1\n0 1\n0\n1\n3 0 1 2 name=floor\n1\n0 1 0.5\n1\n0.5 0 1 2\n";
const OBJ: &str = "mtllib a.mtl\no one\nv 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nv 0 0 1 1 1 1\nvt 0 0\nvt 1 0\nvn 0 0 1\nusemtl wall\n\
                   f 1/1/1 2/2/1 3/1/1\nf 1 2 4\nl 1 2 3\n";
const VRML: &str = "#VRML V2.0 utf8\nTransform { scale 1 2 3 rotation 0 0 1 0.5 children [ DEF A Shape { appearance \
                    Appearance { material Material { diffuseColor 1 0 0 } texture PixelTexture { image 2 1 3 0xFF0000 0x00FF00 } } \
                    geometry IndexedFaceSet { creaseAngle 0.5 coord Coordinate { point [0 0 0,1 0 0,0 1 0,0 0 1] } \
                    coordIndex [0,1,2,-1,0,1,3,-1] } } USE A Shape { geometry Cylinder { } } Shape { geometry ElevationGrid { \
                    xDimension 2 zDimension 2 height [0 0 1 1] } } Shape { geometry Extrusion { spine [0 0 0,0 1 0] } } ] }\n";
const STL: &str = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n\
                   endsolid a\n";

fn files() -> Vec<(&'static str, Vec<u8>)> {
    let uri = format!("\"uri\": \"data:;base64,{}\"", base64(&gltf_buffer()));
    let mut packed = flate2::write::GzEncoder::new(vec![], flate2::Compression::fast());
    std::io::Write::write_all(&mut packed, VRML.as_bytes()).unwrap();
    vec![
        ("d.cao", CAO.into()),
        ("d.obj", OBJ.into()),
        ("d.wrl", VRML.into()),
        ("z.wrl", packed.finish().unwrap()),
        ("d.stl", STL.into()),
        ("b.stl", binary_stl(b"made by hand")),
        ("d.ply", ply("binary_little_endian", |x| x.to_le_bytes().to_vec(), |i| i.to_le_bytes().to_vec())),
        ("b.ply", ply("binary_big_endian", |x| x.to_be_bytes().to_vec(), |i| i.to_be_bytes().to_vec())),
        ("d.gltf", gltf(PLAIN, &uri).into_bytes()),
        ("d.glb", glb(&gltf(PLAIN, "\"name\": \"bin\""), &gltf_buffer())),
    ]
}

/// Everything that is asked of a model before it is tracked.
fn examine(mesh: &Mesh) {
    assert!(mesh.diameter().is_finite() && mesh.triangles().len() < 100_000);
    let _ = (diagnose(mesh), Symmetries::find(mesh));
    // Numbers that are too extreme for edges are an error, too.
    let _ = EdgeModel::new(mesh, &EdgeOptions::default());
}

#[test]
fn damaged_models_are_models_or_errors() {
    let folder = std::env::temp_dir().join(format!("vt-models-{}-damaged", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let files = files();
    for (name, bytes) in &files {
        std::fs::write(folder.join(name), bytes).unwrap();
        examine(&load_mesh(folder.join(name), Unit::Metre).unwrap_or_else(|e| panic!("{e}")));
    }
    let (meshes, errors) = (std::cell::Cell::new(0), std::cell::Cell::new(0));
    for_cases(5000, (0..files.len(), damage()), |(kind, damage)| {
        let (name, bytes) = &files[kind];
        let path = folder.join(name);
        std::fs::write(&path, damage.apply(bytes)).unwrap();
        match load_mesh(&path, Unit::Metre) {
            Ok(mesh) => {
                examine(&mesh);
                meshes.set(meshes.get() + 1);
            }
            Err(e) => {
                assert!(e.to_string().contains(name) || e.to_string().contains(".wrl"), "{e}");
                errors.set(errors.get() + 1);
            }
        }
    });
    std::fs::remove_dir_all(&folder).ok();
    assert!(meshes.get() > 300 && errors.get() > 300, "{meshes:?} meshes, {errors:?} errors");
}
