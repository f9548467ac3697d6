//! A scene forth and back again and again: what adapts is where it was, and without an anchor it is not.

use std::path::Path;

use vt_core::lie::picture_from_plane;
use vt_task::assembly::Scene;
use vt_task::{Document, Registry, check};
use vt_tests::flat::Patch;

const FRAMES: usize = 30;
const ROUNDS: usize = 16;
/// Of scenes and filters.
const SEEDS: [u64; 5] = [1, 2, 3, 4, 5];

fn task(anchor: f64, seed: u64) -> String {
    let adapt = format!(r#"adapt = {{ time = "10 ms", anchor = {anchor:?} }}"#);
    let modalities = format!(
        r#"
    {{ kind = "color", level = "pixel", sensor = "camera", params = {{ rows = 2, {adapt} }} }},
    {{ kind = "template", level = "pixel", sensor = "camera", params = {{ {adapt} }} }},
"#
    );
    Patch {
        seed,
        frames: FRAMES,
        scene: "colours = 4",
        warp: "translation-scale",
        noise: r#"{ translation = "20 px/s^0.5", scale = "3 %/s^0.5" }"#,
        modalities: &modalities,
        estimator: r#"{ kind = "particle", params = { particles = 100 } }"#,
        start: r#"{ picture_from_object = { translation = ["119.5 px", "89.5 px"] }, sigma = { translation = "1 px", scale = "1 %" } }"#,
    }
    .task()
}

/// Distance in pixels of the place in the first frame as it was found at first from that of each later round, root mean square.
fn drift(anchor: f64, seed: u64) -> f64 {
    let registry = Registry::standard();
    let document =
        Document::parse("drift", &task(anchor, seed), Path::new(""), &[], &|_| None).expect("a text");
    let task = check(&document, &registry).expect("a task");
    let mut scene = Scene::build(&document, &task, &registry).expect("a scene");
    let mut frames = vec![];
    while let Some(frame) = scene.sensors[0].next().expect("a frame") {
        frames.push(frame);
    }
    let mut tracker = scene.tracking(&document, &task, &registry, &frames[..1]).expect("a tracker");
    let step = frames[1].time.0 - frames[0].time.0;
    let period = 2 * FRAMES - 2;
    let mut places = vec![];
    for k in 0..=ROUNDS * period {
        let mut frame = frames[(k % period).min(period - k % period)].clone();
        (frame.number, frame.time.0) = (k as u64, frames[0].time.0 + k as i64 * step);
        let report = &tracker.step([frame]).expect("a step")[0];
        assert_eq!(report.failure, None);
        if k % period == 0 {
            let m = picture_from_plane(&report.posterior).expect("a pose");
            places.push(nalgebra::Vector2::new(m.m13, m.m23));
        }
    }
    assert_eq!(places.len(), ROUNDS + 1);
    let squares = places[1..].iter().map(|p| (p - places[0]).norm_squared());
    (squares.sum::<f64>() / ROUNDS as f64).sqrt()
}

#[test]
fn an_anchor_keeps_adaptation_from_drifting() {
    let [held, loose] = [0.5, 0.0].map(|anchor| SEEDS.map(|seed| drift(anchor, seed)));
    println!("in {ROUNDS} rounds, pixels: with the anchor {held:.2?}, without {loose:.2?}");
    let mean = |drifts: &[f64]| drifts.iter().sum::<f64>() / drifts.len() as f64;
    assert!(mean(&held) < 1.0 && held.iter().all(|d| *d < 2.0), "{held:?}");
    assert!(mean(&loose) > 3.0 * mean(&held), "{loose:?} without, {held:?} with the anchor");
}
