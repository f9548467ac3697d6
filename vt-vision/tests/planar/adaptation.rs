//! What is known of the looks follows what is seen, held by its anchor.

use image::RgbImage;
use vt_core::belief::Gaussian;
use vt_core::evidence::Evidence;
use vt_core::lie::TranslationScale;
use vt_core::measurement::Modality;
use vt_core::time::Timestamp;
use vt_models::warp::PlanarWarp;
use vt_vision::adaptation::AdaptationParams;
use vt_vision::color_likelihood::{ColorModality, ColorParams};
use vt_vision::template::{TemplateModality, TemplateParams};

use crate::scene::{SENSOR, draw, prior, show_at};

type Pose = TranslationScale;

const SIZE: [f64; 2] = [60.0, 50.0];

fn start() -> Gaussian<Pose> {
    prior(Pose::new(100.0, 80.0, 1.0), 1.0)
}

/// The picture in another light, which shifts hues and turns the contrast of some colours.
fn relit(image: &RgbImage) -> RgbImage {
    let mut out = image.clone();
    out.pixels_mut().for_each(|p| p.0 = [p.0[2], p.0[0], p.0[1] / 2]);
    out
}

/// A modality with the evidence that it reads.
struct Watched(Box<dyn Modality<Pose>>, Evidence);

impl Watched {
    fn color(adapt: Option<AdaptationParams>) -> Self {
        let params = ColorParams { rows: 2, samples: 10_000, adapt, ..ColorParams::default() };
        let modality = ColorModality::new(params, SENSOR, PlanarWarp::default(), SIZE).unwrap();
        let mut evidence = Evidence::default();
        evidence.add(Box::new(modality.processing()));
        Self(Box::new(modality), evidence)
    }

    fn template(adapt: Option<AdaptationParams>) -> Self {
        let params = TemplateParams { adapt, ..TemplateParams::default() };
        let modality = TemplateModality::new(params, SENSOR, PlanarWarp::default(), SIZE).unwrap();
        Self(Box::new(modality), Evidence::default())
    }

    /// Looks at a picture at a time and says how well the start fits.
    fn look(&mut self, image: &RgbImage, seconds: f64) -> f64 {
        show_at(&mut self.1, image.clone(), Timestamp((seconds * 1e9) as i64));
        for key in self.0.needs().to_vec() {
            self.1.prepare(&key, None).unwrap();
        }
        let mut fit = [0.0];
        let z = self.0.measure(&self.1, &start()).unwrap().expect("in view");
        z.log_likelihoods(&[start().mean], &mut fit);
        fit[0]
    }

    fn adapt(&mut self, pose: &Gaussian<Pose>) {
        self.0.adapt(&self.1, pose).unwrap();
    }
}

const FAST: AdaptationParams = AdaptationParams { time: 0.1, anchor: 0.3 };

#[test]
fn an_adapted_reference_fits_what_is_seen_and_still_fits_the_start() {
    let (before, after) = (draw(&start().mean), relit(&draw(&start().mean)));
    for make in [Watched::color, Watched::template] {
        let (mut fixed, mut held, mut loose) =
            (make(None), make(Some(FAST)), make(Some(AdaptationParams { anchor: 0.0, ..FAST })));
        let mut all = [&mut fixed, &mut held, &mut loose];
        for watched in &mut all {
            assert!(watched.look(&before, 0.0) > -0.01);
            watched.adapt(&start());
            for k in 1..40 {
                watched.look(&after, 0.04 * f64::from(k));
                watched.adapt(&start());
            }
        }
        let [new, old] = [&after, &before].map(|image| all.each_mut().map(|w| w.look(image, 2.0)));
        // The new looks: unknown without adaptation, best known without an anchor.
        assert!(new[0] + 1.0 < new[1] && new[1] < new[2] && new[2] > -0.01, "{new:?}");
        // The old looks: forgotten without an anchor.
        assert!(old[0] > -0.01 && old[1] > old[2] + 1.0, "{old:?}");
    }
}

#[test]
fn what_was_trusted_survives_a_loss_and_no_placement() {
    let (before, after) = (draw(&start().mean), relit(&draw(&start().mean)));
    for make in [Watched::color, Watched::template] {
        let mut watched = make(Some(FAST));
        let first = [&before, &after].map(|image| watched.look(image, 0.0));
        for k in 0..20 {
            watched.look(&after, 0.04 * f64::from(k));
            watched.adapt(&start());
        }
        let adapted = watched.look(&after, 1.0);
        assert!(adapted > first[1] + 1.0);
        watched.0.revert();
        assert_eq!(watched.look(&after, 1.0), adapted);
        watched.0.forget();
        assert!(watched.look(&after, 1.1) > -0.01, "learnt anew");
        // What was never trusted goes with a loss, too.
        watched.0.revert();
        assert!(watched.look(&before, 1.2) > -0.01);
    }
}

#[test]
fn what_is_not_all_in_the_picture_teaches_nothing() {
    let (before, after) = (draw(&start().mean), relit(&draw(&start().mean)));
    for make in [Watched::color, Watched::template] {
        let mut watched = make(Some(FAST));
        watched.look(&before, 0.0);
        watched.adapt(&start());
        let first = watched.look(&after, 0.1);
        for k in 0..20 {
            watched.look(&after, 0.04 * f64::from(k));
            watched.adapt(&prior(Pose::new(10.0, 80.0, 1.0), 1.0));
        }
        assert!((watched.look(&after, 1.0) - first).abs() < 1e-9);
        let broken = Gaussian { mean: Pose::new(f64::NAN, 0.0, 1.0), ..start() };
        assert!(watched.0.adapt(&watched.1, &broken).is_err());
    }
}
