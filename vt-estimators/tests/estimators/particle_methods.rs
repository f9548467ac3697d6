//! Every method of the particle filter against the exact filter, on other threads, under bad luck.

use nalgebra::{Matrix2, Vector2};
use vt_core::agent::Estimator;
use vt_core::belief::{Gaussian, Moving};
use vt_core::dynamics::{Brownian, ConstantVelocity};
use vt_core::error::EstimateError;
use vt_core::lie::{SE3, Vector};
use vt_core::math;
use vt_core::measurement::Quality;
use vt_core::pose_measurement::PoseMeasurement;
use vt_core::time::Seconds;
use vt_estimators::kalman::KalmanFilter;
use vt_estimators::particle::{Adaptive, Annealing, Method, ParticleFilter, ParticleParams};
use vt_estimators::resampling::{Resampling, effective_number};

use crate::particles::{Any, constant};
use crate::problems::{Pixels, before_camera, corners, deviations, random};

type Plane = Vector<2>;
type Filter = ParticleFilter<Plane, Moving<Plane>, ConstantVelocity<Plane>>;

/// All methods with these parts of a pose, without and with marginal velocities.
pub fn methods(parts: &[&[usize]]) -> Vec<(String, ParticleParams)> {
    let kinds = [
        ("bootstrap", Method::Bootstrap),
        ("auxiliary", Method::Auxiliary),
        ("annealed", Method::Annealed(Annealing { survival: 0.7, ..Annealing::default() })),
        ("partitioned", Method::Partitioned(parts.iter().map(|p| p.to_vec()).collect())),
    ];
    let both = |(name, method): &(&str, Method)| {
        [false, true].map(|marginal| {
            let params = ParticleParams { method: method.clone(), marginal, ..ParticleParams::default() };
            (format!("{name}{}", if marginal { ", marginal" } else { "" }), params)
        })
    };
    kinds.iter().flat_map(both).collect()
}

fn prior() -> Gaussian<Plane> {
    Gaussian::from_sigmas(Vector(Vector2::new(0.5, -1.0)), &Vector2::new(0.5, 1.0))
}

fn rest() -> Vec<Vector2<f64>> {
    vec![Vector2::new(1.0, 0.5)]
}

fn motion() -> ConstantVelocity<Plane> {
    ConstantVelocity::new(Vector2::new(0.3, 0.1)).expect("not negative")
}

fn filter(params: ParticleParams) -> Filter {
    Filter::new(&prior(), rest(), motion(), params).expect("a prior")
}

/// Five steps; the sum of the log evidences.
fn run(filter: &mut dyn Estimator<Plane>) -> f64 {
    (0..5)
        .map(|step| {
            filter.predict(Seconds(0.5)).expect("finite");
            let random = &mut random(step);
            let place = Vector(Vector2::new(0.3 * random.normal(), 0.5 * random.normal()));
            let z = PoseMeasurement::new(place, Matrix2::new(6.0, 2.0, 2.0, 4.0), Quality::default());
            filter.correct(&z).expect("likely").log_evidence
        })
        .sum()
}

/// Root mean square over `seeds` of the errors of mean, covariance and log evidence against the exact filter.
fn errors(params: &ParticleParams, count: usize, seeds: u64) -> [f64; 3] {
    let mut exact = KalmanFilter::<_, Moving<Plane>, _>::new(&prior(), rest(), motion(), 1).expect("a prior");
    let evidence = run(&mut exact);
    let exact = exact.pose();
    let mut sums = [0.0; 3];
    for seed in 0..seeds {
        let mut filter = filter(ParticleParams { count, seed, ..params.clone() });
        let log_evidence = run(&mut filter);
        let found = filter.pose();
        sums[0] += (found.mean.0 - exact.mean.0).norm_squared();
        sums[1] += (found.covariance - exact.covariance).norm_squared();
        sums[2] += (log_evidence - evidence) * (log_evidence - evidence);
    }
    sums.map(|s| (s / seeds as f64).sqrt())
}

/// Sixteen times the particles, a quarter of the error. Fifty seeds know each error to 10 % and the ratio to 14 %; the
/// bounds are three standard errors.
#[test]
fn every_method_approaches_the_kalman_filter() {
    for (name, params) in methods(&[&[1], &[0]]) {
        let (few, many) = (errors(&params, 200, 50), errors(&params, 3200, 50));
        println!("{name}: {few:.4?} at 200, {many:.4?} at 3200");
        for k in 0..3 {
            assert!((2.6..6.1).contains(&(few[k] / many[k])), "{name}, figure {k}: {few:?} {many:?}");
        }
        assert!(many[0] < 0.05 && many[1] < 0.05 && many[2] < 0.3, "{name}: {many:?}");
    }
}

/// The same under every resampling scheme.
#[test]
fn every_scheme_approaches_the_kalman_filter() {
    for resampling in [Resampling::Multinomial, Resampling::Stratified, Resampling::Residual] {
        let params = ParticleParams { resampling, ..ParticleParams::default() };
        let (few, many) = (errors(&params, 200, 50), errors(&params, 3200, 50));
        for k in 0..3 {
            assert!((2.6..6.1).contains(&(few[k] / many[k])), "{resampling:?}, figure {k}: {few:?} {many:?}");
        }
    }
}

/// Root mean square error of the pose against the exact filter, where a precise first measurement leaves few of the
/// particles of the start: plain ones keep the few velocities of these.
fn acquisition(marginal: bool, count: usize) -> f64 {
    let prior = Gaussian::from_sigmas(Vector(Vector2::zeros()), &Vector2::repeat(1.0));
    let motion = || ConstantVelocity::new(Vector2::repeat(0.02)).expect("not negative");
    let track = |filter: &mut dyn Estimator<Plane>| {
        for (step, x) in [0.3, 0.8, 1.2].into_iter().enumerate() {
            if step > 0 {
                filter.predict(Seconds(0.5)).expect("finite");
            }
            let z = Vector(Vector2::new(x, -x));
            let z = PoseMeasurement::new(z, Matrix2::identity() * 100.0, Quality::default());
            filter.correct(&z).expect("likely");
        }
        filter.pose().mean.0
    };
    let exact =
        track(&mut KalmanFilter::<_, Moving<Plane>, _>::new(&prior, rest(), motion(), 1).expect("a prior"));
    let square = |seed| {
        let params = ParticleParams { count, seed, marginal, ..ParticleParams::default() };
        let mut filter = Filter::new(&prior, rest(), motion(), params).expect("a prior");
        (track(&mut filter) - exact).norm_squared()
    };
    ((0..100).map(square).sum::<f64>() / 100.0).sqrt()
}

/// Velocities by Kalman filters: a quarter of the particles does what all do without. The covariance of the velocity is
/// that of the Riccati equation.
#[test]
fn marginal_velocities_save_particles() {
    let [plain, marginal] = [false, true].map(|m| [250, 1000, 4000].map(|n| acquisition(m, n)));
    println!("250, 1000, 4000 particles: {plain:.4?}, marginal {marginal:.4?}");
    assert!(marginal[0] < plain[1] && marginal[1] < plain[2], "{plain:?} {marginal:?}");

    let mut filter = filter(ParticleParams { marginal: true, ..ParticleParams::default() });
    filter.predict(Seconds(0.5)).expect("finite");
    let (s, q, t) = (1.0, 0.3, 0.5_f64);
    let (pp, vp, vv) = (s * t * t + q * t * t * t / 3.0, s * t + q * t * t / 2.0, s + q * t);
    let expected = vv - vp * vp / pp;
    let found = filter.conditional_covariance();
    assert!((found[(2, 2)] - expected).abs() < 1e-12 && found[(0, 0)] == 0.0, "{found}");
}

/// All numbers of a run on SE(3) with velocity, to the last bit.
fn rigid_run(params: &ParticleParams, threads: usize) -> String {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    pool.install(|| {
        let random = &mut random(3);
        let truth = before_camera(random);
        let motion = ConstantVelocity::new(deviations(0.1, 0.1)).expect("not negative");
        let prior = Gaussian::from_sigmas(truth, &deviations(0.02, 0.05));
        let rest = vec![deviations(0.1, 0.1)];
        let mut filter = ParticleFilter::<SE3, Moving<SE3>, _>::new(&prior, rest, motion, params.clone())
            .expect("a prior");
        let mut log = String::new();
        for step in 0..4 {
            filter.predict(Seconds(0.05)).expect("finite");
            let z = Pixels::simulate(&corners(), &truth, 5.0, random);
            let innovation = filter.correct(&z).expect("likely");
            log += &format!("{innovation:?} {:?} {:?} {:?}\n", filter.pose(), filter.states(), filter.mode());
            if step == 2 {
                filter.reset(&prior).expect("a prior");
            }
        }
        log
    })
}

#[test]
fn threads_do_not_change_a_bit_of_any_method() {
    let mut all = methods(&[&[3, 4, 5], &[0, 1, 2]]);
    let adaptive = Adaptive { widths: vec![0.01; 6], epsilon: 0.05, confidence: 0.99, least: 150, most: 900 };
    for (name, params) in methods(&[&[3, 4, 5], &[0, 1, 2]]) {
        let adaptive = Some(adaptive.clone());
        all.push((format!("{name}, adaptive"), ParticleParams { adaptive, roughening: 0.05, ..params }));
    }
    all.push(("roughened".into(), ParticleParams { roughening: 0.1, ..ParticleParams::default() }));
    for resampling in
        [Resampling::Multinomial, Resampling::Stratified, Resampling::Systematic, Resampling::Residual]
    {
        for marginal in [false, true] {
            let params = ParticleParams { resampling, marginal, ..ParticleParams::default() };
            all.push((format!("{resampling:?}, marginal {marginal}"), params));
        }
    }
    for (name, params) in all {
        let params = ParticleParams { count: 700, ..params };
        let one = rigid_run(&params, 1);
        assert!(one == rigid_run(&params, 2), "{name}: one and two threads differ");
    }
}

#[test]
fn errors_are_values_and_change_nothing_in_any_method() {
    for (name, params) in methods(&[&[1], &[0]]) {
        let mut filter = filter(params);
        run(&mut filter);
        filter.predict(Seconds(0.5)).expect("finite");
        let state = |f: &Filter| format!("{:?} {:?} {:?}", f.states(), f.particles(), f.pose());
        let before = state(&filter);
        assert_eq!(
            filter.correct(&constant(f64::NEG_INFINITY)),
            Err(EstimateError::ZeroLikelihood),
            "{name}"
        );
        for bad in [f64::NAN, f64::INFINITY] {
            assert_eq!(
                filter.correct(&constant(bad)),
                Err(EstimateError::NotFinite("the likelihood")),
                "{name}"
            );
        }
        assert!(
            filter.predict(Seconds(f64::NAN)).is_err() && filter.predict(Seconds(f64::INFINITY)).is_err()
        );
        assert_eq!(before, state(&filter), "{name}");
        // A constant says nothing and is its own evidence, before and after others.
        for value in [-3.0, -700.0] {
            let innovation = filter.correct(&constant(value)).expect("likely");
            assert!((innovation.log_evidence - value).abs() < 1e-9, "{name}: {innovation:?}");
        }
        run(&mut filter);
    }
    let wrong = |params| Filter::new(&prior(), rest(), motion(), params).err();
    for (parts, found) in [(vec![vec![0, 2]], 1), (vec![vec![1], vec![1]], 1), (vec![vec![0, 1], vec![0]], 2)]
    {
        let parts = ParticleParams { method: Method::Partitioned(parts), ..ParticleParams::default() };
        assert_eq!(
            wrong(parts),
            Some(EstimateError::Dimension { what: "the list of parts", found, expected: 2 })
        );
    }
    let adaptive = Adaptive { widths: vec![0.1], epsilon: 0.05, confidence: 0.99, least: 1, most: 9 };
    let adaptive = ParticleParams { adaptive: Some(adaptive), ..ParticleParams::default() };
    let expected = EstimateError::Dimension { what: "the list of bin widths", found: 1, expected: 2 };
    assert_eq!(wrong(adaptive), Some(expected));
    assert_eq!(
        wrong(ParticleParams { count: 0, ..ParticleParams::default() }),
        Some(EstimateError::NoParticles)
    );
}

/// Few particles for a narrow belief, many for a wide one, within the bounds.
#[test]
fn the_number_of_particles_follows_the_spread() {
    let adaptive = Adaptive { widths: vec![0.1; 2], epsilon: 0.05, confidence: 0.99, least: 50, most: 5000 };
    let still = || Brownian::new(Vector2::repeat(1e-6)).expect("not negative");
    let number = |sigma: f64| {
        let params =
            ParticleParams { count: 2000, adaptive: Some(adaptive.clone()), ..ParticleParams::default() };
        let prior = Gaussian::from_sigmas(Vector(Vector2::zeros()), &Vector2::repeat(sigma));
        let mut filter =
            ParticleFilter::<Plane, Plane, _>::new(&prior, vec![], still(), params).expect("a prior");
        filter.predict(Seconds(0.1)).expect("finite");
        filter.correct(&constant(0.0)).expect("likely");
        let (states, weights) = filter.states();
        assert!(
            states.len() == weights.len() && (effective_number(weights) - states.len() as f64).abs() < 1e-6
        );
        states.len()
    };
    let numbers = [0.001, 0.05, 0.2, 0.5, 50.0].map(number);
    println!("{numbers:?} particles");
    assert!(
        numbers.is_sorted() && numbers[0] == 50 && numbers[4] == 5000 && numbers[3] > 4 * numbers[1],
        "{numbers:?}"
    );
}

/// `σ = K E N^(−1/d)` on top of what there was.
#[test]
fn roughening_adds_its_jitter() {
    let still = Brownian::new(Vector2::zeros()).expect("not negative");
    let prior = Gaussian::from_sigmas(Vector(Vector2::zeros()), &Vector2::repeat(1.0));
    let params =
        ParticleParams { count: 4000, effective_share: 1.1, roughening: 5.0, ..ParticleParams::default() };
    let mut filter = ParticleFilter::<Plane, Plane, _>::new(&prior, vec![], still, params).expect("a prior");
    let before = filter.pose().covariance;
    let (states, _) = filter.states();
    let range = |k: usize| {
        let values = states.iter().map(|s| s.0[k]);
        values.clone().fold(f64::MIN, f64::max) - values.fold(f64::MAX, f64::min)
    };
    let sigma = Vector2::new(range(0), range(1)) * (5.0 / 4000.0_f64.sqrt());
    filter.predict(Seconds(0.1)).expect("finite");
    let after = filter.pose().covariance;
    for k in 0..2 {
        let (found, expected) = (after[(k, k)], before[(k, k)] + sigma[k] * sigma[k]);
        assert!((found / expected - 1.0).abs() < 0.12, "{found} {expected}");
    }
}

/// Two modes of weights 0.65 and 0.35: the mean lies between them, the mode in the heavier one. Of a normal belief the mode
/// is the mean.
#[test]
fn the_mode_is_where_most_particles_are() {
    let still = || Brownian::new(Vector2::repeat(1e-6)).expect("not negative");
    let prior = Gaussian::from_sigmas(Vector(Vector2::zeros()), &Vector2::repeat(2.0));
    let params = ParticleParams { count: 3000, ..ParticleParams::default() };
    let mut filter =
        ParticleFilter::<Plane, Plane, _>::new(&prior, vec![], still(), params).expect("a prior");
    assert!((filter.mode().0).norm() < 0.5, "{:?}", filter.mode());
    let modes = Any(|pose: &Plane| {
        let near = |x: f64| math::exp(-0.5 * (pose.0 - Vector2::new(x, 0.5)).norm_squared() / 0.04);
        math::ln(1e-300 + 0.65 * near(1.5) + 0.35 * near(-1.5))
    });
    filter.correct(&modes).expect("likely");
    let (mean, mode) = (filter.pose().mean.0, filter.mode().0);
    assert!(mean.x.abs() < 1.0 && (mode - Vector2::new(1.5, 0.5)).norm() < 0.25, "{mean} {mode}");
}
