//! From a start some pixels away the most probable pose is found.

use nalgebra::{DefaultAllocator, Matrix2, Point2, Vector2};
use vt_core::evidence::Processing;
use vt_core::laws::{MeasurementTolerance, check_measurement};
use vt_core::least_squares::LeastSquares;
use vt_core::lie::{PlanarMotion, SE2, Sim2, TranslationScale, Vector};
use vt_core::manifold::Alloc;
use vt_core::measurement::Measurement;
use vt_models::warp::PlanarWarp;
use vt_vision::canny::{CannyParams, Thresholds};
use vt_vision::color_likelihood::{ColorModality, ColorParams};
use vt_vision::contour::{ChamferModality, ChamferParams, ContourModality, ContourParams};
use vt_vision::edge::Hypotheses;
use vt_vision::mass_centre::CentreMeasurement;
use vt_vision::template::{TemplateModality, TemplateParams};

use crate::scene::{Prepared, SENSOR, draw, figure, grey, prepared, prior, units};

/// The measurements of this page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Contour,
    SingleContour,
    Chamfer,
    Color,
    ColorParts,
    Template,
}

impl Kind {
    pub const ALL: [Self; 6] =
        [Self::Contour, Self::SingleContour, Self::Chamfer, Self::Color, Self::ColorParts, Self::Template];

    /// The modality with the evidence of a picture at `truth`.
    pub fn prepare<P: PlanarMotion>(self, truth: &P) -> Prepared<P>
    where
        DefaultAllocator: Alloc<P::D>,
    {
        let picture = draw(truth);
        let (warp, contour) = (PlanarWarp::<P>::default(), figure().sample(60));
        let canny = CannyParams::new(Thresholds::Fixed { low: 15.0, high: 25.0 }).unwrap();
        let size = [60.0, 50.0];
        match self {
            Self::Contour | Self::SingleContour => {
                let single = self == Self::SingleContour;
                let hypotheses = if single { Hypotheses::Single } else { Hypotheses::Multiple };
                let params = ContourParams { hypotheses, ..ContourParams::default() };
                let modality = ContourModality::new(params, canny, SENSOR, warp, contour).unwrap();
                let evidence = prepared(modality.processing(), picture);
                (Box::new(modality), evidence)
            }
            Self::Chamfer => {
                let modality =
                    ChamferModality::new(ChamferParams::default(), canny, SENSOR, warp, contour).unwrap();
                let evidence = prepared(modality.processing(), picture);
                (Box::new(modality), evidence)
            }
            Self::Color | Self::ColorParts => {
                let parts = if self == Self::Color { 1 } else { 2 };
                let background = (parts > 1).then_some(1.6);
                let params =
                    ColorParams { columns: parts, rows: parts, background, ..ColorParams::default() };
                let modality = ColorModality::new(params, SENSOR, warp, size).unwrap();
                let modality = modality.with_reference(&picture, truth).unwrap();
                let evidence = prepared(modality.processing(), picture);
                (Box::new(modality), evidence)
            }
            Self::Template => {
                let modality = TemplateModality::new(TemplateParams::default(), SENSOR, warp, size).unwrap();
                let modality = modality.with_reference(&grey(&picture), truth).unwrap();
                // It reads frames; any unit serves.
                let unit = vt_vision::canny::CannyProcessing::new(SENSOR, canny);
                assert!(!unit.key().name.is_empty());
                (Box::new(modality), prepared(unit, picture))
            }
        }
    }

    /// Distance in pixels from the truth that is allowed 30 pixels from the origin. Colours of an ellipse tell a motion by
    /// what comes and goes at its rim alone.
    fn allowed(self) -> f64 {
        match self {
            Self::Contour | Self::SingleContour | Self::Chamfer => 0.7,
            Self::Color => 1.5,
            Self::ColorParts => 1.0,
            Self::Template => 0.1,
        }
    }
}

fn converges<P: PlanarMotion>(kind: Kind, truth: P)
where
    DefaultAllocator: Alloc<P::D>,
{
    let (mut modality, evidence) = kind.prepare(&truth);
    let units = units(&truth);
    let z = modality.measure(&evidence, &prior(truth.clone(), 3.0)).unwrap().expect("in view");
    for sign in [-1.0, 1.0] {
        let mut offset = &units * 2.0 * sign;
        offset[1] *= -1.0;
        let start = truth.retract(&offset);
        let found = LeastSquares::levenberg_marquardt().fit(z, &start, None).unwrap();
        let error = truth.local(&found.pose).component_div(&units).amax();
        println!("{kind:?} {}: {error:.3} px", P::SPACE);
        assert!(error < kind.allowed(), "{kind:?} on {}: {error} px from {sign}", P::SPACE);
    }
}

#[test]
fn the_most_probable_pose_is_the_truth() {
    for kind in Kind::ALL {
        converges(kind, Vector::<2>(Vector2::new(100.3, 80.2)));
        converges(kind, TranslationScale::new(100.3, 80.2, 1.1));
        converges(kind, SE2::new(100.3, 80.2, 0.4));
        converges(kind, Sim2::new(100.3, 80.2, 0.4, 1.1));
    }
}

/// A place is a measurement of any motion, and says nothing about the rest of it.
#[test]
fn a_mass_centre_informs_about_the_place_alone() {
    let covariance = Matrix2::new(4.0, 1.0, 1.0, 2.0);
    let centre = Point2::new(101.0, 79.0);
    let z = CentreMeasurement::<Sim2>::new(PlanarWarp::default(), centre, covariance).unwrap();
    for pose in [Sim2::new(98.0, 83.0, 0.4, 1.3), Sim2::new(101.0, 79.0, -2.0, 0.7)] {
        check_measurement(&z, &pose, MeasurementTolerance::default());
    }
    let start = Sim2::new(90.0, 85.0, 0.4, 1.3);
    let found = LeastSquares::gauss_newton().fit(&z, &start, None).unwrap();
    assert!((found.pose.translation - centre.coords).norm() < 1e-6);
    assert!((found.pose.angle() - 0.4).abs() < 1e-9 && (found.pose.scale - 1.3).abs() < 1e-9);
    let plain = CentreMeasurement::<Vector<2>>::new(PlanarWarp::default(), centre, covariance).unwrap();
    let mut e = vt_core::measurement::NormalEquations::empty(&Vector::<2>(Vector2::zeros()));
    plain.normal_equations(&Vector::<2>(Vector2::zeros()), &mut e);
    assert!((e.information * covariance - Matrix2::identity()).amax() < 1e-12);
    assert!(CentreMeasurement::<Sim2>::new(PlanarWarp::default(), centre, Matrix2::zeros()).is_none());
}
