//! The search of a picture for an outline.

use image::{Rgb, RgbImage};
use nalgebra::DefaultAllocator;
use vt_core::agent::{Posed, Reinitializer, Warp};
use vt_core::belief::Gaussian;
use vt_core::error::MeasureError;
use vt_core::lie::{PlanarMotion, SE2, SL3, Sim2, TranslationScale, Vector};
use vt_core::manifold::Alloc;
use vt_core::random::{Random, Stream};
use vt_models::warp::PlanarWarp;
use vt_vision::canny::{CannyParams, Thresholds};
use vt_vision::contour::{ChamferSearch, ChamferSearchParams};

use crate::scene::{SENSOR, draw, figure, prepared, prior};

fn searching<P: PlanarMotion>() -> ChamferSearch<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    let canny = CannyParams::new(Thresholds::Fixed { low: 8.0, high: 20.0 }).unwrap();
    ChamferSearch::new(ChamferSearchParams::default(), canny, SENSOR, figure().sample(60)).unwrap()
}

/// What is proposed in a picture for an outline that was last at a pose.
fn search<P: PlanarMotion>(last: &Gaussian<P>, image: RgbImage) -> Vec<Gaussian<P>>
where
    DefaultAllocator: Alloc<P::D>,
{
    let (mut search, mut out) = (searching::<P>(), vec![]);
    let evidence = prepared(search.processing(), image);
    search.propose(&evidence, last, &mut out).unwrap();
    out
}

/// Largest distance of the outline's points from their true places.
fn distance<P: PlanarMotion>(a: &P, b: &P) -> f64
where
    DefaultAllocator: Alloc<P::D>,
{
    let warp = PlanarWarp::default();
    let (a, b) = (warp.at(a), warp.at(b));
    let apart = |x| (a.locate(x).unwrap() - b.locate(x).unwrap()).norm();
    figure().sample(60).points().iter().map(apart).fold(0.0, f64::max)
}

/// Wherever the outline is, turned and magnified within the range, the first proposal is there, to a pixel or so, and not farther than
/// it says.
#[test]
fn the_outline_is_found_wherever_it_is() {
    let last = prior(Sim2::new(100.0, 80.0, 0.2, 0.9), 1.0);
    let mut random = Random::new(4, Stream::Sim, 1, 0, 0);
    let (mut worst, mut sum) = (0.0_f64, 0.0);
    let cases = 30;
    for _ in 0..cases {
        let mut within = |low: f64, high: f64| low + (high - low) * random.uniform();
        let truth = Sim2::new(within(50.0, 150.0), within(50.0, 110.0), within(-0.4, 0.8), within(0.75, 1.1));
        let found = search(&last, draw(&truth));
        worst = worst.max(distance(&found[0].mean, &truth));
        sum += found[0].nees(&truth).expect("regular");
    }
    println!("at most {worst:.2} px, mean NEES {:.2} of 4", sum / f64::from(cases));
    assert!(worst < 2.0, "{worst} px");
    assert!(sum / f64::from(cases) < 4.0, "{sum}");
}

#[test]
fn spaces_are_searched_in_the_coordinates_that_they_have() {
    let plain = |x, y| Vector(nalgebra::Vector2::new(x, y));
    let found = &search(&prior(plain(90.0, 80.0), 1.0), draw(&plain(120.0, 60.0)))[0].mean;
    assert!(distance(found, &plain(120.0, 60.0)) < 2.0, "{found:?}");
    let truth = SE2::new(80.0, 90.0, 0.5);
    let found = &search(&prior(SE2::new(100.0, 80.0, 0.2), 1.0), draw(&truth))[0].mean;
    assert!(distance(found, &truth) < 2.0, "{found:?}");
    let last = prior(SL3::of(&Sim2::new(100.0, 80.0, 0.2, 1.0)), 1.0);
    let truth = Sim2::new(80.0, 90.0, 0.5, 0.9);
    let found = &search(&last, draw(&truth))[0].mean;
    assert!(distance(found, &SL3::of(&truth)) < 2.0, "{found:?}");
    let truth = TranslationScale::new(80.0, 90.0, 0.8);
    let found = &search(&prior(TranslationScale::new(100.0, 80.0, 1.0), 1.0), draw(&truth))[0].mean;
    assert!(distance(found, &truth) < 2.0, "{found:?}");
}

#[test]
fn nothing_is_proposed_where_there_are_no_edges_and_the_last_trusted_comes_first() {
    let last = prior(Sim2::new(100.0, 80.0, 0.2, 0.9), 1.0);
    for (width, height) in [(200, 160), (5, 3)] {
        assert!(search(&last, RgbImage::from_pixel(width, height, Rgb([60, 62, 58]))).is_empty());
    }
    let mut search = searching::<Sim2>().with_last_trusted(Some(2.0));
    let evidence = prepared(search.processing(), draw(&last.mean));
    let mut out = vec![];
    search.propose(&evidence, &last, &mut out).unwrap();
    assert_eq!((out[0].mean, out[0].covariance), (last.mean, last.covariance * 4.0));
    assert!(out.len() > 1 && distance(&out[1].mean, &last.mean) < 2.0);
    // A pose that is none, one far too large, and one that is next to nothing.
    let mut strange = last.clone();
    strange.mean.translation.x = f64::NAN;
    let refused = search.propose(&evidence, &strange, &mut out);
    assert!(matches!(refused, Err(MeasureError::Prediction(_))), "{refused:?}");
    for scale in [1e-12, 1e3, 1e12] {
        let strange = Gaussian { mean: Sim2 { scale, ..last.mean }, ..last.clone() };
        search.propose(&evidence, &strange, &mut out).unwrap();
        assert!(out.iter().all(Gaussian::is_finite));
    }
}

#[test]
fn parameters_out_of_range_are_named() {
    let good = ChamferSearchParams::default();
    let wrong = [
        ("turn", ChamferSearchParams { turn: 4.0, ..good }),
        ("magnification", ChamferSearchParams { magnification: 0.9, ..good }),
        ("proposals", ChamferSearchParams { proposals: 0, ..good }),
        (
            "sigma",
            ChamferSearchParams {
                chamfer: vt_vision::contour::ChamferParams { sigma: f64::NAN, ..good.chamfer },
                ..good
            },
        ),
    ];
    for (key, params) in wrong {
        let message = params.check().unwrap_err().to_string();
        assert!(message.contains(key), "{message}");
    }
}
