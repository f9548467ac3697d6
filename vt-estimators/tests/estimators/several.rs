//! Several models, several times: mixtures, smoothers, measurements out of order, noise that is learnt.

use nalgebra::{Const, DMatrix, DVector, Matrix2, RowVector4, SMatrix, Vector1, Vector2, Vector4, Vector6};
use proptest::prelude::*;
use vt_core::agent::{Dynamics, Estimator};
use vt_core::belief::{Accelerating, Gaussian, Moving};
use vt_core::dynamics::{Brownian, ConstantAcceleration, ConstantVelocity, LinearRate, LinearStep};
use vt_core::error::EstimateError;
use vt_core::lie::{DynVector, SE3, Vector};
use vt_core::manifold::{Manifold, Square};
use vt_core::measurement::Quality;
use vt_core::measurement_model::{Instrument, Linear, Reading};
use vt_core::pose_measurement::PoseMeasurement;
use vt_core::time::{Seconds, Timestamp};
use vt_estimators::adaptive::{Adaptive, Noise, NoiseFactor};
use vt_estimators::gaussian_filter::GaussianFilter;
use vt_estimators::imm::{Imm, Switching, mode};
use vt_estimators::information::InformationFilter;
use vt_estimators::kalman::KalmanFilter;
use vt_estimators::out_of_sequence::Replay;
use vt_estimators::particle::{Annealing, Method, ParticleFilter, ParticleParams};
use vt_estimators::resampling::Resampling;
use vt_estimators::retrodiction::{Retrodiction, RetrodictionFilter};
use vt_estimators::sigma_point::{Rule, SigmaPointFilter};
use vt_estimators::smoother::Smoother;
use vt_estimators::square_root::SquareRootFilter;

use crate::linear::{LinearProblem, LinearStep as Step, batch, config};
use crate::problems::{before_camera, deviations, normals, random};

type Plane = Vector<4>;

/// Position and velocity on two axes, white acceleration.
fn motion(density: f64) -> LinearRate<Const<4>> {
    let mut a = SMatrix::<f64, 4, 4>::zeros();
    (a[(0, 2)], a[(1, 3)]) = (1.0, 1.0);
    LinearRate::new(a, SMatrix::from_diagonal(&Vector4::new(0.0, 0.0, density, density))).expect("valid")
}

fn prior() -> Gaussian<Plane> {
    Gaussian::from_sigmas(Vector(Vector4::new(1.0, 2.0, 0.5, -0.5)), &Vector4::new(1.0, 2.0, 1.0, 0.5))
}

fn kalman(density: f64) -> KalmanFilter<Plane, Plane, LinearRate<Const<4>>> {
    KalmanFilter::from_belief(prior(), motion(density)).expect("a prior")
}

fn row(random: &mut vt_core::random::Random) -> Reading<Plane, Linear<Const<1>, Const<4>>> {
    let h = RowVector4::new(random.normal(), random.normal(), 0.0, 0.3 * random.normal());
    let instrument =
        Instrument::new(Linear(h), SMatrix::<f64, 1, 1>::new(0.1 + random.uniform())).expect("valid");
    instrument.read(Vector1::new(3.0 * random.normal())).expect("finite")
}

proptest! {
    #![proptest_config(config())]

    /// One model is the filter itself, and so are two equal ones, however they switch.
    #[test]
    fn models_of_one_kind_are_the_filter(seed: u64) {
        let random = &mut random(seed);
        let mut one = Imm::new(vec![mode(kalman(0.4))], &[1.0], Switching::Step(DMatrix::identity(1, 1)), &prior()).expect("a model");
        let root = SquareRootFilter::<Plane, Plane, _>::from_belief(prior(), motion(0.4)).expect("a prior");
        let modes = vec![mode(kalman(0.4)), mode(root)];
        let mut two = Imm::new(modes, &[0.3, 0.7], Switching::every(Seconds(0.8), 2), &prior()).expect("models");
        let mut alone = kalman(0.4);
        for _ in 0..5 {
            let (dt, z) = (Seconds(0.1 + random.uniform()), row(random));
            for e in [&mut one as &mut dyn Estimator<Plane>, &mut two, &mut alone] {
                e.predict(dt).expect("finite");
            }
            let expected = alone.correct(&z).expect("finite");
            for (name, imm) in [("one", &mut one), ("two", &mut two)] {
                let found = imm.correct(&z).expect("finite");
                prop_assert!((found.nis - expected.nis).abs() < 1e-9 * (1.0 + expected.nis), "{}", name);
                prop_assert!((found.log_evidence - expected.log_evidence).abs() < 1e-9 * (1.0 + expected.nis));
                let (belief, alone) = (imm.belief(), alone.belief());
                prop_assert!((belief.mean.0 - alone.mean.0).norm() < 1e-9 * (1.0 + alone.mean.0.norm()), "{}", name);
                prop_assert!((belief.covariance - alone.covariance).amax() < 1e-9, "{}", name);
            }
        }
    }

    /// Smoothed beliefs are those of all data at once.
    #[test]
    fn smoothing_is_the_batch_solution(seed: u64, lag in 0_usize..4) {
        let problem = LinearProblem::random(3, 2, 6, &mut random(seed));
        let prior = Gaussian { mean: DynVector(problem.mean.clone()), covariance: problem.covariance.clone() };
        let s = &problem.steps[0];
        let motion = LinearStep::new(s.f.clone(), s.q.clone()).expect("valid");
        let filter = KalmanFilter::<DynVector, DynVector, _>::from_belief(prior.clone(), motion.clone()).expect("a prior");
        let sigma = SigmaPointFilter::<DynVector, DynVector, _>::from_belief(prior, motion, Rule::Cubature).expect("a prior");
        let mut all = Smoother::new(filter.clone());
        let (mut lagged, mut points) = (Smoother::fixed_lag(filter, lag), Smoother::new(sigma));
        for (k, s) in problem.steps.iter().enumerate() {
            let instrument = Instrument::<DynVector, _>::new(Linear(s.h.clone()), DMatrix::from_diagonal(&s.r)).expect("valid");
            let z = instrument.read(s.z.clone()).expect("finite");
            for e in [&mut all as &mut dyn Estimator<DynVector>, &mut lagged, &mut points] {
                e.predict(Seconds(1.0)).expect("finite");
                e.correct(&z).expect("finite");
            }
            if k >= lag {
                let (mean, covariance) = state_of(&problem, k + 1, k + 1 - lag);
                let oldest = lagged.oldest().expect("regular");
                prop_assert!((&oldest.mean.0 - mean).amax() < 1e-8 && (&oldest.covariance - covariance).amax() < 1e-8);
            }
        }
        let (smoothed, by_points) = (all.smoothed().expect("regular"), points.smoothed().expect("regular"));
        prop_assert_eq!(smoothed.len(), 7);
        for (k, (belief, points)) in smoothed.iter().zip(&by_points).enumerate() {
            let (mean, covariance) = state_of(&problem, 6, k);
            prop_assert!((&belief.mean.0 - &mean).amax() < 1e-8 && (&belief.covariance - &covariance).amax() < 1e-8, "{}", k);
            prop_assert!((&points.mean.0 - &mean).amax() < 1e-8 && (&points.covariance - &covariance).amax() < 1e-8, "{}", k);
        }
    }

    /// Any order of arrival gives the bytes of the right one, for every estimator.
    #[test]
    fn replay_is_the_right_order(seed: u64, order in Just((0..6_usize).collect::<Vec<_>>()).prop_shuffle()) {
        let random = &mut random(seed);
        let times: Vec<Timestamp> = (0..6).map(|k| Timestamp(100_000_000 * (k + 1) + (random.uniform() * 5e7) as i64)).collect();
        let readings: Vec<_> = times.iter().map(|_| row(random)).collect();
        let sigma = SigmaPointFilter::<Plane, Plane, _>::from_belief(prior(), motion(0.4), Rule::UNSCENTED).expect("a prior");
        let imm = Imm::new(vec![mode(kalman(0.1)), mode(kalman(9.0))], &[0.5, 0.5], Switching::every(Seconds(2.0), 2), &prior()).expect("models");
        macro_rules! check {
            ($filter:expr) => {
                let mut ordered = Replay::new($filter, Timestamp(0), 8);
                let mut shuffled = Replay::new($filter, Timestamp(0), 8);
                for k in 0..6 {
                    ordered.take(times[k], readings[k].clone()).expect("finite");
                    shuffled.take(times[order[k]], readings[order[k]].clone()).expect("in time");
                }
                let [a, b] = [&ordered, &shuffled].map(|r| r.newest().expect("a belief").1.pose());
                prop_assert_eq!((a.mean.0, a.covariance), (b.mean.0, b.covariance));
            };
        }
        check!(kalman(0.4));
        check!(SquareRootFilter::<Plane, Plane, _>::from_belief(prior(), motion(0.4)).expect("a prior"));
        check!(InformationFilter::<Plane, Plane, _>::from_belief(prior(), motion(0.4)).expect("a prior"));
        check!(ParticleFilter::<Plane, Plane, _>::new(&prior(), vec![], motion(0.4), ParticleParams::default()).expect("a prior"));
        check!(sigma.clone());
        check!(imm.clone());
        check!(kalman(0.4).iterated(3));
        check!(Smoother::<Plane, _>::fixed_lag(kalman(0.4), 3));
        let factor = NoiseFactor::new(2, 0.5, (0.1, 10.0)).expect("valid");
        check!(Adaptive::<Plane, _>::new(kalman(0.4), Noise::Process, factor.clone()));
        for method in [Method::Auxiliary, Method::Annealed(Annealing::default()), Method::Partitioned(vec![vec![0, 1], vec![2, 3]])] {
            let params = ParticleParams { method, resampling: Resampling::Residual, ..ParticleParams::default() };
            check!(ParticleFilter::<Plane, Plane, _>::new(&prior(), vec![], motion(0.4), params.clone()).expect("a prior"));
        }
    }

    /// One step late: A1 is the replay; B1 is near, and its covariance is not too small.
    #[test]
    fn retrodiction_of_one_step(seed: u64, late_by in 50_000_000..850_000_000_i64) {
        let random = &mut random(seed);
        let (early, late, last) = (row(random), row(random), row(random));
        let times = [400_000_000, 1_300_000_000 - late_by, 1_300_000_000].map(Timestamp);
        let (first, span, age) = (times[0] - Timestamp(0), times[2] - times[0], times[2] - times[1]);
        let start = || {
            let mut filter = RetrodictionFilter::<Plane, _>::new(prior(), motion(0.7)).expect("a prior");
            filter.predict(first).expect("finite");
            filter.update(&early).expect("finite");
            filter
        };
        let mut replay = Replay::new(kalman(0.7), Timestamp(0), 3);
        for (time, z) in [(times[0], &early), (times[2], &last), (times[1], &late)] {
            replay.take(time, z.clone()).expect("in time");
        }
        let expected = replay.newest().expect("a belief").1.belief();
        let retrodicted = |retrodiction| {
            let mut filter = start();
            filter.predict(span).expect("finite");
            filter.update(&last).expect("finite");
            filter.update_late(&late, age, retrodiction).expect("one step late");
            filter
        };
        let optimal = retrodicted(Retrodiction::Optimal);
        let size = expected.covariance.amax();
        prop_assert!((optimal.belief().mean.0 - expected.mean.0).norm() < 1e-8 * (1.0 + expected.mean.0.norm()));
        prop_assert!((optimal.belief().covariance - expected.covariance).amax() < 1e-8 * size);
        let simple = retrodicted(Retrodiction::WithoutNoise);
        let excess = (simple.belief().covariance - expected.covariance).trace();
        prop_assert!(excess > -1e-8 * size, "B1 claims to know more than the optimum: {}", excess);
        let mut too_late = start();
        prop_assert!(matches!(too_late.update_late(&late, Seconds(5.0), Retrodiction::Optimal), Err(EstimateError::TooLate { .. })), "too late");
    }
}

/// State `at` of a linear problem given the first `steps` measurements: a batch with the state kept as more coordinates.
fn state_of(problem: &LinearProblem, steps: usize, at: usize) -> (DVector<f64>, DMatrix<f64>) {
    let n = problem.mean.len();
    let mut mean = DVector::zeros(2 * n);
    mean.rows_mut(0, n).copy_from(&problem.mean);
    mean.rows_mut(n, n).copy_from(&problem.mean);
    let mut covariance = DMatrix::zeros(2 * n, 2 * n);
    for (r, c) in [(0, 0), (0, n), (n, 0), (n, n)] {
        covariance.view_mut((r, c), (n, n)).copy_from(&problem.covariance);
    }
    let wide = problem.steps[..steps].iter().enumerate().map(|(k, s)| {
        // Up to `at` the second half follows the first one, noise included; then it stays.
        let (mut f, mut q) = (DMatrix::identity(2 * n, 2 * n), DMatrix::zeros(2 * n, 2 * n));
        f.view_mut((0, 0), (n, n)).copy_from(&s.f);
        q.view_mut((0, 0), (n, n)).copy_from(&s.q);
        if k < at {
            f.view_mut((n, n), (n, n)).fill(0.0);
            f.view_mut((n, 0), (n, n)).copy_from(&s.f);
            for (r, c) in [(0, n), (n, 0), (n, n)] {
                q.view_mut((r, c), (n, n)).copy_from(&s.q);
            }
        }
        let mut h = DMatrix::zeros(s.h.nrows(), 2 * n);
        h.columns_mut(0, n).copy_from(&s.h);
        Step { f, q, h, z: s.z.clone(), r: s.r.clone() }
    });
    let wide: Vec<_> = wide.collect();
    let (mean, covariance) = batch(&mean, &covariance, &wide);
    (mean.rows(n, n).into_owned(), covariance.view((n, n), (n, n)).into_owned())
}

/// Models of a pose, a pose with velocity, and one with acceleration: the mixture finds out which one moves.
#[test]
fn models_of_unlike_size_on_rigid_motions() {
    let start = before_camera(&mut random(3));
    let prior = Gaussian::from_sigmas(start, &deviations(0.01, 0.02));
    let (slow, rest) = (deviations(0.002, 0.002), deviations(0.3, 0.5));
    let still = KalmanFilter::<SE3, SE3, _>::new(
        &prior,
        vec![],
        Brownian::new(slow.map(|s| s * s)).expect("valid"),
        1,
    )
    .expect("a prior");
    let moving = ConstantVelocity::<SE3>::new(deviations(1e-4, 1e-4)).expect("valid");
    let moving = KalmanFilter::<SE3, Moving<SE3>, _>::new(&prior, vec![rest], moving, 1).expect("a prior");
    let bent = ConstantAcceleration::<SE3>::new(deviations(1e-3, 1e-3)).expect("valid");
    let bent = SigmaPointFilter::<SE3, Accelerating<SE3>, _>::new(
        &prior,
        vec![rest, deviations(0.5, 0.5)],
        bent,
        Rule::Cubature,
    )
    .expect("a prior");
    let common = GaussianFilter::<SE3, Accelerating<SE3>>::belief(&bent);
    let modes = vec![mode::<SE3, SE3, Accelerating<SE3>, _>(still), mode(moving), mode(bent)];
    let mut imm =
        Imm::new(modes, &[1.0 / 3.0; 3], Switching::every(Seconds(4.0), 3), &common).expect("models");
    let random = &mut random(8);
    let seen = deviations(0.001, 0.003);
    let information = Square::<SE3>::from_diagonal(&seen.map(|s| 1.0 / (s * s)));
    let twist = Vector6::new(0.2, -0.1, 0.15, 0.3, -0.4, 0.2);
    let mut truth = start;
    let mut winners = vec![];
    for k in 0..60 {
        if k >= 30 {
            truth = truth.retract(&(twist * 0.05));
        }
        imm.predict(Seconds(0.05)).expect("finite");
        let z = PoseMeasurement::new(truth.retract(&normals(&seen, random)), information, Quality::default());
        imm.correct(&z).expect("finite");
        let probabilities: Vec<f64> = imm.probabilities().collect();
        assert!((probabilities.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        winners.push(probabilities[0]);
        // Velocities were learnt to be zero: no model can have known the start, and it takes a while to unlearn.
        let nees = imm.pose().nees(&truth).expect("regular");
        assert!((30..45).contains(&k) || nees < 25.0, "step {k}: {nees}");
    }
    assert!(winners[29] > 0.9 && winners[59] < 0.05, "{winners:?}");
    assert!((imm.belief().mean.velocity - twist).norm() < 0.05, "{:?}", imm.belief().mean.velocity);
    imm.reset(&prior).expect("a prior");
    assert!((imm.probabilities().next().expect("models") - 1.0 / 3.0).abs() < 1e-12);
}

#[test]
fn mixtures_do_not_depend_on_how_time_is_cut_nor_underflow() {
    let imm = || {
        Imm::new(
            vec![mode(kalman(0.01)), mode(kalman(4.0))],
            &[0.9, 0.1],
            Switching::every(Seconds(3.0), 2),
            &prior(),
        )
        .expect("models")
    };
    let [mut whole, mut parts] = [imm(), imm()];
    whole.predict(Seconds(0.5)).expect("finite");
    (0..50).for_each(|_| parts.predict(Seconds(0.01)).expect("finite"));
    let [a, b] = [&whole, &parts].map(|i| i.probabilities().collect::<Vec<_>>());
    assert!((a[0] - b[0]).abs() < 1e-12, "{a:?} {b:?}");
    // A reading that is impossible to every model, in likelihoods though not in their logarithms.
    let z = Instrument::<Plane, _>::new(
        Linear(RowVector4::new(1.0, 0.0, 0.0, 0.0)),
        SMatrix::<f64, 1, 1>::new(1e-4),
    )
    .expect("valid");
    let innovation = whole.correct(&z.read(Vector1::new(1e4)).expect("finite")).expect("finite");
    assert!(innovation.log_evidence < -1e6 && whole.probabilities().all(|p| p.is_finite()));
}

#[test]
fn switching_is_checked() {
    let modes = || vec![mode(kalman(0.1)), mode(kalman(1.0))];
    let bad = [
        Switching::Step(DMatrix::identity(3, 3)),
        Switching::Step(DMatrix::from_element(2, 2, 0.6)),
        Switching::Rate(DMatrix::from_element(2, 2, -1.0)),
        Switching::every(Seconds(0.0), 2),
    ];
    for switching in bad {
        assert!(Imm::<Plane, Plane>::new(modes(), &[0.5, 0.5], switching, &prior()).is_err());
    }
    let fit = || Switching::every(Seconds(1.0), 2);
    assert!(Imm::<Plane, Plane>::new(modes(), &[0.5, 0.6], fit(), &prior()).is_err());
    assert!(Imm::<Plane, Plane>::new(modes(), &[1.0], fit(), &prior()).is_err());
    assert!(Imm::<Plane, Plane>::new(vec![], &[], fit(), &prior()).is_err());
}

/// After a failed step all is as before.
#[test]
fn failures_leave_mixtures_alone() {
    let mut imm = Imm::new(
        vec![mode(kalman(0.1)), mode(kalman(1.0))],
        &[0.5, 0.5],
        Switching::every(Seconds(1.0), 2),
        &prior(),
    )
    .expect("models");
    imm.predict(Seconds(0.3)).expect("finite");
    let before = format!("{:?} {:?}", imm.belief(), imm.probabilities().collect::<Vec<_>>());
    assert!(imm.predict(Seconds(f64::NAN)).is_err());
    assert_eq!(before, format!("{:?} {:?}", imm.belief(), imm.probabilities().collect::<Vec<_>>()));
}

/// On rigid motions smoothing lessens the error of the filter and its covariance.
#[test]
fn smoothing_rigid_motions_lessens_errors() {
    let random = &mut random(21);
    let (mut filtered, mut smoothed, mut nees, mut dof) = (0.0, 0.0, 0.0, 0.0);
    for _ in 0..40 {
        let start = before_camera(random);
        let prior = Gaussian::from_sigmas(start, &deviations(0.02, 0.05));
        let model = ConstantVelocity::<SE3>::new(deviations(0.02, 0.05)).expect("valid");
        let rest = deviations(0.3, 0.5);
        let mut truth = Moving {
            pose: start.retract(&normals(&deviations(0.02, 0.05), random)),
            velocity: normals(&rest, random),
        };
        let filter =
            KalmanFilter::<SE3, Moving<SE3>, _>::new(&prior, vec![rest], model.clone(), 1).expect("a prior");
        let mut smoother = Smoother::new(filter);
        let (mut truths, mut errors) = (vec![truth.clone()], vec![0.0]);
        let seen = deviations(0.01, 0.03);
        let information = Square::<SE3>::from_diagonal(&seen.map(|s| 1.0 / (s * s)));
        for _ in 0..12 {
            let dt = Seconds(0.08);
            let w = model.noise_root(&truth, dt) * normals(&truth.zero().map(|_| 1.0), random);
            truth = model.propagate(&truth, dt).retract(&w);
            smoother.predict(dt).expect("finite");
            let z = PoseMeasurement::new(
                truth.pose.retract(&normals(&seen, random)),
                information,
                Quality::default(),
            );
            smoother.correct(&z).expect("finite");
            truths.push(truth.clone());
            errors.push(smoother.pose().mean.local(&truth.pose).norm_squared());
        }
        for ((belief, truth), error) in
            smoother.smoothed().expect("regular").iter().zip(&truths).zip(&errors).skip(1)
        {
            filtered += error;
            smoothed += belief.mean.pose.local(&truth.pose).norm_squared();
            nees += belief.nees(truth).expect("regular");
            dof += 12.0;
        }
    }
    assert!(smoothed < 0.6 * filtered, "{smoothed} {filtered}");
    // Neighbouring states share their errors: no χ² of independent values, but the mean is one.
    assert!((nees / dof - 1.0).abs() < 0.12, "{}", nees / dof);
}

/// Noise claimed four times too small (variance) is found, of either kind.
#[test]
fn adaptation_finds_the_noise() {
    for (noise, process, measurement) in [(Noise::Measurement, 1.0_f64, 4.0_f64), (Noise::Process, 16.0, 1.0)]
    {
        let random = &mut random(5);
        let model = |q: f64| Brownian::<Vector<2>>::new(Vector2::repeat(0.5 * q)).expect("valid");
        let prior = Gaussian::from_sigmas(Vector(Vector2::zeros()), &Vector2::repeat(1.0));
        let filter =
            KalmanFilter::<Vector<2>, Vector<2>, _>::from_belief(prior, model(1.0)).expect("a prior");
        let factor = NoiseFactor::new(50, 0.99, (0.01, 100.0)).expect("valid");
        let mut adaptive = Adaptive::<Vector<2>, _>::new(filter, noise, factor);
        let mut truth = Vector2::zeros();
        let instrument =
            Instrument::<Vector<2>, _>::new(Linear(Matrix2::identity()), Matrix2::identity() * 0.3)
                .expect("valid");
        let mut factors = vec![];
        for k in 0..4000 {
            truth += normals(&Vector2::repeat((0.5 * process * 0.1_f64).sqrt()), random);
            adaptive.predict(Seconds(0.1)).expect("finite");
            let z = truth + normals(&Vector2::repeat((0.3 * measurement).sqrt()), random);
            adaptive.correct(&instrument.read(z).expect("finite")).expect("finite");
            if k >= 1000 {
                factors.push(adaptive.factor());
            }
        }
        let mean = factors.iter().sum::<f64>() / factors.len() as f64;
        let expected = if noise == Noise::Process { process } else { measurement };
        assert!((mean / expected - 1.0).abs() < 0.25, "{noise:?}: {mean} for {expected}");
    }
    assert!(
        NoiseFactor::new(0, 0.9, (0.5, 2.0)).is_err()
            && NoiseFactor::new(9, 1.0, (0.5, 2.0)).is_err()
            && NoiseFactor::new(9, 0.9, (2.0, 3.0)).is_err()
    );
}

#[test]
fn memory_of_replay_ends() {
    let mut replay = Replay::new(kalman(0.4), Timestamp(0), 2);
    let random = &mut random(2);
    for k in 1..=4 {
        replay.take(Timestamp(1_000_000_000 * k), row(random)).expect("finite");
    }
    let before = format!("{:?}", replay.newest().expect("a belief").1.belief());
    let late = replay.take(Timestamp(500_000_000), row(random));
    assert!(
        matches!(late, Err(EstimateError::TooLate { seconds }) if (seconds - 1.5).abs() < 1e-9),
        "{late:?}"
    );
    assert_eq!(before, format!("{:?}", replay.newest().expect("a belief").1.belief()));
    assert!(replay.take(Timestamp(2_500_000_000), row(random)).is_ok());
    assert!(
        replay.pose_at(Timestamp(5_000_000_000)).is_ok() && replay.pose_at(Timestamp(3_000_000_000)).is_err()
    );
}
