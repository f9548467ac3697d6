//! Cameras and streams that OpenCV reads, as a sensor.

use std::time::Instant;

use image::{Luma, Rgb};
use opencv::core::{CV_8UC1, CV_8UC3, Mat, MatTraitConst, MatTraitConstManual};
use opencv::videoio::{self, VideoCapture, VideoCaptureTrait, VideoCaptureTraitConst};
use vt_core::agent::Sensor;
use vt_core::error::DeviceError;
use vt_core::frame::{Frame, Payload, SensorId};
use vt_core::picture_pool::PicturePool;
use vt_core::time::Timestamp;

use crate::images::Conversion;

/// Where pictures come from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Source {
    /// Camera of this number.
    Device(u32),
    /// File, stream or pipeline, as OpenCV names it.
    Name(String),
}

impl core::fmt::Display for Source {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Device(number) => write!(f, "camera {number}"),
            Self::Name(name) => f.write_str(name),
        }
    }
}

/// What is read.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Settings {
    /// Frames per second. A camera is asked for it, and tells its times by the clock; anything else plays at it, and without it at the
    /// times that it says.
    pub rate: Option<f64>,
    /// Number of frames at most.
    pub frames: Option<u64>,
    /// What the pictures are converted to.
    pub conversion: Conversion,
    /// Columns and rows that the camera has: it is asked for them, and pictures of another size are an error.
    pub size: Option<[u32; 2]>,
}

/// An opened camera or stream; frames count from 0, time from the first of them.
pub struct Capture {
    id: SensorId,
    source: Source,
    settings: Settings,
    capture: VideoCapture,
    picture: Mat,
    next: u64,
    started: Option<Instant>,
    last: Option<Timestamp>,
    grey: PicturePool<Luma<u8>>,
    rgb: PicturePool<Rgb<u8>>,
}

impl Capture {
    /// Opens a source.
    ///
    /// # Errors
    /// [`DeviceError`] that names it.
    pub fn open(id: SensorId, source: Source, settings: Settings) -> Result<Self, DeviceError> {
        let fail = |why: &dyn core::fmt::Display| DeviceError::new(&source, why);
        if let Some(rate) = settings.rate.filter(|r| !(*r > 0.0 && r.is_finite())) {
            return Err(fail(&format!("a rate of {rate} Hz; expected a positive one")));
        }
        let opened = match &source {
            Source::Device(number) => VideoCapture::new(*number as i32, videoio::CAP_ANY),
            Source::Name(name) => VideoCapture::from_file(name, videoio::CAP_ANY),
        };
        let mut capture = opened.map_err(|e| fail(&e))?;
        if !capture.is_opened().map_err(|e| fail(&e))? {
            return Err(fail(&"cannot be opened; expected a camera or a stream"));
        }
        if matches!(source, Source::Device(_)) {
            let [w, h] = settings.size.map_or([None; 2], |s| s.map(|n| Some(f64::from(n))));
            let wishes = [
                (videoio::CAP_PROP_FRAME_WIDTH, w),
                (videoio::CAP_PROP_FRAME_HEIGHT, h),
                (videoio::CAP_PROP_FPS, settings.rate),
            ];
            for (property, value) in wishes {
                // What a camera cannot do it says by the pictures that it delivers.
                let _ = value.map(|v| capture.set(property, v));
            }
        }
        let (grey, rgb) = (PicturePool::default(), PicturePool::default());
        let (picture, started, last) = (Mat::default(), None, None);
        Ok(Self { id, source, settings, capture, picture, next: 0, started, last, grey, rgb })
    }

    fn fail(&self, why: impl core::fmt::Display) -> DeviceError {
        DeviceError::new(&self.source, why)
    }

    /// A file ends; a camera or a stream from elsewhere is gone.
    fn ends(&self) -> bool {
        matches!(&self.source, Source::Name(name) if !name.contains("://"))
    }

    fn time(&mut self) -> Result<Timestamp, DeviceError> {
        let now = match (&self.source, self.settings.rate) {
            (Source::Name(_), Some(rate)) => self.next as f64 / rate,
            (Source::Name(_), None) if self.ends() => {
                self.capture.get(videoio::CAP_PROP_POS_MSEC).map_err(|e| self.fail(e))? * 1e-3
            }
            _ => self.started.get_or_insert_with(Instant::now).elapsed().as_secs_f64(),
        };
        let now = Timestamp::from_seconds(now);
        if self.last.is_some_and(|last| now <= last) {
            return Err(
                self.fail(format!("frame {}: no later than the one before; expected `rate`", self.next))
            );
        }
        self.last = Some(now);
        Ok(now)
    }

    /// The picture that was read, converted.
    fn payload(&mut self) -> Result<Payload, DeviceError> {
        let Self { picture, grey, rgb, settings, .. } = self;
        let size = [picture.cols() as u32, picture.rows() as u32];
        if let Some([w, h]) = settings.size.filter(|s| *s != size) {
            let why = format!("{}x{} pixels; expected {w}x{h} as the camera says", size[0], size[1]);
            return Err(self.fail(why));
        }
        let kind = picture.typ();
        let channels = match kind {
            CV_8UC1 => 1,
            CV_8UC3 => 3,
            _ => return Err(self.fail(format!("pictures of type {kind}; expected 8 bits, grey or BGR"))),
        };
        let bytes = picture.data_bytes().map_err(|e| DeviceError::new(&self.source, e))?;
        // Blue, green, red.
        let pixels = bytes.chunks_exact(channels).map(|p| [p[channels - 1], p[channels / 2], p[0]]);
        Ok(match settings.conversion {
            Conversion::Grey => Payload::Grey(grey.picture(size, |out| {
                out.iter_mut().zip(pixels).for_each(|(to, p)| *to = luma(p));
            })),
            Conversion::Rgb => Payload::Rgb(rgb.picture(size, |out| {
                out.chunks_exact_mut(3).zip(pixels).for_each(|(to, p)| to.copy_from_slice(&p));
            })),
        })
    }
}

/// Luma of ITU-R BT.709, as the pictures of folders have it.
fn luma([r, g, b]: [u8; 3]) -> u8 {
    ((2126 * u32::from(r) + 7152 * u32::from(g) + 722 * u32::from(b) + 5000) / 10_000) as u8
}

impl Sensor for Capture {
    fn next(&mut self) -> Result<Option<Frame>, DeviceError> {
        if self.settings.frames.is_some_and(|most| self.next >= most) {
            return Ok(None);
        }
        let read = self.capture.read(&mut self.picture).map_err(|e| self.fail(e))?;
        if !read || self.picture.empty() {
            return if self.ends() {
                Ok(None)
            } else {
                Err(self.fail("no picture; expected one: is it unplugged?"))
            };
        }
        let (number, time) = (self.next, self.time()?);
        let payload = self.payload()?;
        self.next += 1;
        Ok(Some(Frame { sensor: self.id, number, time, payload }))
    }

    fn remaining(&self) -> Option<usize> {
        let most = self.settings.frames?;
        Some((most - self.next.min(most)) as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_there_is_named() {
        let open =
            |source| Capture::open(SensorId(0), source, Settings::default()).err().map(|e| e.to_string());
        assert!(open(Source::Device(97)).is_some_and(|e| e.contains("camera 97")));
        assert!(open(Source::Name("no-such.mp4".into())).is_some_and(|e| e.contains("no-such.mp4")));
    }

    #[test]
    fn pictures_of_a_file_are_those_that_were_written() {
        let folder = tempfile::tempdir().unwrap();
        // Numbered pictures, which OpenCV plays as a video.
        for k in 0..3_u8 {
            let picture = image::RgbImage::from_fn(16, 8, |x, y| Rgb([x as u8 * 10, y as u8 * 20, 50 * k]));
            picture.save(folder.path().join(format!("{k:02}.png"))).unwrap();
        }
        let name = Source::Name(folder.path().join("%02d.png").display().to_string());
        let settings = |conversion| Settings { rate: Some(10.0), conversion, ..Settings::default() };
        let mut capture = Capture::open(SensorId(3), name.clone(), settings(Conversion::Rgb)).unwrap();
        for k in 0..3_u8 {
            let frame = capture.next().unwrap().unwrap();
            assert_eq!((frame.number, frame.time), (k.into(), Timestamp::from_seconds(0.1 * f64::from(k))));
            assert_eq!(frame.rgb().unwrap().get_pixel(5, 3), &Rgb([50, 60, 50 * k]));
        }
        assert!(capture.next().unwrap().is_none());
        let mut capture = Capture::open(SensorId(3), name.clone(), settings(Conversion::Grey)).unwrap();
        let frame = capture.next().unwrap().unwrap();
        let expected =
            image::DynamicImage::from(image::RgbImage::from_pixel(1, 1, Rgb([50, 60, 0]))).into_luma8();
        assert_eq!(frame.grey().unwrap().get_pixel(5, 3), expected.get_pixel(0, 0));
        let small = Settings { size: Some([4, 4]), ..settings(Conversion::Rgb) };
        let error = Capture::open(SensorId(3), name, small).unwrap().next().unwrap_err();
        assert!(error.to_string().contains("16x8 pixels; expected 4x4"), "{error}");
    }
}
