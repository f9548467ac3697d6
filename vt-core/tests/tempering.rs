//! Temperatures of measurements.

use nalgebra::Matrix3;
use vt_core::laws::{MeasurementTolerance, check_measurement, for_each, group};
use vt_core::lie::SE2;
use vt_core::measurement::{Measurement, Quality};
use vt_core::pose_measurement::PoseMeasurement;
use vt_core::tempering::{Tempered, effective_number, temperature_for};

#[test]
fn a_tempered_measurement_keeps_both_forms() {
    let information = Matrix3::new(4.0, 1.0, 0.0, 1.0, 9.0, 0.5, 0.0, 0.5, 2.0);
    let z = PoseMeasurement::new(SE2::new(0.1, -0.2, 0.3), information, Quality::default());
    let tempered = Tempered::new(&z, 4.0).expect("positive");
    for_each(group::<SE2>(0.5), |pose| {
        check_measurement(&tempered, &pose, MeasurementTolerance::default());
        let (mut whole, mut part) = ([0.0], [0.0]);
        z.log_likelihoods(&[pose], &mut whole);
        tempered.log_likelihoods(&[pose], &mut part);
        assert!((4.0 * part[0] - whole[0]).abs() < 1e-12);
        let (mut rows, mut scaled) = (vec![], vec![]);
        assert_eq!(z.normalized_residuals(&[pose], &mut rows), Some(3));
        assert_eq!(tempered.normalized_residuals(&[pose], &mut scaled), Some(3));
        assert!(rows.iter().zip(&scaled).all(|(a, b)| (a - 2.0 * b).abs() < 1e-12));
    });
    for none in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(Tempered::new(&z, none).is_none());
    }
}

#[test]
fn the_temperature_gives_the_wanted_effective_number() {
    let l: Vec<f64> = (0..200).map(|k| -0.5 * f64::from(k - 80) * f64::from(k - 80)).collect();
    assert!(effective_number(&l, 1.0) < 5.0);
    let temperature = temperature_for(&l, 0.4);
    assert!((effective_number(&l, temperature) - 80.0).abs() < 1e-3, "{temperature}");
    assert_eq!(temperature_for(&[0.0; 50], 0.9), 1.0);
    assert_eq!(temperature_for(&[f64::NEG_INFINITY; 3], 0.5), 1e6);
    assert_eq!(effective_number(&[], 1.0), 0.0);
}
