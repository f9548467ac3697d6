//! One picture with a choice of at most 25 pictures of a run.

use image::imageops::{self, FilterType};
use image::{Rgb, RgbImage};

const COLUMNS: usize = 5;
const MOST: usize = COLUMNS * COLUMNS;
const WIDTH: u32 = 320;
const GAP: u32 = 4;

/// Keeps small copies, evenly spread over a run of unknown length: when there are too many, every second one goes
/// and from then on only every second one is taken.
#[derive(Debug)]
pub struct Sheet {
    pictures: Vec<RgbImage>,
    stride: u64,
}

impl Default for Sheet {
    fn default() -> Self {
        Self { pictures: vec![], stride: 1 }
    }
}

impl Sheet {
    /// True when the picture of the step with this index, from 0, is to be added.
    pub fn wants(&self, index: u64) -> bool {
        index.is_multiple_of(self.stride)
    }

    /// Adds a small copy of the picture of a step that is wanted.
    pub fn add(&mut self, index: u64, picture: &RgbImage) {
        if self.pictures.len() == MOST {
            let mut keep = [true, false].into_iter().cycle();
            self.pictures.retain(|_| keep.next().unwrap_or(true));
            self.stride *= 2;
            if !self.wants(index) {
                return;
            }
        }
        let height =
            (u64::from(picture.height()) * u64::from(WIDTH)).div_ceil(u64::from(picture.width())) as u32;
        self.pictures.push(imageops::resize(picture, WIDTH, height, FilterType::Triangle));
    }

    /// The sheet, rows of five; `None` without pictures.
    pub fn compose(&self) -> Option<RgbImage> {
        let height = self.pictures.iter().map(RgbImage::height).max()?;
        let columns = self.pictures.len().min(COLUMNS) as u32;
        let rows = self.pictures.len().div_ceil(COLUMNS) as u32;
        let size = [columns * (WIDTH + GAP) + GAP, rows * (height + GAP) + GAP];
        let mut sheet = RgbImage::from_pixel(size[0], size[1], Rgb([24; 3]));
        for (k, picture) in self.pictures.iter().enumerate() {
            let (x, y) = (k % COLUMNS, k / COLUMNS);
            let at = [GAP + x as u32 * (WIDTH + GAP), GAP + y as u32 * (height + GAP)];
            imageops::replace(&mut sheet, picture, at[0].into(), at[1].into());
        }
        Some(sheet)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_length_gives_at_most_25_evenly_spread_pictures() {
        for length in [1_u64, 5, 25, 26, 51, 1000] {
            let mut sheet = Sheet::default();
            for k in 0..length {
                if sheet.wants(k) {
                    let tone = (k / 4) as u8;
                    sheet.add(k, &RgbImage::from_pixel(8, 6, Rgb([tone; 3])));
                }
            }
            assert!((1..=MOST).contains(&sheet.pictures.len()));
            assert!(length < 13 || sheet.pictures.len() >= 13);
            let expected: Vec<u8> =
                (0..length).step_by(sheet.stride as usize).map(|k| (k / 4) as u8).collect();
            assert_eq!(sheet.pictures.iter().map(|p| p.get_pixel(0, 0).0[0]).collect::<Vec<_>>(), expected);
            assert!(sheet.compose().is_some());
        }
        assert!(Sheet::default().compose().is_none());
    }
}
