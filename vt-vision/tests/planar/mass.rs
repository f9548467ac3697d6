//! Mass centres: honest about what they see, silent where there is nothing.

use std::sync::Arc;

use image::{Rgb, RgbImage};
use nalgebra::Vector2;
use vt_core::belief::Gaussian;
use vt_core::error::MeasureError;
use vt_core::evidence::Evidence;
use vt_core::frame::{Frame, Payload};
use vt_core::laws::{MeasurementTolerance, check_measurement};
use vt_core::lie::Vector;
use vt_core::measurement::Modality;
use vt_core::random::{Random, Stream};
use vt_core::time::{Seconds, Timestamp};
use vt_models::warp::PlanarWarp;
use vt_vision::discriminant::DiscriminantParams;
use vt_vision::mass_centre::{ColorMass, MassCentreModality, MassCentreParams, MotionMass, MotionWeights};
use vt_vision::motion::{Compared, MotionParams};

use crate::scene::SENSOR;

type Pose = Vector<2>;

const SIZE: [f64; 2] = [24.0, 36.0];

/// A brighter patch of a colour of its own about `at` before a weakly coloured background, with noise; no patch without a place.
fn frame(number: u64, at: Option<Vector2<f64>>) -> Frame {
    let mut random = Random::new(7, Stream::Sim, 1, number, 0);
    let picture = RgbImage::from_fn(160, 120, |x, y| {
        let inside = at.is_some_and(|c| {
            (f64::from(x) - c.x).abs() <= SIZE[0] / 2.0 && (f64::from(y) - c.y).abs() <= SIZE[1] / 2.0
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
fn nees(z: &dyn vt_core::measurement::Measurement<Pose>, truth: Vector2<f64>) -> f64 {
    check_measurement(z, &Vector(truth + Vector2::new(2.0, -3.0)), MeasurementTolerance::default());
    let mut l = [0.0];
    z.log_likelihoods(&[Vector(truth)], &mut l);
    -2.0 * l[0]
}

#[test]
fn colours_of_the_start_are_found_again_and_know_their_error() {
    let (mut modality, mut evidence) = (color(), Evidence::default());
    let start = Vector2::new(80.0, 60.0);
    shown(&mut evidence, frame(0, Some(start)), &modality);
    modality.measure(&evidence, &prior(start, 0.5)).unwrap().expect("seen");
    assert!(modality.source().discriminant().is_some());
    let mut sum = 0.0;
    for k in 1..=60 {
        let mut random = Random::new(3, Stream::Sim, 0, k, 0);
        let at = start + Vector2::new(random.normal(), random.normal()) * 4.0;
        shown(&mut evidence, frame(k, Some(at)), &modality);
        let z = modality.measure(&evidence, &prior(start, 4.0)).unwrap().expect("seen");
        sum += nees(z, at);
    }
    // Two degrees of freedom; a rectangle without limbs has less error than is allowed for.
    assert!(sum / 60.0 < 2.0, "{}", sum / 60.0);
    // Gone: no measurement. Back after the colours were forgotten: learnt anew.
    shown(&mut evidence, frame(99, None), &modality);
    assert!(modality.measure(&evidence, &prior(start, 4.0)).unwrap().is_none());
    modality.forget();
    assert!(modality.source().discriminant().is_none());
}

#[test]
fn what_moves_is_found_where_it_is_and_what_stands_is_not_seen() {
    for compared in [Compared::Two, Compared::Three, Compared::Still] {
        // The patch passes a pixel in 0.5 s.
        let params = MotionParams { threshold: 20, compared, duration: Seconds(0.8) };
        let (mut modality, mut evidence) = motion(params);
        let path = |k: u64| Vector2::new(30.0 + 2.0 * k as f64, 60.0);
        let (mut sum, mut seen) = (0.0, 0);
        for k in 0..45 {
            shown(&mut evidence, frame(k, Some(path(k))), &modality);
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
            shown(&mut evidence, frame(k, Some(path(44))), &modality);
        }
        assert!(modality.measure(&evidence, &prior(path(44), 3.0)).unwrap().is_none(), "{compared:?}");
    }
}

#[test]
fn priors_of_no_use_and_other_places_give_no_measurement() {
    let (mut modality, mut evidence) = (color(), Evidence::default());
    let start = Vector2::new(80.0, 60.0);
    shown(&mut evidence, frame(0, Some(start)), &modality);
    assert!(modality.measure(&evidence, &prior(start, 0.5)).unwrap().is_some());
    for bad in [prior(Vector2::new(f64::NAN, 0.0), 1.0), prior(start, f64::INFINITY)] {
        assert!(matches!(modality.measure(&evidence, &bad), Err(MeasureError::Prediction(_))));
        assert!(modality.last().is_none() && modality.region(&bad).is_none());
    }
    for far in [Vector2::new(-500.0, 60.0), Vector2::new(20.0, 1e9), Vector2::new(20.0, 20.0)] {
        assert!(modality.measure(&evidence, &prior(far, 1.0)).unwrap().is_none(), "{far}");
    }
    // A prior without any width is still one.
    assert!(modality.measure(&evidence, &prior(start, 0.0)).unwrap().is_some());
}

#[test]
fn parameters_out_of_range_are_named() {
    let good = MassCentreParams::default();
    let bad = [
        ("share", MassCentreParams { share: 0.0, ..good }),
        ("least_share", MassCentreParams { least_share: 1.5, ..good }),
        ("patch", MassCentreParams { patch: f64::NAN, ..good }),
        ("wobble", MassCentreParams { wobble: -1.0, ..good }),
        ("window", MassCentreParams { window: 0.5, ..good }),
        ("deviations", MassCentreParams { deviations: 0.0, ..good }),
    ];
    for (key, params) in bad {
        assert!(params.check().unwrap_err().to_string().contains(key), "{key}");
    }
}
