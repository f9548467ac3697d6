//! Two thresholds: weak pixels stay where a chain of weak ones leads to a strong one.

use vt_core::batch::vectorized;

use super::{STRONG, WEAK};
use crate::plane::reserve;

/// Classes of the pixels of a region with a border of zeros, and the strong pixels whose neighbours were not looked at.
#[derive(Clone, Debug, Default)]
pub(super) struct Hysteresis {
    classes: Vec<u8>,
    stride: usize,
    open: Vec<u32>,
}

impl Hysteresis {
    /// Makes room for a region of so many pixels, its border included.
    pub(super) fn reserve(&mut self, pixels: usize) {
        reserve(&mut self.classes, pixels);
        reserve(&mut self.open, pixels);
    }

    /// Lends room for the classes of `width` × `height` pixels and one more on every side, which stays zero; the rest is
    /// whatever it is.
    pub(super) fn begin(&mut self, width: usize, height: usize) -> &mut [u8] {
        let count = (width + 2) * (height + 2);
        if self.stride != width + 2 || self.classes.len() != count {
            self.stride = width + 2;
            self.classes.clear();
            self.classes.resize(count, 0);
        }
        &mut self.classes
    }

    /// Makes weak pixels strong that touch a strong one, until none does.
    pub(super) fn spread(&mut self) {
        self.open.clear();
        const BLOCK: usize = 32;
        for (k, block) in self.classes.chunks(BLOCK).enumerate() {
            if block.iter().fold(0, |a, b| a | b) & STRONG != 0 {
                let strong = (k * BLOCK..).zip(block).filter(|(_, c)| **c == STRONG);
                self.open.extend(strong.map(|(at, _)| at as u32));
            }
        }
        let (classes, stride) = (&mut self.classes[..], self.stride);
        while let Some(at) = self.open.pop() {
            let corner = at as usize - stride - 1;
            for row in 0..3 {
                let start = corner + row * stride;
                for (k, class) in (start..).zip(&mut classes[start..start + 3]) {
                    if *class == WEAK {
                        *class = STRONG;
                        self.open.push(k as u32);
                    }
                }
            }
        }
    }

    /// 255 for strong pixels, 0 for all others, without the border.
    pub(super) fn mask(&self, out: &mut [u8]) {
        let stride = self.stride;
        let rows = self.classes.chunks_exact(stride).skip(1);
        vectorized(
            #[inline(always)]
            move || {
                for (row, out) in rows.zip(out.chunks_exact_mut(stride - 2)) {
                    for (m, &class) in out.iter_mut().zip(&row[1..]) {
                        *m = if class == STRONG { 255 } else { 0 };
                    }
                }
            },
        );
    }
}
