//! Pictures that a sensor uses again when nobody else holds them any more, so that frames take no memory.

use std::sync::Arc;

use image::{ImageBuffer, Pixel};

/// Pictures of 8 bits that were handed out and are kept for when they come back.
#[derive(Clone, Debug)]
pub struct PicturePool<P: Pixel<Subpixel = u8>>(Vec<Arc<ImageBuffer<P, Vec<u8>>>>);

impl<P: Pixel<Subpixel = u8>> Default for PicturePool<P> {
    fn default() -> Self {
        Self(vec![])
    }
}

impl<P: Pixel<Subpixel = u8>> PicturePool<P> {
    /// Pictures kept: what a loop holds in a frame, and what motion looks back at.
    const SIZE: usize = 4;

    /// A picture of `size` (columns, rows) that nobody else holds, after `fill` has had its bytes, by rows; they are those of some
    /// frame before.
    pub fn picture(&mut self, size: [u32; 2], fill: impl FnOnce(&mut [u8])) -> Arc<ImageBuffer<P, Vec<u8>>> {
        let free =
            |p: &Arc<ImageBuffer<P, Vec<u8>>>| Arc::strong_count(p) == 1 && p.dimensions() == size.into();
        let slot = self.0.iter().position(free).unwrap_or_else(|| {
            // The one that was taken first is given up.
            if self.0.len() == Self::SIZE {
                self.0.remove(0);
            }
            self.0.push(Arc::new(ImageBuffer::new(size[0], size[1])));
            self.0.len() - 1
        });
        let picture = Arc::make_mut(&mut self.0[slot]);
        fill(picture);
        self.0[slot].clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Luma;

    #[test]
    fn only_what_nobody_holds_is_used_again() {
        let mut pool = PicturePool::<Luma<u8>>::default();
        let mut take = |size, level| pool.picture(size, |bytes| bytes.fill(level));
        let (a, b) = (take([3, 2], 1), take([3, 2], 2));
        assert_eq!((a.as_raw(), b.as_raw()), (&vec![1; 6], &vec![2; 6]));
        let first = Arc::as_ptr(&a);
        drop(a);
        let c = take([3, 2], 3);
        assert_eq!(Arc::as_ptr(&c), first);
        assert_eq!(b.as_raw(), &vec![2; 6]);
        let held: Vec<_> = (4..12).map(|level| take([3, 2], level)).collect();
        assert!(held.iter().zip(4..).all(|(p, level)| p.as_raw() == &vec![level; 6]));
        assert_eq!(take([1, 1], 0).dimensions(), (1, 1));
    }
}
