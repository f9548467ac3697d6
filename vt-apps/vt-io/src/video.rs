//! A video as a sensor: frames piped from a child process of the program `ffmpeg`, so that no library is linked.

mod pipe;

use std::path::{Path, PathBuf};

use image::{Luma, Rgb};
use serde::Deserialize;
use vt_core::agent::Sensor;
use vt_core::error::DeviceError;
use vt_core::frame::{Frame, Payload, SensorId};
use vt_core::picture_pool::PicturePool;
use vt_core::time::Timestamp;

use crate::images::Conversion;
use pipe::Pipe;

/// Most bytes of the pixels of a picture.
const LARGEST: u64 = 1 << 30;

/// The programs that read videos.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Programs {
    /// Decodes.
    pub ffmpeg: PathBuf,
    /// Says what is in a file.
    pub ffprobe: PathBuf,
}

impl Default for Programs {
    /// `ffmpeg` and `ffprobe`, wherever the system finds them.
    fn default() -> Self {
        Self { ffmpeg: "ffmpeg".into(), ffprobe: "ffprobe".into() }
    }
}

/// What is read of a video.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Settings {
    /// Frames per second, from 0 at the first frame of the file; without it the times that the file says.
    pub rate: Option<f64>,
    /// Number of the first frame; those of a file count from 0.
    pub start: u64,
    /// Number of frames at most.
    pub frames: Option<u64>,
    /// What the pictures are converted to; grey is the video's own luma, at full range.
    pub conversion: Conversion,
    /// Columns and rows that the camera has; another size is an error.
    pub size: Option<[u32; 2]>,
    /// The programs.
    pub programs: Programs,
}

/// A video file as a sensor; its first stream of pictures, upright. The child process ends with the sensor.
pub struct Video {
    id: SensorId,
    path: PathBuf,
    settings: Settings,
    contents: Contents,
    pipe: Pipe,
    /// Number of the next frame.
    next: u64,
    /// Number after the last frame that is wanted.
    end: u64,
    ended: bool,
    grey: PicturePool<Luma<u8>>,
    rgb: PicturePool<Rgb<u8>>,
}

/// What a file is said to contain.
struct Contents {
    size: [u32; 2],
    /// Times of the frames in the order in which they are shown, from 0; empty where a rate is given.
    times: Vec<Timestamp>,
    /// Number of frames.
    count: u64,
    /// Whether the file has fewer frames than it says.
    short: bool,
}

#[derive(Deserialize)]
struct Probe {
    #[serde(default)]
    packets: Vec<Packet>,
    #[serde(default)]
    streams: Vec<Stream>,
}

#[derive(Deserialize)]
struct Packet {
    pts_time: Option<String>,
    #[serde(default)]
    flags: String,
}

#[derive(Deserialize)]
struct Stream {
    width: Option<u32>,
    height: Option<u32>,
    nb_frames: Option<String>,
    #[serde(default)]
    side_data_list: Vec<SideData>,
}

#[derive(Deserialize)]
struct SideData {
    rotation: Option<f64>,
}

impl Video {
    /// Opens a file and starts to decode it.
    ///
    /// # Errors
    /// [`DeviceError`] that names the file, or the program that is not installed and what to do about it.
    pub fn open(id: SensorId, path: &Path, settings: Settings) -> Result<Self, DeviceError> {
        let fail = |why: String| DeviceError::new(path.display(), why);
        // Pipes and devices might never end.
        let about = std::fs::metadata(path).map_err(|e| fail(e.to_string()))?;
        if !about.is_file() {
            return Err(fail("found no regular file; expected a video".into()));
        }
        if let Some(rate) = settings.rate.filter(|r| !(*r > 0.0 && r.is_finite())) {
            return Err(fail(format!("a rate of {rate} Hz; expected a positive one")));
        }
        let contents = Contents::probe(path, &settings)?;
        if let Some(size) = settings.size.filter(|s| *s != contents.size) {
            let [w, h] = contents.size;
            return Err(fail(format!("{w}x{h} pixels; expected {}x{} as the camera says", size[0], size[1])));
        }
        if settings.start >= contents.count {
            let why = format!("{} frames; expected more than `start`, {}", contents.count, settings.start);
            return Err(fail(why));
        }
        let end = settings.start.saturating_add(settings.frames.unwrap_or(u64::MAX)).min(contents.count);
        let format = match settings.conversion {
            Conversion::Grey => "gray",
            Conversion::Rgb => "rgb24",
        };
        let select = format!("select=gte(n\\,{})", settings.start);
        let before = ["-nostdin", "-v", "error", "-xerror", "-protocol_whitelist", "file,pipe", "-i"];
        let after = ["-map", "0:v:0", "-vf", &select, "-fps_mode", "passthrough", "-f", "rawvideo"];
        let exact = ["-sws_flags", "bitexact+accurate_rnd", "-pix_fmt", format, "pipe:1"];
        let pipe = Pipe::start(&settings.programs.ffmpeg, path, &before, &[&after[..], &exact].concat())?;
        let (next, ended, grey, rgb) =
            (settings.start, false, PicturePool::default(), PicturePool::default());
        Ok(Self { id, path: path.into(), settings, contents, pipe, next, end, ended, grey, rgb })
    }

    /// Columns and rows.
    pub fn size(&self) -> [u32; 2] {
        self.contents.size
    }

    fn fail(&self, why: impl core::fmt::Display) -> DeviceError {
        DeviceError::new(self.path.display(), why)
    }

    fn time(&self, number: u64) -> Timestamp {
        match self.settings.rate {
            Some(rate) => Timestamp::from_seconds(number as f64 / rate),
            None => self.contents.times[number as usize],
        }
    }

    /// The next picture; `None` at the end of the stream.
    fn read(&mut self) -> Result<Option<Payload>, DeviceError> {
        let Self { contents: Contents { size, .. }, pipe, grey, rgb, .. } = self;
        let (mut read, mut wanted) = (Ok(0), 0);
        let fill = |bytes: &mut [u8]| (read, wanted) = (pipe.fill(bytes), bytes.len());
        let payload = match self.settings.conversion {
            Conversion::Grey => Payload::Grey(grey.picture(*size, fill)),
            Conversion::Rgb => Payload::Rgb(rgb.picture(*size, fill)),
        };
        let got = read.map_err(|e| self.fail(e))?;
        if got == wanted {
            return Ok(Some(payload));
        }
        let (number, count) = (self.next, self.contents.count);
        let (good, said) = self.pipe.finish();
        let missing = number < count && (self.contents.short || !said.is_empty());
        if got > 0 || !good || missing {
            let said = if said.is_empty() { "the data end".to_owned() } else { said };
            return Err(self.fail(format!("frame {number}: {said}; expected {count} frames")));
        }
        Ok(None)
    }
}

impl Contents {
    fn probe(path: &Path, settings: &Settings) -> Result<Self, DeviceError> {
        let fail = |why: String| DeviceError::new(path.display(), why);
        let entries = "stream=width,height,nb_frames:stream_side_data=rotation:packet=pts_time,flags";
        let before = ["-v", "error", "-protocol_whitelist", "file,pipe", "-select_streams", "v:0"];
        let before = [&before[..], &["-show_entries", entries, "-of", "json", "-i"]].concat();
        let mut pipe = Pipe::start(&settings.programs.ffprobe, path, &before, &[])?;
        let text = pipe.rest(vt_core::file::MOST).map_err(|e| fail(e.to_string()))?;
        let (good, said) = pipe.finish();
        if !good {
            let said = if said.is_empty() { "it cannot be read".to_owned() } else { said };
            return Err(fail(format!("{said}; expected a video")));
        }
        let probe: Probe = serde_json::from_slice(&text).map_err(|e| fail(format!("ffprobe said: {e}")))?;
        let stream = probe.streams.first().ok_or_else(|| fail("no pictures; expected a video".into()))?;
        let mut size = [stream.width, stream.height].map(Option::unwrap_or_default);
        let turned = stream.side_data_list.iter().find_map(|s| s.rotation).unwrap_or(0.0);
        if (turned / 90.0).abs().round() % 2.0 == 1.0 {
            size.reverse();
        }
        let pixels = u64::from(size[0]) * u64::from(size[1]);
        if pixels == 0 || 3 * pixels > LARGEST {
            return Err(fail(format!("{}x{} pixels; expected a video", size[0], size[1])));
        }
        let shown = |p: &&Packet| !p.flags.contains('D');
        let count = probe.packets.iter().filter(shown).count() as u64;
        if count == 0 {
            return Err(fail(
                format!("no frames; expected a video{}", if said.is_empty() { "" } else { ": " }) + &said,
            ));
        }
        let promised = stream.nb_frames.as_ref().and_then(|n| n.parse::<u64>().ok()).unwrap_or(0);
        let short = (probe.packets.len() as u64) < promised;
        let mut times = vec![];
        if settings.rate.is_none() {
            let seconds =
                probe.packets.iter().filter(shown).map(|p| p.pts_time.as_ref()?.parse::<f64>().ok());
            let seconds = seconds.collect::<Option<Vec<f64>>>();
            let untimed = || fail("its frames have no times, or the same; expected `rate`".into());
            let mut seconds = seconds.ok_or_else(untimed)?;
            seconds.sort_by(f64::total_cmp);
            times.extend(seconds.iter().map(|s| Timestamp::from_seconds(s - seconds[0])));
            if times.windows(2).any(|w| w[1] <= w[0]) {
                return Err(untimed());
            }
        }
        Ok(Self { size, times, count, short })
    }
}

impl Sensor for Video {
    fn next(&mut self) -> Result<Option<Frame>, DeviceError> {
        if self.ended || self.next >= self.end {
            // Nobody reads on.
            self.ended = true;
            self.pipe.stop();
            return Ok(None);
        }
        let payload = self.read();
        self.ended = !matches!(payload, Ok(Some(_)));
        let Some(payload) = payload? else { return Ok(None) };
        let (number, time) = (self.next, self.time(self.next));
        self.next += 1;
        Ok(Some(Frame { sensor: self.id, number, time, payload }))
    }

    fn remaining(&self) -> Option<usize> {
        Some(if self.ended { 0 } else { (self.end - self.next) as usize })
    }
}
