//! Videos as sensors, on files made here. Without the program `ffmpeg` they are skipped, unless `VT_REQUIRE_DATA=1`.

use std::path::{Path, PathBuf};
use std::process::Command;

use image::{GrayImage, Luma, Rgb, RgbImage};
use vt_core::agent::Sensor;
use vt_core::frame::{Frame, SensorId};
use vt_io::images::Conversion;
use vt_io::video::{Programs, Settings, Video};

fn installed() -> bool {
    let found = Command::new("ffmpeg").arg("-version").output().is_ok();
    let required = std::env::var_os("VT_REQUIRE_DATA").is_some_and(|v| v == "1");
    assert!(found || !required, "`ffmpeg` must be installed");
    if !found {
        println!("skipped: `ffmpeg` is not installed");
    }
    found
}

fn ffmpeg(arguments: &[&str]) {
    let output =
        Command::new("ffmpeg").args(["-nostdin", "-v", "error", "-y"]).args(arguments).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

const SIZE: [u32; 2] = [50, 38];

fn colour(k: u32, x: u32, y: u32) -> Rgb<u8> {
    Rgb([(5 * x + k) as u8, (6 * y + 3 * k) as u8, (x * y + 7 * k) as u8])
}

/// Twelve pictures at 10 Hz, without loss; of one colour channel where `grey`.
fn lossless(folder: &Path, grey: bool) -> PathBuf {
    for k in 0..12 {
        let file = folder.join(format!("p{k:02}.png"));
        match grey {
            true => {
                GrayImage::from_fn(SIZE[0], SIZE[1], |x, y| Luma([colour(k, x, y).0[2]])).save(file).unwrap()
            }
            false => RgbImage::from_fn(SIZE[0], SIZE[1], |x, y| colour(k, x, y)).save(file).unwrap(),
        }
    }
    let (pattern, video) = (folder.join("p%02d.png"), folder.join("video.mkv"));
    let [pattern, file] = [&pattern, &video].map(|p| p.to_str().unwrap());
    let format = if grey { "gray" } else { "bgr0" };
    ffmpeg(&["-framerate", "10", "-i", pattern, "-c:v", "ffv1", "-pix_fmt", format, file]);
    video
}

fn open(path: &Path, settings: Settings) -> Video {
    Video::open(SensorId(3), path, settings).unwrap()
}

fn frames(video: &mut Video) -> Vec<Frame> {
    std::iter::from_fn(|| video.next().unwrap()).collect()
}

#[test]
fn frames_are_those_of_the_file_at_its_times() {
    if !installed() {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let path = lossless(dir.path(), false);
    let mut video = open(&path, Settings { conversion: Conversion::Rgb, ..Settings::default() });
    assert_eq!((video.size(), video.remaining()), (SIZE, Some(12)));
    let all = frames(&mut video);
    assert_eq!((all.len(), video.remaining()), (12, Some(0)));
    for (k, frame) in all.iter().enumerate() {
        assert_eq!((frame.number, frame.time.0, frame.sensor.0), (k as u64, 100_000_000 * k as i64, 3));
        let picture = frame.rgb().unwrap();
        assert!(picture.enumerate_pixels().all(|(x, y, p)| *p == colour(k as u32, x, y)), "frame {k}");
    }
    assert!(video.next().unwrap().is_none());
    let part = Settings {
        rate: Some(4.0),
        start: 5,
        frames: Some(3),
        conversion: Conversion::Rgb,
        ..Settings::default()
    };
    let part = frames(&mut open(&path, part));
    assert_eq!(
        part.iter().map(|f| (f.number, f.time.seconds())).collect::<Vec<_>>(),
        [(5, 1.25), (6, 1.5), (7, 1.75)]
    );
    assert!(part.iter().all(|f| f.rgb().unwrap() == all[f.number as usize].rgb().unwrap()));
}

#[test]
fn grey_videos_are_grey() {
    if !installed() {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let path = lossless(dir.path(), true);
    for (k, frame) in frames(&mut open(&path, Settings::default())).iter().enumerate() {
        let picture = frame.grey().unwrap();
        assert!(
            picture.enumerate_pixels().all(|(x, y, p)| p.0[0] == colour(k as u32, x, y).0[2]),
            "frame {k}"
        );
    }
}

/// Pictures that predict each other are stored in another order than they are shown.
#[test]
fn times_are_in_the_order_of_showing() {
    if !installed() {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("b.mp4");
    let source = "testsrc=size=64x48:rate=25:duration=1";
    ffmpeg(&["-f", "lavfi", "-i", source, "-c:v", "mpeg4", "-bf", "2", path.to_str().unwrap()]);
    let all = frames(&mut open(&path, Settings::default()));
    assert_eq!(all.len(), 25);
    assert!(all.iter().enumerate().all(|(k, f)| f.time.0 == 40_000_000 * k as i64));
}

fn failure(path: &Path, settings: Settings) -> String {
    let mut video = match Video::open(SensorId(0), path, settings) {
        Ok(video) => video,
        Err(e) => return e.to_string(),
    };
    loop {
        match video.next() {
            Ok(Some(_)) => {}
            Ok(None) => return String::new(),
            Err(e) => {
                assert!(video.next().unwrap().is_none(), "after an error it has ended");
                return e.to_string();
            }
        }
    }
}

#[test]
fn what_is_no_whole_video_is_an_error_that_names_the_file() {
    if !installed() {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let whole = dir.path().join("whole.mp4");
    let source = "testsrc=size=160x120:rate=25:duration=2";
    let fast = ["-c:v", "mpeg4", "-movflags", "+faststart"];
    ffmpeg(&[&["-f", "lavfi", "-i", source][..], &fast, &[whole.to_str().unwrap()]].concat());
    assert_eq!(failure(&whole, Settings::default()), "");
    let bytes = std::fs::read(&whole).unwrap();
    for cut in [10, 200, bytes.len() / 3, bytes.len() * 2 / 3] {
        let path = dir.path().join("cut.mp4");
        std::fs::write(&path, &bytes[..cut]).unwrap();
        let said = failure(&path, Settings::default());
        assert!(said.contains("cut.mp4"), "cut at {cut}: {said}");
    }
    let text = dir.path().join("text.mp4");
    std::fs::write(&text, "no video at all").unwrap();
    assert!(failure(&text, Settings::default()).contains("expected a video"));
    std::fs::write(&text, "").unwrap();
    assert!(failure(&text, Settings::default()).contains("text.mp4"));
    assert!(failure(dir.path(), Settings::default()).contains("no regular file"));
    assert!(failure(&dir.path().join("none.mp4"), Settings::default()).contains("none.mp4"));
    let wide = Settings { size: Some([640, 480]), ..Settings::default() };
    assert!(failure(&whole, wide).contains("160x120 pixels; expected 640x480"));
    let late = Settings { start: 50, ..Settings::default() };
    assert!(failure(&whole, late).contains("50 frames"));
    let never = Settings { rate: Some(0.0), ..Settings::default() };
    assert!(failure(&whole, never).contains("0 Hz"));
    // Sound only.
    let sound = dir.path().join("sound.wav");
    ffmpeg(&["-f", "lavfi", "-i", "sine=duration=0.1", sound.to_str().unwrap()]);
    assert!(failure(&sound, Settings::default()).contains("no pictures"));
}

#[test]
fn a_missing_program_is_an_error_that_says_what_to_install() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.mp4");
    std::fs::write(&path, "x").unwrap();
    let programs = Programs { ffprobe: "no-such-probe".into(), ..Programs::default() };
    let said = failure(&path, Settings { programs, ..Settings::default() });
    assert!(said.contains("no-such-probe") && said.contains("install the package `ffmpeg`"), "{said}");
}

/// Whoever stops in the middle does not wait for the rest.
#[test]
fn an_early_end_ends_the_program() {
    if !installed() {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("long.mkv");
    let source = "color=size=640x480:rate=25:duration=120";
    ffmpeg(&["-f", "lavfi", "-i", source, "-c:v", "mpeg4", path.to_str().unwrap()]);
    let mut video = open(&path, Settings { conversion: Conversion::Rgb, ..Settings::default() });
    assert_eq!(video.next().unwrap().unwrap().number, 0);
    // It has filled the pipe and waits: without an end to it this would never return.
    drop(video);
    let mut video = open(&path, Settings { frames: Some(2), ..Settings::default() });
    assert_eq!(frames(&mut video).len(), 2);
}
