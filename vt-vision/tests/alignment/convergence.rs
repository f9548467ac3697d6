//! The protocol of S. Baker and I. Matthews (2004, §3.4): the four corners start away from the truth by normal numbers; how often do
//! they find back to within a pixel?

use vt_core::lie::SL3;
use vt_vision::alignment::{Aligner, AlignmentParams, Method, Similarity, Template};

use crate::scene::{SIZE, Waves, corners, distance, jitter, random, upright};

const TRIALS: u64 = 40;
const SIGMAS: [f64; 6] = [1.0, 2.0, 4.0, 6.0, 8.0, 10.0];

/// Share of the trials that converge, for all parameters and each deviation of the corners.
fn rates(all: &[AlignmentParams]) -> Vec<[f64; SIGMAS.len()]> {
    let mut found = vec![[0.0; SIGMAS.len()]; all.len()];
    for trial in 0..TRIALS {
        let waves = Waves::new(trial % 4);
        let truth: SL3 = upright();
        let reference = waves.draw(&truth, |v| v, 2.0, 1000 + trial);
        let picture = waves.draw(&truth, |v| v, 2.0, 2000 + trial);
        for (params, found) in all.iter().zip(&mut found) {
            let template = Template::new(*params, &reference, SIZE, &truth).expect("a template");
            let model = template.corners();
            let mut aligner = Aligner::new(template);
            for (sigma, found) in SIGMAS.into_iter().zip(found) {
                let mut random = random(trial, 3);
                let start = corners(&truth).map(|c| c + jitter(&mut random, sigma));
                let start = SL3::from_points(&model, &start).expect("corners of a homography");
                let aligned = aligner.align(&picture, &start);
                let close = aligned.is_ok_and(|a| distance(&a.pose, &truth) < 1.0);
                *found += f64::from(u8::from(close)) / TRIALS as f64;
            }
        }
    }
    found
}

/// Rates of convergence at deviations of 1, 2, 4, 6, 8 and 10 pixels; the template has 90 × 66.
#[test]
fn corners_find_back_from_several_pixels() {
    let mut all = vec![];
    for similarity in Similarity::ALL {
        for method in [Method::InverseCompositional, Method::Esm] {
            all.push(AlignmentParams { similarity, method, points: 1000, ..AlignmentParams::default() });
        }
    }
    for (params, rates) in all.iter().zip(rates(&all)) {
        let AlignmentParams { similarity, method, .. } = params;
        println!("{similarity:?} {method:?}: {rates:.2?}");
        let least = [1.0, 1.0, 0.95, 0.9, 0.8, 0.7];
        let enough = rates.iter().zip(least).all(|(r, least)| *r > least - 1e-9);
        assert!(enough, "{similarity:?} {method:?}: {rates:?}");
    }
}
