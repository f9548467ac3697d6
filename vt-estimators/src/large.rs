//! Products and factors of large matrices of run-time size, by `faer` (one thread, so that results are the same on any
//! number).

use faer::linalg::matmul::matmul;
use faer::linalg::solvers::Llt;
use faer::linalg::triangular_solve::{solve_lower_triangular_in_place, solve_upper_triangular_in_place};
use faer::prelude::ReborrowMut;
use faer::{Accum, MatMut, MatRef, Par, Side};

/// More coordinates than this are large.
pub(crate) const LARGE: usize = 60;

/// `A ← A + s B Fᵀ` with the first columns of `B`, all by columns; `sizes` are the rows of `B`, the columns and the rows of
/// `F`.
pub(crate) fn add_product(a: &mut [f64], s: f64, b: &[f64], f: &[f64], sizes: [usize; 3]) {
    let [rows, columns, n] = sizes;
    let b = MatRef::from_column_major_slice(&b[..rows * columns], rows, columns);
    let f = MatRef::from_column_major_slice(f, n, columns);
    let a = MatMut::from_column_major_slice_mut(a, rows, n);
    matmul(a, Accum::Add, b, f.transpose(), s, Par::Seq);
}

/// Replaces the lower triangle of an `n × n` matrix by its Cholesky factor; false unless it is finite and positive definite.
pub(crate) fn cholesky(m: &mut [f64], n: usize) -> bool {
    if !vt_core::math::all_finite(m) {
        return false;
    }
    let Ok(factor) = Llt::new(MatRef::from_column_major_slice(m, n, n), Side::Lower) else { return false };
    MatMut::from_column_major_slice_mut(m, n, n).copy_from_triangular_lower(factor.L());
    true
}

/// `B ← B (L Lᵀ)⁻¹` by columns; `sizes` are the rows and columns of `B`.
pub(crate) fn divide_columns(b: &mut [f64], l: &[f64], sizes: [usize; 2]) {
    let [rows, columns] = sizes;
    let l = MatRef::from_column_major_slice(l, columns, columns);
    let mut b = MatMut::from_column_major_slice_mut(b, rows, columns).transpose_mut();
    solve_lower_triangular_in_place(l, b.rb_mut(), Par::Seq);
    solve_upper_triangular_in_place(l.transpose(), b, Par::Seq);
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector, Dyn};
    use vt_core::agent::Estimator;
    use vt_core::belief::Gaussian;
    use vt_core::dynamics::LinearStep;
    use vt_core::lie::DynVector;
    use vt_core::measurement_model::{Instrument, Linear};
    use vt_core::random::{Random, Stream};
    use vt_core::time::Seconds;

    use super::*;
    use crate::congruence::congruence;
    use crate::gain::Gain;
    use crate::information::InformationFilter;
    use crate::kalman::KalmanFilter;
    use crate::sigma_point::{Rule, SigmaPointFilter};
    use crate::smoother::Smoother;
    use crate::square_root::SquareRootFilter;

    /// Linear problems side by side, as one in other coordinates: `x = T (x_1, …)` with an orthogonal `T`.
    struct Problem {
        f: DMatrix<f64>,
        q: DMatrix<f64>,
        h: DMatrix<f64>,
        prior: DMatrix<f64>,
    }

    const PARTS: usize = 9;
    const SMALL: usize = 8;
    const STEPS: usize = 4;

    impl Problem {
        fn random(random: &mut Random) -> Self {
            let mut matrix = |r, c| DMatrix::from_fn(r, c, |_, _| random.normal());
            let mut square = |size: f64| {
                let side = matrix(SMALL, SMALL);
                (&side * side.transpose() / SMALL as f64 + DMatrix::identity(SMALL, SMALL)) * size
            };
            let (q, prior) = (square(0.1), square(1.0));
            let f = DMatrix::identity(SMALL, SMALL) + matrix(SMALL, SMALL) * 0.1;
            Self { f, q, h: matrix(SMALL - 1, SMALL), prior }
        }

        fn motion(&self) -> LinearStep<Dyn> {
            LinearStep::new(self.f.clone(), self.q.clone()).expect("a covariance")
        }

        fn belief(&self) -> Gaussian<DynVector> {
            Gaussian { mean: DynVector(DVector::zeros(self.f.nrows())), covariance: self.prior.clone() }
        }

        /// Runs an estimator over readings.
        fn run(&self, estimator: &mut dyn Estimator<DynVector>, readings: &[DVector<f64>]) {
            let noise = DMatrix::identity(self.h.nrows(), self.h.nrows());
            let sensor = Instrument::new(Linear(self.h.clone()), noise).expect("a covariance");
            for z in readings {
                estimator.predict(Seconds(1.0)).expect("finite");
                estimator.correct(&sensor.read(z.clone()).expect("of this size")).expect("regular");
            }
        }
    }

    fn blocks(of: &[DMatrix<f64>]) -> DMatrix<f64> {
        let (r, c) = of[0].shape();
        let mut all = DMatrix::zeros(r * of.len(), c * of.len());
        for (k, block) in of.iter().enumerate() {
            all.view_mut((k * r, k * c), (r, c)).copy_from(block);
        }
        all
    }

    /// Filters and smoothers of 72 states (products and factors by faer) are those of nine problems of 8 states each (by
    /// nalgebra), to 1e-9.
    #[test]
    fn large_problems_are_their_small_parts() {
        let mut random = Random::new(5, Stream::Sim, 0, 0, 0);
        let parts: Vec<Problem> = (0..PARTS).map(|_| Problem::random(&mut random)).collect();
        let n = PARTS * SMALL;
        assert!(n > LARGE);
        let turn = DMatrix::from_fn(n, n, |_, _| random.normal()).qr().q();
        let all = |part: fn(&Problem) -> &DMatrix<f64>| {
            blocks(&parts.iter().map(part).cloned().collect::<Vec<_>>())
        };
        let turned = |m: DMatrix<f64>| {
            let m = &turn * m * turn.transpose();
            (&m + m.transpose()) * 0.5
        };
        let large = Problem {
            f: &turn * all(|p| &p.f) * turn.transpose(),
            q: turned(all(|p| &p.q)),
            h: all(|p| &p.h) * turn.transpose(),
            prior: turned(all(|p| &p.prior)),
        };
        let m = parts[0].h.nrows();
        let readings: Vec<_> =
            (0..STEPS).map(|_| DVector::from_fn(m * PARTS, |_, _| random.normal())).collect();
        let of = |k: usize| readings.iter().map(|z| z.rows(k * m, m).into_owned()).collect::<Vec<_>>();

        let smoothed = |problem: &Problem, readings: &[DVector<f64>]| {
            let filter =
                KalmanFilter::<DynVector, DynVector, _>::from_belief(problem.belief(), problem.motion());
            let mut smoother = Smoother::<DynVector, _>::new(filter.expect("a prior"));
            problem.run(&mut smoother, readings);
            (smoother.pose(), smoother.oldest().expect("regular"))
        };
        let small: Vec<_> = parts.iter().enumerate().map(|(k, p)| smoothed(p, &of(k))).collect();
        let expected = |belief: fn(&(Gaussian<DynVector>, Gaussian<DynVector>)) -> &Gaussian<DynVector>| {
            let mean = DVector::from_iterator(n, small.iter().flat_map(|s| belief(s).mean.0.iter().copied()));
            let covariance = blocks(&small.iter().map(|s| belief(s).covariance.clone()).collect::<Vec<_>>());
            (&turn * mean, &turn * covariance * turn.transpose())
        };
        let same = |found: &Gaussian<DynVector>, (mean, covariance): &(DVector<f64>, DMatrix<f64>)| {
            (&found.mean.0 - mean).amax() < 1e-9 && (&found.covariance - covariance).amax() < 1e-9
        };
        let (filtered, first) = (expected(|s| &s.0), expected(|s| &s.1));
        let (last, oldest) = smoothed(&large, &readings);
        assert!(same(&last, &filtered) && same(&oldest, &first));

        let (belief, motion) = (|| large.belief(), || large.motion());
        let filters: [(&str, Box<dyn Estimator<DynVector>>); 3] = [
            (
                "square root",
                Box::new(
                    SquareRootFilter::<DynVector, DynVector, _>::from_belief(belief(), motion())
                        .expect("a prior"),
                ),
            ),
            (
                "information",
                Box::new(
                    InformationFilter::<DynVector, DynVector, _>::from_belief(belief(), motion())
                        .expect("a prior"),
                ),
            ),
            (
                "cubature",
                Box::new(
                    SigmaPointFilter::<DynVector, DynVector, _>::from_belief(
                        belief(),
                        motion(),
                        Rule::Cubature,
                    )
                    .expect("a prior"),
                ),
            ),
        ];
        for (name, mut filter) in filters {
            large.run(filter.as_mut(), &readings);
            assert!(same(&filter.pose(), &filtered), "{name}");
        }
    }

    #[test]
    fn matrices_of_no_use_are_refused() {
        let n = LARGE + 3;
        let mut negative = DMatrix::<f64>::identity(n, n);
        negative[(n - 1, n - 1)] = -1.0;
        let mut broken = DMatrix::<f64>::identity(n, n);
        broken[(3, 1)] = f64::NAN;
        for mut m in [negative, broken] {
            assert!(!cholesky(m.as_mut_slice(), n));
        }
    }

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
