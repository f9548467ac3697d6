//! Time of a simulated frame: `cargo run --release -p vt-sim --example frame_timing [FOLDER]`. With a folder, the middle
//! frame of each scene is written there as PGM.

use std::time::Instant;

use image::GrayImage;
use vt_sim::bodies::{house, stairs, tee, wedge};
use vt_sim::scenario::{Disturbance, Scenario};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::env::args().nth(1);
    let disturbances = [
        Disturbance::None,
        Disturbance::Occlusion,
        Disturbance::Blur,
        Disturbance::Clutter,
        Disturbance::Teleport,
        Disturbance::Light,
    ];
    for disturbance in disturbances {
        for (seed, body) in [house, stairs, wedge, tee].into_iter().enumerate() {
            let start = Instant::now();
            let scenario = Scenario::random(body(0.18), seed as u64, disturbance);
            let mut sensor = scenario.sensor(0).ok_or("a camera")?;
            let made = start.elapsed();
            let (mut count, mut seen) = (0, f64::INFINITY);
            let start = Instant::now();
            while let Some(shot) = sensor.shot() {
                count += 1;
                seen = seen.min(shot.visible[0]);
                if let (Some(folder), 30) = (&folder, shot.frame.number) {
                    save(&format!("{folder}/{disturbance:?}-{seed}.pgm"), shot.frame.grey()?)?;
                }
            }
            let each = start.elapsed() / count;
            println!("{disturbance:?} {seed}: scene {made:.1?}, frame {each:.2?}, least visible {seen:.2}");
        }
    }
    Ok(())
}

fn save(path: &str, picture: &GrayImage) -> std::io::Result<()> {
    let mut bytes = format!("P5 {} {} 255\n", picture.width(), picture.height()).into_bytes();
    bytes.extend_from_slice(picture);
    std::fs::write(path, bytes)
}
