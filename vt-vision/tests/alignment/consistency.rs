//! Whether covariances are honest: normalised squared errors of many pictures with noise.

use std::sync::Arc;

use nalgebra::{DefaultAllocator, Dim};
use vt_core::lie::{Affine2, PlanarMotion, SL3, Sim2, Vector};
use vt_core::manifold::Alloc;
use vt_core::metrics::Consistency;
use vt_vision::alignment::{Aligner, AlignmentParams, Method, Similarity, Template};

use crate::scene::{SIZE, Waves, random, upright};

/// Mean NEES per degree of freedom for each of the parameters.
fn ratios<P: PlanarMotion>(all: &[AlignmentParams], noise: f64, trials: u64) -> Vec<f64>
where
    DefaultAllocator: Alloc<P::D>,
{
    let mut records = vec![Consistency::default(); all.len()];
    for trial in 0..trials {
        let waves = Waves::new(trial % 8);
        let base: P = upright();
        let mut random = random(trial, 4);
        let mut normal = |s: f64| s * random.normal();
        let motion = Sim2::new(79.3 + normal(1.5), 59.6 + normal(1.5), normal(0.02), 1.0 + normal(0.01));
        let truth = P::of(&motion);
        let reference = waves.draw(&base, |v| v, noise, 3000 + trial);
        let picture = waves.draw(&truth, |v| v, noise, 4000 + trial);
        for (params, record) in all.iter().zip(&mut records) {
            let template = Arc::new(Template::new(*params, &reference, SIZE, &base).expect("a template"));
            let found = Aligner::new(template).align(&picture, &base).expect("aligned");
            record.push(found.belief().nees(&truth).expect("regular"), truth.dim().value());
        }
    }
    records.iter().map(|r| r.ratio().expect("trials")).collect()
}

/// The squared errors of 40 pictures are in the mean what the covariances say; a tenth more or less is chance (two tenths for
/// translations), and the seeds are fixed.
fn holds(noise: f64) {
    let mut all = vec![];
    for similarity in Similarity::ALL {
        for method in [Method::InverseCompositional, Method::Esm] {
            all.push(AlignmentParams { similarity, method, points: 1000, ..AlignmentParams::default() });
        }
    }
    let of = [
        ratios::<Vector<2>>(&all, noise, 40),
        ratios::<Sim2>(&all, noise, 40),
        ratios::<Affine2>(&all, noise, 40),
        ratios::<SL3>(&all, noise, 40),
    ];
    for (k, p) in all.iter().enumerate() {
        let ratios = of.each_ref().map(|v| v[k]);
        println!("{:?} {:?}, noise {noise}: {ratios:.2?}", p.similarity, p.method);
        assert!(ratios.iter().all(|r| (0.7..1.4).contains(r)), "{p:?} {ratios:?}");
    }
}

#[test]
fn covariances_are_those_of_the_errors_under_little_noise() {
    holds(4.0);
}

#[test]
fn covariances_are_those_of_the_errors_under_much_noise() {
    holds(10.0);
}
