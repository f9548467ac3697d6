//! Likelihoods of flat targets with something to measure: a coloured ellipse before coloured tiles, at 640 × 480.

use std::sync::Arc;

use image::{Rgb, RgbImage};
use nalgebra::{Point2, Vector4};
use vt_core::belief::Gaussian;
use vt_core::evidence::{Evidence, Processing};
use vt_core::frame::{Frame, Payload, SensorId};
use vt_core::lie::{LieGroup, Sim2};
use vt_core::manifold::Manifold;
use vt_core::measurement::Modality;
use vt_core::random::{Random, Stream};
use vt_core::time::Timestamp;
use vt_models::outline::Outline;
use vt_models::warp::PlanarWarp;
use vt_vision::canny::{CannyParams, Thresholds};
use vt_vision::color_likelihood::{ColorModality, ColorParams};
use vt_vision::contour::{ChamferModality, ChamferParams, ContourModality, ContourParams};
use vt_vision::template::{TemplateModality, TemplateParams};

const SENSOR: SensorId = SensorId(0);

/// The picture, and what its processing units found in it.
pub struct PlanarScene {
    /// Coloured tiles with an ellipse of other tiles in the middle, and noise.
    pub picture: Arc<RgbImage>,
    /// Evidence of all modalities.
    pub evidence: Evidence,
    /// Where the object is thought to be: the truth, 6 px, 0.05 rad and 3 %.
    pub prior: Gaussian<Sim2>,
}

/// A modality of the scene.
pub type Flat = Box<dyn Modality<Sim2>>;

impl PlanarScene {
    /// The scene and the modalities with their names.
    ///
    /// # Errors
    /// When a modality refuses its parameters or a processing unit fails.
    pub fn new() -> anyhow::Result<(Self, Vec<(&'static str, Flat)>)> {
        let truth = Sim2::new(320.0, 240.0, 0.2, 1.0);
        let picture = Arc::new(picture(&truth, &Outline::ellipse(60.0, 60.0)?));
        let canny = CannyParams::new(Thresholds::Fixed { low: 12.5, high: 37.5 })?;
        let hand = Outline::ellipse(110.0, 150.0)?.sample(60);
        let warp = PlanarWarp::default;
        let params = ContourParams { sigma: 3.0, range: 15.0, ..ContourParams::default() };
        let contour = ContourModality::new(params, canny.clone(), SENSOR, warp(), hand.clone())?;
        let chamfer = ChamferModality::new(ChamferParams::default(), canny, SENSOR, warp(), hand)?;
        let color = |samples| {
            let params = ColorParams { samples, ..ColorParams::default() };
            ColorModality::new(params, SENSOR, warp(), [60.0, 60.0])
        };
        let (coarse, fine) = (color(400)?, color(4000)?);
        let template = TemplateModality::new(TemplateParams::default(), SENSOR, warp(), [60.0, 60.0])?;
        let mut evidence = Evidence::default();
        let units: [Box<dyn Processing>; 3] =
            [Box::new(contour.processing()), Box::new(chamfer.processing()), Box::new(coarse.processing())];
        let keys = units.each_ref().map(|unit| unit.key().clone());
        units.into_iter().for_each(|unit| evidence.add(unit));
        let payload = Payload::Rgb(picture.clone());
        evidence.begin([Frame { sensor: SENSOR, number: 0, time: Timestamp(0), payload }]);
        for key in &keys {
            evidence.prepare(key, None)?;
        }
        let modalities: Vec<(&'static str, Flat)> = vec![
            ("contour, 60 normals", Box::new(contour)),
            ("chamfer, 60 points", Box::new(chamfer)),
            ("colour, 60x60 px, 110 bins, 400 samples", Box::new(coarse)),
            ("colour, 60x60 px, 110 bins, every pixel", Box::new(fine)),
            ("template, 400 samples", Box::new(template)),
        ];
        let prior = Gaussian::from_sigmas(truth, &Vector4::new(6.0, 6.0, 0.05, 0.03));
        Ok((Self { picture, evidence, prior }, modalities))
    }

    /// Poses drawn from the prior.
    pub fn particles(&self, count: usize) -> Vec<Sim2> {
        let mut random = Random::new(2, Stream::Sim, 0, 0, 0);
        let sigma = self.prior.covariance.diagonal().map(f64::sqrt);
        let mut draw = || self.prior.mean.retract(&sigma.map(|s| s * random.normal()));
        (0..count).map(|_| draw()).collect()
    }
}

/// Coloured tiles with an ellipse of other tiles in the middle, and noise.
fn picture(pose: &Sim2, outline: &Outline) -> RgbImage {
    let mut random = Random::new(1, Stream::Sim, 0, 0, 0);
    let inverse = pose.inverse();
    RgbImage::from_fn(640, 480, |x, y| {
        let place = Point2::new(f64::from(x), f64::from(y));
        let p = inverse.act(&place);
        let (tile, base) = if outline.contains(&p) {
            ((p.x / 9.0).floor() as i64 * 3 + (p.y / 9.0).floor() as i64, 120)
        } else {
            (i64::from(x / 23) * 7 + i64::from(y / 19) * 5, 30)
        };
        let mut level =
            |k: i64| base + (tile * (k + 2) * 29).rem_euclid(100) + (random.uniform() * 12.0) as i64;
        Rgb([level(0) as u8, level(1) as u8, level(2) as u8])
    })
}
