use super::*;

use vt_core::laws::{damage, for_cases};

/// A small picture of all kinds that are read, with edges and a slope.
fn files() -> Vec<(&'static str, Vec<u8>)> {
    let picture = image::RgbImage::from_fn(24, 16, |x, y| image::Rgb([(8 * x) as u8, (x * y) as u8, 90]));
    let grey = DynamicImage::ImageRgb8(picture.clone()).into_luma8();
    let coded = |picture: DynamicImage, format| {
        let mut out = Cursor::new(vec![]);
        picture.write_to(&mut out, format).unwrap();
        out.into_inner()
    };
    vec![
        ("p.png", coded(picture.clone().into(), ImageFormat::Png)),
        ("p.jpg", coded(picture.clone().into(), ImageFormat::Jpeg)),
        ("p.ppm", coded(picture.into(), ImageFormat::Pnm)),
        ("p.pgm", coded(grey.into(), ImageFormat::Pnm)),
    ]
}

#[test]
fn a_picture_cut_off_anywhere_is_an_error_that_names_the_file() {
    let dir = tempfile::tempdir().unwrap();
    for (name, bytes) in files() {
        let path = dir.path().join(name);
        std::fs::write(&path, &bytes).unwrap();
        assert_eq!(decode(&path, Some([24, 16])).unwrap().width(), 24);
        // The last chunk of a PNG says nothing but that it is the last one.
        let whole = bytes.len() - if name == "p.png" { 12 } else { 0 };
        for end in 0..whole {
            std::fs::write(&path, &bytes[..end]).unwrap();
            let e = decode(&path, None).expect_err(name).to_string();
            assert!(e.contains(name) && e.contains("expected"), "{end}: {e}");
        }
    }
}

#[test]
fn sizes_that_a_file_cannot_hold_are_refused_before_memory_is_asked_for() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("huge.pgm");
    for header in ["P5\n60000 60000\n255\n", "P5\n9000 9000\n255\n", "P5 0 7 255\n", "P2 30000 30000 255 1 2"]
    {
        std::fs::write(&path, header).unwrap();
        let e = decode(&path, None).unwrap_err().to_string();
        assert!(e.contains("huge.pgm") && e.contains("PNM"), "{e}");
    }
    std::fs::write(&path, "P5\n60000 60000\n255\n").unwrap();
    let e = decode(&path, Some([8, 6])).unwrap_err().to_string();
    assert!(e.contains("60000x60000 pixels; expected 8x6"), "{e}");
}

#[test]
fn damaged_pictures_are_pictures_or_errors() {
    let dir = tempfile::tempdir().unwrap();
    let files = files();
    for_cases(2000, (0..files.len(), damage()), |(kind, damage)| {
        let (name, bytes) = &files[kind];
        let path = dir.path().join(name);
        std::fs::write(&path, damage.apply(bytes)).unwrap();
        match decode(&path, None) {
            Ok(picture) => assert!(picture.width() > 0 && picture.height() > 0),
            Err(e) => assert!(e.to_string().contains(name), "{e}"),
        }
    });
}
