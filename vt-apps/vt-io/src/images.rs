//! Pictures of a folder as a sensor.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use vt_core::agent::Sensor;
use vt_core::error::DeviceError;
use vt_core::frame::{Frame, Payload, SensorId};
use vt_core::time::Timestamp;

use crate::picture::decode;

/// Which files.
#[derive(Clone, Debug, PartialEq)]
pub enum Files {
    /// Names by number, as `Image_%04d.pgm`; without `last` up to the first that is missing.
    Pattern {
        /// Path with one `%d` or `%0Nd`.
        pattern: PathBuf,
        /// First number.
        first: u64,
        /// Last number.
        last: Option<u64>,
        /// Distance of numbers.
        step: u64,
    },
    /// All PNG, JPEG and PNM files of a folder, sorted as people count (`a2` before `a10`); the frame's number is the
    /// last number of the file's name.
    Folder(PathBuf),
}

/// In which order files are played.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Order {
    /// First to last.
    #[default]
    Forward,
    /// First to last and back to the first; frames keep their own numbers, time goes on.
    PingPong,
}

/// When the pictures were taken.
#[derive(Clone, Debug, PartialEq)]
pub enum Times {
    /// At a fixed rate in hertz, from 0.
    Rate(f64),
    /// As in a file, see [`crate::timestamps::read`].
    File(PathBuf),
}

/// What the pictures are converted to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Conversion {
    /// 8-bit grey, luma of ITU-R BT.709 as the `image` crate weighs it.
    #[default]
    Grey,
    /// 8-bit sRGB.
    Rgb,
}

/// Pictures of a folder as a sensor.
#[derive(Debug)]
pub struct ImageSequence {
    id: SensorId,
    frames: Vec<(PathBuf, u64, Timestamp)>,
    next: usize,
    conversion: Conversion,
    /// That of the camera, else of the first picture.
    size: Option<[u32; 2]>,
}

impl ImageSequence {
    /// Looks for the files; pictures are read one by one later. Pictures of another size than `size` (columns, rows),
    /// or without it than the first, are errors.
    ///
    /// # Errors
    /// [`DeviceError`] that names the file or folder.
    pub fn open(
        id: SensorId,
        files: &Files,
        order: Order,
        times: &Times,
        conversion: Conversion,
        size: Option<[u32; 2]>,
    ) -> Result<Self, DeviceError> {
        let found = match files {
            Files::Pattern { pattern, first, last, step } => numbered(pattern, *first, *last, *step)?,
            Files::Folder(folder) => listed(folder)?,
        };
        let times = moments(&found, times)?;
        let mut frames: Vec<_> = found.into_iter().zip(times).map(|((p, n), t)| (p, n, t)).collect();
        if order == Order::PingPong {
            let end = frames.last().map_or(Timestamp(0), |f| f.2);
            let back: Vec<_> = frames.iter().rev().skip(1).cloned().collect();
            frames.extend(
                back.into_iter()
                    .map(|(p, n, t)| (p, n, Timestamp(end.0.saturating_mul(2).saturating_sub(t.0)))),
            );
        }
        Ok(Self { id, frames, next: 0, conversion, size })
    }

    fn read(&mut self, path: &Path) -> Result<Payload, DeviceError> {
        let picture = decode(path, self.size)?;
        self.size.get_or_insert([picture.width(), picture.height()]);
        Ok(match self.conversion {
            Conversion::Grey => Payload::Grey(Arc::new(picture.into_luma8())),
            Conversion::Rgb => Payload::Rgb(Arc::new(picture.into_rgb8())),
        })
    }
}

impl Sensor for ImageSequence {
    fn next(&mut self) -> Result<Option<Frame>, DeviceError> {
        let Some((path, number, time)) = self.frames.get(self.next).cloned() else { return Ok(None) };
        let frame = Frame { sensor: self.id, number, time, payload: self.read(&path)? };
        self.next += 1;
        Ok(Some(frame))
    }

    fn remaining(&self) -> Option<usize> {
        Some(self.frames.len() - self.next)
    }
}

/// Widest number of a pattern.
const WIDEST: usize = 32;

/// Splits `Image_%04d.pgm` into prefix, width and suffix.
fn split(pattern: &str) -> Option<(&str, usize, &str)> {
    let (prefix, rest) = pattern.split_once('%')?;
    let (width, suffix) = rest.split_once('d')?;
    let width = if width.is_empty() { 0 } else { width.parse().ok()? };
    (!suffix.contains('%') && width <= WIDEST).then_some((prefix, width, suffix))
}

fn numbered(
    pattern: &Path,
    first: u64,
    last: Option<u64>,
    step: u64,
) -> Result<Vec<(PathBuf, u64)>, DeviceError> {
    let fail = |why: String| DeviceError::new(pattern.display(), why);
    let text = pattern.to_string_lossy();
    let (prefix, width, suffix) = split(&text)
        .ok_or_else(|| fail("no pattern; expected one `%d` or `%0Nd`, as in `Image_%04d.pgm`".into()))?;
    if step == 0 || last.is_some_and(|l| l < first) {
        return Err(fail(format!(
            "first {first}, last {last:?}, step {step}; expected first <= last and a step from 1"
        )));
    }
    let path = |n: u64| PathBuf::from(format!("{prefix}{n:0width$}{suffix}"));
    let mut out = vec![];
    let mut n = first;
    while last.is_none_or(|l| n <= l) {
        let file = path(n);
        if !file.is_file() {
            if last.is_none() && !out.is_empty() {
                break;
            }
            return Err(DeviceError::new(
                file.display(),
                format!("no such file; expected frame {n} of the sequence"),
            ));
        }
        out.push((file, n));
        n += step;
    }
    Ok(out)
}

fn listed(folder: &Path) -> Result<Vec<(PathBuf, u64)>, DeviceError> {
    let fail = |why: String| DeviceError::new(folder.display(), why);
    const EXTENSIONS: [&str; 7] = ["png", "jpg", "jpeg", "pgm", "ppm", "pbm", "pnm"];
    let mut names = vec![];
    for entry in std::fs::read_dir(folder).map_err(|e| fail(e.to_string()))? {
        let path = entry.map_err(|e| fail(e.to_string()))?.path();
        let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
        if EXTENSIONS.contains(&extension.as_str()) {
            let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
            names.push((natural(&stem), path));
        }
    }
    if names.is_empty() {
        return Err(fail(format!("no pictures; expected files ending in {}", EXTENSIONS.join(", "))));
    }
    names.sort();
    let number = |parts: &[Piece]| {
        parts.iter().rev().find_map(|p| if let Piece::Number(n) = p { Some(*n) } else { None })
    };
    Ok(names
        .into_iter()
        .enumerate()
        .map(|(k, (parts, path))| (path, number(&parts).unwrap_or(k as u64)))
        .collect())
}

#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Piece {
    Number(u64),
    Text(String),
}

/// A name in pieces that sort as people count.
fn natural(name: &str) -> Vec<Piece> {
    let mut out = vec![];
    for c in name.chars() {
        match (out.last_mut(), c.to_digit(10)) {
            (Some(Piece::Number(n)), Some(d)) => *n = n.saturating_mul(10).saturating_add(d.into()),
            (_, Some(d)) => out.push(Piece::Number(d.into())),
            (Some(Piece::Text(t)), None) => t.push(c),
            (_, None) => out.push(Piece::Text(c.into())),
        }
    }
    out
}

fn moments(files: &[(PathBuf, u64)], times: &Times) -> Result<Vec<Timestamp>, DeviceError> {
    let path = match times {
        Times::Rate(rate) => {
            return Ok((0..files.len()).map(|k| Timestamp::from_seconds(k as f64 / rate)).collect());
        }
        Times::File(path) => path,
    };
    let read = crate::timestamps::read(path)?;
    let numbered: BTreeMap<u64, Timestamp> = read.iter().filter_map(|(n, t)| Some(((*n)?, *t))).collect();
    let found: Option<Vec<Timestamp>> = if numbered.len() == read.len() {
        files.iter().map(|(_, n)| numbered.get(n).copied()).collect()
    } else {
        (read.len() >= files.len()).then(|| read.iter().take(files.len()).map(|r| r.1).collect())
    };
    let found = found.ok_or_else(|| {
        DeviceError::new(
            path.display(),
            format!("{} times; expected one for each of {} frames", read.len(), files.len()),
        )
    })?;
    match found.windows(2).position(|w| w[1] <= w[0]) {
        Some(k) => {
            Err(DeviceError::new(path.display(), format!("time {} is not after the one before", k + 2)))
        }
        None => Ok(found),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(names: &[&str]) -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        for (k, name) in names.iter().enumerate() {
            image::RgbImage::from_pixel(4, 3, image::Rgb([k as u8, 0, 0]))
                .save(dir.path().join(name))
                .unwrap();
        }
        dir
    }

    fn numbers(s: &mut ImageSequence) -> Vec<(u64, i64)> {
        std::iter::from_fn(|| s.next().unwrap()).map(|f| (f.number, f.time.0)).collect()
    }

    fn open(files: Files, order: Order, times: Times) -> Result<ImageSequence, DeviceError> {
        ImageSequence::open(SensorId(0), &files, order, &times, Conversion::Grey, None)
    }

    #[test]
    fn folders_are_sorted_as_people_count() {
        let dir = folder(&["a10.png", "a9.png", "a100.png"]);
        let mut s = open(Files::Folder(dir.path().into()), Order::Forward, Times::Rate(10.0)).unwrap();
        assert_eq!(s.remaining(), Some(3));
        assert_eq!(numbers(&mut s), [(9, 0), (10, 100_000_000), (100, 200_000_000)]);
    }

    #[test]
    fn ping_pong_keeps_numbers_and_time_goes_on() {
        let dir = folder(&["f_01.png", "f_03.png", "f_05.png"]);
        let files =
            Files::Pattern { pattern: dir.path().join("f_%02d.png"), first: 1, last: Some(5), step: 2 };
        let mut s = open(files, Order::PingPong, Times::Rate(1.0)).unwrap();
        let s9 = 1_000_000_000;
        assert_eq!(numbers(&mut s), [(1, 0), (3, s9), (5, 2 * s9), (3, 3 * s9), (1, 4 * s9)]);
    }

    #[test]
    fn times_come_from_a_file_by_number_or_in_order() {
        let dir = folder(&["1.png", "2.png"]);
        let file = dir.path().join("times.txt");
        for text in ["# s\n0.5\n2\n", "2 2.0\n1 0.5\n"] {
            std::fs::write(&file, text).unwrap();
            let mut s =
                open(Files::Folder(dir.path().into()), Order::Forward, Times::File(file.clone())).unwrap();
            assert_eq!(numbers(&mut s), [(1, 500_000_000), (2, 2_000_000_000)]);
        }
        for (text, word) in [("1\n", "2 frames"), ("1\nx\n", "line 2"), ("2\n1\n", "not after")] {
            std::fs::write(&file, text).unwrap();
            let e = open(Files::Folder(dir.path().into()), Order::Forward, Times::File(file.clone()))
                .unwrap_err();
            assert!(e.to_string().contains(word) && e.to_string().contains("times.txt"), "{e}");
        }
    }

    #[test]
    fn errors_name_the_file() {
        let dir = folder(&["f1.png"]);
        let pattern = |p: &str, last| Files::Pattern { pattern: dir.path().join(p), first: 1, last, step: 1 };
        let e = open(pattern("f%d.png", Some(2)), Order::Forward, Times::Rate(1.0)).unwrap_err();
        assert!(e.what.ends_with("f2.png"), "{e}");
        assert!(
            open(pattern("f.png", None), Order::Forward, Times::Rate(1.0)).unwrap_err().why.contains("%d")
        );
        assert_eq!(
            open(pattern("f%d.png", None), Order::Forward, Times::Rate(1.0)).unwrap().remaining(),
            Some(1)
        );
        std::fs::write(dir.path().join("f2.png"), "no picture").unwrap();
        let mut s = open(pattern("f%d.png", None), Order::Forward, Times::Rate(1.0)).unwrap();
        s.next().unwrap();
        assert!(s.next().unwrap_err().what.ends_with("f2.png"));
        let files = pattern("f%d.png", Some(1));
        let size = Some([8, 3]);
        let mut s = ImageSequence::open(
            SensorId(0),
            &files,
            Order::Forward,
            &Times::Rate(1.0),
            Conversion::Rgb,
            size,
        )
        .unwrap();
        assert!(s.next().unwrap_err().why.contains("expected 8x3"));
    }
}
