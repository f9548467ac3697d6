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

#[test]
fn formats_of_other_programs() {
    let Some(root) = folder("VT_DATA") else { return };
    let load = |name: &str, unit| load_mesh(root.join("models").join(name), unit);
    // Vertices and faces as the headers state them, diameters computed from the texts by another program.
    let expected = [
        ("ply/bunny.ply", Unit::Metre, [35_947, 69_451, 0], 0.1983),
        ("ply/ape.ply", Unit::Millimetre, [5841, 11_678, 0], 0.102_099),
        ("ply/cow.ply", Unit::Metre, [2903, 5804, 0], 4.8277),
        ("ply/plane.ply", Unit::Metre, [1335, 2452, 0], 1515.87),
    ];
    for (name, unit, expected, diameter) in expected {
        let mesh = load(name, unit).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(counts(&mesh), expected, "{name}");
        let d = mesh.diameter();
        println!("{name}: diameter {d} m");
        assert!((d / diameter - 1.0).abs() < 0.02, "{name}: {d} m");
    }
    let ape = load("ply/ape.ply", Unit::Millimetre).unwrap();
    assert!(ape.polygons().iter().all(|p| p.colours.is_some() && p.normals.is_some()));
    for hand in ["hand/left.glb", "hand/right.glb"] {
        let mesh = load(hand, Unit::Metre).unwrap_or_else(|e| panic!("{e}"));
        // 6942 and about as many indices; some of the 1360 vertices are doubles at seams.
        let skin = mesh.skin().expect("a skinned hand");
        println!("{hand}: {:?}, {} joints, diameter {} m", counts(&mesh), skin.joints.len(), mesh.diameter());
        assert_eq!(skin.joints.len(), 25);
        assert!(skin.joints.iter().any(|j| j.name == "index-finger-tip"));
        assert!((2200..2400).contains(&mesh.polygons().len()) && mesh.vertices().len() <= 1360);
        assert!((0.15..0.3).contains(&mesh.diameter()), "{}", mesh.diameter());
        // The tip of the index finger lies at the surface.
        let tip = skin.joints.iter().find(|j| j.name == "index-finger-tip").unwrap();
        let tip = nalgebra::Point3::from(tip.object_from_joint.fixed_view::<3, 1>(0, 3).into_owned());
        let nearest = mesh.vertices().iter().map(|v| (v - tip).norm()).fold(f64::INFINITY, f64::min);
        assert!(nearest < 0.02, "{nearest} m");
        assert!(skin.weights.iter().all(|w| (w.iter().map(|w| w.1).sum::<f64>() - 1.0).abs() < 1e-6));
    }
    let draco = load("head/LeePerrySmith_draco.glb", Unit::Metre).unwrap_err().to_string();
    assert!(draco.contains("KHR_draco_mesh_compression"), "{draco}");
}

/// Every model file there is loads, or is refused for a reason that we know.
#[test]
fn every_model_file_loads() {
    let mut loaded = 0;
    for variable in ["VISP_IMAGES", "VT_DATA"] {
        let Some(root) = folder(variable) else { return };
        let start = if variable == "VT_DATA" { root.join("models") } else { root };
        let mut folders = vec![start];
        while let Some(next) = folders.pop() {
            for entry in std::fs::read_dir(&next).expect("a folder").filter_map(Result::ok) {
                let path = entry.path();
                let extension =
                    path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
                let known = ["wrl", "obj", "ply", "stl", "gltf", "glb", "cao"].contains(&extension.as_str());
                if path.is_dir() {
                    folders.push(path);
                } else if known {
                    let result = load_mesh(&path, Unit::Metre);
                    let refused = path.ends_with("LeePerrySmith_draco.glb");
                    assert_eq!(result.is_err(), refused, "{}: {:?}", path.display(), result.err());
                    loaded += usize::from(!refused);
                }
            }
        }
    }
    println!("{loaded} files");
    assert!(loaded >= 30, "{loaded} files");
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

/// The outline of the paper's Fig. 5: a hand in its bind pose, from the side on which it is broadest.
#[test]
fn the_hand_has_an_outline() {
    let Some(root) = folder("VT_DATA") else { return };
    let mesh = load_mesh(root.join("models/hand/right.glb"), Unit::Metre).unwrap_or_else(|e| panic!("{e}"));
    let bounds = mesh.bounds();
    let (size, centre) = (bounds.max - bounds.min, bounds.center());
    // Looking along the thinnest axis from ten diagonals away.
    let towards = nalgebra::Vector3::ith(size.imin(), 1.0);
    let turn = nalgebra::UnitQuaternion::rotation_between(&towards, &nalgebra::Vector3::z()).unwrap();
    let distance = 10.0 * bounds.diagonal();
    let shift = nalgebra::Vector3::new(0.0, 0.0, distance) - turn * centre.coords;
    let pose = vt_core::lie::SE3::new(turn, shift);
    let camera = vt_models::camera::Camera::new(3200.0, 3200.0, 319.5, 239.5, 640, 480).unwrap();
    let outline = vt_models::outline::Outline::silhouette(&mesh, &camera, &pose).unwrap().centred();
    let [low, high] = outline.bounds();
    let extent = high - low;
    let share = outline.area() / (extent.x * extent.y);
    println!("extent {extent}, share {share:.2}, length {:.0}", outline.length());
    // Fingers: less than its box, and a rim longer than that of the box.
    assert!((0.25..0.8).contains(&share), "{share}");
    assert!(outline.length() > 1.9 * (extent.x + extent.y), "{}", outline.length());
    let large = outline.scaled(150.0 / extent.max()).unwrap();
    assert_eq!(large.sample(60).points().len(), 60);
}
