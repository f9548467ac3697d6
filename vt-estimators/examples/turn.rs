//! A target that turns, seen by bearing and range: two filters, drawn as `turn.svg` in the current folder.

use std::error::Error;

use plotters::prelude::*;
use vt_core::agent::{Dynamics, Estimator};
use vt_core::belief::Gaussian;
use vt_core::dynamics::CoordinatedTurn;
use vt_core::lie::Vector;
use vt_core::math;
use vt_core::measurement_model::{Angular, Function, Instrument};
use vt_core::nalgebra::{Matrix2, Vector2, Vector5};
use vt_core::random::{Random, Stream};
use vt_core::time::Seconds;
use vt_estimators::kalman::KalmanFilter;
use vt_estimators::sigma_point::{Rule, SigmaPointFilter};

type Turn = Vector<5>;

/// Points of the ellipse of two deviations about a mean.
fn ellipse(belief: &Gaussian<Turn>) -> Vec<(f64, f64)> {
    let p: Matrix2<f64> = belief.covariance.fixed_view::<2, 2>(0, 0).into_owned();
    let root = p.cholesky().map_or_else(Matrix2::zeros, |c| c.l());
    let point = |k: i32| {
        let (sin, cos) = math::sin_cos(f64::from(k) * 0.1 * core::f64::consts::PI);
        let d = root * Vector2::new(cos, sin) * 2.0;
        (belief.mean.0.x + d.x, belief.mean.0.y + d.y)
    };
    (0..=20).map(point).collect()
}

fn main() -> Result<(), Box<dyn Error>> {
    let motion = CoordinatedTurn::new(0.05, 0.002)?;
    let h = |s: &Turn| Vector2::new(math::atan2(s.0.y, s.0.x), math::hypot(s.0.x, s.0.y));
    let radar = Instrument::new(Angular::new(Function(h), [0]), Matrix2::new(4e-4, 0.0, 0.0, 0.25))?;
    let mut truth = Vector(Vector5::new(40.0, 10.0, 2.0, 3.0, 0.0));
    let start = Vector(Vector5::new(42.0, 8.0, 0.0, 0.0, 0.0));
    let prior = Gaussian::from_sigmas(start, &Vector5::new(3.0, 3.0, 3.0, 3.0, 0.2));
    let mut extended = KalmanFilter::<Turn, Turn, _>::from_belief(prior.clone(), motion)?;
    let mut unscented = SigmaPointFilter::<Turn, Turn, _>::from_belief(prior, motion, Rule::UNSCENTED)?;
    let mut random = Random::new(1, Stream::Sim, 0, 0, 0);
    let (mut truths, mut seen, mut tracks) = (vec![], vec![], [vec![], vec![]]);
    for k in 0..60 {
        truth.0[4] = if (15..45).contains(&k) { 0.15 } else { 0.0 };
        truth = motion.propagate(&truth, Seconds(0.7));
        let z = h(&truth) + Vector2::new(0.02 * random.normal(), 0.5 * random.normal());
        let reading = radar.read(z)?;
        extended.predict(Seconds(0.7))?;
        extended.update(&reading)?;
        unscented.predict(Seconds(0.7))?;
        unscented.update(&reading)?;
        truths.push((truth.0.x, truth.0.y));
        let (sin, cos) = math::sin_cos(z.x);
        seen.push((z.y * cos, z.y * sin));
        tracks[0].push(extended.pose());
        tracks[1].push(unscented.pose());
    }
    let error = |track: &[Gaussian<Turn>]| {
        let square =
            |(b, t): (&Gaussian<Turn>, &(f64, f64))| (b.mean.0.xy() - Vector2::new(t.0, t.1)).norm_squared();
        (track.iter().zip(&truths).map(square).sum::<f64>() / truths.len() as f64).sqrt()
    };
    println!(
        "root mean square error: extended {:.2} m, unscented {:.2} m",
        error(&tracks[0]),
        error(&tracks[1])
    );

    let points = || truths.iter().chain(&seen);
    let range = |axis: fn(&(f64, f64)) -> f64| {
        let (low, high) = points().map(axis).fold((f64::MAX, f64::MIN), |(a, b), v| (a.min(v), b.max(v)));
        low - 3.0..high + 3.0
    };
    let area = SVGBackend::new("turn.svg", (800, 700)).into_drawing_area();
    area.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&area)
        .margin(20)
        .x_label_area_size(40)
        .y_label_area_size(50)
        .build_cartesian_2d(range(|p| p.0), range(|p| p.1))?;
    chart.configure_mesh().light_line_style(TRANSPARENT).x_desc("x / m").y_desc("y / m").draw()?;
    chart.draw_series(seen.iter().map(|p| Circle::new(*p, 2, BLACK.mix(0.4).filled())))?;
    chart.draw_series(LineSeries::new(truths.clone(), BLACK.stroke_width(2)))?;
    for (track, colour) in tracks.iter().zip([RED, BLUE]) {
        chart.draw_series(LineSeries::new(track.iter().map(|b| (b.mean.0.x, b.mean.0.y)), &colour))?;
        for belief in track.iter().step_by(5) {
            chart.draw_series(LineSeries::new(ellipse(belief), colour.mix(0.5)))?;
        }
    }
    area.present()?;
    println!(
        "turn.svg: truth black, measurements grey, extended filter red, unscented blue, ellipses of two deviations"
    );
    Ok(())
}
