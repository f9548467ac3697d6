//! Products of large matrices of run-time size, by `faer` (one thread, so that results are the same on any number).

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};

/// More coordinates than this are large.
pub(crate) const LARGE: usize = 60;

/// `P Fᵀ` with the first columns of `P`, all by columns; `sizes` are the rows of `P`, the columns and the rows of `F`.
pub(crate) fn times_transpose(p: &[f64], f: &[f64], sizes: [usize; 3], out: &mut [f64]) {
    let [rows, columns, n] = sizes;
    let p = MatRef::from_column_major_slice(&p[..rows * columns], rows, columns);
    let f = MatRef::from_column_major_slice(f, n, columns);
    let out = MatMut::from_column_major_slice_mut(out, rows, n);
    matmul(out, Accum::Replace, p, f.transpose(), 1.0, Par::Seq);
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};
    use vt_core::random::{Random, Stream};

    use super::*;
    use crate::congruence::congruence;
    use crate::gain::Gain;

    /// 90 coordinates, 70 rows: both libraries agree to 1e-9.
    #[test]
    fn products_are_those_of_nalgebra() {
        let mut random = Random::new(4, Stream::Sim, 0, 0, 0);
        let n = LARGE + 30;
        let mut matrix = |r, c| DMatrix::from_fn(r, c, |_, _| random.normal());
        let side = matrix(n, n);
        let p = &side * side.transpose() / n as f64 + DMatrix::identity(n, n);
        let f = DMatrix::identity(n, n) + matrix(n, n) * 0.1;
        let expected = &f * &p * f.transpose();
        let found = congruence(&f, &p);
        assert!((&found - &expected).amax() < 1e-9 && found == found.transpose());
        let h = matrix(LARGE + 10, n);
        let s = &h * &p * h.transpose() + DMatrix::identity(LARGE + 10, LARGE + 10);
        let inverse = s.clone().try_inverse().expect("regular");
        let gain = Gain::new(&p, &h, None).expect("regular");
        assert!((&gain.gain - &p * h.transpose() * &inverse).amax() < 1e-9);
        let after = gain.joseph(&p, &h, None);
        assert!((after - (&p - &p * h.transpose() * &inverse * &h * &p)).amax() < 1e-9);
        let nu = DVector::from_fn(LARGE + 10, |k, _| k as f64 * 0.01);
        assert!((gain.surprise(&nu).0 - (&inverse * &nu).dot(&nu)).abs() < 1e-9);
    }
}
