use super::*;
use std::path::PathBuf;

mod damaged;
mod features;

/// A file of our own in the system's temporary folder, removed at the end of the test.
struct Temporary(PathBuf);

impl Temporary {
    fn new(name: &str, text: &str) -> Self {
        let path = std::env::temp_dir().join(format!("vt-models-{}-{name}", std::process::id()));
        std::fs::write(&path, text).expect("temporary folder is writable");
        Self(path)
    }

    fn load(&self) -> Result<Mesh, LoadError> {
        load_mesh(&self.0, Unit::Metre)
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        std::fs::remove_file(&self.0).ok();
    }
}

fn load(name: &str, text: &str) -> Result<Mesh, LoadError> {
    Temporary::new(name, text).load()
}

#[track_caller]
fn syntax_line(result: Result<Mesh, LoadError>) -> usize {
    match result.unwrap_err() {
        LoadError::Syntax { line, .. } => line,
        other => panic!("expected a syntax error, got {other}"),
    }
}

#[test]
fn unknown_extension_lists_the_known_ones() {
    let e = load_mesh("model.step", Unit::Metre).unwrap_err().to_string();
    assert_eq!(
        e,
        "model.step: found extension `step`, expected one of .wrl, .vrml, .obj, .cao, .ply, .stl, .gltf, .glb"
    );
    assert!(matches!(load_mesh("absent.cao", Unit::Metre), Err(LoadError::Read { .. })));
}

#[test]
fn units_scale_to_metres() {
    let file = Temporary::new("unit.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    for (unit, metres) in
        [(Unit::Metre, 1.0), (Unit::Centimetre, 0.01), (Unit::Millimetre, 0.001), (Unit::Inch, 0.0254)]
    {
        assert_eq!(load_mesh(&file.0, unit).unwrap().bounds().max.x, metres);
    }
}

#[test]
fn obj_keeps_polygons_texture_polylines_and_welds() {
    let text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n\
                o quad\nf 1/1 2/2 3/3 4/4\no path\nl 5 2 3\n";
    let m = load("poly.obj", text).unwrap();
    assert_eq!((m.vertices().len(), m.polygons().len(), m.segments().len()), (4, 1, 2));
    assert_eq!(m.polygons()[0].texcoords.as_ref().unwrap()[2], [1.0, 1.0]);
    assert_eq!(m.segments()[0].ends[0], m.polygons()[0].corners[0], "vertex 5 repeats vertex 1");
}

#[test]
fn obj_errors_name_the_line() {
    assert_eq!(syntax_line(load("a.obj", "v 0 0 0\nv 1 0 0\nv 0 x 0\nf 1 2 3\n")), 3);
    assert_eq!(syntax_line(load("b.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n\nf 1 2 9\n")), 5);
    let e = load("c.obj", "v 0 0 0\nv inf 0 0\nv 0 1 0\nf 1 2 3\n").unwrap_err().to_string();
    assert!(e.contains("vertex 1 is not finite"), "{e}");
}

#[test]
fn vrml_composes_nested_transforms_in_the_order_of_the_standard() {
    // Scale 2 along x about (1,0,0), turn 90° about z, shift by y: the point (2,0,0) goes
    // (2,0,0) -> scaled about 1: (3,0,0) -> turned about (1,0,0): (1,2,0) -> shifted: (1,12,0); outer: x + 100.
    let text = "#VRML V2.0 utf8\nTransform { translation 100 0 0 children [ Transform { center 1 0 0 scale 2 1 1 \
        rotation 0 0 3 1.5707963267948966 translation 0 10 0 children [ DEF P Shape { geometry IndexedFaceSet { \
        coord DEF C Coordinate { point [ 2 0 0, 1 0 0, 1 1 0 ] } coordIndex [ 0 1 2 -1 ] } } ] } USE P ] }\n";
    let m = load("t.wrl", text).unwrap();
    let p = m.vertices()[0];
    assert!((p - nalgebra::Point3::new(101.0, 12.0, 0.0)).norm() < 1e-6, "{p}");
    assert_eq!(m.polygons().len(), 2);
    assert_eq!(m.vertices()[3], nalgebra::Point3::new(102.0, 0.0, 0.0), "USE under the outer transform only");
    assert_eq!(m.parts(), ["P", "P"]);
}

#[test]
fn vrml_scale_orientation_is_conjugated() {
    let text = "#VRML V2.0 utf8\nTransform { scale 3 1 1 scaleOrientation 0 0 1 1.5707963267948966 children Shape { \
        geometry IndexedLineSet { coord Coordinate { point [ 1 1 0, 0 0 0 ] } coordIndex [ 0 1 ] } } }\n";
    let p = load("so.wrl", text).unwrap().vertices()[0];
    assert!((p - nalgebra::Point3::new(1.0, 3.0, 0.0)).norm() < 1e-6, "{p}");
}

#[test]
fn vrml_switch_lod_and_primitives() {
    let text = "#VRML V2.0 utf8\n\
        Switch { whichChoice 1 choice [ Shape { geometry Sphere {} } Shape { geometry Box { size 2 4 6 } } ] }\n\
        Switch { choice [ Shape { geometry Sphere {} } ] }\n\
        LOD { level [ Shape { geometry Cone { bottom FALSE } } Shape { geometry Box {} } ] }\n\
        Shape { appearance Appearance { material Material { diffuseColor 0 1 0 } } geometry Cylinder {} }\n\
        Shape { geometry Sphere { radius 2 } }\n";
    let m = load("prim.wrl", text).unwrap();
    let count = |part| m.polygons().iter().filter(|p| p.part == part).count();
    assert_eq!([0, 1, 2, 3].map(count), [6, 64, 66, 32 * 16]);
    assert_eq!(m.bounds().max.coords, nalgebra::Vector3::new(2.0, 2.0, 3.0));
    assert_eq!(m.materials()[0].diffuse, [0.0, 1.0, 0.0]);
    // All solids are closed and wound outwards: their volumes come out positive and right within the chord error.
    let volume = |part| -> f64 {
        m.triangles()
            .iter()
            .filter(|t| m.polygons()[t.polygon as usize].part == part)
            .map(|t| {
                let [a, b, c] = m.corners(t);
                a.coords.dot(&b.coords.cross(&c.coords)) / 6.0
            })
            .sum()
    };
    assert!((volume(0) - 48.0).abs() < 1e-9);
    assert!((volume(2) / (2.0 * std::f64::consts::PI) - 1.0).abs() < 0.01);
    assert!((volume(3) / (32.0 / 3.0 * std::f64::consts::PI) - 1.0).abs() < 0.02);
}

#[test]
fn vrml_errors() {
    assert_eq!(syntax_line(load("h.wrl", "VRML\n")), 1);
    let syntax = load("s.wrl", "#VRML V2.0 utf8\nShape {\n geometry Box { size 1 2\n }\n}\n");
    assert!((3..=4).contains(&syntax_line(syntax)));
    let deep = format!("#VRML V2.0 utf8\n{}", "Group { children [\n".repeat(50_000));
    assert_eq!(syntax_line(load("d.wrl", &deep)), 130);
    let text = "#VRML V2.0 utf8\nShape { geometry DEF F IndexedFaceSet { coord Coordinate { point [0 0 0] } \
        coordIndex [0 0 5] } }\n";
    let e = load("i.wrl", text).unwrap_err().to_string();
    assert!(e.contains("IndexedFaceSet F") && e.contains("coordIndex 5") && e.contains("below 1"), "{e}");
    let e = load("e.wrl", "#VRML V2.0 utf8\nGroup {}\n").unwrap_err().to_string();
    assert!(e.contains("mesh is empty"), "{e}");
}

#[test]
fn cao_sections_options_and_includes() {
    let part = Temporary::new("part.cao", "V1\n2\n0 0 0\n1 0 0\n1\n0 1\n0\n0\n");
    let name = part.0.file_name().unwrap().to_string_lossy().into_owned();
    let text = format!(
        "# comment\nV1\nload(\"{name}\", t=[0; 0; 5], tu=[0, 0, 90deg]) # turned\n5\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n0 0 1\n\
         5 # lines\n0 1\n2 1\n2 3\n3 0\n0 4 name=mast useLod=true\n1 # faces from lines\n4 0 1 2 3 name=floor\n\
         1\n3 0 1 4 name=sail useLod=true minLineLengthThreshold=50 minPolygonAreaThreshold=100\n\
         1\n0 4 0.5\n1\n0.25 0 1 4\n"
    );
    let m = load("whole.cao", &text).unwrap();
    // One line of the part, one free line (the mast), 64 sides of the circle.
    assert_eq!(m.segments().len(), 1 + 1 + 64);
    // Two faces, 64 sides and two caps of the cylinder.
    assert_eq!(m.polygons().len(), 2 + 64 + 2);
    assert_eq!(m.polygons()[0].name.as_deref(), Some("floor"));
    assert_eq!(m.polygons()[0].corners.len(), 4);
    let end = m.vertices()[m.segments()[0].ends[1] as usize];
    assert!((end - nalgebra::Point3::new(0.0, 1.0, 5.0)).norm() < 1e-12, "{end}");
}

#[test]
fn cao_errors_name_the_line() {
    assert_eq!(syntax_line(load("v.cao", "# nothing\nV2\n")), 2);
    assert_eq!(syntax_line(load("p.cao", "V1\n2\n0 0 0\n0 y 0\n")), 4);
    assert_eq!(syntax_line(load("i.cao", "V1\n1\n0 0 0\n0\n0\n1\n3 0 0 1\n")), 7);
    assert_eq!(syntax_line(load("o.cao", "V1\n1\n0 0 0\n0\n0\n1\n3 0 0 0 colour=red\n")), 7);
    assert_eq!(syntax_line(load("n.cao", "V1\n1\n0 0 0\n0\n0\n1\n9 0 0 0\n")), 7);
    assert_eq!(
        syntax_line(load("f.cao", "V1\n4\n0 0 0\n1 0 0\n2 0 0\n3 0 0\n3\n0 1\n1 2\n2 3\n1\n3 0 1 2\n0\n")),
        12
    );
    assert_eq!(syntax_line(load("e.cao", "V1\n99999999999\n0 0 0\n")), 3);
    assert_eq!(syntax_line(load("x.cao", "V1\nload(\"not-there.cao\")\n0\n0\n0\n0\n")), 2);
    let path = std::env::temp_dir().join(format!("vt-models-{}-cycle.cao", std::process::id()));
    let name = path.file_name().unwrap().to_string_lossy().into_owned();
    let cycle = load("cycle.cao", &format!("V1\nload(\"{name}\")\n0\n0\n0\n0\n")).unwrap_err().to_string();
    assert!(cycle.contains(":2:") && cycle.contains("cyclic"), "{cycle}");
}
