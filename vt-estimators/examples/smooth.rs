//! A slow walk measured roughly and with gaps: filtered and smoothed, drawn as `smooth.svg` in the current folder.

use std::error::Error;

use plotters::prelude::*;
use vt_core::agent::Estimator;
use vt_core::belief::{Gaussian, Moving};
use vt_core::dynamics::ConstantVelocity;
use vt_core::lie::Vector;
use vt_core::math;
use vt_core::measurement_model::{Instrument, Linear};
use vt_core::nalgebra::{Matrix1, Vector1};
use vt_core::random::{Random, Stream};
use vt_core::time::Seconds;
use vt_estimators::kalman::KalmanFilter;
use vt_estimators::smoother::Smoother;

type Line = Vector<1>;

fn main() -> Result<(), Box<dyn Error>> {
    let prior = Gaussian::from_sigmas(Vector(Vector1::new(0.0)), &Vector1::new(1.0));
    let motion = ConstantVelocity::new(Vector1::new(0.05))?;
    let filter = KalmanFilter::<Line, Moving<Line>, _>::new(&prior, vec![Vector1::new(1.0)], motion, 1)?;
    let mut smoother = Smoother::<Moving<Line>, _>::new(filter);
    let gauge = Instrument::<Line, _>::new(Linear(Matrix1::new(1.0)), Matrix1::new(0.25))?;
    let mut random = Random::new(2, Stream::Sim, 0, 0, 0);
    let truth = |t: f64| math::sin(0.5 * t) + 0.1 * t;
    let (mut times, mut seen, mut filtered) = (vec![0.0], vec![], vec![smoother.pose()]);
    for k in 1..=100 {
        let t = 0.2 * f64::from(k);
        smoother.predict(Seconds(0.2))?;
        if !(40..60).contains(&k) {
            let z = truth(t) + 0.5 * random.normal();
            smoother.correct(&gauge.read(Vector1::new(z))?)?;
            seen.push((t, z));
        }
        times.push(t);
        filtered.push(smoother.pose());
    }
    let band = |b: &Gaussian<Line>| (b.mean.0.x, b.covariance[(0, 0)].sqrt());
    let smoothed = smoother.smoothed()?;
    let smoothed: Vec<(f64, f64)> =
        smoothed.iter().map(|b| (b.mean.pose.0.x, b.covariance[(0, 0)].sqrt())).collect();
    let filtered: Vec<(f64, f64)> = filtered.iter().map(band).collect();
    let error = |track: &[(f64, f64)]| {
        let square = |(x, t): (&(f64, f64), &f64)| (x.0 - truth(*t)) * (x.0 - truth(*t));
        (track.iter().zip(&times).map(square).sum::<f64>() / times.len() as f64).sqrt()
    };
    println!(
        "root mean square error: filtered {:.3} m, smoothed {:.3} m",
        error(&filtered),
        error(&smoothed)
    );

    let area = SVGBackend::new("smooth.svg", (900, 500)).into_drawing_area();
    area.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&area)
        .margin(20)
        .x_label_area_size(40)
        .y_label_area_size(50)
        .build_cartesian_2d(0.0..20.0, -6.0..4.0)?;
    chart.configure_mesh().light_line_style(TRANSPARENT).x_desc("time / s").y_desc("place / m").draw()?;
    for (track, colour) in [(&filtered, RED), (&smoothed, BLUE)] {
        let edge = |side: f64| times.iter().zip(track.iter()).map(move |(t, (x, s))| (*t, x + side * s));
        let band: Vec<_> = edge(2.0).chain(edge(-2.0).collect::<Vec<_>>().into_iter().rev()).collect();
        chart.draw_series([Polygon::new(band, colour.mix(0.15))])?;
        chart.draw_series(LineSeries::new(edge(0.0), &colour))?;
    }
    chart.draw_series(seen.iter().map(|p| Circle::new(*p, 2, BLACK.mix(0.4).filled())))?;
    chart.draw_series(LineSeries::new(times.iter().map(|t| (*t, truth(*t))), BLACK.stroke_width(2)))?;
    area.present()?;
    println!("smooth.svg: truth black, filter red, smoother blue, bands of two deviations");
    Ok(())
}
