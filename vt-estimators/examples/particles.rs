//! A walk along a wall in the dark, past two doors: particles over time, drawn as `particles.svg` in the current folder.

use std::error::Error;

use plotters::prelude::*;
use vt_core::agent::Estimator;
use vt_core::belief::Gaussian;
use vt_core::dynamics::Brownian;
use vt_core::lie::Vector;
use vt_core::math;
use vt_core::measurement::{Level, Linearized, Measurement, NormalEquations, Quality};
use vt_core::nalgebra::Vector1;
use vt_core::time::Seconds;
use vt_estimators::particle::{ParticleFilter, ParticleParams};

const DOORS: [f64; 2] = [2.0, 7.0];

/// Whether a door was felt, within some 30 cm.
struct Felt(bool);

impl Measurement<Vector<1>> for Felt {
    fn log_likelihoods(&self, poses: &[Vector<1>], out: &mut [f64]) {
        for (pose, l) in poses.iter().zip(out) {
            let [a, b] = DOORS.map(|door| {
                let d = (pose.0.x - door) / 0.3;
                math::exp(-0.5 * d * d)
            });
            let p = 0.05 + 0.9 * a.max(b);
            *l = math::ln(if self.0 { p } else { 1.0 - p });
        }
    }
    fn residuals(&self, _: &Vector<1>, out: &mut Linearized<Vector<1>>) {
        out.clear();
    }
    fn normal_equations(&self, _: &Vector<1>, out: &mut NormalEquations<Vector<1>>) {
        out.clear();
    }
    fn quality(&self, _: &Vector<1>) -> Quality {
        Quality::default()
    }
    fn level(&self) -> Level {
        Level::Pixel
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    // Nothing is known of the steps but that they are of some 20 cm.
    let lost = Gaussian::from_sigmas(Vector(Vector1::new(4.5)), &Vector1::new(3.0));
    let steps = Brownian::new(Vector1::new(0.2))?;
    let params = ParticleParams { count: 1000, ..ParticleParams::default() };
    let mut filter = ParticleFilter::<Vector<1>, Vector<1>, _>::new(&lost, vec![], steps, params)?;
    let (mut cloud, mut truth, mut modes) = (vec![], vec![], vec![]);
    for k in 0..=50 {
        let (time, place) = (0.2 * f64::from(k), 1.5 + 0.12 * f64::from(k));
        if k > 0 {
            filter.predict(Seconds(0.2))?;
        }
        filter.correct(&Felt(DOORS.iter().any(|door| (place - door).abs() < 0.3)))?;
        let (states, weights) = filter.states();
        let heaviest = weights.iter().copied().fold(0.0, f64::max);
        let each = states.iter().zip(weights).step_by(4);
        cloud.extend(each.map(|(x, w)| (time, x.0.x, w / heaviest)));
        truth.push((time, place));
        modes.push((time, filter.mode().0.x));
    }
    let (pose, place) = (filter.pose(), truth[50].1);
    println!(
        "at the end: {:.2} ± {:.2} m in the mean of two modes, most likely {:.2} m, truth {place:.2} m",
        pose.mean.0.x,
        pose.covariance[(0, 0)].sqrt(),
        filter.mode().0.x
    );

    let area = SVGBackend::new("particles.svg", (900, 500)).into_drawing_area();
    area.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&area)
        .margin(20)
        .x_label_area_size(30)
        .y_label_area_size(40)
        .build_cartesian_2d(0.0..10.0, -4.0..13.0)?;
    chart.configure_mesh().light_line_style(TRANSPARENT).x_desc("time / s").y_desc("place / m").draw()?;
    for door in DOORS {
        chart.draw_series(LineSeries::new([(0.0, door), (10.0, door)], GREEN.mix(0.5).stroke_width(8)))?;
    }
    let dot = |&(t, x, w): &(f64, f64, f64)| Circle::new((t, x), 1, BLUE.mix(0.05 + 0.5 * w).filled());
    chart.draw_series(cloud.iter().map(dot))?;
    chart.draw_series(LineSeries::new(truth, BLACK.stroke_width(2)))?;
    chart.draw_series(modes.iter().map(|m| Cross::new(*m, 3, RED)))?;
    area.present()?;
    println!("particles.svg: particles blue, doors green, truth black, mode red");
    Ok(())
}
