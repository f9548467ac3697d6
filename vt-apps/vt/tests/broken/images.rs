//! Pictures.

use crate::support::{Case, Change, RUN, check, file, pgm};

/// A picture of 64x48 pixels in a format.
fn coded(format: image::ImageFormat) -> Vec<u8> {
    let picture = image::GrayImage::from_fn(64, 48, |x, y| image::Luma([(x * y) as u8]));
    let mut out = std::io::Cursor::new(vec![]);
    picture.write_to(&mut out, format).unwrap();
    out.into_inner()
}

/// The third of four pictures in the middle of a run.
const THIRD: &str = "frames/f2.pgm";

fn third(what: &'static str, bytes: Vec<u8>, words: &'static [&'static str]) -> Case {
    Case { what, changes: vec![Change::File(THIRD, bytes)], command: RUN, words }
}

/// The chunk with the size of a PNG, for a grey picture of 8 bits.
fn png_header(width: u32, height: u32) -> Vec<u8> {
    let mut out = coded(image::ImageFormat::Png);
    out[16..20].copy_from_slice(&width.to_be_bytes());
    out[20..24].copy_from_slice(&height.to_be_bytes());
    out
}

#[test]
fn pictures_that_are_not_whole_or_not_pictures() {
    let cut = |format, keep: usize| {
        let mut bytes = coded(format);
        bytes.truncate(keep.min(bytes.len() - 20));
        bytes
    };
    let mut late = coded(image::ImageFormat::Jpeg);
    late.truncate(late.len() - 2);
    let mut damaged = coded(image::ImageFormat::Png);
    let middle = damaged.len() / 2;
    damaged[middle] ^= 0xff;
    check(vec![
        third("empty", vec![], &["f2.pgm", "in 0 bytes", "expected a whole PNG, JPEG or PNM picture"]),
        third("text", b"no picture".to_vec(), &["f2.pgm", "in 10 bytes", "expected a whole PNG"]),
        third("PGM cut in its header", b"P5\n64 4".to_vec(), &["f2.pgm", "in 7 bytes", "expected"]),
        third("PGM cut in its pixels", pgm(64, 48)[..700].to_vec(), &["f2.pgm", "in 700 bytes", "expected"]),
        third("PNG cut after its signature", cut(image::ImageFormat::Png, 8), &["f2.pgm", "in 8 bytes"]),
        third("PNG cut in its pixels", cut(image::ImageFormat::Png, 300), &["f2.pgm", "expected a whole"]),
        third("PNG with a flipped byte", damaged, &["f2.pgm", "expected a whole"]),
        third("JPEG cut in its header", cut(image::ImageFormat::Jpeg, 100), &["f2.pgm", "in 100 bytes"]),
        third("JPEG cut in its pixels", cut(image::ImageFormat::Jpeg, 900), &["f2.pgm", "expected a whole"]),
        third("JPEG without its end", late, &["f2.pgm", "no end of the JPEG"]),
        third(
            "GIF, which is not read",
            b"GIF89a\x01\0\x01\0\0\0\0;".to_vec(),
            &["f2.pgm", "expected a whole PNG"],
        ),
        third("PGM with letters for a size", b"P5\nab cd\n255\n".to_vec(), &["f2.pgm", "expected a whole"]),
    ]);
}

#[test]
fn pictures_of_a_wrong_size() {
    check(vec![
        third("larger", pgm(65, 48), &["f2.pgm", "65x48 pixels", "expected 64x48 as the camera says"]),
        third("turned", pgm(48, 64), &["f2.pgm", "48x64 pixels", "expected 64x48"]),
        third("one pixel", pgm(1, 1), &["f2.pgm", "1x1 pixels", "expected 64x48"]),
        third("no column", b"P5\n0 48\n255\n".to_vec(), &["f2.pgm", "expected"]),
        third(
            "PGM that claims to be huge",
            b"P5\n60000 60000\n255\n".to_vec(),
            &["f2.pgm", "60000x60000", "64x48"],
        ),
        third("PNG that claims to be huge", png_header(60_000, 60_000), &["f2.pgm", "expected"]),
        third("PNG without rows", png_header(64, 0), &["f2.pgm", "expected"]),
        Case {
            what: "first picture of another size",
            changes: vec![Change::File("frames/f0.pgm", pgm(32, 24))],
            command: RUN,
            words: &["f0.pgm", "32x24 pixels", "expected 64x48"],
        },
        Case {
            what: "camera of another size",
            changes: vec![Change::Task("size = [64, 48]", "size = [640, 480]")],
            command: RUN,
            words: &["f0.pgm", "64x48 pixels", "expected 640x480"],
        },
    ]);
}

#[test]
fn pictures_that_are_not_there() {
    let folder = || Change::Task("pattern = \"frames/f%d.pgm\", last = 3", "folder = \"frames\"");
    let times = || Change::Task("rate = \"25 Hz\"", "timestamps = \"times.txt\"");
    let case = |what, changes, words| Case { what, changes, command: RUN, words };
    check(vec![
        case(
            "gap in the numbers",
            vec![Change::Gone(THIRD)],
            &["f2.pgm", "expected frame 2 of the sequence", "task.toml:7"],
        ),
        case("folder for a picture", vec![Change::Folder(THIRD)], &["f2.pgm", "expected frame 2"]),
        case("pipe for a picture", vec![Change::Pipe(THIRD)], &["f2.pgm", "expected frame 2"]),
        case(
            "pipe in a folder of pictures",
            vec![folder(), Change::Pipe(THIRD)],
            &["f2.pgm", "no regular file", "expected a file"],
        ),
        case(
            "folder in a folder of pictures",
            vec![folder(), Change::Folder(THIRD)],
            &["f2.pgm", "found a folder; expected a file"],
        ),
        case(
            "folder without pictures",
            vec![folder(), Change::Gone("frames"), Change::Folder("frames")],
            &["frames", "no pictures", "expected files ending in png"],
        ),
        case(
            "file for the folder",
            vec![folder(), Change::Gone("frames"), file("frames", "no folder")],
            &["frames", "task.toml:7", "readable pictures"],
        ),
        case(
            "no folder",
            vec![folder(), Change::Gone("frames")],
            &["frames", "does not exist", "task.toml:7"],
        ),
        case(
            "no folder of the pattern",
            vec![Change::Gone("frames")],
            &["frames", "does not exist", "task.toml:7"],
        ),
        case(
            "pattern without number",
            vec![Change::Task("f%d.pgm", "f0.pgm")],
            &["f0.pgm", "expected a path with one `%d`"],
        ),
        case(
            "pattern of two numbers",
            vec![Change::Task("f%d.pgm", "f%d%d.pgm")],
            &["f%d%d.pgm", "expected one `%d`"],
        ),
        case(
            "pattern of an endless number",
            vec![Change::Task("f%d.pgm", "f%099999d.pgm")],
            &["%099999d", "expected one `%d`"],
        ),
        case(
            "last before first",
            vec![Change::Task("last = 3", "last = 3, first = 9")],
            &["`first`", "task.toml:7"],
        ),
        case("no step", vec![Change::Task("last = 3", "last = 3, step = 0")], &["expected a step from 1"]),
        case("no times", vec![times()], &["times.txt", "does not exist", "task.toml:7"]),
        case(
            "too few times",
            vec![times(), file("times.txt", "0\n0.1\n")],
            &["times.txt", "2 times; expected one for each of 4"],
        ),
        case(
            "times that go back",
            vec![times(), file("times.txt", "0\n2\n1\n3\n")],
            &["times.txt", "not after"],
        ),
        case(
            "NaN for a time",
            vec![times(), file("times.txt", "0\nnan\n1\n3\n")],
            &["times.txt", "line 2", "`nan`"],
        ),
        case(
            "a time of 1e300 s",
            vec![times(), file("times.txt", "0\n1\n1e300\n3\n")],
            &["times.txt", "line 3", "below 4e9"],
        ),
        case(
            "two times of a frame",
            vec![times(), file("times.txt", "0 0\n1 1\n1 2\n3 3\n")],
            &["times.txt", "line 3", "second time of frame 1"],
        ),
        case(
            "three words for a time",
            vec![times(), file("times.txt", "0 0 0\n")],
            &["times.txt", "line 1", "`frame seconds`"],
        ),
    ]);
}
