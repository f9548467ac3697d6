//! The protocol of S. Baker and I. Matthews (2004, §3.4): the four corners start away from the truth by normal numbers; how often do
//! they find back to within a pixel?

use vt_core::lie::SL3;
use vt_vision::alignment::{Aligner, AlignmentParams, Method, Similarity, Template};

use crate::scene::{Waves, corners, distance, jitter, random, upright};

const TRIALS: u64 = 40;
const SIGMAS: [f64; 6] = [1.0, 2.0, 4.0, 6.0, 8.0, 10.0];

/// Share of the trials that converge, for each deviation of the corners.
fn rates(params: AlignmentParams) -> [f64; 6] {
    SIGMAS.map(|sigma| {
        let mut found = 0;
        for trial in 0..TRIALS {
            let waves = Waves::new(trial % 4);
            let truth: SL3 = upright();
            let reference = waves.draw(&truth, |v| v, 2.0, 1000 + trial);
            let picture = waves.draw(&truth, |v| v, 2.0, 2000 + trial);
            let template = Template::new(params, &reference, crate::scene::SIZE, &truth).expect("a template");
            let mut random = random(trial, 3);
            let start = corners(&truth).map(|c| c + jitter(&mut random, sigma));
            // Corners of the model as the truth has them at the middle.
            let model = template.corners();
            let Some(start) = SL3::from_points(&model, &start) else { continue };
            let aligned = Aligner::new(template).align(&picture, &start);
            found += u32::from(aligned.is_ok_and(|a| distance(&a.pose, &truth) < 1.0));
        }
        f64::from(found) / TRIALS as f64
    })
}

#[test]
fn corners_find_back_from_several_pixels() {
    for similarity in Similarity::ALL {
        for method in [Method::InverseCompositional, Method::Esm] {
            let params = AlignmentParams { similarity, method, ..AlignmentParams::default() };
            let rates = rates(params);
            println!("{similarity:?} {method:?}: {rates:?}");
            assert!(rates[0] == 1.0 && rates[1] == 1.0, "{similarity:?} {method:?}: {rates:?}");
        }
    }
}
