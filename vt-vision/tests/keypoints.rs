//! Keypoints and their matching allocate nothing once buffers have grown.

use std::alloc::System;

use image::{GrayImage, Luma};
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use vt_core::frame::Roi;
use vt_vision::matching::{MatchParams, Matcher};
use vt_vision::sift::{Sift, SiftParams};

#[global_allocator]
static HEAP: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

#[test]
fn nothing_is_allocated_after_the_first_frames() {
    let picture = |shift: u32| {
        GrayImage::from_fn(200, 160, |x, y| {
            let (u, v) = ((x + shift) / 5 % 29, y / 5 % 31);
            Luma([(40 + (u * u * 7 + v * v * 11 + u * v * 3) % 180) as u8])
        })
    };
    let pictures = [picture(0), picture(3)];
    let mut sifts = [(); 2].map(|()| Sift::new(SiftParams::default()).unwrap());
    let mut matcher = Matcher::default();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let roi = Some(Roi { x: 30, y: 20, width: 120, height: 100 });
    let mut count = 0;
    let mut frame = |roi| {
        for (sift, picture) in sifts.iter_mut().zip(&pictures) {
            sift.compute(picture, roi);
        }
        let [a, b] = &sifts;
        count = matcher.compute(a.descriptors(), b.descriptors(), &MatchParams::default()).len();
        count
    };
    let allocations = pool.install(|| {
        for _ in 0..3 {
            frame(None);
            frame(roi);
        }
        let region = Region::new(HEAP);
        frame(roi);
        assert!(frame(None) > 20);
        region.change().allocations
    });
    assert_eq!(allocations, 0);
}
