//! Real videos as sensors.

use vt_core::agent::Sensor;
use vt_core::frame::SensorId;
use vt_io::images::Conversion;
use vt_io::video::{Settings, Video};

/// Every frame of two videos arrives, at its time.
#[test]
fn real_videos_are_read_from_first_to_last() {
    let Some(data) = vt_tests::data::root("VT_DATA") else { return };
    let cases = [
        ("face/franck.mp4", [360, 288], 4800, 24.0, Conversion::Grey),
        ("pets/View_001.mp4", [768, 576], 795, 30.0, Conversion::Rgb),
    ];
    for (name, size, count, rate, conversion) in cases {
        let settings = Settings { conversion, ..Settings::default() };
        let mut video = Video::open(SensorId(0), &data.join(name), settings).unwrap();
        assert_eq!((video.size(), video.remaining()), (size, Some(count)), "{name}");
        let mut frames = 0;
        while let Some(frame) = video.next().unwrap() {
            assert_eq!(frame.number, frames);
            assert!((frame.time.seconds() - frames as f64 / rate).abs() < 1e-5, "{name}: frame {frames}");
            frames += 1;
        }
        assert_eq!(frames as usize, count, "{name}");
    }
}
