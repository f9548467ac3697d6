//! Processing units: nothing is allocated per frame, and no picture or region makes one panic.

use std::alloc::System;
use std::sync::Arc;

use image::{GrayImage, Luma, Rgb, RgbImage};
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use vt_core::error::MeasureError;
use vt_core::evidence::{Evidence, Processing, Slot};
use vt_core::frame::{Frame, Payload, Roi, SensorId};
use vt_core::time::Timestamp;
use vt_vision::blobs::{BlobDetector, BlobParams};
use vt_vision::canny::{Canny, CannyEvidence, CannyParams, CannyProcessing, Thresholds};
use vt_vision::color::{HsvProcessing, HueRange};
use vt_vision::distance_transform::EdgeDistanceProcessing;
use vt_vision::edge_map::EdgeMapProcessing;
use vt_vision::gradient::GradientProcessing;
use vt_vision::histogram::{BinningParams, ColorBinsProcessing};
use vt_vision::integral::IntegralProcessing;
use vt_vision::motion::{
    Compared, Motion, MotionGradient, MotionParams, MotionProcessing, MotionSegmentation,
};
use vt_vision::pyramid::PyramidProcessing;
use vt_vision::segments::{SegmentDetector, SegmentParams};

#[global_allocator]
static HEAP: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

const SENSOR: SensorId = SensorId(0);

fn units() -> Vec<Box<dyn Processing>> {
    let fixed = CannyParams::new(Thresholds::Fixed { low: 5.0, high: 12.0 }).unwrap();
    let share = CannyParams::new(Thresholds::Share { below: 0.9, ratio: 0.4, least: 2.0 }).unwrap();
    let motion = MotionParams::default();
    vec![
        Box::new(HsvProcessing::new(SENSOR, HueRange::Half)),
        Box::new(ColorBinsProcessing::new(SENSOR, BinningParams::default().check().unwrap())),
        Box::new(CannyProcessing::new(SENSOR, CannyParams { color: true, ..fixed.clone() })),
        Box::new(CannyProcessing::new(SENSOR, CannyParams { blur: None, ..share.clone() })),
        Box::new(EdgeDistanceProcessing::new(SENSOR, share)),
        Box::new(IntegralProcessing::new(SENSOR)),
        Box::new(MotionProcessing::new(SENSOR, motion)),
        Box::new(MotionProcessing::new(SENSOR, MotionParams { compared: Compared::Two, ..motion })),
        Box::new(GradientProcessing::new(SENSOR)),
        Box::new(EdgeMapProcessing::new(SENSOR, 5.0)),
        Box::new(PyramidProcessing::new(SENSOR, 2)),
    ]
}

/// Ten pictures a second of a disc that comes back every five.
fn frame(k: u32, size: (u32, u32), color: bool) -> Frame {
    let level = |x: u32, y: u32| {
        let disc = x.abs_diff(20 + 3 * (k % 5)).pow(2) + y.abs_diff(25).pow(2) < 150;
        if disc { 200 } else { 60 + ((x * 5 + y * 3 + x * y) % 23) as u8 }
    };
    let payload = if color {
        let pixel = |x, y| Rgb([level(x, y), level(y, x), (x * 3) as u8]);
        Payload::Rgb(Arc::new(RgbImage::from_fn(size.0, size.1, pixel)))
    } else {
        Payload::Grey(Arc::new(GrayImage::from_fn(size.0, size.1, |x, y| Luma([level(x, y)]))))
    };
    Frame { sensor: SENSOR, number: k.into(), time: Timestamp(100_000_000 * i64::from(k)), payload }
}

#[test]
fn units_are_frugal_and_robust() {
    no_allocation_after_ten_frames();
    any_picture_and_any_region();
}

fn no_allocation_after_ten_frames() {
    let mut evidence = Evidence::default();
    // Those that take colour pictures; the others have a test of their own.
    let keys: Vec<_> = units().iter().take(8).map(|u| u.key().clone()).collect();
    units().into_iter().take(8).for_each(|u| evidence.add(u));
    let (mut blobs, mut segments) = (BlobDetector::default(), SegmentDetector::default());
    let (mut gradient, mut motions) = (MotionGradient::default(), MotionSegmentation::default());
    let frames: Vec<Frame> = (0..40).map(|k| frame(k, (90, 70), true)).collect();
    let mut counts = Vec::with_capacity(frames.len());
    for frame in frames {
        let region = Region::new(HEAP);
        evidence.begin([frame]);
        for key in &keys {
            evidence.prepare(key, None).unwrap();
        }
        let canny = evidence.get::<CannyEvidence>(&keys[2]).unwrap().edges.now();
        segments.detect(canny, &SegmentParams::default());
        let motion = evidence.get::<Motion>(&keys[6]).unwrap();
        blobs.detect(motion.mask(), &BlobParams::default());
        gradient.compute(motion.history(), None, 0.01, 0.4);
        motions.compute(motion.history(), 0.05, 5);
        let change = region.change();
        counts.push(change.allocations + change.reallocations);
    }
    assert!(counts[0] > 0, "the counter does not count");
    assert!(counts[10..].iter().all(|&n| n == 0), "{counts:?}");
}

fn any_picture_and_any_region() {
    let mut k = 0;
    for unit in units() {
        let mut slot = Slot::default();
        for size in [(0, 0), (1, 1), (2, 9), (9, 2), (3, 3), (4, 5), (5, 5), (40, 33), (6, 0), (33, 40)] {
            for roi in [
                None,
                Some(Roi { x: 0, y: 0, width: 0, height: 0 }),
                Some(Roi { x: 2, y: 1, width: 3, height: 3 }),
                Some(Roi { x: 30, y: 30, width: u32::MAX, height: u32::MAX }),
                Some(Roi { x: u32::MAX, y: u32::MAX, width: u32::MAX, height: 1 }),
            ] {
                for color in [false, true] {
                    k += 1;
                    let outcome = unit.run(&frame(k, size, color), roi, &mut slot);
                    assert!(matches!(outcome, Ok(()) | Err(MeasureError::Payload { .. })));
                }
            }
        }
        let vector = Frame { payload: Payload::Vector(vec![1.0]), ..frame(k, (1, 1), false) };
        let error = unit.run(&vector, None, &mut slot).unwrap_err();
        assert!(matches!(error, MeasureError::Payload { .. }));
    }
    assert_eq!(Canny::default().edges().count(), 0);
}
