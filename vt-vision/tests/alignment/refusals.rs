//! What is refused, and how.

use image::{GrayImage, Luma};
use nalgebra::{Matrix3, Vector2};
use proptest::prelude::*;
use vt_core::lie::{Affine2, SL3, Vector};
use vt_core::robust::Robust;
use vt_vision::alignment::{Aligner, AlignmentError, AlignmentParams, Similarity, Template, TemplateError};

use crate::scene::{PICTURE, SIZE, Waves, upright};

fn picture() -> GrayImage {
    Waves::new(1).draw(&upright::<Affine2>(), |v| v, 1.0, 60)
}

fn template(picture: &GrayImage, pose: &Affine2) -> Result<Template<Affine2>, TemplateError> {
    Template::new(AlignmentParams::default(), picture, SIZE, pose)
}

fn moved(x: f64, y: f64) -> Affine2 {
    Affine2 { matrix: Matrix3::new(1.0, 0.0, x, 0.0, 1.0, y, 0.0, 0.0, 1.0) }
}

#[test]
fn templates_need_contrast_in_two_directions() {
    let (width, height) = PICTURE;
    let flat = GrayImage::from_pixel(width, height, Luma([80]));
    assert_eq!(template(&flat, &upright()).unwrap_err(), TemplateError::Flat { found: 0, expected: 64 });
    let stripes = GrayImage::from_fn(width, height, |x, _| Luma([if x / 8 % 2 == 0 { 40 } else { 200 }]));
    let error = template(&stripes, &upright()).unwrap_err();
    assert!(matches!(error, TemplateError::Ambiguous { found: 1..=5, expected: 6 }), "{error}");
}

#[test]
fn templates_lie_in_the_picture() {
    assert!(template(&picture(), &upright()).is_ok());
    for (x, y, corner) in [(20.0, 60.0, 0), (130.0, 60.0, 1), (130.0, 90.0, 1), (80.0, 100.0, 2)] {
        let error = template(&picture(), &moved(x, y)).unwrap_err();
        assert_eq!(error, TemplateError::OutOfPicture { corner }, "{x} {y}");
    }
    assert_eq!(
        template(&GrayImage::default(), &upright()).unwrap_err(),
        TemplateError::OutOfPicture { corner: 0 }
    );
    assert_eq!(template(&picture(), &moved(f64::NAN, 3.0)).map(|_| ()).unwrap_err(), TemplateError::Pose);
}

#[test]
fn parameters_are_checked() {
    let good = AlignmentParams::default();
    let information = Similarity::MutualInformation;
    for (key, bad) in [
        ("levels", AlignmentParams { levels: 0, ..good }),
        ("levels", AlignmentParams { levels: 9, ..good }),
        ("finest", AlignmentParams { finest: 3, ..good }),
        ("smoothing", AlignmentParams { smoothing: 0.0, ..good }),
        ("smoothing", AlignmentParams { smoothing: f64::NAN, ..good }),
        ("points", AlignmentParams { points: 63, ..good }),
        ("least_gradient", AlignmentParams { least_gradient: 0.0, ..good }),
        ("robust constant", AlignmentParams { robust: Some(Robust::Huber(-1.0)), ..good }),
        ("robust", AlignmentParams { robust: Some(Robust::TUKEY), similarity: information, ..good }),
        ("iterations", AlignmentParams { iterations: 0, ..good }),
        ("tolerance", AlignmentParams { tolerance: -1.0, ..good }),
        ("least_inside", AlignmentParams { least_inside: 1.1, ..good }),
        ("reach", AlignmentParams { reach: f64::INFINITY, ..good }),
    ] {
        let error = Template::new(bad, &picture(), SIZE, &upright::<Affine2>()).unwrap_err();
        assert!(error.to_string().contains(&format!("`{key}`")), "{key}: {error}");
    }
    let size = Template::new(good, &picture(), [0.0, 3.0], &upright::<Affine2>()).unwrap_err();
    assert!(size.to_string().contains("`size`"), "{size}");
}

/// A model whose one side is as nothing beside the other has as many points as its picture allows, not as its sides.
#[test]
fn sides_of_very_unlike_units_have_no_more_points() {
    for thin in [1e-6, 1e-12, 1e-100] {
        let size = [SIZE[0], SIZE[1] * thin];
        let pose = Affine2 { matrix: Matrix3::new(1.0, 0.0, 79.3, 0.0, 1.0 / thin, 59.6, 0.0, 0.0, 1.0) };
        let made = Template::new(AlignmentParams::default(), &picture(), size, &pose);
        let points = made.map_or(0, |t| t.points().max().unwrap_or(0));
        assert!(points <= 3 * AlignmentParams::default().points, "{points}");
    }
}

#[test]
fn pictures_without_the_template_are_refused() {
    let template = template(&picture(), &upright()).expect("a template");
    let found: Vec<usize> = template.points().collect();
    let mut aligner = Aligner::new(template);
    let far = aligner.align(&picture(), &moved(-500.0, 60.0)).unwrap_err();
    assert_eq!(far, AlignmentError::OutOfPicture { inside: 0, points: found[0] });
    let edge = aligner.align(&picture(), &moved(0.0, 0.0)).unwrap_err();
    assert!(matches!(edge, AlignmentError::OutOfPicture { inside: 100.., .. }), "{edge}");
    assert_eq!(aligner.align(&picture(), &moved(f64::NAN, 0.0)).unwrap_err(), AlignmentError::Start);
    let flat = GrayImage::from_pixel(PICTURE.0, PICTURE.1, Luma([80]));
    assert_eq!(aligner.align(&flat, &upright()).unwrap_err(), AlignmentError::Flat);
    assert!(aligner.align(&GrayImage::default(), &upright()).is_err());
    assert!(aligner.align(&GrayImage::new(3, 2), &upright()).is_err());
}

proptest! {
    /// Any picture and any start are aligned or refused.
    #[test]
    fn nothing_panics(
        (width, height) in (1u32..120, 1u32..90), seed in 0u32..1000, kind in 0usize..5, levels in 1u32..6,
        start in prop::array::uniform8(-1.0..1.0f64), size in prop::array::uniform2(0.2..0.95f64), at in prop::array::uniform2(-0.5..0.5f64),
    ) {
        let noise = GrayImage::from_fn(width, height, |x, y| Luma([((x * 97 + y * 61 + x * y * seed) % 256) as u8]));
        // Mostly inside.
        let bounds = [f64::from(width), f64::from(height)];
        let size: [f64; 2] = core::array::from_fn(|k| bounds[k] * size[k]);
        let at: [f64; 2] = core::array::from_fn(|k| 0.5 * bounds[k] + at[k] * (bounds[k] - size[k]));
        let params = AlignmentParams { similarity: Similarity::ALL[kind], levels, points: 64 + seed as usize, ..AlignmentParams::default() };
        let middle = SL3::from_matrix(&Matrix3::new(1.0, 0.0, at[0], 0.0, 1.0, at[1], 0.0, 0.0, 1.0)).unwrap();
        let Ok(template) = Template::new(params, &noise, size, &middle) else { return Ok(()) };
        let mut aligner = Aligner::new(template);
        let [a, b, c, d, e, f, g, h] = start;
        let anywhere = Matrix3::new(1.0 + a, b, at[0] + 40.0 * c, d, 1.0 + e, at[1] + 40.0 * f, 0.02 * g, 0.02 * h, 1.0);
        for start in [Some(middle), SL3::from_matrix(&anywhere)].into_iter().flatten() {
            if let Ok(found) = aligner.align(&noise, &start) {
                prop_assert!(found.covariance.iter().chain(found.pose.matrix.iter()).all(|v| v.is_finite()));
                prop_assert!(found.score.is_finite() && found.inside <= 1.0 && found.inliers <= 1.0 + 1e-9);
            }
        }
    }
}

#[test]
fn translations_too_have_their_template() {
    let start = Vector(Vector2::new(79.3, 59.6));
    let template = Template::new(AlignmentParams::default(), &picture(), SIZE, &start).expect("a template");
    let found = Aligner::new(template)
        .align(&picture(), &Vector(start.0 + Vector2::new(5.0, -4.0)))
        .expect("aligned");
    assert!((found.pose.0 - start.0).norm() < 0.01 && found.converged(), "{found:?}");
}
