//! Formats with colours, textures, binary numbers and node graphs, in files of our own.

use super::*;
use crate::mesh::{ImageContent, Polygon};
use nalgebra::{Point3, Vector3};
use std::path::PathBuf;

/// A folder of our own in the system's temporary folder, removed at the end of the test.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("vt-models-{}-{name}", std::process::id()));
        std::fs::create_dir_all(&path).expect("temporary folder is writable");
        Self(path)
    }

    fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.0.join(name);
        std::fs::write(&path, bytes).expect("temporary folder is writable");
        path
    }

    fn load(&self, name: &str, bytes: impl AsRef<[u8]>) -> Result<Mesh, LoadError> {
        load_mesh(self.write(name, bytes), Unit::Metre)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        std::fs::remove_dir_all(&self.0).ok();
    }
}

fn volume(mesh: &Mesh) -> f64 {
    let six = mesh.triangles().iter().map(|t| {
        let [a, b, c] = mesh.corners(t).map(|p| p.coords);
        a.dot(&b.cross(&c))
    });
    six.sum::<f64>() / 6.0
}

/// Corners of a tetrahedron and its faces, seen anti-clockwise from outside; its volume is 1/6.
const CORNERS: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
const FACES: [[usize; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];

pub(super) fn ply(format: &str, number: fn(f32) -> Vec<u8>, index: fn(i32) -> Vec<u8>) -> Vec<u8> {
    let mut file = format!(
        "ply\nformat {format} 1.0\ncomment TextureFile skin.png\nelement vertex 4\nproperty float x\nproperty float y\n\
         property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nproperty float s\n\
         property float t\nelement face 4\nproperty list uchar int vertex_indices\nend_header\n"
    )
    .into_bytes();
    for p in CORNERS {
        file.extend(p.into_iter().flat_map(number));
        file.extend([255, 0, 51]);
        file.extend([p[0], p[1]].into_iter().flat_map(number));
    }
    for f in FACES {
        file.push(3);
        file.extend(f.into_iter().flat_map(|i| index(i as i32)));
    }
    file
}

#[test]
fn ply_of_all_three_encodings_is_the_same_mesh() {
    let folder = Folder::new("ply");
    let mut text = String::from(
        "ply\nformat ascii 1.0\ncomment TextureFile skin.png\nelement vertex 4\nproperty float x\nproperty float y\n\
         property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nproperty float s\n\
         property float t\nelement face 4\nproperty list uchar int vertex_indices\nend_header\n",
    );
    for p in CORNERS {
        text += &format!("{} {} {} 255 0 51 {} {}\n", p[0], p[1], p[2], p[0], p[1]);
    }
    for f in FACES {
        text += &format!("3 {} {} {}\n", f[0], f[1], f[2]);
    }
    let files = [
        text.into_bytes(),
        ply("binary_little_endian", |x| x.to_le_bytes().to_vec(), |x| x.to_le_bytes().to_vec()),
        ply("binary_big_endian", |x| x.to_be_bytes().to_vec(), |x| x.to_be_bytes().to_vec()),
    ];
    for file in &files {
        let m = folder.load("a.ply", file).unwrap();
        assert_eq!((m.vertices().len(), m.polygons().len()), (4, 4));
        assert!((volume(&m) - 1.0 / 6.0).abs() < 1e-12);
        let face = &m.polygons()[1];
        assert_eq!(face.colours.as_ref().unwrap()[2], [1.0, 0.0, 0.2]);
        assert_eq!(face.texcoords.as_ref().unwrap()[1], [1.0, 0.0]);
        assert_eq!(m.materials()[0].texture.as_deref(), Some("skin.png"));
        // Cut off anywhere, it is an error that names the file, never a panic.
        for end in 0..file.len() - 1 {
            let e = folder.load("cut.ply", &file[..end]);
            assert!(e.is_err() || end + 2 >= file.len(), "{end} of {}", file.len());
        }
    }
}

#[test]
fn ply_that_promises_too_much_is_refused() {
    let folder = Folder::new("ply-hostile");
    let header = |vertices: &str, faces: &str| {
        format!(
            "ply\nformat binary_little_endian 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\n\
             property float z\nelement face {faces}\nproperty list uint uint vertex_indices\nend_header\n"
        )
    };
    let e = folder.load("v.ply", header("4000000000", "1")).unwrap_err().to_string();
    assert!(e.contains("4000000000 elements `vertex`") && e.contains("at most the 0"), "{e}");
    // A list that claims four billion entries.
    let mut list = header("1", "1").into_bytes();
    list.extend([0; 12]);
    list.extend(u32::MAX.to_le_bytes());
    assert!(matches!(folder.load("l.ply", list), Err(LoadError::Syntax { .. })));
    // Elements without properties would be read for ever.
    let empty = "ply\nformat ascii 1.0\nelement nothing 99999999999\nend_header\n";
    assert!(matches!(folder.load("n.ply", empty), Err(LoadError::Syntax { .. })));
    let index = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
                 element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n3 0 0 7\n";
    let e = folder.load("i.ply", index).unwrap_err().to_string();
    assert!(e.contains("face 0") && e.contains("vertex index 7") && e.contains("below 1"), "{e}");
    let line = index.replace("3 0 0 7", "3 0 x 0");
    match folder.load("x.ply", line).unwrap_err() {
        LoadError::Syntax { line, .. } => assert_eq!(line, 11),
        other => panic!("{other}"),
    }
}

pub(super) fn binary_stl(header: &[u8]) -> Vec<u8> {
    let mut file = header.to_vec();
    file.resize(80, b' ');
    file.extend(4_u32.to_le_bytes());
    for f in FACES {
        file.extend([0; 12]);
        f.iter().flat_map(|i| CORNERS[*i]).for_each(|x| file.extend(x.to_le_bytes()));
        file.extend([0; 2]);
    }
    file
}

#[test]
fn stl_binary_even_where_its_header_says_solid_and_text() {
    let folder = Folder::new("stl");
    let mut text = String::from("solid\n");
    for (k, f) in FACES.iter().enumerate() {
        let v = f.map(|i| CORNERS[i].map(|x| x.to_string()).join(" "));
        if k == 2 {
            text += "endsolid\nSolid second of two\n";
        }
        text += &format!(
            " facet normal 0 0 0\n  OUTER LOOP\n   vertex {}\n   vertex {}\n   vertex {}\n  endloop\n endfacet\n",
            v[0], v[1], v[2]
        );
    }
    text += "endsolid\n";
    for file in [binary_stl(b"made by hand"), binary_stl(b"solid but binary"), text.clone().into_bytes()] {
        let m = folder.load("a.stl", file).unwrap();
        assert_eq!((m.vertices().len(), m.polygons().len()), (4, 4), "vertices are welded");
        assert!((volume(&m) - 1.0 / 6.0).abs() < 1e-12);
    }
    let mut many = binary_stl(b"x");
    many[80..84].copy_from_slice(&u32::MAX.to_le_bytes());
    let e = folder.load("m.stl", many).unwrap_err().to_string();
    assert!(e.contains("4294967295 triangles") && e.contains("at most the 4"), "{e}");
    assert!(folder.load("s.stl", b"short").is_err());
    let wrong = text.replacen("vertex", "vortex", 4);
    match folder.load("w.stl", &wrong).unwrap_err() {
        LoadError::Syntax { line, .. } => assert_eq!(line, 2, "the facet in which the first error lies"),
        other => panic!("{other}"),
    }
    assert!(matches!(folder.load("c.stl", &text[..text.len() - 10]), Err(LoadError::Syntax { .. })));
}

#[test]
fn content_counts_more_than_the_name() {
    let folder = Folder::new("sniff");
    let file = ply("binary_little_endian", |x| x.to_le_bytes().to_vec(), |x| x.to_le_bytes().to_vec());
    assert_eq!(folder.load("wrongly.stl", &file).unwrap().polygons().len(), 4);
    assert_eq!(folder.load("nameless", &file).unwrap().polygons().len(), 4);
    assert!(matches!(folder.load("other.xyz", "1 2 3"), Err(LoadError::UnknownExtension { .. })));
    assert!(matches!(load_mesh(&folder.0, Unit::Metre), Err(LoadError::UnknownExtension { .. })));
    std::fs::create_dir_all(folder.0.join("folder.ply")).unwrap();
    let e = load_mesh(folder.0.join("folder.ply"), Unit::Metre).unwrap_err();
    assert!(matches!(e, LoadError::Read { .. }), "{e}");
}

pub(super) fn base64(bytes: &[u8]) -> String {
    use ::base64::Engine;
    ::base64::engine::general_purpose::STANDARD.encode(bytes)
}

/// Buffer: 4 positions, 4 texture coordinates, 12 indices, 4 joint quadruples, 4 weight quadruples, an identity and
/// the inverse of the second joint's frame.
pub(super) fn gltf_buffer() -> Vec<u8> {
    let mut out = Vec::new();
    CORNERS.iter().flatten().for_each(|x| out.extend(x.to_le_bytes()));
    CORNERS.iter().flat_map(|p| [p[0], p[1]]).for_each(|x| out.extend(x.to_le_bytes()));
    FACES.iter().flatten().for_each(|i| out.extend((*i as u16).to_le_bytes()));
    for k in 0..4_u8 {
        out.extend([k / 2, 1, 0, 0]);
    }
    for k in 0..4_u8 {
        let w = if k == 3 { [0.5_f32, 0.5, 0.0, 0.0] } else { [2.0, 0.0, 0.0, 0.0] };
        w.into_iter().for_each(|x| out.extend(x.to_le_bytes()));
    }
    let identity = nalgebra::Matrix4::<f32>::identity();
    let moved = nalgebra::Matrix4::new_translation(&Vector3::new(0.0, -1.0, 0.0));
    [identity, moved].iter().flat_map(|m| m.iter()).for_each(|x| out.extend(x.to_le_bytes()));
    out
}

/// The tetrahedron under `nodes` (JSON), which say what refers to mesh 0 and skin 0.
pub(super) fn gltf(nodes: &str, buffer: &str) -> String {
    let accessor = |view: u32, component: u32, count: u32, kind: &str| {
        let bounds = if view == 0 { ", \"min\": [0, 0, 0], \"max\": [1, 1, 1]" } else { "" };
        format!(
            r#"{{"bufferView": {view}, "componentType": {component}, "count": {count}, "type": "{kind}"{bounds}}}"#
        )
    };
    let accessors = [
        accessor(0, 5126, 4, "VEC3"),
        accessor(1, 5126, 4, "VEC2"),
        accessor(2, 5123, 12, "SCALAR"),
        accessor(3, 5121, 4, "VEC4"),
        accessor(4, 5126, 4, "VEC4"),
        accessor(5, 5126, 2, "MAT4"),
    ];
    let sizes = [48, 32, 24, 16, 64, 128];
    let views: Vec<String> = (0..6)
        .map(|k| {
            let start: usize = sizes[..k].iter().sum();
            format!(r#"{{"buffer": 0, "byteOffset": {start}, "byteLength": {}}}"#, sizes[k])
        })
        .collect();
    format!(
        r#"{{"asset": {{"version": "2.0"}}, "scene": 0, "scenes": [{{"nodes": [0]}}], "nodes": [{nodes}],
        "meshes": [{{"name": "tetra", "primitives": [{{"attributes": {{"POSITION": 0, "TEXCOORD_0": 1, "JOINTS_0": 3,
        "WEIGHTS_0": 4}}, "indices": 2, "material": 0}}]}}],
        "materials": [{{"name": "red", "pbrMetallicRoughness": {{"baseColorFactor": [1, 0.5, 0, 1],
        "baseColorTexture": {{"index": 0}}}}}}], "textures": [{{"source": 0}}],
        "images": [{{"uri": "data:image/png;base64,{}"}}], "skins": [{{"joints": [1, 2], "inverseBindMatrices": 5}}],
        "accessors": [{}], "bufferViews": [{}], "buffers": [{{"byteLength": 312, {buffer}}}]}}"#,
        base64(b"no png"),
        accessors.join(", "),
        views.join(", ")
    )
}

/// A binary glTF of this text and buffer.
pub(super) fn glb(json: &str, buffer: &[u8]) -> Vec<u8> {
    let mut text = json.as_bytes().to_vec();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut out = b"glTF".to_vec();
    out.extend(2_u32.to_le_bytes());
    out.extend((28 + text.len() as u32 + buffer.len() as u32).to_le_bytes());
    out.extend((text.len() as u32).to_le_bytes());
    out.extend(b"JSON");
    out.extend(text);
    out.extend((buffer.len() as u32).to_le_bytes());
    out.extend(b"BIN\0");
    out.extend(buffer);
    out
}

pub(super) const PLAIN: &str = r#"{"name": "top", "translation": [0, 0, 5], "scale": [2, 2, 2], "children": [1]},
    {"children": [2]}, {"mesh": 0, "rotation": [0, 0, 1, 0], "name": "leaf"}"#;

#[test]
fn gltf_transforms_textures_and_three_ways_to_a_buffer() {
    let folder = Folder::new("gltf");
    let bytes = gltf_buffer();
    folder.write("a buffer.bin", &bytes);
    let uri = format!("\"uri\": \"data:application/octet-stream;base64,{}\"", base64(&bytes));
    let files = [
        ("a.gltf", gltf(PLAIN, &uri).into_bytes()),
        ("b.gltf", gltf(PLAIN, "\"uri\": \"a%20buffer.bin\"").into_bytes()),
        ("c.glb", glb(&gltf(PLAIN, "\"name\": \"bin\""), &bytes)),
    ];
    for (name, file) in &files {
        let m = folder.load(name, file).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!((m.vertices().len(), m.polygons().len(), m.parts()), (4, 4, &["leaf".to_owned()][..]));
        assert!((volume(&m) - 8.0 / 6.0).abs() < 1e-6);
        // Half a turn about z, then twice as large, then up.
        assert!(
            (m.vertices()[m.polygons()[0].corners[2] as usize] - Point3::new(-2.0, 0.0, 5.0)).norm() < 1e-6
        );
        assert_eq!(m.polygons()[0].texcoords.as_ref().unwrap()[1], [0.0, 0.0], "v counts upwards here");
        let material = &m.materials()[0];
        assert_eq!((material.name.as_str(), material.diffuse), ("red", [1.0, 0.5, 0.0]));
        let image = m.image(material.texture.as_deref().unwrap()).unwrap();
        let ImageContent::Encoded { mime, bytes } = &image.content else { panic!("{image:?}") };
        assert_eq!((mime.as_str(), bytes.as_slice()), ("image/png", &b"no png"[..]));
        assert!(m.skin().is_none(), "no node uses the skin");
    }
    // A mirror turns faces inside out unless their winding is turned, too.
    let mirror = gltf(r#"{"mesh": 0, "scale": [-1, 1, 1]}, {}, {}"#, &uri);
    assert!((volume(&folder.load("m.gltf", mirror).unwrap()) - 1.0 / 6.0).abs() < 1e-6);
}

#[test]
fn gltf_skin_is_kept_in_the_rest_pose() {
    let folder = Folder::new("skin");
    let uri = format!("\"uri\": \"data:;base64,{}\"", base64(&gltf_buffer()));
    // The second joint was bound at y = 1 and rests at y = 3: what follows it moves up by 2.
    let nodes = r#"{"children": [1, 3]}, {"name": "root", "children": [2]}, {"name": "tip", "translation": [0, 3, 0]},
        {"mesh": 0, "skin": 0, "translation": [9, 9, 9]}"#;
    let path = folder.write("s.gltf", gltf(nodes, &uri));
    let m = load_mesh(&path, Unit::Centimetre).unwrap();
    let skin = m.skin().expect("a skin");
    assert_eq!(
        skin.joints.iter().map(|j| (j.name.as_str(), j.parent)).collect::<Vec<_>>(),
        [("root", None), ("tip", Some(0))]
    );
    let expected = [[0.0, 0.0, 0.0], [0.01, 0.0, 0.0], [0.0, 0.03, 0.0], [0.0, 0.02, 0.01]];
    for (k, p) in expected.iter().enumerate() {
        assert!((m.vertices()[k] - Point3::from(*p)).norm() < 1e-9, "{k}: {}", m.vertices()[k]);
        assert!((skin.weights[k].iter().map(|w| w.1).sum::<f64>() - 1.0).abs() < 1e-12);
    }
    assert_eq!(skin.weights[3][1], (1, 0.5));
    // Frames are in metres, and undone by their inverses.
    assert!((skin.joints[1].object_from_joint[(1, 3)] - 0.03).abs() < 1e-12);
    let product = skin.joints[1].object_from_joint * skin.joints[1].joint_from_object;
    assert!((product - nalgebra::Matrix4::identity()).norm() < 1e-12);
}

#[test]
fn gltf_that_is_hostile_or_compressed_is_refused() {
    let folder = Folder::new("gltf-bad");
    let uri = format!("\"uri\": \"data:;base64,{}\"", base64(&gltf_buffer()));
    let good = gltf(PLAIN, &uri);
    let refuse = |text: &str| folder.load("x.gltf", text).map(|_| ()).unwrap_err();
    let cyclic = gltf(r#"{"children": [1]}, {"children": [2]}, {"children": [0], "mesh": 0}"#, &uri);
    assert!(refuse(&cyclic).to_string().contains("a tree within"), "{}", refuse(&cyclic));
    let draco = good.replacen('{', r#"{"extensionsRequired": ["KHR_draco_mesh_compression"], "#, 1);
    let e = refuse(&draco);
    assert!(
        matches!(&e, LoadError::Extension { extension, .. } if extension == "KHR_draco_mesh_compression"),
        "{e}"
    );
    for (from, to) in [
        (r#""count": 12"#, r#""count": 4000000000"#),
        (r#""byteOffset": 80, "byteLength": 24"#, r#""byteOffset": 300, "byteLength": 24"#),
        (r#""byteLength": 312"#, r#""byteLength": 99999999999"#),
        (r#""indices": 2"#, r#""indices": 77"#),
        (r#""indices": 2"#, r#""indices": 0"#),
        (r#""POSITION": 0"#, r#""POSITION": 1"#),
        ("base64,", "base64,*"),
        (r#""version": "2.0""#, r#""version": 7"#),
    ] {
        assert!(good.contains(from), "{from}");
        assert!(matches!(refuse(&good.replacen(from, to, 1)), LoadError::Element { .. }), "{to}");
    }
    // Damage anywhere in the text or the binary ends in a mesh or an error.
    let bytes = glb(&gltf(PLAIN, "\"name\": \"bin\""), &gltf_buffer());
    let mut meshes = 0;
    for at in (0..bytes.len()).step_by(3) {
        let mut damaged = bytes.clone();
        damaged[at] ^= 0x55;
        meshes += usize::from(folder.load("d.glb", &damaged).is_ok());
        folder.load("d.glb", &bytes[..at]).unwrap_err();
    }
    assert!(meshes > 20, "{meshes} readable");
}

#[test]
fn vrml_colours_normals_textures_and_their_transform() {
    let folder = Folder::new("vrml");
    let faces = "coord Coordinate { point [0 0 0, 1 0 0, 1 1 0, 0 1 0, 0.5 0.5 2] } \
                 coordIndex [0 1 4 -1 1 2 4 -1 2 3 4 -1 3 0 4 -1]";
    let shape = |appearance: &str, rest: &str| {
        format!(
            "#VRML V2.0 utf8\nShape {{ appearance Appearance {{ {appearance} }} geometry IndexedFaceSet {{ {faces} {rest} }} }}\n"
        )
    };
    let load = |appearance: &str, rest: &str| {
        folder.load("a.wrl", shape(appearance, rest)).unwrap_or_else(|e| panic!("{e}"))
    };
    let colours = "color Color { color [1 0 0, 0 1 0, 0 0 1, 1 1 1, 0 0 0] }";
    let m = load("", colours);
    assert_eq!(
        m.polygons()[1].colours.as_ref().unwrap()[..2],
        [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        "as coordIndex"
    );
    let m = load("", &format!("{colours} colorPerVertex FALSE"));
    assert_eq!(m.polygons()[2].colours.as_ref().unwrap(), &vec![[0.0, 0.0, 1.0]; 3], "in face order");
    let m = load("", &format!("{colours} colorPerVertex FALSE colorIndex [3 3 0 1] ccw FALSE"));
    assert_eq!(m.polygons()[3].colours.as_ref().unwrap(), &vec![[0.0, 1.0, 0.0]; 3]);
    let e =
        folder.load("b.wrl", shape("", &format!("{colours} colorIndex [0 1 9 -1]"))).unwrap_err().to_string();
    assert!(e.contains("colorIndex 9"), "{e}");
    // All four faces meet at the tip: with a large crease angle its normal points up, with none there are no normals.
    let tip = |m: &Mesh| m.polygons()[0].normals.as_ref().map(|n| Vector3::from(n[2]));
    assert!((tip(&load("", "creaseAngle 3")).unwrap() - Vector3::z()).norm() < 1e-6);
    assert!(tip(&load("", "creaseAngle 0.1")).unwrap().y < -0.9, "below the crease angle faces stay flat");
    assert_eq!(tip(&load("", "")), None);
    let given =
        load("", "normal Normal { vector [0 1 0, 1 0 0] } normalPerVertex FALSE normalIndex [0 1 0 1]");
    assert_eq!(given.polygons()[1].normals.as_ref().unwrap(), &vec![[1.0, 0.0, 0.0]; 3]);
    // The longest side, z, is s; of the others, equally long, x comes first.
    let image = "texture ImageTexture { url \"wall.png\" }";
    let m = load(image, "");
    assert_eq!(m.materials()[0].texture.as_deref(), Some("wall.png"));
    assert_eq!(m.polygons()[0].texcoords.as_ref().unwrap(), &[[0.0, 0.0], [0.0, 0.5], [1.0, 0.25]]);
    let turned =
        "textureTransform TextureTransform { center 0.5 0.5 rotation 1.5707963 scale 2 1 translation 0 1 }";
    let m = load(
        &format!("{image} {turned}"),
        "texCoord TextureCoordinate { point [0 0, 1 0, 1 1, 0 1, 0.5 0.5] }",
    );
    // (0, 0) moved by T and C: (0.5, 1.5), turned: (-1.5, 0.5), scaled: (-3, 0.5), back by C: (-3.5, 0).
    let t = m.polygons()[0].texcoords.as_ref().unwrap()[0];
    assert!((t[0] + 3.5).abs() < 1e-5 && t[1].abs() < 1e-5, "{t:?}");
    let m = load("texture PixelTexture { image 2 2 3 0xFF0000 0x00FF00 0x0000FF 0xFFFFFF }", "");
    let name = m.materials()[0].texture.clone().unwrap();
    let ImageContent::Pixels { width, rgba } = &m.image(&name).unwrap().content else { panic!("pixels") };
    assert_eq!(
        (*width, rgba[0], rgba[3]),
        (2, [0, 0, 255, 255], [0, 255, 0, 255]),
        "the file begins at the bottom"
    );
    let huge = folder.load("h.wrl", shape("texture PixelTexture { image 100000 100000 3 0 }", ""));
    assert!(huge.is_err() || huge.is_ok_and(|m| m.images().is_empty()));
    let grid = "#VRML V2.0 utf8\nShape { geometry ElevationGrid { xDimension 3 zDimension 2 height [0 0 0 1 1 1] \
                colorPerVertex FALSE color Color { color [1 0 0, 0 1 0] } } }\n";
    let m = folder.load("g.wrl", grid).unwrap();
    assert_eq!(m.polygons()[1].colours.as_ref().unwrap()[0], [0.0, 1.0, 0.0]);
    assert_eq!(m.polygons()[1].texcoords.as_ref().unwrap()[2], [1.0, 1.0]);
}

#[test]
fn vrml_inline_is_followed_but_not_in_circles() {
    let folder = Folder::new("inline");
    folder.write("part.wrl", "#VRML V2.0 utf8\nShape { geometry Box {} }\n");
    let text = "#VRML V2.0 utf8\nTransform { translation 5 0 0 children Inline { url [ \"http://a.b/c.wrl\", \"part.wrl\" ] } }\n";
    let m = folder.load("whole.wrl", text).unwrap();
    assert_eq!((m.polygons().len(), m.bounds().max.x), (6, 6.0));
    let e = folder.load("me.wrl", "#VRML V2.0 utf8\nInline { url \"me.wrl\" }\n").unwrap_err().to_string();
    assert!(e.contains("in a circle"), "{e}");
    let e = folder.load("absent.wrl", "#VRML V2.0 utf8\nInline { url \"no.wrl\" }\n").unwrap_err();
    assert!(matches!(e, LoadError::Read { .. }), "{e}");
}

#[test]
fn obj_switches_materials_and_keeps_colours_and_normals() {
    let folder = Folder::new("obj");
    folder.write("a.mtl", "newmtl wall\nmap_Kd textures/wall 1.png\nnewmtl roof\nKd 1 0 0\n");
    let text = "mtllib a.mtl\nv 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nv 0 0 1 1 1 1\nvt 0 0\nvt 1 0\nvt 0 1\nvn 0 0 1\n\
                usemtl wall\nf 1/1/1 2/2/1 3/3/1\nusemtl roof\nf 1 3 4\nusemtl wall\nf 1/1 4/2 2/3\n";
    let m = folder.load("a.obj", text).unwrap();
    let name = |p: &Polygon| m.materials()[p.material.unwrap() as usize].name.as_str();
    assert_eq!(m.polygons().iter().map(name).collect::<Vec<_>>(), ["wall", "roof", "wall"]);
    assert_eq!(m.polygons()[2].texcoords.as_ref().unwrap(), &[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]);
    assert_eq!(m.materials()[0].texture.as_deref(), Some("textures/wall 1.png"));
    assert_eq!((m.materials()[0].diffuse, m.materials()[1].diffuse), ([1.0; 3], [1.0, 0.0, 0.0]));
    assert_eq!(m.polygons()[0].normals.as_ref().unwrap()[2], [0.0, 0.0, 1.0]);
    assert_eq!(m.polygons()[1].colours.as_ref().unwrap()[2], [1.0; 3]);
    assert_eq!(m.vertices().len(), 4);
}
