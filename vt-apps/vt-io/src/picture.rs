//! One PNG, JPEG or PNM picture of a file.

use std::io::Cursor;
use std::path::Path;

use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader};
use vt_core::error::DeviceError;
use vt_core::file::MOST;

/// Bytes of pixels that a byte of a file can code at most. Deflate reaches 1032, eight pixels of one bit each.
const DENSEST: u64 = 10_000;

/// Most bytes of the pixels of a picture.
const LARGEST: u64 = 1 << 30;

/// Reads a picture. With `size` (columns, rows), one of another size is an error before its pixels are read.
pub(crate) fn decode(path: &Path, size: Option<[u32; 2]>) -> Result<DynamicImage, DeviceError> {
    let device = |why: String| DeviceError::new(path.display(), why);
    let bytes = vt_core::file::read(path, MOST).map_err(|e| device(e.to_string()))?;
    let fail = |why: String| {
        device(format!("{why}, in {} bytes; expected a whole PNG, JPEG or PNM picture", bytes.len()))
    };
    let reader = ImageReader::new(Cursor::new(&bytes));
    let reader = reader.with_guessed_format().map_err(|e| fail(e.to_string()))?;
    let format = reader.format();
    let decoder = reader.into_decoder().map_err(|e| fail(e.to_string()))?;
    let (columns, rows) = decoder.dimensions();
    if let Some(size) = size.filter(|s| *s != [columns, rows]) {
        let expected = format!("expected {}x{} as the camera says", size[0], size[1]);
        return Err(device(format!("{columns}x{rows} pixels; {expected}")));
    }
    if columns == 0 || rows == 0 || decoder.total_bytes() > LARGEST.min(DENSEST * bytes.len() as u64) {
        return Err(fail(format!("{columns}x{rows} pixels")));
    }
    // The decoder makes up what is missing of a JPEG.
    if format == Some(ImageFormat::Jpeg) && !ends(&bytes) {
        return Err(fail("no end of the JPEG".into()));
    }
    DynamicImage::from_decoder(decoder).map_err(|e| fail(e.to_string()))
}

/// Reads a PNG, JPEG or PNM picture.
///
/// # Errors
/// [`DeviceError`] that names the file.
pub fn read_rgb(path: &Path) -> Result<image::RgbImage, DeviceError> {
    decode(path, None).map(DynamicImage::into_rgb8)
}

/// Whether the markers of a JPEG (ITU-T T.81, annex B) lead to the one that ends it.
fn ends(bytes: &[u8]) -> bool {
    const END: u8 = 0xd9;
    let mut at = 0;
    while let Some(found) = bytes.get(at..).and_then(|rest| rest.windows(2).position(marks)) {
        at += found + 2;
        match bytes[at - 1] {
            END => return true,
            // Without content: temporary, restarts, start of image.
            0x01 | 0xd0..=0xd8 => {}
            _ => match bytes.get(at..at + 2) {
                Some(length) => at += usize::from(u16::from_be_bytes([length[0], length[1]])),
                None => return false,
            },
        }
    }
    false
}

/// A marker, neither a stuffed byte of coded data nor one that fills up.
fn marks(pair: &[u8]) -> bool {
    pair[0] == 0xff && !matches!(pair[1], 0 | 0xff)
}

#[cfg(test)]
mod tests;
