//! Peakedness of likelihoods under control: temperatures.
//!
//! A likelihood of many correlated rows is narrower than what is known, and one particle takes all the weight. Its
//! logarithm divided by a temperature `τ > 1` is flatter; a product of measurements may give each its own. What to look at is the
//! effective number of particles, [`effective_particles`](crate::report::Innovation::effective_particles), and [`temperature_for`] says
//! which temperature gives a wanted one.

use nalgebra::DefaultAllocator;

use crate::manifold::{Alloc, Manifold};
use crate::math;
use crate::measurement::{Level, Linearized, Measurement, NormalEquations, Quality};

/// A measurement at a temperature: `P(z|p)^(1/τ)`. Products are stacks of these.
pub struct Tempered<'a, P: Manifold>
where
    DefaultAllocator: Alloc<P::D>,
{
    measurement: &'a dyn Measurement<P>,
    inverse: f64,
}

impl<'a, P: Manifold> Tempered<'a, P>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// `measurement` at a positive temperature; `None` for any other.
    pub fn new(measurement: &'a dyn Measurement<P>, temperature: f64) -> Option<Self> {
        let positive = temperature > 0.0 && temperature.is_finite();
        positive.then(|| Self { measurement, inverse: 1.0 / temperature })
    }
}

impl<P: Manifold> Measurement<P> for Tempered<'_, P>
where
    DefaultAllocator: Alloc<P::D>,
{
    fn log_likelihoods(&self, poses: &[P], out: &mut [f64]) {
        self.measurement.log_likelihoods(poses, out);
        out.iter_mut().for_each(|l| *l *= self.inverse);
    }

    fn importances(&self, poses: &[P], placed: &[usize], out: &mut [f64]) {
        self.measurement.importances(poses, placed, out);
        out.iter_mut().for_each(|l| *l *= self.inverse);
    }

    fn residuals(&self, at: &P, out: &mut Linearized<P>) {
        self.measurement.residuals(at, out);
        out.variances.iter_mut().for_each(|v| *v /= self.inverse);
    }

    fn normal_equations(&self, at: &P, out: &mut NormalEquations<P>) {
        self.measurement.normal_equations(at, out);
        out.information *= self.inverse;
        out.gradient *= self.inverse;
        out.cost *= self.inverse;
    }

    fn normalized_residuals(&self, poses: &[P], out: &mut Vec<f64>) -> Option<usize> {
        let rows = self.measurement.normalized_residuals(poses, out)?;
        let root = self.inverse.sqrt();
        out.iter_mut().for_each(|r| *r *= root);
        Some(rows)
    }

    /// Of the measurement itself: a temperature says how much it counts, not how well it fits.
    fn quality(&self, at: &P) -> Quality {
        self.measurement.quality(at)
    }

    fn level(&self) -> Level {
        self.measurement.level()
    }
}

/// Effective number `(Σ w)² / Σ w²` of particles with these log-likelihoods at a temperature, from equal weights.
pub fn effective_number(log_likelihoods: &[f64], temperature: f64) -> f64 {
    let most = log_likelihoods.iter().fold(f64::NEG_INFINITY, |a, &b| a.max(b));
    if !most.is_finite() {
        return 0.0;
    }
    let (mut sum, mut squares) = (0.0, 0.0);
    for l in log_likelihoods {
        let w = math::exp((l - most) / temperature);
        sum += w;
        squares += w * w;
    }
    sum * sum / squares
}

/// The least temperature, not below 1, at which the effective number is at least this share of all particles; bounded by
/// 1e6, for shares that no temperature reaches.
pub fn temperature_for(log_likelihoods: &[f64], share: f64) -> f64 {
    let wanted = share * log_likelihoods.len() as f64;
    let (mut low, mut high) = (1.0, 1e6);
    if effective_number(log_likelihoods, low) >= wanted {
        return low;
    }
    // The effective number grows with the temperature.
    for _ in 0..60 {
        let middle = f64::sqrt(low * high);
        if effective_number(log_likelihoods, middle) >= wanted { high = middle } else { low = middle }
    }
    high
}
