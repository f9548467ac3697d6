//! Both forms of every measurement say the same.

use nalgebra::DefaultAllocator;
use proptest::prelude::*;
use vt_core::laws::{MeasurementTolerance, check_measurement, for_cases, tangent};
use vt_core::lie::{Affine2, PlanarMotion, SE2, SL3, Sim2, TranslationScale, Vector};
use vt_core::manifold::Alloc;
use vt_core::random::{Random, Stream};

use crate::convergence::Kind;
use crate::scene::{Prepared, prior, units};

/// Poses within some pixels of `truth`.
fn near<P: PlanarMotion>(truth: P, pixels: f64) -> impl Strategy<Value = P>
where
    DefaultAllocator: Alloc<P::D>,
{
    any::<u64>().prop_map(move |seed| {
        let mut random = Random::new(seed, Stream::Sim, 5, 0, 0);
        truth.retract(&(tangent(truth.dim(), &mut random).component_mul(&units(&truth)) * pixels))
    })
}

/// Steps so short that normals and samples hardly ever pass from one pixel to the next within them: there the
/// likelihood has kinks or jumps, which no derivative knows.
const TOLERANCE: MeasurementTolerance =
    MeasurementTolerance { step: 1e-7, gradient: 2e-4, accumulation: 1e-9 };

fn check<P: PlanarMotion>(kind: Kind, truth: P)
where
    DefaultAllocator: Alloc<P::D>,
{
    let (mut modality, evidence): Prepared<P> = kind.prepare(&truth);
    let z = modality.measure(&evidence, &prior(truth.clone(), 2.0)).unwrap().expect("in view");
    for_cases(20, near(truth, 2.5), |pose| check_measurement(z, &pose, TOLERANCE));
}

#[test]
fn both_forms_agree_on_all_motions() {
    for kind in Kind::ALL {
        println!("{kind:?}");
        check(kind, Vector::<2>(nalgebra::Vector2::new(100.3, 80.2)));
        check(kind, TranslationScale::new(100.3, 80.2, 1.1));
        check(kind, SE2::new(100.3, 80.2, 0.4));
        check(kind, Sim2::new(100.3, 80.2, 0.4, 1.1));
        check(kind, Affine2::from_rows([1.1, -0.2, 100.3], [0.3, 0.9, 80.2]).unwrap());
        let tilted = nalgebra::Matrix3::new(1.1, -0.2, 100.3, 0.3, 0.9, 80.2, 1e-3, -5e-4, 1.0);
        check(kind, SL3::from_matrix(&tilted).unwrap());
    }
}
