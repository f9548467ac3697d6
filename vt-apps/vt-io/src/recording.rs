//! Frames of a sensor with what is true of them, as files that the sensor `images` and the truth `tum` read.

use core::fmt::Write;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use image::ImageFormat;
use vt_core::error::DeviceError;
use vt_core::frame::{Frame, Payload};
use vt_core::lie::SE3;
use vt_core::manifold::Coordinates;

use crate::files::{Lines, file_name, of_target, replace};
use crate::poses;

/// Folder of a sensor's recording, and its files: `images/NUMBER.png`, `timestamps.txt` (`frame seconds`), `truth.tum`
/// (`frame tx ty tz qx qy qz qw`, camera_from_object; one file an object, `truth-NAME.tum`, where there are several)
/// and `visible.csv` (the share of each object that is seen).
pub struct Recording {
    images: PathBuf,
    times: Lines,
    truths: Vec<Lines>,
    visible: Lines,
}

/// Folder below `base` for the sensor with this name; characters that file systems refuse are replaced.
pub fn folder(base: &Path, sensor: &str) -> PathBuf {
    base.join(file_name(sensor))
}

/// File of the truth of one of these objects.
pub fn truth(folder: &Path, objects: &[String], object: usize) -> PathBuf {
    of_target(folder, "truth", "tum", objects, object)
}

impl Recording {
    /// Starts a recording of a scene with these objects.
    ///
    /// # Errors
    /// [`DeviceError`] when a file cannot be made, or when there are pictures in the folder already: they would be taken
    /// for those of this recording.
    pub fn create(folder: &Path, objects: &[String]) -> Result<Self, DeviceError> {
        let images = folder.join("images");
        let fail = |e: std::io::Error| DeviceError::new(images.display(), e);
        std::fs::create_dir_all(&images).map_err(fail)?;
        if std::fs::read_dir(&images).map_err(fail)?.next().is_some() {
            return Err(DeviceError::new(images.display(), "not empty; expected a new or an empty folder"));
        }
        let truths = (0..objects.len()).map(|k| Lines::create(truth(folder, objects, k), poses::HEADER));
        let truths = truths.collect::<Result<_, _>>()?;
        let times = Lines::create(folder.join("timestamps.txt"), "# frame seconds\n")?;
        let header = objects.iter().fold("frame".to_owned(), |h, o| h + "," + &file_name(o)) + "\n";
        let visible = Lines::create(folder.join("visible.csv"), &header)?;
        Ok(Self { images, times, truths, visible })
    }

    /// Adds a frame with the pose and the visible share of each object.
    ///
    /// # Errors
    /// [`DeviceError`] when a file cannot be written or the frame is no picture.
    pub fn add(&mut self, frame: &Frame, poses: &[SE3], visible: &[f64]) -> Result<(), DeviceError> {
        let path = self.images.join(format!("{:06}.png", frame.number));
        let mut encoded = Cursor::new(vec![]);
        let saved = match &frame.payload {
            Payload::Grey(picture) => picture.write_to(&mut encoded, ImageFormat::Png),
            Payload::Rgb(picture) => picture.write_to(&mut encoded, ImageFormat::Png),
            other => {
                let why = format!("a frame of {}; expected a picture", other.kind());
                return Err(DeviceError::new(path.display(), why));
            }
        };
        saved.map_err(|e| DeviceError::new(path.display(), e))?;
        replace(&path, encoded.get_ref())?;
        // Nanoseconds in full, so that the time comes back as it was.
        let (sign, ns) = (if frame.time.0 < 0 { "-" } else { "" }, frame.time.0.unsigned_abs());
        let _ = writeln!(
            self.times.buffer(),
            "{} {sign}{}.{:09}",
            frame.number,
            ns / 1_000_000_000,
            ns % 1_000_000_000
        );
        let mut coordinates = vec![];
        for (file, pose) in self.truths.iter_mut().zip(poses) {
            coordinates.clear();
            pose.write(&mut coordinates);
            poses::line(file.buffer(), frame.number, &coordinates);
            file.flush()?;
        }
        let shares = visible.iter().fold(frame.number.to_string(), |l, v| l + &format!(",{v:.4}"));
        let _ = writeln!(self.visible.buffer(), "{shares}");
        self.times.flush()?;
        self.visible.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::truth::Truth;
    use nalgebra::Vector3;
    use std::sync::Arc;
    use vt_core::frame::SensorId;
    use vt_core::time::Timestamp;

    #[test]
    fn what_was_recorded_comes_back() {
        let dir = tempfile::tempdir().unwrap();
        let objects = ["a b".to_owned(), "c".to_owned()];
        let mut recording = Recording::create(dir.path(), &objects).unwrap();
        let picture = image::GrayImage::from_fn(4, 3, |x, y| image::Luma([(50 * x + y) as u8]));
        let poses = [0.1, 0.2]
            .map(|v| SE3::from_rotation_vector(&Vector3::new(v, 3.0, v), Vector3::new(v, 0.0, 1.0)));
        for (number, ns) in [(0, 0), (7, 233_333_333)] {
            let payload = Payload::Grey(Arc::new(picture.clone()));
            let frame = Frame { sensor: SensorId(0), number, time: Timestamp(ns), payload };
            recording.add(&frame, &poses, &[1.0, 0.25]).unwrap();
        }
        let read = image::open(dir.path().join("images/000007.png")).unwrap().into_luma8();
        assert_eq!(read, picture);
        let times = crate::timestamps::read(&dir.path().join("timestamps.txt")).unwrap();
        assert_eq!(times[1], (Some(7), Timestamp(233_333_333)));
        let truth = Truth::read_tum(&truth(dir.path(), &objects, 0)).unwrap();
        assert!((truth.poses[&7].to_matrix() - poses[0].to_matrix()).norm() < 1e-8);
        let visible = std::fs::read_to_string(dir.path().join("visible.csv")).unwrap();
        assert_eq!(visible, "frame,a_b,c\n0,1.0000,0.2500\n7,1.0000,0.2500\n");
        let again = Recording::create(dir.path(), &objects).err().unwrap();
        assert!(again.to_string().contains("not empty"), "{again}");
    }
}
