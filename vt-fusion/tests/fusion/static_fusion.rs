//! Stacking, updating one after the other and summing information are one on linear problems.

use nalgebra::{DMatrix, DVector, Matrix2, Vector6};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use vt_core::belief::Gaussian;
use vt_core::laws::{MeasurementTolerance, check_measurement, for_each};
use vt_core::lie::{DynVector, LieGroup, SE3};
use vt_core::manifold::{Manifold, Square};
use vt_core::measurement::{Level, Linearized, Measurement, Modality, Quality};
use vt_core::pose_measurement::PoseMeasurement;
use vt_core::report::StepReport;
use vt_core::tempering::Tempered;
use vt_estimators::map::maximum_a_posteriori;
use vt_fusion::TrackingLoop;
use vt_fusion::stacked::{Stacked, StaticFusion};
use vt_fusion::summed::information_sum;

use crate::sensors::{Direct, Plane, SUPPORTED, filter, frame, random, target};

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 60, rng_seed: RngSeed::Fixed(6), failure_persistence: None, ..ProptestConfig::default()
    })]

    /// Parts of any rank, from nothing to everything.
    #[test]
    fn stacked_is_sequential_is_summed(seed: u64, n in 1_usize..6, parts in 0_usize..5) {
        let random = &mut random(seed);
        let mut matrix = |rows, columns| DMatrix::from_fn(rows, columns, |_, _| random.normal());
        let side = matrix(n, n);
        let covariance = &side * side.transpose() + DMatrix::identity(n, n) * 0.1;
        let prior = Gaussian { mean: DynVector(matrix(n, 1).column(0).into_owned()), covariance };
        let parts: Vec<PoseMeasurement<DynVector>> = (0..parts)
            .map(|k| {
                let rows = matrix(k % (n + 1), n);
                let z = DynVector(matrix(n, 1).column(0).into_owned());
                PoseMeasurement::new(z, rows.tr_mul(&rows), SUPPORTED)
            })
            .collect();
        let list: Vec<&dyn Measurement<DynVector>> = parts.iter().map(|z| z as _).collect();
        let (stacked, at_once) = maximum_a_posteriori(&prior, &Stacked(&list), 1).expect("finite");

        let mut sequential = prior.clone();
        let mut log_evidence = 0.0;
        for z in &list {
            let (next, innovation) = maximum_a_posteriori(&sequential, *z, 1).expect("finite");
            sequential = next;
            log_evidence += innovation.log_evidence;
        }
        prop_assert!((at_once.log_evidence - log_evidence).abs() < 1e-9 * (1.0 + log_evidence.abs()));

        let summed = information_sum(&list, &prior.mean);
        let (summed, _) = maximum_a_posteriori(&prior, &summed, 1).expect("finite");

        let mut information = prior.covariance.clone().try_inverse().expect("regular");
        let mut vector: DVector<f64> = &information * &prior.mean.0;
        for z in &parts {
            information += z.information();
            vector += z.information() * &z.pose().0;
        }
        let covariance = information.try_inverse().expect("regular");
        let closed = &covariance * vector;
        let others = [
            (&sequential.mean.0, &sequential.covariance),
            (&summed.mean.0, &summed.covariance),
            (&closed, &covariance),
        ];
        for (mean, spread) in others {
            prop_assert!((&stacked.mean.0 - mean).amax() < 1e-9, "{} {mean}", stacked.mean.0);
            prop_assert!((&stacked.covariance - spread).amax() < 1e-9, "{} {spread}", stacked.covariance);
        }
    }
}

/// In a target it does not matter in which of the three ways several modalities correct it, as long as all is linear.
#[test]
fn targets_fuse_in_three_ways() {
    let run = |fusion| {
        let modalities = || -> Vec<Box<dyn Modality<Plane>>> {
            let partial = Matrix2::new(30.0, 10.0, 10.0, 10.0 / 3.0);
            [Matrix2::identity() * 4.0, partial, Matrix2::zeros()]
                .map(|information| Box::new(Direct::new(0, information)) as Box<dyn Modality<Plane>>)
                .into()
        };
        let one = target("one", &[0], modalities(), filter(0.0, 0.0), None).with_fusion(fusion);
        let mut tracker = TrackingLoop::new(vec![Box::new(one)]);
        let steps = (0..10_i32).map(|k| {
            let z = vec![0.1 * f64::from(k), -0.05 * f64::from(k)];
            tracker.step([frame(0, 100 * i64::from(k), z)]).expect("a step")[0].clone()
        });
        steps.collect::<Vec<_>>()
    };
    let stacked = run(StaticFusion::Stacked);
    for other in [StaticFusion::Sequential, StaticFusion::InformationSum] {
        for (a, b) in stacked.iter().zip(run(other)) {
            let numbers = |r: &StepReport| [&r.posterior.coordinates[..], &r.posterior.covariance].concat();
            let difference =
                numbers(a).iter().zip(numbers(&b)).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(difference < 1e-9, "{other:?}: {difference}");
            assert_eq!((a.assessment.quality, &a.verdict.status), (b.assessment.quality, &b.verdict.status));
            // The data agree with each other, so that the prediction is all there is to be surprised at.
            let [a, b] = [a, &b].map(|r| r.assessment.innovation.expect("corrected").nis);
            assert!((a - b).abs() < 1e-9, "{other:?}: {a} {b}");
        }
    }
}

fn some_pose(seed: u64) -> SE3 {
    let random = &mut random(seed);
    SE3::exp(&Vector6::from_fn(|_, _| 0.5 * random.normal()))
}

fn parts() -> [PoseMeasurement<SE3>; 2] {
    let near = some_pose(1).retract(&Vector6::repeat(0.05));
    let partial = Square::<SE3>::from_diagonal(&Vector6::new(10.0, 0.0, 3.0, 0.0, 5.0, 0.0));
    let other = Quality { expected: 3, inliers: 1, inlier_ratio: 0.5, log_ratio: 0.2, normalized_rms: 2.0 };
    [
        PoseMeasurement::new(some_pose(1), Square::<SE3>::identity() * 4.0, SUPPORTED),
        PoseMeasurement::new(near, partial, other),
    ]
}

#[test]
fn a_stack_is_a_measurement() {
    let [a, b] = parts();
    let tolerance = MeasurementTolerance { step: 1e-3, ..MeasurementTolerance::default() };
    for_each(2_u64..1000, |seed| {
        let pose = some_pose(1).retract(&(some_pose(seed).log() * 0.5));
        for list in [&[&a as &dyn Measurement<SE3>, &b][..], &[&b], &[&a, &a, &b]] {
            check_measurement(&Stacked(list), &pose, tolerance);
        }
    });
}

/// More hypotheses than are weighed at once.
#[test]
fn long_batches_are_many_short_ones() {
    let [a, b] = parts();
    let both = Stacked(&[&a, &b]);
    let poses: Vec<SE3> = (0..200).map(some_pose).collect();
    let (mut long, mut first, mut second) = (vec![f64::NAN; 200], vec![0.0; 200], vec![0.0; 200]);
    both.log_likelihoods(&poses, &mut long);
    a.log_likelihoods(&poses, &mut first);
    b.log_likelihoods(&poses, &mut second);
    assert!((0..200).all(|k| long[k] == first[k] + second[k]));
}

#[test]
fn figures_add_up() {
    let [a, b] = parts();
    let both = Stacked(&[&a, &b]);
    let q = both.quality(&some_pose(1));
    assert_eq!((q.expected, q.inliers, q.inlier_ratio), (4, 2, 0.625));
    assert!((q.log_ratio - 1.4).abs() < 1e-15 && (q.normalized_rms - 2.5_f64.sqrt()).abs() < 1e-15, "{q:?}");
    let mut rows = Linearized::default();
    both.residuals(&some_pose(1), &mut rows);
    assert_eq!((rows.len(), both.level()), (9, Level::Feature));
    assert_eq!(Stacked(&[&a as &dyn Measurement<SE3>]).level(), Level::Object);
    let nothing: Stacked<'_, SE3> = Stacked(&[]);
    assert_eq!(nothing.quality(&some_pose(1)), Quality::default());
}

/// A product of likelihoods, each to a power of its own, is the sum of the logarithms divided by the temperatures.
#[test]
fn a_stack_at_temperatures_is_their_product() {
    let tolerance = MeasurementTolerance { step: 1e-3, ..MeasurementTolerance::default() };
    for_each((2_u64..1000, 0.2..20.0_f64, 0.2..20.0_f64), |(seed, hot, cold)| {
        let (pose, parts) = (some_pose(1).retract(&(some_pose(seed).log() * 0.5)), parts());
        let tempered =
            [(&parts[0], hot), (&parts[1], cold)].map(|(z, t)| Tempered::new(z, t).expect("positive"));
        let measurements = [&tempered[0], &tempered[1]].map(|z| z as &dyn Measurement<SE3>);
        let product = Stacked(&measurements);
        check_measurement(&product, &pose, tolerance);
        let poses = [pose, pose.retract(&Vector6::repeat(0.01))];
        let (mut found, mut first, mut second) = ([0.0; 2], [0.0; 2], [0.0; 2]);
        product.log_likelihoods(&poses, &mut found);
        parts[0].log_likelihoods(&poses, &mut first);
        parts[1].log_likelihoods(&poses, &mut second);
        for k in 0..2 {
            let expected = first[k] / hot + second[k] / cold;
            assert!((found[k] - expected).abs() <= 1e-12 * expected.abs(), "{} {expected}", found[k]);
        }
    });
}
