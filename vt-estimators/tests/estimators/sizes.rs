//! Sizes known at run time only: what does not fit is an error of every estimator, which says both sizes, and changes nothing.

use nalgebra::{DMatrix, DVector};
use vt_core::agent::{Dynamics, Estimator};
use vt_core::belief::{Accelerating, Gaussian, Moving};
use vt_core::dynamics::{
    Brownian, ConstantAcceleration, ConstantVelocity, DiscreteWhiteAcceleration, LinearRate, LinearStep,
    OrnsteinUhlenbeck, Singer,
};
use vt_core::error::EstimateError;
use vt_core::lie::DynVector;
use vt_core::measurement::{Measurement, Quality};
use vt_core::measurement_model::{Differentiable, Function, Instrument, Linear, MeasurementModel};
use vt_core::pose_measurement::PoseMeasurement;
use vt_core::robust::Robust;
use vt_core::time::Seconds;
use vt_estimators::adaptive::{Adaptive, Noise, NoiseFactor};
use vt_estimators::gaussian_filter::GaussianFilter;
use vt_estimators::imm::{Imm, Switching, mode};
use vt_estimators::information::InformationFilter;
use vt_estimators::kalman::KalmanFilter;
use vt_estimators::particle::{ParticleFilter, ParticleParams};
use vt_estimators::retrodiction::RetrodictionFilter;
use vt_estimators::sigma_point::{Rule, SigmaPointFilter};
use vt_estimators::smoother::Smoother;
use vt_estimators::square_root::SquareRootFilter;

type V = DynVector;

fn zeros(n: usize) -> V {
    DynVector(DVector::zeros(n))
}

fn belief(n: usize) -> Gaussian<V> {
    Gaussian::from_sigmas(zeros(n), &DVector::repeat(n, 1.0))
}

fn walk(n: usize) -> Brownian<V> {
    Brownian::new(DVector::repeat(n, 0.1)).expect("not negative")
}

fn kalman() -> KalmanFilter<V, V, Brownian<V>> {
    KalmanFilter::from_belief(belief(3), walk(3)).expect("a prior")
}

/// One of each, of three coordinates.
fn estimators() -> Vec<(&'static str, Box<dyn Estimator<V>>)> {
    let root = SquareRootFilter::<V, V, _>::from_belief(belief(3), walk(3)).expect("a prior");
    let information = InformationFilter::<V, V, _>::from_belief(belief(3), walk(3)).expect("a prior");
    let sigma =
        SigmaPointFilter::<V, V, _>::from_belief(belief(3), walk(3), Rule::Cubature).expect("a prior");
    let particle = ParticleFilter::<V, V, _>::new(&belief(3), vec![], walk(3), ParticleParams::default())
        .expect("a prior");
    let modes = vec![mode::<V, V, V, _>(kalman()), mode(sigma.clone())];
    let imm = Imm::new(modes, &[0.5, 0.5], Switching::every(Seconds(1.0), 2), &belief(3)).expect("models");
    let factor = NoiseFactor::new(9, 0.9, (0.1, 10.0)).expect("valid");
    vec![
        ("Kalman", Box::new(kalman())),
        ("iterated", Box::new(kalman().iterated(5))),
        ("square root", Box::new(root)),
        ("information", Box::new(information)),
        ("sigma points", Box::new(sigma)),
        ("particles", Box::new(particle)),
        ("mixture", Box::new(imm)),
        ("smoother", Box::new(Smoother::<V, _>::new(kalman()))),
        ("adaptive", Box::new(Adaptive::<V, _>::new(kalman(), Noise::Measurement, factor))),
    ]
}

fn reading<H>(model: H, robust: Robust) -> impl Measurement<V>
where
    H: MeasurementModel<V, M = nalgebra::Dyn>,
{
    let instrument = Instrument::<V, _>::robust(model, DMatrix::identity(2, 2), robust).expect("valid");
    instrument.read(DVector::zeros(2)).expect("finite")
}

/// A sensor of two rows from two coordinates, a measured pose of two, and functions that give another number of rows or columns
/// than they should.
#[test]
fn measurements_that_do_not_fit_are_refused() {
    let broken = |rows: usize, size: (usize, usize)| Differentiable {
        function: move |_: &V| DVector::zeros(rows),
        jacobian: move |_: &V| DMatrix::zeros(size.0, size.1),
    };
    let pose = |n, size| PoseMeasurement::new(zeros(n), DMatrix::identity(size, size), Quality::default());
    for robust in [Robust::Square, Robust::HUBER] {
        let linear = || Linear(DMatrix::zeros(2, 2));
        let sized: [Box<dyn Measurement<V>>; 3] =
            [Box::new(reading(linear(), robust)), Box::new(pose(2, 2)), Box::new(pose(3, 2))];
        let unsized_: [Box<dyn Measurement<V>>; 4] = [
            Box::new(reading(Function(|_: &V| DVector::zeros(3)), robust)),
            Box::new(reading(broken(1, (1, 3)), robust)),
            Box::new(reading(broken(3, (3, 3)), robust)),
            Box::new(reading(broken(2, (2, 2)), robust)),
        ];
        for (name, mut estimator) in estimators() {
            estimator.predict(Seconds(0.5)).expect("finite");
            let before = format!("{:?}", estimator.pose());
            for z in &sized {
                let refused = estimator.correct(z.as_ref());
                assert!(
                    matches!(refused, Err(EstimateError::Dimension { found: 2, expected: 3, .. })),
                    "{name}: {refused:?}"
                );
            }
            for (k, z) in unsized_.iter().enumerate() {
                let refused = estimator.correct(z.as_ref());
                // The last one is wrong in its Jacobian only.
                let asks = !["particles", "sigma points"].contains(&name);
                assert!(refused.is_err() || (k == 3 && !asks), "{name}, {k}: {refused:?}");
                if refused.is_err() {
                    assert_eq!(before, format!("{:?}", estimator.pose()), "{name}, {k}");
                }
            }
        }
    }
    // By a reading.
    let narrow =
        Instrument::<V, _>::new(Linear(DMatrix::zeros(2, 2)), DMatrix::identity(2, 2)).expect("valid");
    let narrow = narrow.read(DVector::zeros(2)).expect("finite");
    let mut root = SquareRootFilter::<V, V, _>::from_belief(belief(3), walk(3)).expect("a prior");
    let mut sigma =
        SigmaPointFilter::<V, V, _>::from_belief(belief(3), walk(3), Rule::Cubature).expect("a prior");
    let mut late = RetrodictionFilter::<V, _>::new(belief(3), walk(3)).expect("a prior");
    let refused = [
        kalman().update(&narrow),
        kalman().update_by_rows(&narrow),
        root.update(&narrow),
        sigma.update(&narrow),
        late.update(&narrow),
    ];
    for refused in refused {
        let what = "the measurement's matrix";
        assert_eq!(refused, Err(EstimateError::Dimension { what, found: 2, expected: 3 }));
    }
}

#[test]
fn beliefs_that_do_not_fit_are_refused() {
    for (name, mut estimator) in estimators() {
        let before = format!("{:?}", estimator.pose());
        let refused = estimator.reset(&belief(2));
        assert!(matches!(refused, Err(EstimateError::Dimension { .. })), "{name}: {refused:?}");
        assert_eq!(before, format!("{:?}", estimator.pose()), "{name}");
    }
    let mut oblong = belief(3);
    oblong.covariance = DMatrix::identity(3, 2);
    for (bad, found) in [(belief(2), 2), (oblong, 2)] {
        let refused = GaussianFilter::<V, V>::set_belief(&mut kalman(), bad.clone());
        assert!(matches!(refused, Err(EstimateError::Dimension { expected: 3, found: f, .. }) if f == found));
        assert!(matches!(
            KalmanFilter::<V, V, _>::from_belief(bad, walk(3)),
            Err(EstimateError::Dimension { .. })
        ));
    }
}

/// A motion of two coordinates for a pose of three.
#[test]
fn motions_that_do_not_fit_are_refused() {
    let two = || DVector::repeat(2, 0.1);
    let square = || DMatrix::<f64>::identity(2, 2);
    let flat: [Box<dyn Dynamics<V>>; 3] = [
        Box::new(walk(2)),
        Box::new(LinearStep::new(square(), square()).expect("valid")),
        Box::new(LinearRate::new(square(), square()).expect("valid")),
    ];
    let moving: [Box<dyn Dynamics<Moving<V>>>; 3] = [
        Box::new(ConstantVelocity::new(two()).expect("valid")),
        Box::new(OrnsteinUhlenbeck::new(Seconds(1.0), two()).expect("valid")),
        Box::new(DiscreteWhiteAcceleration::new(two()).expect("valid")),
    ];
    let bent: [Box<dyn Dynamics<Accelerating<V>>>; 2] = [
        Box::new(ConstantAcceleration::new(two()).expect("valid")),
        Box::new(Singer::new(Seconds(1.0), two()).expect("valid")),
    ];
    let (pose, rest) = (zeros(3), DVector::zeros(3));
    let faster = Moving { pose: pose.clone(), velocity: rest.clone() };
    let fastest = Accelerating { pose: pose.clone(), velocity: rest.clone(), acceleration: rest };
    let found = flat.iter().map(|m| m.fits(&pose));
    let found =
        found.chain(moving.iter().map(|m| m.fits(&faster))).chain(bent.iter().map(|m| m.fits(&fastest)));
    for refused in found {
        assert!(
            matches!(refused, Err(EstimateError::Dimension { found: 2, expected: 3, .. })),
            "{refused:?}"
        );
    }
    assert!(LinearStep::new(DMatrix::identity(3, 2), DMatrix::identity(3, 3)).is_err());
    let refused = [
        KalmanFilter::<V, V, _>::from_belief(belief(3), walk(2)).err(),
        SquareRootFilter::<V, V, _>::from_belief(belief(3), walk(2)).err(),
        InformationFilter::<V, V, _>::new(&belief(3), vec![], walk(2)).err(),
        SigmaPointFilter::<V, V, _>::new(&belief(3), vec![], walk(2), Rule::UNSCENTED).err(),
        RetrodictionFilter::<V, _>::new(belief(3), walk(2)).err(),
        ParticleFilter::<V, V, _>::new(&belief(3), vec![], walk(2), ParticleParams::default()).err(),
    ];
    for refused in refused {
        let what = "the noise density";
        assert_eq!(refused, Some(EstimateError::Dimension { what, found: 2, expected: 3 }));
    }
}
