//! Scenes keep what their settings promise.

use super::*;

fn quiet() -> Settings {
    Settings { noise: Noise { gaussian: 0.0, ..Noise::default() }, frames: 40, ..Settings::default() }
}

fn camera(settings: Settings) -> PlanarCamera {
    PlanarCamera::new(SensorId(0), Outline::rectangle(100.0, 60.0).unwrap(), settings).unwrap()
}

fn pictures(camera: &mut PlanarCamera) -> Vec<Frame> {
    std::iter::from_fn(|| camera.next().unwrap()).collect()
}

#[test]
fn the_shape_is_where_the_truth_says_and_brighter_than_all() {
    let mut camera = camera(quiet());
    let truth = camera.truth();
    let limit = 255.0 * background_levels(camera.settings())[LEVELS - 1] + 1.0;
    for frame in pictures(&mut camera) {
        let picture = frame.grey().unwrap();
        let inverse = truth[&frame.number].inverse();
        let mut share = 0.0;
        for (x, y, p) in picture.enumerate_pixels() {
            let at = inverse.act(&Point2::new(f64::from(x), f64::from(y)));
            let inside = (at.x.abs() - 50.0).max(at.y.abs() - 30.0) * truth[&frame.number].scale;
            if inside < -1.0 {
                assert_eq!(p.0[0], 225);
            } else if inside > 1.0 {
                assert!(f64::from(p.0[0]) <= limit, "{}", p.0[0]);
            }
            share += f64::from(u8::from(inside < 0.0));
        }
        let area = 6000.0 * truth[&frame.number].scale.powi(2);
        assert!((share - area).abs() < 100.0, "{share} {area}");
        let bounds = camera.bounds(frame.number).unwrap();
        assert!(bounds.x >= 2.0 && bounds.y + bounds.height <= 477.0);
        let corners = camera.corners(frame.number).unwrap();
        let left = corners.iter().map(|c| c.x).fold(f64::INFINITY, f64::min);
        assert!((left - bounds.x).abs() < 1e-9);
    }
}

#[test]
fn the_walk_has_its_deviations() {
    let poses: Vec<Sim2> = camera(Settings { frames: 5000, size: [2000, 2000], clutter: 0.0, ..quiet() })
        .truth()
        .into_values()
        .collect();
    let n = poses.len() as f64 - 1.0;
    let deviation = |f: &dyn Fn(&Sim2, &Sim2) -> f64| {
        (poses.windows(2).map(|w| f(&w[0], &w[1]).powi(2)).sum::<f64>() / n).sqrt()
    };
    let x = deviation(&|a, b| b.translation.x - a.translation.x);
    let turn = deviation(&|a, b| (a.rotation.inverse() * b.rotation).angle().to_degrees());
    let scale = deviation(&|a, b| math::ln(b.scale / a.scale));
    assert!(
        (x - 4.0).abs() < 0.2 && (turn - 2.0).abs() < 0.1 && (scale - 0.01).abs() < 5e-4,
        "{x} {turn} {scale}"
    );
}

#[test]
fn clutter_has_its_density() {
    // So many leaves that their number is no chance, and so few that hardly any is narrower than the borders beside it, which are not told apart here.
    for density in [0.015, 0.02, 0.03] {
        let mut edges = 0;
        let mut length = 0;
        for seed in 0..6 {
            let settings = Settings { clutter: density, seed, ..quiet() };
            let [w, h] = settings.size.map(|n| n as usize);
            let picture = dead_leaves([w, h], &settings, 0);
            let level = |x: usize, y: usize| 255.0 * picture[y * w + x][0];
            for y in (0..h).step_by(4) {
                // A border is in at most two pixels; what lies further on is the level behind it.
                let mut last = level(0, y);
                for x in 1..w - 1 {
                    let flat = (level(x, y) - level(x + 1, y)).abs() < 1.0;
                    if flat && (level(x, y) - last).abs() > 20.0 {
                        edges += 1;
                    }
                    if flat {
                        last = level(x, y);
                    }
                }
                length += w;
            }
        }
        let found = f64::from(edges) / length as f64;
        assert!((found / density - 1.0).abs() < 0.15, "{found} for {density}");
    }
}

#[test]
fn hidden_shapes_are_not_to_be_seen() {
    let mut camera = camera(Settings { occlusions: vec![[10, 14]], ..quiet() });
    for frame in pictures(&mut camera) {
        let centre = camera.truth()[&frame.number].translation;
        let middle = frame.grey().unwrap().get_pixel(centre.x as u32, centre.y as u32).0[0];
        assert_eq!(middle == 225, camera.visible(frame.number), "{}", frame.number);
    }
}

#[test]
fn a_seed_is_a_scene_at_any_number_of_threads() {
    let run = |threads, seed| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let colours =
                Settings { fill: Fill::Patches(3), colour: true, frames: 2, seed, ..Settings::default() };
            let frames = pictures(&mut camera(colours));
            frames.iter().flat_map(|f| f.rgb().unwrap().as_raw().clone()).collect::<Vec<u8>>()
        })
    };
    assert!(run(1, 3) == run(2, 3));
    assert!(run(1, 3) != run(1, 4));
}

#[test]
fn settings_are_checked() {
    let new =
        |settings| PlanarCamera::new(SensorId(0), Outline::rectangle(100.0, 60.0).unwrap(), settings).err();
    assert!(new(quiet()).is_none());
    for (settings, word) in [
        (Settings { contrast: 200.0, ..quiet() }, "contrast"),
        (Settings { clutter: f64::NAN, ..quiet() }, "clutter"),
        (Settings { size: [0, 480], ..quiet() }, "size"),
        (Settings { size: [80, 480], ..quiet() }, "fits"),
        (Settings { frames: 0, ..quiet() }, "frames"),
        (Settings { fill: Fill::Patches(0), ..quiet() }, "patches"),
    ] {
        let e = new(settings).expect("out of range").to_string();
        assert!(e.contains(word), "{e}");
    }
}

/// Pictures to look at: `cargo test -p vt-sim -- --ignored pictures_to_look_at`, in the folder for temporary files.
#[test]
#[ignore = "writes pictures"]
fn pictures_to_look_at() {
    let folder = std::env::temp_dir();
    let hidden = vec![[30, 39]];
    let plain = Settings { occlusions: hidden.clone(), ..Settings { frames: 40, ..Settings::default() } };
    let colours = Settings { fill: Fill::Patches(3), colour: true, ..plain.clone() };
    for (name, settings) in [("plain", plain), ("colours", colours)] {
        for frame in pictures(&mut camera(settings)).iter().step_by(15) {
            let (kind, bytes) = match &frame.payload {
                Payload::Rgb(p) => ("P6", p.as_raw()),
                _ => ("P5", frame.grey().unwrap().as_raw()),
            };
            let file = folder.join(format!("planar-{name}-{}.pnm", frame.number));
            std::fs::write(file, [format!("{kind} 640 480 255\n").as_bytes(), bytes].concat()).unwrap();
        }
    }
}
