//! What changes of the light and occluders do.

use image::{GrayImage, Luma};
use vt_core::lie::{Affine2, PlanarMotion, SL3, Sim2};
use vt_core::robust::Robust;
use vt_vision::alignment::{Aligned, Aligner, AlignmentError, AlignmentParams, Method, Similarity, Template};

use crate::scene::{SIZE, Waves, distance, upright};

const METHODS: [Method; 2] = [Method::InverseCompositional, Method::Esm];

fn truth() -> Sim2 {
    Sim2::new(82.1, 57.9, 0.05, 1.03)
}

/// Aligns a template of the plain picture with this one.
fn align(params: AlignmentParams, picture: &GrayImage) -> Result<Aligned<Affine2>, AlignmentError> {
    let start = upright::<Affine2>();
    let reference = Waves::new(5).draw(&start, |v| v, 1.0, 50);
    let template = Template::new(params, &reference, SIZE, &start).expect("a template");
    Aligner::new(template).align(picture, &start)
}

fn with(similarity: Similarity, method: Method) -> AlignmentParams {
    AlignmentParams { similarity, method, ..AlignmentParams::default() }
}

/// Error in pixels under light, of all that should hold under it.
fn holds(kinds: &[Similarity], light: fn(f64) -> f64) {
    let truth = Affine2 { matrix: truth().matrix() };
    let picture = Waves::new(5).draw(&truth, light, 1.0, 51);
    for &similarity in kinds {
        for method in METHODS {
            let found = align(with(similarity, method), &picture).expect("aligned");
            let error = distance(&found.pose, &truth);
            assert!(found.converged() && error < 0.12, "{similarity:?} {method:?}: {error}");
            assert_eq!((found.inside, found.inliers), (1.0, 1.0));
        }
    }
}

#[test]
fn gain_and_bias_do_not_matter() {
    holds(&Similarity::ALL, |v| v);
    holds(&Similarity::ALL, |v| 0.4 * v + 100.0);
}

#[test]
fn inverted_contrast_does_not_matter_where_the_sign_does_not() {
    use Similarity::{MutualInformation, NormalizedMutualInformation, Scv, Ssd};
    holds(&[Ssd, Scv, MutualInformation, NormalizedMutualInformation], |v| 255.0 - v);
}

#[test]
fn curves_do_not_matter_to_conditional_variance_and_information() {
    use Similarity::{MutualInformation, NormalizedMutualInformation, Scv};
    // Dark and bright places both become bright.
    holds(&[Scv, MutualInformation, NormalizedMutualInformation], |v| 40.0 + (v - 128.0).abs() * 1.6);
}

#[test]
fn scores_tell_the_template_from_something_else() {
    let truth = Affine2 { matrix: truth().matrix() };
    let (same, other) =
        (Waves::new(5).draw(&truth, |v| v, 4.0, 52), Waves::new(6).draw(&truth, |v| v, 4.0, 53));
    for similarity in Similarity::ALL {
        let seen = align(with(similarity, Method::Esm), &same).expect("aligned").score;
        let missed = align(with(similarity, Method::Esm), &other).map_or(0.0, |found| found.score);
        println!("{similarity:?}: {seen:.3}, something else {missed:.3}");
        assert!(seen > missed, "{similarity:?} {seen} {missed}");
        if !similarity.is_information() {
            assert!(seen > 0.97 && missed < 0.8, "{similarity:?} {seen} {missed}");
        }
    }
}

#[test]
fn an_m_estimator_leaves_an_occluder_out() {
    let truth = Affine2 { matrix: truth().matrix() };
    let mut picture = Waves::new(5).draw(&truth, |v| v, 1.0, 54);
    for y in 40..80 {
        for x in 50..78 {
            picture.put_pixel(x, y, Luma([if (x / 5 + y / 4) % 2 == 0 { 250 } else { 10 }]));
        }
    }
    for similarity in [Similarity::Ssd, Similarity::Zncc, Similarity::Scv] {
        for method in METHODS {
            let plain = with(similarity, method);
            let robust = AlignmentParams { robust: Some(Robust::TUKEY), ..plain };
            let found = align(robust, &picture).expect("aligned");
            let error = distance(&found.pose, &truth);
            let other = align(plain, &picture).map_or(f64::INFINITY, |found| distance(&found.pose, &truth));
            println!(
                "{similarity:?} {method:?}: {error:.3} px, without weights {other:.3}, {} {:?} {} {}",
                found.iterations, found.stop, found.inliers, found.score
            );
            assert!(error < 0.1 && error < 0.5 * other, "{similarity:?} {method:?}: {error} {other}");
            assert!((0.5..0.9).contains(&found.inliers), "{}", found.inliers);
        }
    }
}

#[test]
fn the_same_picture_gives_the_same_bytes() {
    let truth = SL3::from_matrix(&truth().matrix()).expect("regular");
    let start = upright::<SL3>();
    let reference = Waves::new(5).draw(&start, |v| v, 1.0, 50);
    let picture = Waves::new(5).draw(&truth, |v| v, 1.0, 55);
    for similarity in Similarity::ALL {
        let template =
            Template::new(with(similarity, Method::Esm), &reference, SIZE, &start).expect("a template");
        let mut aligner = Aligner::new(template);
        let once = aligner.align(&picture, &start).expect("aligned");
        let _ = aligner.align(&reference, &start).expect("aligned");
        let again = aligner.align(&picture, &start).expect("aligned");
        assert_eq!((once.pose, once.covariance, once.score), (again.pose, again.covariance, again.score));
    }
}
