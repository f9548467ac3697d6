//! Many points at once: rows of coordinates, and the widest vector instructions that the machine has.
//!
//! A [`Row`] holds one coordinate of up to [`LANES`] points, so that a loop over a row is a loop over points, which
//! compilers turn into vector instructions. Every lane is computed as it would be alone, with the same operations in the
//! same order and none of them fused: the width of the registers does not change a bit.

use core::cell::RefCell;

/// Number of points in a batch.
pub const LANES: usize = 64;

/// One coordinate of [`LANES`] points.
pub type Row = [f64; LANES];

/// Runs a kernel compiled for the best instruction set of this machine. The kernel and all it calls must be
/// `#[inline(always)]`, or they stay what they were compiled for.
#[inline(always)]
pub fn vectorized<R>(kernel: impl FnOnce() -> R) -> R {
    pulp::Arch::new().dispatch(kernel)
}

thread_local! {
    /// Stacks of rows of this thread that are not in use.
    static SPARE: RefCell<Vec<Vec<Row>>> = const { RefCell::new(vec![]) };
}

/// Lends `count` rows with any content; storage of a thread is used again.
pub fn with_rows<R>(count: usize, use_them: impl FnOnce(&mut [Row]) -> R) -> R {
    let mut rows = SPARE.with_borrow_mut(Vec::pop).unwrap_or_default();
    if rows.len() < count {
        rows.resize(count, [0.0; LANES]);
    }
    let result = use_them(&mut rows[..count]);
    SPARE.with_borrow_mut(|spare| spare.push(rows));
    result
}

/// `Σ a_k b_k`, summed in an order that does not depend on the machine.
#[inline(always)]
pub fn dot(a: &Row, b: &Row) -> f64 {
    let mut sums = [0.0; 8];
    for (a, b) in a.chunks_exact(8).zip(b.chunks_exact(8)) {
        for l in 0..8 {
            sums[l] += a[l] * b[l];
        }
    }
    fold(sums)
}

/// `Σ a_k`, in the same order.
#[inline(always)]
pub fn total(a: &Row) -> f64 {
    let mut sums = [0.0; 8];
    for a in a.chunks_exact(8) {
        for l in 0..8 {
            sums[l] += a[l];
        }
    }
    fold(sums)
}

#[inline(always)]
fn fold([a, b, c, d, e, f, g, h]: [f64; 8]) -> f64 {
    ((a + e) + (c + g)) + ((b + f) + (d + h))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_nest_without_sharing() {
        for _ in 0..3 {
            with_rows(3, |outer| {
                outer[2].fill(1.0);
                with_rows(2, |inner| inner.iter_mut().for_each(|row| row.fill(7.0)));
                assert_eq!((outer.len(), outer[2]), (3, [1.0; LANES]));
            });
        }
    }

    #[test]
    fn dot_is_the_sum_of_products() {
        let a: Row = core::array::from_fn(|k| k as f64);
        let b: Row = core::array::from_fn(|k| 1.0 + (k % 3) as f64);
        let expected: f64 = (0..LANES).map(|k| a[k] * b[k]).sum();
        assert_eq!((dot(&a, &b), total(&a)), (expected, a.iter().sum()));
        assert_eq!(
            vectorized(
                #[inline(always)]
                || dot(&a, &b)
            ),
            expected
        );
    }
}
