//! Track-to-track fusion: identities with closed forms, and honest covariances.

use nalgebra::{DMatrix, DVector, Matrix2, Matrix6, Vector2, Vector6};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use vt_core::agent::{Dynamics, Estimator};
use vt_core::belief::{Gaussian, Moving};
use vt_core::dynamics::{Brownian, ConstantVelocity};
use vt_core::lie::{DynVector, LieGroup, SE3, Vector};
use vt_core::manifold::Manifold;
use vt_core::measurement::Measurement;
use vt_core::metrics::Consistency;
use vt_core::pose_measurement::PoseMeasurement;
use vt_core::random::Random;
use vt_core::time::Seconds;
use vt_estimators::kalman::KalmanFilter;
use vt_estimators::map::maximum_a_posteriori;
use vt_fusion::tracks::{
    BarShalomCampo, Criterion, CrossCovariance, EquivalentMeasurements, Intersection, Track, TrackFusion,
    bar_shalom_campo, equivalent_measurement, information_sum,
};

use crate::sensors::{Plane, SUPPORTED, filter, random};

type Belief = Gaussian<DynVector>;

fn normal(random: &mut Random, rows: usize, columns: usize) -> DMatrix<f64> {
    DMatrix::from_fn(rows, columns, |_, _| random.normal())
}

/// A regular covariance.
fn covariance(random: &mut Random, n: usize) -> DMatrix<f64> {
    let side = normal(random, n, n);
    &side * side.transpose() + DMatrix::identity(n, n) * 0.1
}

fn belief(random: &mut Random, n: usize) -> Belief {
    let mean = DynVector(normal(random, n, 1).column(0).into_owned());
    Gaussian { mean, covariance: covariance(random, n) }
}

/// Two beliefs and a cross-covariance with which the joint covariance is regular.
fn correlated(random: &mut Random, n: usize) -> ([Belief; 2], DMatrix<f64>, DMatrix<f64>) {
    let joint = covariance(random, 2 * n);
    let part = |k: usize, random: &mut Random| Gaussian {
        mean: DynVector(normal(random, n, 1).column(0).into_owned()),
        covariance: joint.view((k * n, k * n), (n, n)).into_owned(),
    };
    let both = [part(0, random), part(1, random)];
    let cross = joint.view((0, n), (n, n)).into_owned();
    (both, cross, joint)
}

fn close(a: &Belief, b: &Belief) -> bool {
    (&a.mean.0 - &b.mean.0).amax() < 1e-9 && (&a.covariance - &b.covariance).amax() < 1e-9
}

fn least_eigenvalue(m: DMatrix<f64>) -> f64 {
    m.symmetric_eigenvalues().min()
}

fn measurement(belief: &Belief) -> PoseMeasurement<DynVector> {
    let information = belief.covariance.clone().try_inverse().expect("regular");
    PoseMeasurement::new(belief.mean.clone(), information, SUPPORTED)
}

fn cases(cases: u32) -> ProptestConfig {
    let rng_seed = RngSeed::Fixed(7);
    ProptestConfig { cases, rng_seed, failure_persistence: None, ..ProptestConfig::default() }
}

proptest! {
    #![proptest_config(cases(60))]

    /// Independent tracks are measurements of each other: the sum of information is the Kalman update, in any order.
    #[test]
    fn independent_tracks_add_up(seed: u64, n in 1_usize..6) {
        let random = &mut random(seed);
        let parts = [belief(random, n), belief(random, n), belief(random, n)];
        let sum = information_sum(&parts).expect("finite");
        let turned = information_sum(parts.iter().rev()).expect("finite");
        let mut updated = parts[0].clone();
        for part in &parts[1..] {
            updated = maximum_a_posteriori(&updated, &measurement(part), 1).expect("finite").0;
        }
        prop_assert!(close(&sum, &turned) && close(&sum, &updated));
        let zero = DMatrix::zeros(n, n);
        let pair = bar_shalom_campo(&parts[0], &parts[1], &zero).expect("finite");
        prop_assert!(close(&pair, &information_sum(&parts[..2]).expect("finite")));
    }

    /// Bar-Shalom and Campo's combination is the best linear unbiased estimate, `(Hᵀ Σ⁻¹ H)⁻¹ Hᵀ Σ⁻¹ z` with `H = [1; 1]`.
    #[test]
    fn known_correlation_gives_the_best_linear_estimate(seed: u64, n in 1_usize..5) {
        let random = &mut random(seed);
        let ([a, b], cross, joint) = correlated(random, n);
        let fused = bar_shalom_campo(&a, &b, &cross).expect("finite");
        let weight = joint.try_inverse().expect("regular");
        let h = DMatrix::from_fn(2 * n, n, |r, c| f64::from(u8::from(r % n == c)));
        let z = DVector::from_iterator(2 * n, a.mean.0.iter().chain(b.mean.0.iter()).copied());
        let best = (h.tr_mul(&weight) * &h).try_inverse().expect("regular");
        let mean = &best * (h.tr_mul(&weight) * z);
        let expected = Gaussian { mean: DynVector(mean.column(0).into_owned()), covariance: best };
        prop_assert!(close(&fused, &expected), "{fused:?} {expected:?}");
        let swapped = bar_shalom_campo(&b, &a, &cross.transpose()).expect("finite");
        prop_assert!(close(&fused, &swapped));
    }

    /// Whatever the correlation, the covariance of the error of an intersection is not above what it says.
    #[test]
    fn intersections_are_never_over_confident(seed: u64, n in 1_usize..5, trace: bool) {
        let random = &mut random(seed);
        let ([a, b], _, joint) = correlated(random, n);
        let criterion = if trace { Criterion::Trace } else { Criterion::Determinant };
        let mut rule = Intersection::new(criterion);
        let fused = rule.combine([&a, &b]).expect("finite");
        let gain = |belief: &Belief, weight: f64| {
            &fused.covariance * belief.covariance.clone().try_inverse().expect("regular") * weight
        };
        let mut both = DMatrix::zeros(n, 2 * n);
        both.columns_mut(0, n).copy_from(&gain(&a, rule.weights()[0]));
        both.columns_mut(n, n).copy_from(&gain(&b, rule.weights()[1]));
        let actual = &both * joint * both.transpose();
        prop_assert!(least_eigenvalue(&fused.covariance - actual) > -1e-9);
        // And it is unbiased: the gains add up to one.
        prop_assert!((both.columns(0, n) + both.columns(n, n) - DMatrix::identity(n, n)).amax() < 1e-9);
    }

    /// No other weights make a smaller covariance.
    #[test]
    fn weights_are_optimal(seed: u64, n in 1_usize..5, count in 2_usize..5, trace: bool) {
        let random = &mut random(seed);
        let parts: Vec<Belief> = (0..count).map(|_| belief(random, n)).collect();
        let criterion = if trace { Criterion::Trace } else { Criterion::Determinant };
        let size = |p: &DMatrix<f64>| if trace { p.trace() } else { vt_core::math::ln(p.determinant()) };
        let mut rule = Intersection::new(criterion);
        let found = size(&rule.combine(&parts).expect("finite").covariance);
        prop_assert!((rule.weights().iter().sum::<f64>() - 1.0).abs() < 1e-12);
        prop_assert!(rule.weights().iter().all(|w| (0.0..=1.0).contains(w)));
        for _ in 0..200 {
            let weights: Vec<f64> = (0..count).map(|_| random.uniform() * random.uniform()).collect();
            let total: f64 = weights.iter().sum();
            let sum = parts.iter().zip(weights).fold(DMatrix::zeros(n, n), |sum, (part, weight)| {
                sum + part.covariance.clone().try_inverse().expect("regular") * (weight / total)
            });
            let other = size(&sum.try_inverse().expect("regular"));
            prop_assert!(other > found - 1e-9, "{other} {found} {:?}", rule.weights());
        }
    }

    /// What was learnt in a correction, taken out of the beliefs, is what was taken in; also where it says nothing of
    /// some directions.
    #[test]
    fn equivalent_measurements_are_the_data(seed: u64, n in 1_usize..6, rows in 0_usize..6) {
        let random = &mut random(seed);
        let prior = belief(random, n);
        let rows = normal(random, rows.min(n), n);
        let pose = DynVector(normal(random, n, 1).column(0).into_owned());
        let z = PoseMeasurement::new(pose, rows.tr_mul(&rows), SUPPORTED);
        let (posterior, _) = maximum_a_posteriori(&prior, &z, 1).expect("finite");
        let equivalent = equivalent_measurement(&prior, &posterior, SUPPORTED).expect("finite");
        let scale = 1.0 + z.information().amax();
        prop_assert!((equivalent.information() - z.information()).amax() < 1e-9 * scale);
        let other = belief(random, n);
        let (expected, _) = maximum_a_posteriori(&other, &z, 1).expect("finite");
        let (found, _) = maximum_a_posteriori(&other, &equivalent, 1).expect("finite");
        let size = 1.0 + expected.mean.0.amax() + expected.covariance.amax();
        prop_assert!((found.mean.0 - expected.mean.0).amax() < 1e-8 * size);
        prop_assert!((found.covariance - expected.covariance).amax() < 1e-8 * size);
    }

    /// On a curved space the result does not depend on the order, and fusing one belief with itself is that belief.
    #[test]
    fn poses_are_fused_in_any_order(seed: u64) {
        let random = &mut random(seed);
        let mut vector = |s: f64| Vector6::from_fn(|_, _| s * random.normal());
        let centre = SE3::exp(&vector(1.0));
        let poses = [centre.retract(&vector(0.05)), centre.retract(&vector(0.05)), centre.retract(&vector(0.05))];
        let parts = poses.map(|mean| {
            let side = Matrix6::from_fn(|_, _| 0.03 * random.normal());
            Gaussian { mean, covariance: side * side.transpose() + Matrix6::identity() * 1e-4 }
        });
        let same = |a: &Gaussian<SE3>, b: &Gaussian<SE3>| {
            a.mean.local(&b.mean).amax() < 1e-9 && (a.covariance - b.covariance).amax() < 1e-9
        };
        let reversed = || parts.iter().rev();
        prop_assert!(same(&information_sum(&parts).expect("finite"), &information_sum(reversed()).expect("finite")));
        for criterion in [Criterion::Determinant, Criterion::Trace] {
            let mut rule = Intersection::new(criterion);
            let (forth, back) = (rule.combine(&parts[..2]), rule.combine(parts[..2].iter().rev()));
            prop_assert!(same(&forth.expect("finite"), &back.expect("finite")));
            let twice = rule.combine([&parts[0], &parts[0]]).expect("finite");
            prop_assert!(same(&twice, &parts[0]) && rule.weights() == [0.5, 0.5]);
        }
        let half = (parts[0].covariance + parts[1].covariance) * 0.1;
        let pair = bar_shalom_campo(&parts[0], &parts[1], &half).expect("finite");
        let swapped = bar_shalom_campo(&parts[1], &parts[0], &half.transpose()).expect("finite");
        prop_assert!(same(&pair, &swapped));
        let itself = bar_shalom_campo(&parts[0], &parts[0], &parts[0].covariance).expect("finite");
        prop_assert!(same(&itself, &parts[0]));
    }
}

/// Locked coordinates stay locked, and the rest is fused as if they were not there.
#[test]
fn locked_coordinates_stay_locked() {
    let random = &mut random(3);
    let full = [belief(random, 2), belief(random, 2)];
    let padded = full.clone().map(|b| {
        let mut covariance = DMatrix::zeros(3, 3);
        for (r, to) in [(0, 0), (1, 2)] {
            for (c, at) in [(0, 0), (1, 2)] {
                covariance[(to, at)] = b.covariance[(r, c)];
            }
        }
        Gaussian { mean: DynVector(DVector::from_vec(vec![b.mean.0[0], 7.0, b.mean.0[1]])), covariance }
    });
    let mut rule = Intersection::new(Criterion::Determinant);
    let zero = |n| DMatrix::zeros(n, n);
    let pairs = [
        (information_sum(&full), information_sum(&padded)),
        (rule.combine(&full), rule.combine(&padded)),
        (bar_shalom_campo(&full[0], &full[1], &zero(2)), bar_shalom_campo(&padded[0], &padded[1], &zero(3))),
    ];
    for (small, large) in pairs {
        let (small, large) = (small.expect("finite"), large.expect("finite"));
        let mean = &large.mean.0;
        assert_eq!(mean[1], 7.0);
        assert!((mean[0] - small.mean.0[0]).abs() < 1e-12 && (mean[2] - small.mean.0[1]).abs() < 1e-12);
        assert!(large.covariance.row(1).amax() < 1e-15, "{}", large.covariance);
        assert!((large.covariance[(0, 2)] - small.covariance[(0, 1)]).abs() < 1e-12);
    }
}

#[test]
fn what_cannot_be_fused_is_said() {
    let none: [Belief; 0] = [];
    assert!(information_sum(&none).expect_err("nothing").to_string().contains("no track"));
    let random = &mut random(4);
    let (two, three) = (belief(random, 2), belief(random, 3));
    let e = Intersection::new(Criterion::Trace).combine([&two, &three]).expect_err("sizes differ");
    assert!(e.to_string().contains("dimension 3; expected 2"), "{e}");
    let bad = Gaussian { covariance: &two.covariance * f64::NAN, ..two.clone() };
    assert!(bar_shalom_campo(&two, &bad, &DMatrix::zeros(2, 2)).is_err());
    assert!(bar_shalom_campo(&two, &two, &(&two.covariance * f64::NAN)).is_err());
}

/// The joint covariance of the errors of two filters, carried along in one piece with gains by the textbook.
#[test]
fn the_cross_covariance_is_that_of_the_joint_errors() {
    type State = Moving<Plane>;
    let motion = ConstantVelocity::<Plane>::new(Vector2::new(0.5, 0.2)).expect("not negative");
    let dt = Seconds(0.1);
    let mut beliefs = [filter(0.0, 0.0), filter(0.0, 0.0)].map(|f| f.belief().clone());
    let mut cross = CrossCovariance::<State>::of_common_prior(&beliefs[0]);
    let start = DMatrix::from_iterator(4, 4, beliefs[0].covariance.iter().copied());
    let mut joint = DMatrix::from_fn(8, 8, |r, c| start[(r % 4, c % 4)]);
    let noises = [Matrix2::new(0.01, 0.0, 0.0, 0.04), Matrix2::new(0.02, 0.01, 0.01, 0.02)];
    for step in 0..20 {
        let means = [&beliefs[0].mean, &beliefs[1].mean];
        cross.predict(&motion, means, dt);
        let f = motion.jacobian(&beliefs[0].mean, dt);
        let q = motion.noise(&beliefs[0].mean, dt);
        let both = DMatrix::from_fn(8, 8, |r, c| if r / 4 == c / 4 { f[(r % 4, c % 4)] } else { 0.0 });
        joint = &both * joint * both.transpose() + DMatrix::from_fn(8, 8, |r, c| q[(r % 4, c % 4)]);
        for belief in &mut beliefs {
            belief.mean = motion.propagate(&belief.mean, dt);
            belief.covariance = f * belief.covariance * f.transpose() + q;
        }
        let predictions = beliefs.clone();
        let mut keep = DMatrix::identity(8, 8);
        let mut noise = DMatrix::zeros(8, 8);
        for (k, belief) in beliefs.iter_mut().enumerate() {
            // The second sees nothing in every third step.
            if k == 1 && step % 3 == 0 {
                continue;
            }
            let p = DMatrix::from_iterator(4, 4, belief.covariance.iter().copied());
            let h = DMatrix::from_fn(2, 4, |r, c| f64::from(u8::from(r == c)));
            let r = DMatrix::from_iterator(2, 2, noises[k].iter().copied());
            let gain = &p * h.transpose() * (&h * &p * h.transpose() + &r).try_inverse().expect("regular");
            keep.view_mut((4 * k, 4 * k), (4, 4)).copy_from(&(DMatrix::identity(4, 4) - &gain * &h));
            noise.view_mut((4 * k, 4 * k), (4, 4)).copy_from(&(&gain * &r * gain.transpose()));
            let z = PoseMeasurement::new(
                Vector(Vector2::new(0.1, -0.2)),
                noises[k].try_inverse().expect("regular"),
                SUPPORTED,
            );
            *belief = maximum_a_posteriori(belief, &z as &dyn Measurement<Plane>, 1).expect("finite").0;
        }
        joint = &keep * joint * keep.transpose() + noise;
        let [a, b] = &beliefs;
        cross.correct([&predictions[0], a], [&predictions[1], b]);
        let found = DMatrix::from_iterator(4, 4, cross.0.iter().copied());
        assert!((found - joint.view((0, 4), (4, 4))).amax() < 1e-9, "step {step}");
        let own = DMatrix::from_iterator(4, 4, b.covariance.iter().copied());
        assert!((own - joint.view((4, 4), (4, 4))).amax() < 1e-9, "step {step}");
    }
}

fn walk() -> Brownian<Plane> {
    Brownian::new(Vector2::new(1.0, 0.5)).expect("not negative")
}

fn walker() -> KalmanFilter<Plane, Plane, Brownian<Plane>> {
    let prior = Gaussian::from_sigmas(Vector(Vector2::zeros()), &Vector2::repeat(1.0));
    KalmanFilter::new(&prior, vec![], walk(), 1).expect("a prior")
}

/// Fused beliefs of tracks of one random walk against the truth.
fn errors(mut rule: impl FnMut() -> Box<dyn TrackFusion<Plane>>) -> Consistency {
    let mut record = Consistency::default();
    let information = [Matrix2::new(25.0, 0.0, 0.0, 2.0), Matrix2::new(2.0, 0.5, 0.5, 20.0)];
    for run in 0..600 {
        let random = &mut random(run);
        let mut rule = rule();
        let mut tracks = [walker(), walker()];
        let mut steps = tracks.each_ref().map(|t| Track::at(t.pose()));
        let mut truth = Vector2::new(random.normal(), random.normal());
        let mut fused = None;
        for _ in 0..8 {
            let dt = Seconds(0.2);
            rule.predict(&steps, dt).expect("finite");
            truth +=
                Vector2::new((1.0 * dt.0).sqrt() * random.normal(), (0.5 * dt.0).sqrt() * random.normal());
            for (k, track) in tracks.iter_mut().enumerate() {
                track.predict(dt).expect("finite");
                steps[k].prediction = track.pose();
                let root = information[k].try_inverse().expect("regular").cholesky().expect("regular").l();
                let noise = root * Vector2::new(random.normal(), random.normal());
                let z = PoseMeasurement::new(Vector(truth + noise), information[k], SUPPORTED);
                track.correct(&z).expect("finite");
                steps[k].posterior = track.pose();
                steps[k].quality = Some(SUPPORTED);
            }
            fused = Some(rule.fuse(&steps).expect("tracks").posterior);
        }
        let d2 = fused.and_then(|f| f.nees(&Vector(truth))).expect("regular");
        record.push(d2, 2);
    }
    record
}

/// What forgets the noise that tracks share.
struct Naive;

impl TrackFusion<Plane> for Naive {
    fn fuse(&mut self, tracks: &[Track<Plane>]) -> Result<Track<Plane>, vt_core::error::EstimateError> {
        Ok(Track::at(information_sum(tracks.iter().map(|t| &t.posterior))?))
    }
}

#[test]
fn fused_tracks_know_their_errors() {
    let prior = walker().pose();
    let naive = errors(|| Box::new(Naive));
    assert!(naive.p_value() < Some(1e-6), "common noise makes a difference: {:?}", naive.ratio());
    let known = errors(|| Box::new(BarShalomCampo::new(Box::new(walk()), &prior)));
    assert!(known.is_consistent(0.99), "{:?}", known.ratio());
    let central = errors(|| Box::new(EquivalentMeasurements::new(Box::new(walker()))));
    assert!(central.is_consistent(0.99), "{:?}", central.ratio());
    let careful = errors(|| Box::new(Intersection::new(Criterion::Determinant)));
    assert!(careful.ratio() < Some(1.0) && careful.ratio() > Some(0.5), "{:?}", careful.ratio());
}

/// A filter fed with what tracks learnt in each step is the filter of all measurements, velocity and all; knowing the
/// cross-covariance only is not better than that.
#[test]
fn equivalent_measurements_make_the_central_filter() {
    let mut tracks = [filter(0.0, 0.0), filter(0.0, 0.0)];
    let mut central = filter(0.0, 0.0);
    let mut rule = EquivalentMeasurements::new(Box::new(filter(0.0, 0.0)));
    let information = [Matrix2::new(25.0, 0.0, 0.0, 0.0), Matrix2::new(2.0, 0.5, 0.5, 20.0)];
    let random = &mut random(9);
    let mut steps = tracks.each_ref().map(|t| Track::at(t.pose()));
    for step in 0..50 {
        let dt = Seconds(0.05 + 0.1 * random.uniform());
        rule.predict(&steps, dt).expect("finite");
        central.predict(dt).expect("finite");
        for (k, track) in tracks.iter_mut().enumerate() {
            track.predict(dt).expect("finite");
            steps[k].prediction = track.pose();
            if k == 0 || step % 3 != 0 {
                let z = Vector(Vector2::new(random.normal(), random.normal()));
                let z = PoseMeasurement::new(z, information[k], SUPPORTED);
                track.correct(&z).expect("finite");
                central.correct(&z).expect("finite");
            }
            steps[k].posterior = track.pose();
            steps[k].quality = Some(SUPPORTED);
        }
        let fused = rule.fuse(&steps).expect("tracks");
        let (found, expected) = (fused.posterior, central.pose());
        assert!((found.mean.0 - expected.mean.0).amax() < 1e-9, "step {step}");
        assert!((found.covariance - expected.covariance).amax() < 1e-9, "step {step}");
    }
}

/// The best combination of two tracks is not better than the filter of all data.
#[test]
fn tracks_lose_against_the_central_filter() {
    let mut rule = BarShalomCampo::new(Box::new(walk()), &walker().pose());
    let (mut tracks, mut central) = ([walker(), walker()], walker());
    let information = [Matrix2::new(25.0, 0.0, 0.0, 2.0), Matrix2::new(2.0, 0.5, 0.5, 20.0)];
    let mut steps = tracks.each_ref().map(|t| Track::at(t.pose()));
    for _ in 0..20 {
        let dt = Seconds(0.2);
        rule.predict(&steps, dt).expect("finite");
        central.predict(dt).expect("finite");
        for (k, track) in tracks.iter_mut().enumerate() {
            track.predict(dt).expect("finite");
            steps[k].prediction = track.pose();
            let z = PoseMeasurement::new(Vector(Vector2::zeros()), information[k], SUPPORTED);
            track.correct(&z).expect("finite");
            central.correct(&z).expect("finite");
            steps[k].posterior = track.pose();
        }
        let fused = rule.fuse(&steps).expect("tracks").posterior.covariance;
        let above = fused - central.pose().covariance;
        assert!(above.symmetric_eigenvalues().min() > -1e-12);
        for step in &steps {
            assert!((step.posterior.covariance - fused).symmetric_eigenvalues().min() > -1e-12);
        }
    }
}
