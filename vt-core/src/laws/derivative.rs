//! Oracles for Jacobians, and their comparison block by block.

use nalgebra::{DMatrix, Dim, Matrix, RawStorage};

use super::Dual64;

/// Names and lengths of the parts of a vector, as [`crate::manifold::Manifold::blocks`] gives them.
pub type Blocks = Vec<(String, usize)>;

/// A matrix of any size as one of run-time size.
pub fn block<R: Dim, C: Dim, S: RawStorage<f64, R, C>>(m: &Matrix<f64, R, C, S>) -> DMatrix<f64> {
    DMatrix::from_fn(m.nrows(), m.ncols(), |r, c| m[(r, c)])
}

/// Jacobian at zero of a function of `columns` variables with `rows` values: central differences of fourth order with
/// this step, whose truncation error goes with its fourth power.
///
/// # Panics
/// When `f` gives another number of values.
pub fn difference_jacobian(
    rows: usize,
    columns: usize,
    step: f64,
    mut f: impl FnMut(&[f64]) -> Vec<f64>,
) -> DMatrix<f64> {
    let mut j = DMatrix::zeros(rows, columns);
    let mut e = vec![0.0; columns];
    for c in 0..columns {
        for (at, weight) in [(1.0, 8.0), (-1.0, -8.0), (2.0, -1.0), (-2.0, 1.0)] {
            e[c] = at * step;
            let value = f(&e);
            assert_eq!(value.len(), rows, "number of values");
            for r in 0..rows {
                j[(r, c)] += weight * value[r] / (12.0 * step);
            }
        }
        e[c] = 0.0;
    }
    j
}

/// Jacobian at zero of a function of `columns` variables with `rows` values, by dual numbers: exact up to rounding.
///
/// # Panics
/// When `f` gives another number of values.
pub fn dual_jacobian(
    rows: usize,
    columns: usize,
    mut f: impl FnMut(&[Dual64]) -> Vec<Dual64>,
) -> DMatrix<f64> {
    let mut j = DMatrix::zeros(rows, columns);
    let mut e = vec![Dual64::from_re(0.0); columns];
    for c in 0..columns {
        e[c].eps = 1.0;
        let value = f(&e);
        assert_eq!(value.len(), rows, "number of values");
        for r in 0..rows {
            j[(r, c)] = value[r].eps;
        }
        e[c].eps = 0.0;
    }
    j
}

/// Compares two matrices block by block. A block may differ by `tolerance` times its largest entry, or times one
/// where that is larger.
///
/// # Panics
/// When a block differs, an entry is not finite, or sizes do not fit. The message names the worst block.
pub fn compare(
    what: &str,
    rows: &Blocks,
    columns: &Blocks,
    found: &DMatrix<f64>,
    expected: &DMatrix<f64>,
    tolerance: f64,
) {
    let size = |blocks: &Blocks| blocks.iter().map(|b| b.1).sum::<usize>();
    assert_eq!(found.shape(), expected.shape(), "{what}: shape");
    assert_eq!(
        found.shape(),
        (size(rows), size(columns)),
        "{what}: lengths of the blocks {rows:?}, {columns:?}"
    );
    let mut worst: Option<(f64, String)> = None;
    let mut r0 = 0;
    for (row, height) in rows {
        let mut c0 = 0;
        for (column, width) in columns {
            let part = (r0, c0);
            let (f, e) = (found.view(part, (*height, *width)), expected.view(part, (*height, *width)));
            let size = e.iter().fold(1.0, |m: f64, v| m.max(v.abs()));
            // A NaN must not pass.
            let error = (f - e)
                .iter()
                .fold(0.0, |m: f64, v| if v.is_finite() { m.max(v.abs() / size) } else { f64::INFINITY });
            if error > tolerance && worst.as_ref().is_none_or(|w| error > w.0) {
                let text =
                    format!("{what}: block {row}/{column} differs by {error:.3e}; found {f}expected {e}");
                worst = Some((error, text));
            }
            c0 += width;
        }
        r0 += height;
    }
    if let Some((_, text)) = worst {
        panic!("{text}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_oracles_give_known_derivatives() {
        // (x² y + x, sin y) around (2, 0.5)
        let expected = DMatrix::from_row_slice(2, 2, &[3.0, 4.0, 0.0, crate::math::cos(0.5)]);
        let real = |e: &[f64]| {
            let (x, y) = (2.0 + e[0], 0.5 + e[1]);
            vec![x * x * y + x, crate::math::sin(y)]
        };
        let dual = |e: &[Dual64]| {
            let (x, y) = (e[0] + 2.0, e[1] + 0.5);
            vec![x * x * y + x, nalgebra::ComplexField::sin(y)]
        };
        assert!((difference_jacobian(2, 2, 1e-3, real) - &expected).amax() < 1e-11);
        assert!((dual_jacobian(2, 2, dual) - &expected).amax() < 1e-15);
    }

    #[test]
    fn the_bad_block_is_named() {
        let blocks = vec![("translation".to_string(), 2), ("rotation".to_string(), 1)];
        let good = DMatrix::identity(3, 3);
        compare("J", &blocks, &blocks, &good, &good, 1e-9);
        for (at, value, name) in [
            ((0, 2), 1e-3, "translation/rotation"),
            ((2, 1), f64::NAN, "rotation/translation"),
            ((2, 2), 1.1, "rotation/rotation"),
        ] {
            let mut bad = good.clone();
            bad[at] = value;
            let message = std::panic::catch_unwind(|| compare("J", &blocks, &blocks, &bad, &good, 1e-9))
                .expect_err("must differ")
                .downcast::<String>()
                .expect("text");
            assert!(message.contains(name), "{message}");
        }
    }
}
