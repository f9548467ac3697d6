//! Thinning: of neighbours along the gradient only the largest stays.

use vt_core::batch::vectorized;

use super::{Norm, STRONG, WEAK};

/// Sizes of gradients.
pub(super) fn magnitude(gx: &[i16], gy: &[i16], norm: Norm, out: &mut [f32]) {
    vectorized(
        #[inline(always)]
        || {
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

/// Classes of a row of pixels: the sizes of three rows have one value more on both sides. A pixel must exceed what is before it
/// and not be below what is after it.
pub(super) fn suppress(sizes: [&[f32]; 3], gx: &[i16], gy: &[i16], [low, high]: [f32; 2], out: &mut [u8]) {
    vectorized(
        #[inline(always)]
        || {
            let n = out.len();
            let [[nw, no, ne], [we, me, ea], [sw, so, se]] =
                sizes.map(|row| [0, 1, 2].map(|k| &row[k..][..n]));
            let (gx, gy, out) = (&gx[..n], &gy[..n], &mut out[..n]);
            for i in 0..n {
                let (x, y) = (i32::from(gx[i]), i32::from(gy[i]));
                let (ax, ay) = (x.abs(), y.abs());
                let across = ax >= ay;
                let falling = (x ^ y) >= 0;
                let (major, minor) = (ax.max(ay) as f32, ax.min(ay) as f32);
                let rest = major - minor;
                let straight = if across { [we[i], ea[i]] } else { [no[i], so[i]] };
                // The slanted neighbours of a line that falls to the right lie north-west and south-east; otherwise the
                // one after a pixel lies east for lines nearer to a row, south for those nearer to a column.
                let rising = if across { [sw[i], ne[i]] } else { [ne[i], sw[i]] };
                let slanted = if falling { [nw[i], se[i]] } else { rising };
                let size = me[i] * major;
                let before = straight[0] * rest + slanted[0] * minor;
                let after = straight[1] * rest + slanted[1] * minor;
                let peak = (size > before) & (size >= after) & (me[i] > low);
                let class = if me[i] > high { STRONG } else { WEAK };
                out[i] = if peak { class } else { 0 };
            }
        },
    );
}
