//! Every filter on every kind of space: errors and innovations of 500 runs of seed 0 follow χ² (99.9 %, both sides).

use nalgebra::{DMatrix, DefaultAllocator, DimAdd, DimSum, Vector2, Vector3, Vector6};
use vt_core::agent::{Dynamics, Estimator};
use vt_core::belief::{Gaussian, Moving};
use vt_core::dynamics::ConstantVelocity;
use vt_core::lie::{SE2, SE3, Vector};
use vt_core::manifold::{Alloc, Manifold, Square, Tangent};
use vt_core::measurement::Quality;
use vt_core::metrics::Consistency;
use vt_core::pose_measurement::PoseMeasurement;
use vt_core::random::{Random, Stream};
use vt_core::time::Seconds;
use vt_estimators::imm::{Imm, Switching, mode};
use vt_estimators::information::InformationFilter;
use vt_estimators::kalman::KalmanFilter;
use vt_estimators::sigma_point::{Rule, SigmaPointFilter};
use vt_estimators::smoother::Smoother;
use vt_estimators::square_root::SquareRootFilter;

use crate::problems::{deviations, normals};

const RUNS: u64 = 500;
const STEPS: u32 = 8;

/// A scene in the space `P`: deviations of the start, of the velocity, of the measurements; density of the motion.
#[derive(Clone)]
struct Scene<P: Manifold>
where
    DefaultAllocator: Alloc<P::D>,
{
    start: P,
    sigmas: Tangent<P>,
    rest: Tangent<P>,
    seen: Tangent<P>,
    density: Tangent<P>,
}

/// The filters by name, each made from the prior of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Extended,
    Iterated,
    SquareRoot,
    Information,
    Unscented,
    Cubature,
    OneModel,
    TwoModels,
    Smoothed,
}

const KINDS: [Kind; 9] = [
    Kind::Extended,
    Kind::Iterated,
    Kind::SquareRoot,
    Kind::Information,
    Kind::Unscented,
    Kind::Cubature,
    Kind::OneModel,
    Kind::TwoModels,
    Kind::Smoothed,
];

fn filter<P>(kind: Kind, scene: &Scene<P>, prior: &Gaussian<P>) -> Box<dyn Estimator<P>>
where
    P: Manifold,
    P::D: DimAdd<P::D>,
    DefaultAllocator: Alloc<P::D> + Alloc<DimSum<P::D, P::D>>,
    DefaultAllocator: vt_core::manifold::AllocPair<DimSum<P::D, P::D>, P::D>,
{
    let motion = |factor: f64| ConstantVelocity::<P>::new(&scene.density * factor).expect("not negative");
    let rest = || vec![scene.rest.clone()];
    let kalman = |factor, iterations| {
        KalmanFilter::<P, Moving<P>, _>::new(prior, rest(), motion(factor), iterations).expect("a prior")
    };
    let sigma =
        |rule| SigmaPointFilter::<P, Moving<P>, _>::new(prior, rest(), motion(1.0), rule).expect("a prior");
    let common = || kalman(1.0, 1).belief().clone();
    match kind {
        Kind::Extended => Box::new(kalman(1.0, 1)),
        Kind::Iterated => Box::new(kalman(1.0, 5)),
        Kind::SquareRoot => {
            Box::new(SquareRootFilter::<P, Moving<P>, _>::new(prior, rest(), motion(1.0)).expect("a prior"))
        }
        Kind::Information => {
            Box::new(InformationFilter::<P, Moving<P>, _>::new(prior, rest(), motion(1.0)).expect("a prior"))
        }
        Kind::Unscented => Box::new(sigma(Rule::UNSCENTED)),
        Kind::Cubature => Box::new(sigma(Rule::Cubature)),
        Kind::OneModel => {
            let switching = Switching::Step(DMatrix::identity(1, 1));
            Box::new(Imm::new(vec![mode(kalman(1.0, 1))], &[1.0], switching, &common()).expect("a model"))
        }
        Kind::TwoModels => {
            let modes = vec![mode(kalman(1.0, 1)), mode(sigma(Rule::Cubature))];
            let switching = Switching::every(Seconds(1.0), 2);
            Box::new(Imm::new(modes, &[0.5, 0.5], switching, &common()).expect("models"))
        }
        Kind::Smoothed => Box::new(Smoother::fixed_lag(kalman(1.0, 1), 2)),
    }
}

fn assert_honest<P>(name: &str, scene: &Scene<P>)
where
    P: Manifold,
    P::D: DimAdd<P::D>,
    DefaultAllocator: Alloc<P::D> + Alloc<DimSum<P::D, P::D>>,
    DefaultAllocator: vt_core::manifold::AllocPair<DimSum<P::D, P::D>, P::D>,
{
    let motion = ConstantVelocity::<P>::new(scene.density.clone()).expect("not negative");
    let mut records = [(Consistency::default(), Consistency::default()); KINDS.len()];
    for run in 0..RUNS {
        let random = &mut Random::new(0, Stream::Sim, 0, run, 0);
        let prior = Gaussian::from_sigmas(scene.start.clone(), &scene.sigmas);
        let mut truth = Moving {
            pose: scene.start.retract(&normals(&scene.sigmas, random)),
            velocity: normals(&scene.rest, random),
        };
        let mut filters = KINDS.map(|kind| filter(kind, scene, &prior));
        for step in 0..STEPS {
            let dt = Seconds(if step % 3 == 0 { 0.12 } else { 0.04 });
            let root = motion.noise_root(&truth, dt);
            let w = normals(&truth.zero().map(|_| 1.0), random);
            truth = motion.propagate(&truth, dt).retract(&(root * w));
            let seen = truth.pose.retract(&normals(&scene.seen, random));
            let information = Square::<P>::from_diagonal(&scene.seen.map(|s| 1.0 / (s * s)));
            let z = PoseMeasurement::new(seen, information, Quality::default());
            for (filter, (_, nis)) in filters.iter_mut().zip(&mut records) {
                filter.predict(dt).expect("finite");
                // Every fifth measurement is missed.
                if step % 5 != 4 {
                    let innovation = filter.correct(&z).expect("finite");
                    nis.push(innovation.nis, innovation.dof);
                }
            }
        }
        for (filter, (nees, _)) in filters.iter().zip(&mut records) {
            nees.push(filter.pose().nees(&truth.pose).expect("regular"), truth.pose.zero().len());
        }
    }
    for (kind, (nees, nis)) in KINDS.iter().zip(&records) {
        let figures = [nees, nis].map(|c| (c.ratio(), c.p_value()));
        assert_eq!(nees.samples(), RUNS as usize);
        assert!(
            nees.is_consistent(0.999),
            "{kind:?} on {name}: NEES per degree of freedom, tail: {figures:?}"
        );
        assert!(nis.is_consistent(0.999), "{kind:?} on {name}: NIS per degree of freedom, tail: {figures:?}");
    }
}

#[test]
fn in_the_plane() {
    let scene = Scene {
        start: Vector(Vector2::new(1.0, -2.0)),
        sigmas: Vector2::new(0.3, 0.5),
        rest: Vector2::new(1.0, 0.5),
        seen: Vector2::new(0.1, 0.03),
        density: Vector2::new(0.2, 1.0),
    };
    assert_honest("R^2", &scene);
}

#[test]
fn of_planar_motions() {
    let scene = Scene {
        start: SE2::new(0.3, -0.2, 1.0),
        sigmas: Vector3::new(0.05, 0.05, 0.05),
        rest: Vector3::new(0.3, 0.3, 0.5),
        seen: Vector3::new(0.02, 0.01, 0.03),
        density: Vector3::new(0.02, 0.02, 0.05),
    };
    assert_honest("SE(2)", &scene);
}

#[test]
fn of_rigid_motions() {
    let scene = Scene {
        start: SE3::from_rotation_vector(&Vector3::new(0.4, -0.3, 0.7), Vector3::new(0.05, -0.1, 0.8)),
        sigmas: deviations(0.02, 0.05),
        rest: deviations(0.3, 0.5),
        seen: Vector6::new(0.004, 0.004, 0.02, 0.03, 0.03, 0.01),
        density: deviations(0.02, 0.05),
    };
    assert_honest("SE(3)", &scene);
}
