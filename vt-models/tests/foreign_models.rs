//! Model files of others, found through `VISP_IMAGES` and `VT_DATA`; their element counts are read off the files.
#![cfg(feature = "loaders")]

use std::path::PathBuf;
use vt_models::edges::{EdgeModel, EdgeOptions};
use vt_models::loaders::load_mesh;
use vt_models::mesh::{Mesh, MeshData, Polygon, Segment, Unit};

/// The folder named by an environment variable, or a printed reason to skip.
fn folder(variable: &str) -> Option<PathBuf> {
    let found = std::env::var_os(variable).map(PathBuf::from).filter(|p| p.is_dir());
    if found.is_none() {
        assert!(
            std::env::var("VT_REQUIRE_DATA").as_deref() != Ok("1"),
            "VT_REQUIRE_DATA=1 but {variable} is no folder"
        );
        eprintln!("skipped: {variable} is not set to a folder");
    }
    found
}

fn counts(m: &Mesh) -> [usize; 3] {
    [m.vertices().len(), m.polygons().len(), m.segments().len()]
}

#[test]
fn visp_models() {
    let Some(root) = folder("VISP_IMAGES") else { return };
    // A cylinder is 64 sides and two caps (128 points more), a circle 64 lines (64 points more).
    let expected = [
        ("mbt/cube.cao", [8, 6, 0]),
        ("mbt/cube.wrl", [8, 6, 0]),
        ("mbt/cube_and_cylinder.cao", [10 + 128, 6 + 66, 0]),
        ("mbt/cube_and_cylinder.wrl", [16, 12, 0]),
        ("mbt-cao/cylinder_cao_model_linux_line_ending.cao", [4 + 128 + 64, 66, 64]),
        ("mbt-cao/cylinder_cao_model_windows_line_ending.cao", [4 + 128 + 64, 66, 64]),
        ("mbt-depth/Castle-simu/Models/cube.cao", [10, 4, 0]),
        ("mbt-depth/Castle-simu/Models/chateau.cao", [14, 5, 0]),
        ("mbt-depth/Castle-simu/Models/chateau_parts/chateau_floor.cao", [6, 1, 0]),
        ("mbt-depth/Castle-simu/Models/chateau_parts/chateau_tower.cao", [8, 4, 0]),
        ("mbt-depth/castel/chateau.cao", [24, 7, 0]),
        ("mbt-depth/castel/chateau_parts/chateau_front_door.cao", [6, 1, 0]),
        ("mbt-depth/castel/chateau_parts/chateau_slope.cao", [4, 1, 0]),
    ];
    for (name, expected) in expected {
        let mesh = load_mesh(root.join(name), Unit::Metre).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(counts(&mesh), expected, "{name}");
    }
    let castle = load_mesh(root.join("mbt-depth/Castle-simu/Models/chateau.wrl"), Unit::Metre).unwrap();
    // 14 IndexedFaceSets (one of four faces), 2 IndexedLineSets of which one has a single point.
    assert_eq!(counts(&castle), [69, 17, 1]);
    assert!(castle.materials().iter().any(|m| m.diffuse == [1.0, 1.0, 0.0]), "the yellow box");
    let d = castle.diameter();
    assert!((0.25..0.45).contains(&d), "{d}");
    load_mesh(root.join("mbt-depth/castel/chateau_gantry.wrl"), Unit::Metre)
        .unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(
        load_mesh(root.join("mbt/cube.wrl"), Unit::Metre).unwrap().bounds().min.x,
        -0.084,
        "decimals survive"
    );
}

#[test]
fn other_models() {
    let Some(root) = folder("VT_DATA") else { return };
    let load =
        |name: &str, unit| load_mesh(root.join("models").join(name), unit).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(load("vrml/elevationGrid2.wrl", Unit::Metre).polygons().len(), 4 * 5);
    // 12 wall strips and two caps of 12 corners.
    let room = load("vrml/extrusion1.wrl", Unit::Metre);
    assert_eq!(room.polygons().len(), 12 + 2);
    assert_eq!(room.bounds().max.coords, nalgebra::Vector3::new(2.0, 2.0, 1.0));
    assert_eq!(load("vrml/creaseAngle.wrl", Unit::Metre).polygons().len(), 4 + 20);
    let textured = load("vrml/meshWithTexture.wrl", Unit::Metre);
    assert_eq!(textured.polygons().len(), 32);
    assert!(textured.polygons().iter().all(|p| p.texcoords.as_ref().is_some_and(|t| t.len() == 3)));
    assert_eq!(textured.materials()[0].texture.as_deref(), Some("map.gif"));
    assert!(load("vrml/crystal.wrl", Unit::Metre).polygons().len() >= 10);
    assert!(load("vrml/house.wrl", Unit::Metre).polygons().len() > 500);
    let teapot = load("teapot.obj", Unit::Metre);
    assert!(teapot.polygons().len() > 1000 && teapot.triangles().len() >= teapot.polygons().len() - 500);
    let head = load("head/head_180mm.obj", Unit::Metre);
    assert!((head.bounds().max.y - head.bounds().min.y - 0.18).abs() < 0.09, "{:?}", head.bounds());
    assert_eq!(head.materials()[0].texture.as_deref(), Some("head_180mm_texture.png"));
    assert!(load("head/LeePerrySmith.obj", Unit::Metre).polygons().len() > 1000);
}

/// Unwelded triangles of a mesh, each cut into `4^levels`, in an order scrambled by a multiplicative hash.
fn soup(mesh: &Mesh, levels: u32) -> Mesh {
    let mut triangles: Vec<_> = mesh.triangles().iter().map(|t| mesh.corners(t)).collect();
    for _ in 0..levels {
        triangles = triangles
            .iter()
            .flat_map(|&[a, b, c]| {
                let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(p, q)| nalgebra::center(&p, &q));
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [bc, ca, ab]]
            })
            .collect();
    }
    let mut order: Vec<u32> = (0..triangles.len() as u32).collect();
    order.sort_by_key(|i| i.wrapping_mul(2_654_435_761));
    let mut data = MeshData::default();
    for i in order {
        let base = data.vertices.len() as u32;
        data.vertices.extend(triangles[i as usize]);
        let corners =
            if i % 3 == 0 { vec![base + 2, base + 1, base] } else { vec![base, base + 1, base + 2] };
        data.polygons.push(Polygon { corners, ..Default::default() });
    }
    for s in mesh.segments() {
        let base = data.vertices.len() as u32;
        data.vertices.extend(s.ends.map(|e| mesh.vertices()[e as usize]));
        data.segments.push(Segment { ends: [base, base + 1], material: None, part: 0 });
    }
    Mesh::new(data).unwrap()
}

fn assert_same_hard_edges(a: &EdgeModel, b: &EdgeModel, tolerance: f64) {
    assert_eq!(a.hard().count(), b.hard().count(), "{:?}\n{:?}", a.report(), b.report());
    for e in a.hard() {
        let twin = b.hard().any(|f| {
            let d = |i: usize, j: usize| (e.ends[i] - f.ends[j]).norm();
            f.kind == e.kind && (d(0, 0).max(d(1, 1)) < tolerance || d(0, 1).max(d(1, 0)) < tolerance)
        });
        assert!(twin, "{:?} {:?} has no twin", e.kind, e.ends);
    }
}

#[test]
fn edges_of_the_castle_survive_soup() {
    let Some(root) = folder("VISP_IMAGES") else { return };
    for name in ["mbt-depth/Castle-simu/Models/chateau.wrl", "mbt/cube_and_cylinder.wrl"] {
        let mesh = load_mesh(root.join(name), Unit::Metre).unwrap();
        let options = EdgeOptions::default();
        let original = EdgeModel::new(&mesh, &options).unwrap();
        eprintln!("{name}: {:?}", original.report());
        for levels in 0..4 {
            let model = EdgeModel::new(&soup(&mesh, levels), &options).unwrap();
            assert_same_hard_edges(&original, &model, 2e-5 * mesh.diameter());
        }
    }
    let cube = load_mesh(root.join("mbt/cube.wrl"), Unit::Metre).unwrap();
    let model = EdgeModel::new(&cube, &EdgeOptions::default()).unwrap();
    assert_eq!((model.edges().len(), model.report().creases), (12, 12));
}
