//! One frame both ways: the data's own solution as a measured pose (loose), and data and prior in one solve (tight).

use vt_core::agent::Estimator;
use vt_core::belief::Gaussian;
use vt_core::dynamics::Brownian;
use vt_core::least_squares::LeastSquares;
use vt_core::lie::SE3;
use vt_core::manifold::Manifold;
use vt_core::measurement::Quality;
use vt_core::pose_measurement::PoseMeasurement;
use vt_estimators::kalman::KalmanFilter;

use crate::problems::{Pixels, before_camera, corners, deviations, normals, random};

struct Frame {
    prior: Gaussian<SE3>,
    data: Pixels,
}

/// A prior 3 cm and 4° wide, and pixels known to 2 px, both shrunk by `size`; `points` corners of the box.
fn frame(case: u64, size: f64, points: usize) -> Frame {
    let random = &mut random(case);
    let truth = before_camera(random);
    let sigmas = deviations(0.03, 0.07) * size;
    let prior = Gaussian::from_sigmas(truth.retract(&normals(&sigmas, random)), &sigmas);
    Frame { prior, data: Pixels::simulate(&corners()[..points], &truth, 2.0 * size, random) }
}

fn filter(prior: &Gaussian<SE3>, iterations: u32) -> KalmanFilter<SE3, SE3, Brownian<SE3>> {
    let motion = Brownian::new(deviations(0.0, 0.0)).expect("not negative");
    KalmanFilter::new(prior, vec![], motion, iterations).expect("a prior")
}

/// The pose that the data alone give, searched from the prior, which does not enter.
fn measured(f: &Frame) -> PoseMeasurement<SE3> {
    let solver =
        LeastSquares { max_iterations: 100, step_tolerance: 1e-8, ..LeastSquares::levenberg_marquardt() };
    let own = solver.fit(&f.data, &f.prior.mean, None).expect("finite");
    PoseMeasurement::new(own.pose, own.information, Quality::default())
}

/// Difference of means in deviations of the tight posterior, and of covariances relative to it.
fn difference(f: &Frame, iterations: u32) -> (f64, f64) {
    let (mut loose, mut tight) = (filter(&f.prior, iterations), filter(&f.prior, 20));
    tight.correct(&f.data).expect("finite");
    loose.correct(&measured(f)).expect("finite");
    let (loose, tight) = (loose.pose(), tight.pose());
    let whitening = tight.covariance.cholesky().expect("regular").l().try_inverse().expect("regular");
    let mean = (whitening * tight.mean.local(&loose.mean)).norm();
    let spread = whitening * loose.covariance * whitening.transpose();
    (mean, (spread - nalgebra::Matrix6::identity()).amax())
}

/// Errors in units of the (shrinking) deviations are of first order, hence errors of the pose of second order: at half
/// the size they are half in deviations, a quarter in metres and radians.
#[test]
fn loose_is_tight_to_second_order() {
    for iterations in [1, 10] {
        let rms = |size: f64| {
            let squares = (0..30).map(|case| {
                let (mean, spread) = difference(&frame(case, size, 8), iterations);
                (mean * mean, spread * spread)
            });
            let sum = squares.fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
            ((sum.0 / 30.0_f64).sqrt(), (sum.1 / 30.0_f64).sqrt())
        };
        let [whole, half, quarter] = [0.4, 0.2, 0.1].map(rms);
        for (coarse, fine) in [(whole, half), (half, quarter)] {
            let (mean, spread) = (coarse.0 / fine.0, coarse.1 / fine.1);
            assert!(
                (1.6..2.6).contains(&mean),
                "{iterations} iterations, means: {whole:?} {half:?} {quarter:?}"
            );
            assert!(
                (1.6..2.6).contains(&spread),
                "{iterations} iterations, spread: {whole:?} {half:?} {quarter:?}"
            );
        }
        assert!(quarter.0 < 0.02 && quarter.1 < 0.03, "{iterations} iterations: {quarter:?}");
    }
}

/// The information after the update is that of the prior once and of the data once; with the posterior of a solve
/// with prior as measurement it would be the prior's twice.
#[test]
fn the_prior_counts_once() {
    for case in 0..20 {
        // Two points say four numbers about six unknowns, three say six, all of them say more.
        for points in [2, 3, 8] {
            let f = frame(case, 0.02, points);
            let z = measured(&f);
            let directions = vt_core::least_squares::Spectrum::new(z.information(), 1e-9).rank();
            assert_eq!(directions, 6.min(2 * points), "case {case}, {points} points");
            let mut loose = filter(&f.prior, 1);
            loose.correct(&z).expect("finite");
            let prior = f.prior.covariance.try_inverse().expect("regular");
            let both = (prior + z.information()).try_inverse().expect("regular");
            let found = loose.pose().covariance;
            let whitening = both.cholesky().expect("regular").l().try_inverse().expect("regular");
            let excess = (whitening * found * whitening.transpose() - nalgebra::Matrix6::identity()).amax();
            assert!(excess < 0.05, "case {case}, {points} points: {excess}");
        }
    }
}

/// Where the data say nothing, loose and tight keep the prior.
#[test]
fn null_directions_have_no_information() {
    for case in 0..20 {
        let (mean, spread) = difference(&frame(case, 0.02, 2), 1);
        assert!(mean < 0.05 && spread < 0.05, "case {case}: {mean} {spread}");
    }
}
