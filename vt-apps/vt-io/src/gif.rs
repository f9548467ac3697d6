//! Overlays as one animated GIF, which is a valid file after every frame.

use core::ops::ControlFlow;
use std::fs::File;
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use gif::{Encoder, EncodingError, Frame, Repeat};
use image::RgbImage;
use image::imageops::{self, FilterType};
use vt_core::agent::{Output, Step};
use vt_core::error::DeviceError;

use crate::files::{forget, replace};
use crate::overlay::Drawing;

/// Last byte of every GIF.
const TRAILER: u8 = 0x3b;

/// Quality of the palettes of 256 colours, one a frame: 1 is best, 30 fastest.
const SPEED: i32 = 10;

/// What is written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GifSettings {
    /// Every how many steps a frame is added, at least 1.
    pub every: u64,
    /// Size of a frame as a share of the picture's.
    pub scale: f64,
    /// How long a frame is shown in seconds; players know hundredths.
    pub delay: f64,
    /// Size of the file in bytes from which on no frame is added.
    pub max_bytes: u64,
}

impl Default for GifSettings {
    fn default() -> Self {
        Self { every: 2, scale: 1.0, delay: 0.08, max_bytes: 50_000_000 }
    }
}

/// Writes `overlays.gif`. Only one frame is in memory at a time.
pub struct Gif {
    path: PathBuf,
    drawing: Drawing,
    settings: GifSettings,
    open: Option<Open>,
    index: u64,
}

/// The file, there from the first frame on, with an encoder whose bytes are taken over after every frame.
struct Open {
    file: Option<File>,
    encoder: Encoder<Vec<u8>>,
    size: [u32; 2],
    bytes: u64,
}

impl Gif {
    /// A file in `folder`, made with the first frame.
    ///
    /// # Errors
    /// [`DeviceError`] when an old file cannot be removed: it would be mistaken for that of this run.
    pub fn create(folder: &Path, drawing: Drawing, settings: GifSettings) -> Result<Self, DeviceError> {
        let path = folder.join("overlays.gif");
        forget(&path)?;
        Ok(Self { path, drawing, settings, open: None, index: 0 })
    }

    fn add(&mut self, picture: &RgbImage) -> Result<(), DeviceError> {
        let fail = |e: String| DeviceError::new(self.path.display(), e);
        if self.open.is_none() {
            let size = [picture.width(), picture.height()]
                .map(|n| (f64::from(n) * self.settings.scale).round().max(1.0) as u32);
            self.open = Some(Open::new(size).map_err(fail)?);
        }
        match &mut self.open {
            Some(open) if open.bytes < self.settings.max_bytes => {
                open.add(&self.path, picture, self.settings.delay).map_err(fail)
            }
            _ => Ok(()),
        }
    }
}

fn text(e: impl core::fmt::Display) -> String {
    e.to_string()
}

impl Open {
    fn new(size: [u32; 2]) -> Result<Self, String> {
        let narrow = |n: u32| {
            u16::try_from(n).map_err(|_| format!("{n} pixels; expected at most 65535 a side, see `scale`"))
        };
        let mut encoder = Encoder::new(vec![], narrow(size[0])?, narrow(size[1])?, &[]).map_err(text)?;
        encoder.set_repeat(Repeat::Infinite).map_err(text)?;
        Ok(Self { file: None, encoder, size, bytes: 0 })
    }

    fn add(&mut self, path: &Path, picture: &RgbImage, delay: f64) -> Result<(), String> {
        let [width, height] = self.size;
        let resized;
        let pixels = if picture.dimensions() == (width, height) {
            picture.as_raw()
        } else {
            resized = imageops::resize(picture, width, height, FilterType::Triangle);
            resized.as_raw()
        };
        // The sides were found to fit.
        let mut frame = Frame::from_rgb_speed(width as u16, height as u16, pixels, SPEED);
        frame.delay = (100.0 * delay).round() as u16;
        self.encoder.write_frame(&frame).map_err(|e: EncodingError| text(e))?;
        let mut content = core::mem::take(self.encoder.get_mut());
        content.push(TRAILER);
        match &mut self.file {
            None => {
                replace(path, &content).map_err(|e| e.why)?;
                self.file = Some(File::options().write(true).open(path).map_err(text)?);
            }
            // The byte that goes over the old trailer comes last, so that the file is whole at every moment.
            Some(file) => {
                for (from, part) in [(1, &content[1..]), (0, &content[..1])] {
                    let moved = file.seek(SeekFrom::Start(self.bytes + from));
                    moved.and_then(|_| file.write_all(part)).map_err(text)?;
                }
            }
        }
        self.bytes += content.len() as u64 - 1;
        Ok(())
    }
}

impl Output for Gif {
    fn step(&mut self, step: &Step<'_>) -> Result<ControlFlow<()>, DeviceError> {
        let full = self.open.as_ref().is_some_and(|o| o.bytes >= self.settings.max_bytes);
        if !full
            && self.index.is_multiple_of(self.settings.every.max(1))
            && let Some(picture) = self.drawing.draw(step)
        {
            self.add(&picture)?;
        }
        self.index += 1;
        Ok(ControlFlow::Continue(()))
    }
}
