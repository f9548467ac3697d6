//! Once its buffers have grown, an alignment takes no memory. Alone in its program, since the counter sees all threads.

use std::alloc::System;

use image::GrayImage;
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use vt_core::lie::SL3;
use vt_core::robust::Robust;
use vt_vision::alignment::{Aligner, AlignmentParams, Method, Similarity, Template};

#[path = "alignment/scene.rs"]
#[allow(dead_code, reason = "part of another program's scene")]
mod scene;

#[global_allocator]
static HEAP: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

#[test]
fn aligning_allocates_nothing_after_the_first_pictures() {
    let waves = scene::Waves::new(1);
    let start: SL3 = scene::upright();
    let poses: Vec<SL3> = (0..6)
        .map(|k| {
            let mut moved = start;
            moved.matrix[(0, 2)] += 2.0 * f64::from(k);
            moved
        })
        .collect();
    let pictures: Vec<GrayImage> = poses.iter().map(|p| waves.draw(p, |v| v, 1.0, 3)).collect();
    for similarity in Similarity::ALL {
        for method in [Method::InverseCompositional, Method::Esm] {
            let robust = (!similarity.is_information()).then_some(Robust::HUBER);
            let params = AlignmentParams { similarity, method, robust, ..AlignmentParams::default() };
            let template = Template::new(params, &pictures[0], scene::SIZE, &start).expect("a template");
            let mut aligner = Aligner::new(template);
            let mut pass = || {
                let mut pose = start;
                for (picture, truth) in pictures.iter().zip(&poses) {
                    pose = aligner.align(picture, &pose).expect("aligned").pose;
                    assert!(scene::distance(&pose, truth) < 0.2);
                }
            };
            pass();
            let region = Region::new(HEAP);
            pass();
            let change = region.change();
            let count = change.allocations + change.reallocations;
            assert_eq!(count, 0, "{similarity:?} {method:?}: {change:?}");
        }
    }
}
