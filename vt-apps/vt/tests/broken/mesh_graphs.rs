//! Model files whose parts refer to each other: circles, depth, references that multiply, compressed emptiness.

use std::fmt::Write;

use crate::support::{Case, Change, check, file};

fn case(
    what: &'static str,
    command: &'static str,
    changes: Vec<Change>,
    words: &'static [&'static str],
) -> Case {
    Case { what, changes, command, words }
}

const WRL: &str = "model inspect a.wrl";
const GLTF: &str = "model inspect a.gltf";

/// Ten levels of groups that each show the level below `uses` times.
fn multiplied(leaf: &str, levels: usize, uses: usize) -> String {
    let mut out = format!("#VRML V2.0 utf8\nSwitch {{ choice [ DEF L0 {leaf}\n");
    for k in 1..=levels {
        let below = format!("USE L{} ", k - 1).repeat(uses);
        let _ = writeln!(out, "DEF L{k} Group {{ children [ {below} ] }}");
    }
    let _ = writeln!(out, "] }}\nUSE L{levels}");
    out
}

#[test]
fn vrml_graphs() {
    let faces = "Shape { geometry IndexedFaceSet { coord Coordinate { point [0 0 0, 1 0 0, 0 1 0] } coordIndex [0 1 2 -1] } }";
    let lines = "Shape { geometry IndexedLineSet { coord Coordinate { point [0 0 0, 1 0 0, 0 1 0] } coordIndex [0 1 2 0 1 2 0 -1] } }";
    let spine: String = (0..4000).map(|k| format!("0 {k} 0, ")).collect();
    let section: String = (0..4000).map(|k| format!("{k} {}, ", k % 7)).collect();
    let extrusion = format!(
        "#VRML V2.0 utf8\nShape {{ geometry Extrusion {{ spine [{spine}] crossSection [{section}] }} }}\n"
    );
    check(vec![
        case(
            "nesting",
            WRL,
            vec![file("a.wrl", &format!("#VRML V2.0 utf8\n{}", "Group { children [\n".repeat(100_000)))],
            &["a.wrl:130", "nested braces", "at most 256"],
        ),
        case(
            "circle of USE",
            WRL,
            vec![file(
                "a.wrl",
                "#VRML V2.0 utf8\nDEF A Group { children [ USE A Shape { geometry Box {} } ] }\n",
            )],
            &["a.wrl", "expected"],
        ),
        case(
            "multiplied groups",
            WRL,
            vec![file("a.wrl", &multiplied("Group { }", 10, 10))],
            &["a.wrl", "1000000 nodes"],
        ),
        case(
            "multiplied faces",
            WRL,
            vec![file("a.wrl", &multiplied(faces, 10, 10))],
            &["a.wrl", "expected"],
        ),
        case(
            "multiplied lines",
            WRL,
            vec![file("a.wrl", &multiplied(lines, 10, 10))],
            &["a.wrl", "expected"],
        ),
        case(
            "multiplied spheres",
            WRL,
            vec![file("a.wrl", &multiplied("Shape { geometry Sphere { } }", 5, 10))],
            &["a.wrl", "at most"],
        ),
        case("square of an extrusion", WRL, vec![file("a.wrl", &extrusion)], &["Extrusion", "at most"]),
        case(
            "file that includes itself",
            WRL,
            vec![file("a.wrl", "#VRML V2.0 utf8\nInline { url \"a.wrl\" }\n")],
            &["a.wrl", "in a circle"],
        ),
        case(
            "file that includes itself twice",
            WRL,
            vec![file("a.wrl", &format!("#VRML V2.0 utf8\n{}", "Inline { url \"a.wrl\" }\n".repeat(30)))],
            &["a.wrl", "expected"],
        ),
        case(
            "included file that is not there",
            WRL,
            vec![file("a.wrl", "#VRML V2.0 utf8\nInline { url \"b.wrl\" }\n")],
            &["b.wrl", "cannot be read"],
        ),
        case("compressed gigabyte", WRL, vec![Change::File("a.wrl", bomb())], &["a.wrl", "expected at most"]),
        case(
            "compressed and cut",
            WRL,
            vec![Change::File("a.wrl", bomb()[..40_000].to_vec())],
            &["a.wrl", "expected"],
        ),
    ]);
}

/// A gzip file (RFC 1952) of 600 MB of zeros: one block of Deflate (RFC 1951) with fixed codes, in which each 13 bits
/// say "258 bytes as the one before".
fn bomb() -> Vec<u8> {
    let mut out = vec![0x1f, 0x8b, 8, 0, 0, 0, 0, 0, 0, 3];
    let (mut bits, mut count) = (0_u64, 0);
    let mut put = |value: u64, length: u32, out: &mut Vec<u8>| {
        bits |= value << count;
        count += length;
        while count >= 8 {
            out.push(bits as u8);
            bits >>= 8;
            count -= 8;
        }
    };
    // Last block, fixed codes; the literal 0 is 0b00110000 from its highest bit.
    put(0b011, 3, &mut out);
    put(0b0000_1100, 8, &mut out);
    for _ in 0..600_000_000 / 258 {
        // Length 258 is the code 285, 0b11000101 from its highest bit; distance 1 the code 0 of five bits.
        put(0b1010_0011, 8, &mut out);
        put(0, 5, &mut out);
    }
    out
}

#[test]
fn cao_graphs() {
    let mut chain: Vec<Change> = vec![];
    let names =
        ["a.cao", "b0.cao", "b1.cao", "b2.cao", "b3.cao", "b4.cao", "b5.cao", "b6.cao", "b7.cao", "b8.cao"];
    for (k, name) in names.iter().enumerate() {
        let next = names.get(k + 1).map_or(String::new(), |n| format!("load(\"{n}\")\n").repeat(10));
        chain.push(file(name, &format!("V1\n{next}3\n0 0 0\n1 0 0\n0 1 0\n0\n0\n1\n3 0 1 2\n")));
    }
    check(vec![
        case(
            "CAO in a circle",
            "model inspect a.cao",
            vec![file("a.cao", "V1\nload(\"a.cao\")\n0\n0\n0\n0\n")],
            &["a.cao:2", "no cyclic include"],
        ),
        case(
            "CAO of a missing file",
            "model inspect a.cao",
            vec![file("a.cao", "V1\nload(\"b.cao\")\n0\n0\n0\n0\n")],
            &["a.cao:2", "b.cao", "an existing file"],
        ),
        case("CAO whose files multiply", "model inspect a.cao", chain, &[".cao:", "expected at most"]),
    ]);
}

/// A triangle under nodes; `buffer` begins with its positions.
fn gltf(nodes: &str, more: &str) -> String {
    let positions: Vec<u8> =
        [0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].iter().flat_map(|x| x.to_le_bytes()).collect();
    // Each byte as a percent code would be no base64: six bits a letter, twelve letters nine bytes.
    const LETTERS: &[u8] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let letters: String = positions
        .chunks(3)
        .flat_map(|c| {
            let n = u32::from(c[0]) << 16 | u32::from(c[1]) << 8 | u32::from(c[2]);
            [18, 12, 6, 0].map(|s| char::from(LETTERS[(n >> s & 63) as usize]))
        })
        .collect();
    format!(
        r#"{{"asset": {{"version": "2.0"}}, "scenes": [{{"nodes": [0]}}], "scene": 0, "nodes": [{nodes}],
        "meshes": [{{"primitives": [{{"attributes": {{"POSITION": 0}}, "mode": 4}}]}}],
        "accessors": [{{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]{more}}}],
        "bufferViews": [{{"buffer": 0, "byteOffset": 0, "byteLength": 36}}],
        "buffers": [{{"byteLength": 36, "uri": "data:application/octet-stream;base64,{letters}"}}]}}"#
    )
}

#[test]
fn sides_without_number() {
    let points: String =
        (0..20_000).map(|k| format!("v {} {} {}\n", k % 97 + 1, k % 89 + 1, k % 83)).collect();
    let book: String = (3..20_000).map(|k| format!("f 1 2 {k}\n")).collect();
    let star: String = (3..20_000).map(|k| format!("l 1 {k}\n")).collect();
    let case =
        |what, text: String, words| case(what, "model inspect a.obj", vec![file("a.obj", &text)], words);
    check(vec![
        case(
            "faces at one side",
            format!("v 0 0 0\nv 0 0 10\n{points}{book}"),
            &["a.obj", "faces at one side", "at most 1000"],
        ),
        case(
            "lines at one place",
            format!("v 0 0 0\nv 0 0 10\n{points}{star}"),
            &["a.obj", "sides of the edges", "20 million pairs"],
        ),
        case(
            "face of many corners",
            format!("{points}f {}\n", (1..5000).map(|k| format!("{k} ")).collect::<String>()),
            &["a.obj", "polygon 0", "at most 4096"],
        ),
    ]);
}

#[test]
fn gltf_graphs() {
    let leaf = r#"{"mesh": 0}"#;
    let deep: Vec<String> =
        (1..3000).map(|k| format!(r#"{{"children": [{k}]}}"#)).chain([leaf.into()]).collect();
    let levels = 8;
    let wide: Vec<String> = (0..levels)
        .map(|k| {
            let children: Vec<String> = (0..10).map(|_| (k + 1).to_string()).collect();
            format!(r#"{{"children": [{}]}}"#, children.join(","))
        })
        .chain([leaf.into()])
        .collect();
    let good = gltf(leaf, "");
    let one = |what, text: String, words| case(what, GLTF, vec![file("a.gltf", &text)], words);
    let glb = |length: u32| {
        let mut out = b"glTF".to_vec();
        out.extend([2_u32, length, 4_000_000_000, 0x4e4f_534a].iter().flat_map(|v| v.to_le_bytes()));
        out
    };
    check(vec![
        one("glTF empty", String::new(), &["a.gltf", "expected glTF 2.0"]),
        one("glTF cut", good[..200].to_owned(), &["a.gltf", "line 3", "expected glTF 2.0"]),
        one("glTF of another version", good.replace("\"2.0\"", "\"x\""), &["a.gltf", "expected"]),
        one("glTF without mesh", gltf("{}", ""), &["a.gltf", "mesh is empty"]),
        one(
            "glTF in a circle",
            gltf(r#"{"children": [1]}, {"children": [0], "mesh": 0}"#, ""),
            &["a.gltf", "node", "a tree within"],
        ),
        one("glTF that is deep", gltf(&deep.join(","), ""), &["a.gltf", "node", "256 levels"]),
        one("glTF whose nodes multiply", gltf(&wide.join(","), ""), &["a.gltf", "expected"]),
        one(
            "glTF node that is not there",
            gltf(r#"{"children": [7], "mesh": 0}"#, ""),
            &["a.gltf", "expected"],
        ),
        one(
            "glTF that promises too much",
            good.replace("\"count\": 3", "\"count\": 3000000000"),
            &["accessor 0", "3000000000 elements", "hold"],
        ),
        one(
            "glTF offset beyond all numbers",
            gltf(leaf, r#", "byteOffset": 18446744073709551612"#),
            &["accessor 0", "expected"],
        ),
        one(
            "glTF buffer that is short",
            good.replace("\"byteLength\": 36, \"uri\"", "\"byteLength\": 3600, \"uri\""),
            &["buffer 0", "36 bytes", "3600 bytes"],
        ),
        one(
            "glTF buffer that is not there",
            good.replace("data:application/octet-stream;base64,", "no.bin?"),
            &["no.bin", "cannot be read"],
        ),
        case(
            "GLB cut",
            "model inspect a.glb",
            vec![Change::File("a.glb", glb(20))],
            &["a.glb", "expected glTF 2.0"],
        ),
        case(
            "GLB that promises too much",
            "model inspect a.glb",
            vec![Change::File("a.glb", glb(u32::MAX))],
            &["a.glb", "expected glTF 2.0"],
        ),
    ]);
}
