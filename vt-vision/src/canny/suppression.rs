//! Thinning: of neighbours along the gradient only the largest stays.

use vt_core::batch::vectorized;

use super::{Norm, STRONG, WEAK};

/// Sizes of gradients.
pub(super) fn magnitude(gx: &[i16], gy: &[i16], norm: Norm, out: &mut [f32]) {
    vectorized(
        #[inline(always)]
        move || {
            let pairs = gx.iter().zip(gy).zip(out);
            match norm {
                Norm::L1 => pairs.for_each(|((&x, &y), m)| {
                    *m = (i32::from(x).abs() + i32::from(y).abs()) as f32;
                }),
                Norm::L2 => pairs.for_each(|((&x, &y), m)| {
                    let (x, y) = (i32::from(x), i32::from(y));
                    *m = ((x * x + y * y) as f32).sqrt();
                }),
            }
        },
    );
}

/// So many pixels are looked at together.
const BLOCK: usize = 64;

/// Classes of a row of pixels: the sizes of three rows have one value more on both sides. A pixel must exceed what is before it
/// and not be below what is after it.
pub(super) fn suppress(sizes: [&[f32]; 3], gx: &[i16], gy: &[i16], bounds: [f32; 2], out: &mut [u8]) {
    vectorized(
        #[inline(always)]
        move || {
            let n = out.len();
            let blocks = n - n % BLOCK;
            for at in (0..blocks).step_by(BLOCK) {
                out[at..at + BLOCK].copy_from_slice(&peaks::<BLOCK>(sizes, gx, gy, bounds, at));
            }
            for at in blocks..n {
                out[at] = peaks::<1>(sizes, gx, gy, bounds, at)[0];
            }
        },
    );
}

/// Values that follow each other, as an array: what is written next to it is then known not to change it.
#[inline(always)]
fn take<T: Copy + Default, const N: usize>(row: &[T], at: usize) -> [T; N] {
    let mut values = [T::default(); N];
    values.copy_from_slice(&row[at..at + N]);
    values
}

/// Classes of the pixels `at .. at + N`.
#[inline(always)]
fn peaks<const N: usize>(
    [above, here, below]: [&[f32]; 3],
    gx: &[i16],
    gy: &[i16],
    [low, high]: [f32; 2],
    at: usize,
) -> [u8; N] {
    let (nw, no, ne) = (take::<_, N>(above, at), take::<_, N>(above, at + 1), take::<_, N>(above, at + 2));
    let (we, me, ea) = (take::<_, N>(here, at), take::<_, N>(here, at + 1), take::<_, N>(here, at + 2));
    let (sw, so, se) = (take::<_, N>(below, at), take::<_, N>(below, at + 1), take::<_, N>(below, at + 2));
    let (gx, gy) = (take::<_, N>(gx, at), take::<_, N>(gy, at));
    let mut out = [0; N];
    for i in 0..N {
        let (x, y) = (f32::from(gx[i]), f32::from(gy[i]));
        let (ax, ay) = (x.abs(), y.abs());
        let across = ax >= ay;
        // The line falls to the right if both have one sign; the slanted neighbours then lie north-west and south-east.
        // Otherwise the one after a pixel lies north-east for lines nearer to a row, south-west for those nearer to a
        // column.
        let falling = x * y >= 0.0;
        let (major, minor) = if across { (ax, ay) } else { (ay, ax) };
        let rest = major - minor;
        let (straight_before, straight_after) = if across { (we[i], ea[i]) } else { (no[i], so[i]) };
        let (rising_before, rising_after) = if across { (sw[i], ne[i]) } else { (ne[i], sw[i]) };
        let (slanted_before, slanted_after) =
            if falling { (nw[i], se[i]) } else { (rising_before, rising_after) };
        let size = me[i] * major;
        let before = straight_before * rest + slanted_before * minor;
        let after = straight_after * rest + slanted_after * minor;
        let peak = (size > before) & (size >= after) & (me[i] > low);
        let class = if me[i] > high { STRONG } else { WEAK };
        out[i] = if peak { class } else { 0 };
    }
    out
}
