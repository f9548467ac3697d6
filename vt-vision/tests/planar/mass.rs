//! Mass centres: honest about what they see, silent where there is nothing.

use std::sync::Arc;

use image::{Rgb, RgbImage};
use nalgebra::{Matrix2, Vector2};
use vt_core::belief::Gaussian;
use vt_core::error::MeasureError;
use vt_core::evidence::Evidence;
use vt_core::frame::{Frame, Payload};
use vt_core::laws::{MeasurementTolerance, check_measurement};
use vt_core::lie::Vector;
use vt_core::measurement::{Measurement, Modality, NormalEquations};
use vt_core::random::{Random, Stream};
use vt_core::time::{Seconds, Timestamp};
use vt_models::warp::PlanarWarp;
use vt_vision::discriminant::DiscriminantParams;
use vt_vision::mass_centre::{ColorMass, MassCentreModality, MassCentreParams, MotionMass, MotionWeights};
use vt_vision::motion::{Compared, MotionParams};

use crate::scene::SENSOR;

type Pose = Vector<2>;

const SIZE: [f64; 2] = [24.0, 36.0];

/// Brighter patches of a colour of their own about the places `at` before a weakly coloured background, with noise.
fn frame(number: u64, at: impl IntoIterator<Item = Vector2<f64>>) -> Frame {
    sized(number, at, SIZE)
}

/// Patches of this size.
fn sized(number: u64, at: impl IntoIterator<Item = Vector2<f64>>, size: [f64; 2]) -> Frame {
    let at: Vec<_> = at.into_iter().collect();
    let mut random = Random::new(7, Stream::Sim, 1, number, 0);
    let picture = RgbImage::from_fn(160, 120, |x, y| {
        let inside = at.iter().any(|c| {
            (f64::from(x) - c.x).abs() <= size[0] / 2.0 && (f64::from(y) - c.y).abs() <= size[1] / 2.0
        });
        let texture = f64::from((x / 5 + y / 7) % 3) * 8.0;
        let base = if inside { [230.0, 120.0, 110.0] } else { [90.0 + texture, 100.0 + texture, 95.0] };
        Rgb(base.map(|c| (c + 4.0 * random.normal()).round().clamp(0.0, 255.0) as u8))
    });
    let time = Timestamp::from_seconds(0.04 * number as f64);
    Frame { sensor: SENSOR, number, time, payload: Payload::Rgb(Arc::new(picture)) }
}

fn prior(mean: Vector2<f64>, sigma: f64) -> Gaussian<Pose> {
    Gaussian::from_sigmas(Vector(mean), &Vector2::repeat(sigma))
}

fn color() -> MassCentreModality<Pose, ColorMass> {
    let source = ColorMass::new(SENSOR, DiscriminantParams::default()).unwrap();
    MassCentreModality::new(MassCentreParams::default(), source, PlanarWarp::default(), SIZE).unwrap()
}

fn motion(params: MotionParams) -> (MassCentreModality<Pose, MotionMass>, Evidence) {
    let source = MotionMass::new(SENSOR, params, MotionWeights::Newest);
    let mut evidence = Evidence::default();
    evidence.add(Box::new(source.processing()));
    let all = MassCentreParams { share: 1.0, ..Default::default() };
    (MassCentreModality::new(all, source, PlanarWarp::default(), SIZE).unwrap(), evidence)
}

fn shown(evidence: &mut Evidence, frame: Frame, modality: &dyn Modality<Pose>) {
    evidence.begin([frame]);
    for key in modality.needs() {
        evidence.prepare(key, None).unwrap();
    }
}

/// Squared error of a measured place over its covariance.
fn nees(z: &dyn Measurement<Pose>, truth: Vector2<f64>) -> f64 {
    check_measurement(z, &Vector(truth + Vector2::new(2.0, -3.0)), MeasurementTolerance::default());
    let mut l = [0.0];
    z.log_likelihoods(&[Vector(truth)], &mut l);
    -2.0 * l[0]
}

#[test]
fn colours_of_the_start_are_found_again_and_know_their_error() {
    let (mut modality, mut evidence) = (color(), Evidence::default());
    let start = Vector2::new(80.0, 60.0);
    shown(&mut evidence, frame(0, [start]), &modality);
    modality.measure(&evidence, &prior(start, 3.0)).unwrap().expect("seen");
    assert!(modality.source().discriminant().is_some());
    let mut sum = 0.0;
    for k in 1..=60 {
        let mut random = Random::new(3, Stream::Sim, 0, k, 0);
        let at = start + Vector2::new(random.normal(), random.normal()) * 4.0;
        shown(&mut evidence, frame(k, [at]), &modality);
        let z = modality.measure(&evidence, &prior(start, 4.0)).unwrap().expect("seen");
        sum += nees(z, at);
    }
    // Two degrees of freedom; a rectangle without limbs has less error than is allowed for.
    assert!(sum / 60.0 < 2.0, "{}", sum / 60.0);
    // Gone: no measurement. Back after the colours were forgotten: learnt anew.
    shown(&mut evidence, frame(99, []), &modality);
    assert!(modality.measure(&evidence, &prior(start, 4.0)).unwrap().is_none());
    modality.forget();
    assert!(modality.source().discriminant().is_none());
}

#[test]
fn what_moves_is_found_where_it_is_and_what_stands_is_not_seen() {
    for compared in [Compared::Two, Compared::Three, Compared::Still] {
        // The patch passes a pixel in 0.5 s.
        let params = MotionParams { threshold: 20, compared, duration: Seconds(0.8), absorbed: Seconds(0.8) };
        let (mut modality, mut evidence) = motion(params);
        let path = |k: u64| Vector2::new(30.0 + 2.0 * k as f64, 60.0);
        let (mut sum, mut seen) = (0.0, 0);
        for k in 0..45 {
            shown(&mut evidence, frame(k, [path(k)]), &modality);
            let z = modality.measure(&evidence, &prior(path(k), 3.0)).unwrap();
            // Frames alone show two thin borders of a plain patch; the picture of what stands still shows all of it.
            if let (Some(z), true) = (z, k >= 30 && compared == Compared::Still) {
                sum += nees(z, path(k));
                seen += 1;
            }
        }
        assert_eq!(seen, if compared == Compared::Still { 15 } else { 0 }, "{compared:?}");
        assert!(sum / 15.0 < 2.0, "{compared:?}: {}", sum / 15.0);
        // It stands longer than motion is remembered.
        for k in 45..70 {
            shown(&mut evidence, frame(k, [path(44)]), &modality);
        }
        assert!(modality.measure(&evidence, &prior(path(44), 3.0)).unwrap().is_none(), "{compared:?}");
    }
}

/// The start is learnt from one patch; then there are two, `apart` from each other, the first of them where it was.
fn beside(apart: Option<Vector2<f64>>) -> Option<(Vector2<f64>, Matrix2<f64>)> {
    let (mut modality, mut evidence) = (color(), Evidence::default());
    let start = Vector2::new(80.0, 60.0);
    shown(&mut evidence, frame(0, [start]), &modality);
    modality.measure(&evidence, &prior(start, 3.0)).unwrap().expect("seen");
    shown(&mut evidence, frame(1, [start].into_iter().chain(apart.map(|d| start + d))), &modality);
    let z = modality.measure(&evidence, &prior(start, 6.0)).unwrap()?;
    let mut equations = NormalEquations::empty(&Vector(start));
    z.normal_equations(&Vector(start), &mut equations);
    let covariance = covariance(z, start);
    Some((covariance * equations.gradient, covariance))
}

fn covariance(z: &dyn Measurement<Pose>, at: Vector2<f64>) -> Matrix2<f64> {
    let mut equations = NormalEquations::empty(&Vector(at));
    z.normal_equations(&Vector(at), &mut equations);
    equations.information.try_inverse().expect("information")
}

#[test]
fn another_mass_that_touches_the_objects_makes_it_uncertain_along_the_line_between_them() {
    let (error, alone) = beside(None).expect("seen");
    assert!(error.norm() < 1.0, "{error}");
    let (_, touched) = beside(Some(Vector2::new(SIZE[0], 0.0))).expect("seen");
    assert!(touched.m11 > 2.0 * alone.m11, "{touched} {alone}");
    assert!(touched.m22 < 1.5 * alone.m22, "{touched} {alone}");
    // Farther off it does not draw the measurement away.
    let (error, far) = beside(Some(Vector2::new(2.0 * SIZE[0], 0.0))).expect("seen");
    assert!(error.norm() < 2.0, "{error} {far}");
    // All around there is the object's colour: it may be anywhere.
    let near = [-1.0, 0.0, 1.0].map(|k| k * 0.9);
    let places = near.iter().flat_map(|x| near.map(|y| Vector2::new(80.0 + x * SIZE[0], 60.0 + y * SIZE[1])));
    let (mut modality, mut evidence) = (color(), Evidence::default());
    let start = Vector2::new(80.0, 60.0);
    shown(&mut evidence, frame(0, [start]), &modality);
    modality.measure(&evidence, &prior(start, 3.0)).unwrap().expect("seen");
    shown(&mut evidence, frame(1, places), &modality);
    assert!(modality.measure(&evidence, &prior(start, 3.0)).unwrap().is_none());
}

#[test]
fn the_mass_that_is_expected_follows_what_is_seen_until_it_is_taken_back() {
    let (mut modality, mut evidence) = (color(), Evidence::default());
    let start = Vector2::new(80.0, 60.0);
    shown(&mut evidence, frame(0, [start]), &modality);
    modality.measure(&evidence, &prior(start, 3.0)).unwrap().expect("seen");
    modality.adapt(&evidence, &prior(start, 3.0)).unwrap();
    // It is half as large from now on.
    let mut variance = |modality: &mut MassCentreModality<Pose, ColorMass>, number, adapts: bool| {
        shown(&mut evidence, sized(number, [start], SIZE.map(|s| 0.7 * s)), modality);
        let z = modality.measure(&evidence, &prior(start, 3.0)).unwrap().expect("seen");
        let variance = covariance(z, start).trace();
        if adapts {
            modality.adapt(&evidence, &prior(start, 1.0)).unwrap();
        }
        variance
    };
    let before = variance(&mut modality, 1, false);
    let after = (2..200).map(|k| variance(&mut modality, k, true)).last().unwrap();
    modality.revert();
    let back = variance(&mut modality, 200, false);
    // Of less that is expected nothing is missing, and where it is is less certain.
    assert!(
        (after / before - 1.0).abs() > 0.1 && (back / before - 1.0).abs() < 0.05,
        "{before} {after} {back}"
    );
    assert!(modality.source().discriminant().is_some());
}

#[test]
fn priors_of_no_use_and_other_places_give_no_measurement() {
    let (mut modality, mut evidence) = (color(), Evidence::default());
    let start = Vector2::new(80.0, 60.0);
    shown(&mut evidence, frame(0, [start]), &modality);
    assert!(modality.measure(&evidence, &prior(start, 3.0)).unwrap().is_some());
    for bad in [prior(Vector2::new(f64::NAN, 0.0), 1.0), prior(start, f64::INFINITY)] {
        assert!(matches!(modality.measure(&evidence, &bad), Err(MeasureError::Prediction(_))));
        assert!(modality.last().is_none() && modality.region(&bad).is_none());
    }
    for far in [Vector2::new(-500.0, 60.0), Vector2::new(20.0, 1e9), Vector2::new(20.0, 20.0)] {
        assert!(modality.measure(&evidence, &prior(far, 1.0)).unwrap().is_none(), "{far}");
    }
    // A prior without any width is still one, which a picture cannot improve.
    assert!(modality.measure(&evidence, &prior(start, 0.0)).unwrap().is_none());
}

#[test]
fn parameters_out_of_range_are_named() {
    let good = MassCentreParams::default();
    let bad = [
        ("share", MassCentreParams { share: 0.0, ..good }),
        ("enough", MassCentreParams { enough: 1.5, ..good }),
        ("sharpness", MassCentreParams { sharpness: f64::NAN, ..good }),
        ("hidden", MassCentreParams { hidden: 0.0, ..good }),
        ("follows", MassCentreParams { follows: Seconds(-1.0), ..good }),
        ("wobble", MassCentreParams { wobble: -1.0, ..good }),
        ("deviations", MassCentreParams { deviations: 0.0, ..good }),
    ];
    for (key, params) in bad {
        assert!(params.check().unwrap_err().to_string().contains(key), "{key}");
    }
}
