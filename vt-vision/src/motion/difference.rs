//! Pixels that change.

use vt_core::batch::vectorized;

/// 255 where two pictures differ by more than `threshold` grey levels, 0 elsewhere.
pub fn difference(a: &[u8], b: &[u8], threshold: u8, mask: &mut [u8]) {
    vectorized(
        #[inline(always)]
        || {
            for ((&a, &b), m) in a.iter().zip(b).zip(mask) {
                *m = if a.abs_diff(b) > threshold { 255 } else { 0 };
            }
        },
    );
}

/// 255 where `now` differs from both others by more than `threshold` grey levels, 0 elsewhere: where something is now that was
/// there neither before nor earlier.
pub fn three_frame_difference(now: &[u8], before: &[u8], earlier: &[u8], threshold: u8, mask: &mut [u8]) {
    vectorized(
        #[inline(always)]
        || {
            for (((&a, &b), &c), m) in now.iter().zip(before).zip(earlier).zip(mask) {
                let least = a.abs_diff(b).min(a.abs_diff(c));
                *m = if least > threshold { 255 } else { 0 };
            }
        },
    );
}
