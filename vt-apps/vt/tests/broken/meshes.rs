//! Model files.

use crate::support::{CUBE, Case, Change, RUN, check, file, task};

fn inspect(
    what: &'static str,
    name: &'static str,
    content: impl AsRef<[u8]>,
    words: &'static [&'static str],
) -> Case {
    let command: &'static str = match name {
        "a.obj" => "model inspect a.obj",
        "a.ply" => "model inspect a.ply",
        "a.stl" => "model inspect a.stl",
        "a.wrl" => "model inspect a.wrl",
        "a.cao" => "model inspect a.cao",
        "a.gltf" => "model inspect a.gltf",
        "a.glb" => "model inspect a.glb",
        _ => "model inspect a.xyz",
    };
    Case { what, changes: vec![Change::File(name, content.as_ref().to_vec())], command, words }
}

/// The header of a PLY with these counts.
fn ply(format: &str, vertices: &str, faces: &str) -> String {
    format!(
        "ply\nformat {format} 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    )
}

fn wrl(points: &str, indices: &str) -> String {
    format!(
        "#VRML V2.0 utf8\nShape {{ geometry DEF F IndexedFaceSet {{ coord Coordinate {{ point [{points}] }} coordIndex [{indices}] }} }}\n"
    )
}

#[test]
fn wavefront() {
    check(vec![
        inspect("OBJ empty", "a.obj", "", &["a.obj", "mesh is empty", "expected at least one"]),
        inspect("OBJ of points", "a.obj", "v 0 0 0\nv 1 0 0\n", &["a.obj", "mesh is empty"]),
        inspect(
            "OBJ with a letter",
            "a.obj",
            CUBE.replace("v 10 10 10", "v 10 x 10"),
            &["a.obj:8", "v x y z"],
        ),
        inspect(
            "OBJ index too high",
            "a.obj",
            CUBE.replace("7 3", "7 99"),
            &["a.obj:9", "existing vertices"],
        ),
        inspect("OBJ index zero", "a.obj", CUBE.replace("7 3", "7 0"), &["a.obj:9", "indices"]),
        inspect(
            "OBJ NaN",
            "a.obj",
            CUBE.replace("v 10 10 10", "v nan 10 10"),
            &["a.obj", "vertex", "finite"],
        ),
        inspect(
            "OBJ infinite",
            "a.obj",
            CUBE.replace("v 10 10 10", "v 1e999 10 10"),
            &["a.obj", "vertex", "finite"],
        ),
        inspect(
            "OBJ far away",
            "a.obj",
            CUBE.replace("v 10 10 10", "v 1e200 10 10"),
            &["a.obj", "vertex", "1e12"],
        ),
        inspect(
            "OBJ all in one point",
            "a.obj",
            "v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\n",
            &["a.obj", "expected"],
        ),
        inspect("OBJ of binary rubbish", "a.obj", [0xff_u8; 300], &["a.obj", "mesh is empty"]),
    ]);
}

#[test]
fn polygon_file_format() {
    let text = ply("ascii", "3", "1");
    check(vec![
        inspect("PLY empty", "a.ply", "", &["a.ply:1", "expected PLY"]),
        inspect("PLY cut in its header", "a.ply", &text[..60], &["a.ply", "expected PLY"]),
        inspect("PLY of points", "a.ply", ply("ascii", "1", "0") + "0 0 0\n", &["a.ply", "mesh is empty"]),
        inspect(
            "PLY index too high",
            "a.ply",
            text.clone() + "0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n",
            &["face 0", "index 7", "below 3"],
        ),
        inspect(
            "PLY index negative",
            "a.ply",
            text.clone() + "0 0 0\n1 0 0\n0 1 0\n3 0 1 -2\n",
            &["a.ply", "face 0", "whole numbers from 0"],
        ),
        inspect(
            "PLY NaN",
            "a.ply",
            text.clone() + "0 0 0\nnan 0 0\n0 1 0\n3 0 1 2\n",
            &["a.ply:11", "nan", "expected PLY"],
        ),
        inspect(
            "PLY with a row missing",
            "a.ply",
            text.clone() + "0 0 0\n1 0 0\n0 1 0\n",
            &["a.ply:13", "1 elements `face`", "has room for"],
        ),
        inspect(
            "PLY that promises too much",
            "a.ply",
            ply("ascii", "4000000000", "1"),
            &["a.ply:", "4000000000 elements", "has room for"],
        ),
        inspect(
            "PLY, binary, that promises too much",
            "a.ply",
            ply("binary_little_endian", "999999999", "1"),
            &["a.ply:", "has room for"],
        ),
        inspect(
            "PLY of a face of two",
            "a.ply",
            text.clone() + "0 0 0\n1 0 0\n0 1 0\n2 0 1\n",
            &["polygon 0", "2 corners", "at least 3"],
        ),
        inspect(
            "PLY of unknown format",
            "a.ply",
            ply("binary_middle_endian", "3", "1"),
            &["a.ply:2", "expected PLY"],
        ),
    ]);
}

#[test]
fn stereolithography() {
    let binary = |count: u32, records: usize| {
        let mut out = vec![b' '; 80];
        out.extend(count.to_le_bytes());
        out.resize(84 + 50 * records, 0x7f);
        out
    };
    check(vec![
        inspect("STL empty", "a.stl", "", &["a.stl", "0 bytes", "a header of 84 bytes"]),
        inspect("STL cut", "a.stl", binary(2, 1), &["a.stl", "2 triangles", "at most the 1"]),
        inspect(
            "STL that promises too much",
            "a.stl",
            binary(u32::MAX, 1),
            &["a.stl", "4294967295 triangles", "at most the 1"],
        ),
        inspect("STL without triangles", "a.stl", binary(0, 0), &["a.stl", "mesh is empty"]),
        inspect("STL far away", "a.stl", binary(1, 1), &["a.stl", "vertex 0", "expected"]),
        inspect(
            "STL as text without its end",
            "a.stl",
            "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\n",
            &["a.stl:4", "`endsolid`"],
        ),
        inspect(
            "STL as text with a letter",
            "a.stl",
            "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 x 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid a\n",
            &["a.stl:2", "vertex x y z"],
        ),
    ]);
}

#[test]
fn vrml() {
    check(vec![
        inspect("VRML empty", "a.wrl", "", &["a.wrl:1", "the header `#VRML V2.0 utf8`"]),
        inspect("VRML of version 1", "a.wrl", "#VRML V1.0 ascii\n", &["a.wrl:1", "V1.0", "#VRML V2.0"]),
        inspect("VRML without content", "a.wrl", "#VRML V2.0 utf8\n", &["a.wrl", "mesh is empty"]),
        inspect(
            "VRML cut",
            "a.wrl",
            &wrl("0 0 0, 1 0 0, 0 1 0", "0 1 2 -1")[..90],
            &["a.wrl:2", "expected VRML97"],
        ),
        inspect("VRML of points", "a.wrl", wrl("0 0 0, 1 0 0", ""), &["a.wrl", "mesh is empty"]),
        inspect(
            "VRML index too high",
            "a.wrl",
            wrl("0 0 0, 1 0 0, 0 1 0", "0 1 9 -1"),
            &["IndexedFaceSet F", "coordIndex 9", "below 3"],
        ),
        inspect(
            "VRML face of two",
            "a.wrl",
            wrl("0 0 0, 1 0 0, 0 1 0", "0 1 -1"),
            &["IndexedFaceSet F", "2 corners", "at least 3"],
        ),
        inspect(
            "VRML far away",
            "a.wrl",
            wrl("0 0 0, 1e30 0 0, 0 1 0", "0 1 2 -1"),
            &["a.wrl", "vertex 1", "1e12"],
        ),
        inspect(
            "VRML of unknown node",
            "a.wrl",
            "#VRML V2.0 utf8\nShapee { }\n",
            &["a.wrl", "line 2", "Shapee", "expected nodes of VRML97"],
        ),
        inspect(
            "VRML grid without heights",
            "a.wrl",
            "#VRML V2.0 utf8\nShape { geometry ElevationGrid { xDimension 60000 zDimension 60000 height [1] } }\n",
            &["ElevationGrid", "1 heights", "60000 x 60000"],
        ),
    ]);
}

#[test]
fn cao() {
    let good = "V1\n3\n0 0 0\n1 0 0\n0 1 0\n0\n0\n1\n3 0 1 2\n";
    check(vec![
        inspect("CAO empty", "a.cao", "", &["a.cao:1", "the version `V1`"]),
        inspect(
            "CAO of version 2",
            "a.cao",
            good.replace("V1", "V2"),
            &["a.cao:1", "`V2`", "the version `V1`"],
        ),
        inspect("CAO cut", "a.cao", &good[..18], &["a.cao:5", "1 numbers", "three coordinates of a point"]),
        inspect("CAO of points", "a.cao", "V1\n1\n0 0 0\n0\n0\n0\n", &["a.cao", "mesh is empty"]),
        inspect(
            "CAO index too high",
            "a.cao",
            good.replace("3 0 1 2", "3 0 1 8"),
            &["a.cao:9", "`8`", "point below 3"],
        ),
        inspect(
            "CAO NaN",
            "a.cao",
            good.replace("1 0 0", "nan 0 0"),
            &["a.cao:4", "`nan`", "three coordinates"],
        ),
        inspect(
            "CAO that promises too much",
            "a.cao",
            good.replace("V1\n3", "V1\n99999999999"),
            &["a.cao:", "expected"],
        ),
        inspect(
            "CAO of unknown option",
            "a.cao",
            good.replace("3 0 1 2", "3 0 1 2 nam=a"),
            &["a.cao:9", "`nam=`", "name="],
        ),
        inspect(
            "CAO with more than its sections",
            "a.cao",
            format!("{good}0\n0\n7\n"),
            &["a.cao:12", "the end of the file"],
        ),
    ]);
}

#[test]
fn files_and_units() {
    let part = "file = \"cube.obj\", unit = \"cm\"";
    check(vec![
        inspect("format that is not known", "a.xyz", "1 2 3", &["a.xyz", "`xyz`", ".wrl", ".glb"]),
        Case {
            what: "no file",
            changes: vec![],
            command: "model inspect no.obj",
            words: &["no.obj", "cannot be read"],
        },
        Case {
            what: "folder",
            changes: vec![Change::Folder("a.obj")],
            command: "model inspect a.obj",
            words: &["a.obj", "found a folder"],
        },
        Case {
            what: "pipe",
            changes: vec![Change::Pipe("a.obj")],
            command: "model inspect a.obj",
            words: &["a.obj", "no regular file"],
        },
        Case { what: "device", changes: vec![], command: "model inspect /dev/zero", words: &["/dev/zero"] },
        Case {
            what: "unknown unit",
            changes: vec![],
            command: "model inspect cube.obj --unit km",
            words: &["km", "m, cm, mm, in"],
        },
        task("no unit in the task", part, "file = \"cube.obj\"", &["task.toml:12", "missing key `unit`"]),
        task(
            "misspelt unit",
            part,
            "file = \"cube.obj\", unit = \"mn\"",
            &["task.toml:12", "`mn`", "nearest: `m`", "mm, in"],
        ),
        task(
            "unit of an angle",
            part,
            "file = \"cube.obj\", unit = \"deg\"",
            &["task.toml:12", "`deg`", "m, cm, mm, in"],
        ),
        task(
            "no model file",
            part,
            "file = \"cub.obj\", unit = \"m\"",
            &["task.toml:12", "cub.obj does not exist"],
        ),
        task(
            "no part",
            "parts = [{ file = \"cube.obj\", unit = \"cm\" }]",
            "parts = []",
            &["task.toml:12", "at least one part"],
        ),
        Case {
            what: "broken model of a task",
            changes: vec![file("cube.obj", &CUBE.replace("f 1 5 7 3", "f 1 5 77 3"))],
            command: RUN,
            words: &["task.toml:12", "cube.obj:9", "existing vertices"],
        },
        Case {
            what: "empty model of a task",
            changes: vec![file("cube.obj", "")],
            command: RUN,
            words: &["task.toml:12", "cube.obj", "mesh is empty"],
        },
        Case {
            what: "broken model of a score",
            changes: vec![file("cube.obj", "f 1 2 3\n")],
            command: "eval estimates.tum --truth truth.tum --model cube.obj --unit cm",
            words: &["--model", "cube.obj:1", "existing vertices"],
        },
    ]);
}
