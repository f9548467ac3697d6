//! The search of a picture for the colours of a target.

use image::{Rgb, RgbImage};
use vt_core::agent::Reinitializer;
use vt_core::belief::Gaussian;
use vt_core::evidence::Evidence;
use vt_core::lie::{PlanarMotion, SE2, Sim2, TranslationScale, Vector};
use vt_core::manifold::Alloc;
use vt_core::random::{Random, Stream};
use vt_vision::color_likelihood::{ColorSearch, ColorSearchParams};

use crate::scene::{SENSOR, draw, prior, show};

/// What the target looks like at `learnt`, then a picture of it: what is proposed.
fn search<P: PlanarMotion>(learnt: &Gaussian<P>, image: RgbImage) -> Vec<Gaussian<P>>
where
    nalgebra::DefaultAllocator: Alloc<P::D>,
{
    let mut search = ColorSearch::<P>::new(ColorSearchParams::default(), SENSOR, [60.0, 50.0]).unwrap();
    let (mut evidence, mut out) = (Evidence::default(), vec![]);
    show(&mut evidence, image.clone());
    search.propose(&evidence, learnt, &mut out).unwrap();
    assert!(out.is_empty(), "nothing is known yet");
    show(&mut evidence, draw(&learnt.mean));
    search.adapt(&evidence, learnt).unwrap();
    show(&mut evidence, image);
    search.propose(&evidence, learnt, &mut out).unwrap();
    out
}

/// The first proposal is as far from the truth as it says: over many places and sizes, the errors of place and scale have the
/// deviations that are proposed, or less (a figure that fills its box is easy); and no single one is a surprise.
#[test]
fn the_best_proposal_is_honest() {
    let learnt = prior(TranslationScale::new(100.0, 80.0, 0.8), 1.0);
    let mut random = Random::new(3, Stream::Sim, 1, 0, 0);
    let (mut sum, mut worst) = (0.0, 0.0_f64);
    let cases = 40;
    for _ in 0..cases {
        let mut within = |low: f64, high: f64| low + (high - low) * random.uniform();
        let truth = TranslationScale::new(within(45.0, 155.0), within(40.0, 120.0), within(0.6, 1.1));
        let found = search(&learnt, draw(&truth));
        let nees = found[0].nees(&truth).expect("regular");
        (sum, worst) = (sum + nees, worst.max(nees));
    }
    let mean = sum / f64::from(cases);
    println!("mean NEES {mean:.2} of 3, worst {worst:.1}");
    assert!((0.5..4.2).contains(&mean), "{mean}");
    assert!(worst < 16.3, "{worst}"); // χ²(3) at 0.999
}

#[test]
fn coordinates_that_colours_do_not_tell_are_those_trusted_last() {
    let shifted = |dx: f64| draw(&Sim2::new(100.0 + dx, 70.0, 0.3, 0.9));
    let sim = prior(Sim2::new(90.0, 80.0, 0.3, 0.9), 1.0);
    let found = &search(&sim, shifted(30.0))[0];
    assert!((found.mean.translation - nalgebra::Vector2::new(130.0, 70.0)).norm() < 10.0, "{found:?}");
    assert!((found.mean.angle() - 0.3).abs() < 1e-9);
    assert!((found.covariance[(2, 2)] / sim.covariance[(2, 2)] - 9.0).abs() < 1e-9);
    // A locked scale stays, and spaces without one are searched at one size.
    let mut locked = sim.clone();
    locked.covariance[(3, 3)] = 0.0;
    let found = &search(&locked, shifted(30.0))[0];
    assert!((found.mean.scale - 0.9).abs() < 1e-12 && found.covariance[(3, 3)] == 0.0);
    let found = &search(&prior(SE2::new(90.0, 80.0, 0.3), 1.0), draw(&SE2::new(130.0, 70.0, 0.3)))[0];
    assert!((found.mean.translation - nalgebra::Vector2::new(130.0, 70.0)).norm() < 10.0, "{found:?}");
    let plain = prior(Vector(nalgebra::Vector2::new(90.0, 80.0)), 1.0);
    let found = &search(&plain, draw(&Vector(nalgebra::Vector2::new(60.0, 90.0))))[0];
    assert!((found.mean.0 - nalgebra::Vector2::new(60.0, 90.0)).norm() < 10.0, "{found:?}");
}

#[test]
fn every_copy_is_proposed_once_and_nothing_where_the_colours_are_not() {
    let learnt = prior(TranslationScale::new(100.0, 80.0, 0.6), 1.0);
    let (left, right) = (TranslationScale::new(50.0, 60.0, 0.6), TranslationScale::new(150.0, 100.0, 0.6));
    let mut both = draw(&left);
    for (x, y, pixel) in draw(&right).enumerate_pixels().filter(|(x, ..)| *x >= 100) {
        both.put_pixel(x, y, *pixel);
    }
    let found = search(&learnt, both);
    for truth in [left, right] {
        let near = |f: &&Gaussian<TranslationScale>| (f.mean.translation - truth.translation).norm() < 10.0;
        assert_eq!(found[..2].iter().filter(near).count(), 1, "{found:?}");
    }
    let empty = RgbImage::from_pixel(200, 160, Rgb([60, 62, 58]));
    assert!(search(&learnt, empty).is_empty());
    // A picture that is smaller than the target, and a grey one.
    assert!(search(&learnt, RgbImage::from_pixel(20, 10, Rgb([200, 90, 120]))).is_empty());
}

#[test]
fn the_last_trusted_belief_comes_first_with_wider_deviations() {
    let learnt = prior(TranslationScale::new(100.0, 80.0, 0.8), 1.0);
    let mut search =
        ColorSearch::new(ColorSearchParams::default(), SENSOR, [60.0, 50.0]).unwrap().with_last_trusted(2.0);
    let (mut evidence, mut out) = (Evidence::default(), vec![]);
    show(&mut evidence, draw(&learnt.mean));
    search.adapt(&evidence, &learnt).unwrap();
    search.propose(&evidence, &learnt, &mut out).unwrap();
    assert_eq!(out[0].mean, learnt.mean);
    assert_eq!(out[0].covariance, learnt.covariance * 4.0);
    assert!(out.len() > 1);
    // What is forgotten is not searched.
    Reinitializer::forget(&mut search);
    out.clear();
    search.propose(&evidence, &learnt, &mut out).unwrap();
    assert_eq!(out.len(), 1);
    for wrong in [0, 101] {
        let params = ColorSearchParams { proposals: wrong, ..ColorSearchParams::default() };
        assert!(params.check().unwrap_err().to_string().contains("proposals"));
    }
    let params = ColorSearchParams { least_contrast: 1.0, ..ColorSearchParams::default() };
    assert!(params.check().unwrap_err().to_string().contains("least_contrast"));
}
