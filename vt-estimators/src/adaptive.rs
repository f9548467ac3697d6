//! Noise that is learnt on the way: the normalised innovations of a window against χ² (R. Mehra, "On the identification of
//! variances and adaptive Kalman filtering", 1970; the factor by covariance matching).
//!
//! When the mean NIS of a full window leaves its χ² interval, the covariance of one of the two noises is scaled by the
//! ratio of the mean to its degrees of freedom, by at most 2 up or down, and a new window begins. Only one of them can be
//! told from the NIS alone: choose the one that is not known.

use nalgebra::DefaultAllocator;
use vt_core::agent::Estimator;
use vt_core::belief::{Gaussian, State};
use vt_core::error::{ConfigError, EstimateError};
use vt_core::manifold::{Alloc, Manifold};
use vt_core::measurement::{Level, Linearized, Measurement, NormalEquations, Quality};
use vt_core::metrics::Consistency;
use vt_core::report::Innovation;
use vt_core::time::Seconds;

use crate::gaussian_filter::GaussianFilter;

use core::marker::PhantomData;

/// Which noise is scaled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Noise {
    /// That of the motion: `Q`.
    Process,
    /// That of the measurements: `R`.
    Measurement,
}

/// Largest change of a window.
const STEP: f64 = 2.0;

/// The factor of a noise covariance, from windows of innovations.
#[derive(Clone, Debug)]
pub struct NoiseFactor {
    window: usize,
    confidence: f64,
    range: (f64, f64),
    record: Consistency,
    factor: f64,
}

impl NoiseFactor {
    /// Windows of so many innovations, left alone while their mean lies in the central interval of this probability; the
    /// factor stays in `range`.
    ///
    /// # Errors
    /// When the window is empty, the probability is not between 0 and 1, or the range does not hold 1.
    pub fn new(window: usize, confidence: f64, range: (f64, f64)) -> Result<Self, ConfigError> {
        if window == 0 {
            return Err(ConfigError::parameter("window", window, "at least 1"));
        }
        if !(confidence > 0.0 && confidence < 1.0) {
            return Err(ConfigError::parameter("confidence", confidence, "a number between 0 and 1"));
        }
        if !(range.0 > 0.0 && range.0 <= 1.0 && range.1 >= 1.0 && range.1.is_finite()) {
            let found = format!("{} to {}", range.0, range.1);
            return Err(ConfigError::parameter("range", found, "positive numbers around 1"));
        }
        Ok(Self { window, confidence, range, record: Consistency::default(), factor: 1.0 })
    }

    /// The factor that holds now.
    pub fn factor(&self) -> f64 {
        self.factor
    }

    /// Takes note of an innovation; true when the factor has changed.
    pub fn push(&mut self, innovation: &Innovation) -> bool {
        if innovation.dof > 0 {
            self.record.push(innovation.nis, innovation.dof);
        }
        if self.record.samples() < self.window {
            return false;
        }
        let record = core::mem::take(&mut self.record);
        if record.is_consistent(self.confidence) {
            return false;
        }
        let ratio = record.ratio().unwrap_or(1.0).clamp(1.0 / STEP, STEP);
        let before = self.factor;
        self.factor = (self.factor * ratio).clamp(self.range.0, self.range.1);
        self.factor != before
    }
}

/// A filter whose process or measurement noise follows its innovations.
#[derive(Clone)]
pub struct Adaptive<S, F> {
    filter: F,
    noise: Noise,
    factor: NoiseFactor,
    state: PhantomData<fn() -> S>,
}

impl<S, F> Adaptive<S, F> {
    /// A filter with one of its noises scaled.
    pub fn new(filter: F, noise: Noise, factor: NoiseFactor) -> Self {
        Self { filter, noise, factor, state: PhantomData }
    }

    /// The filter.
    pub fn filter(&self) -> &F {
        &self.filter
    }

    /// The factor that holds now.
    pub fn factor(&self) -> f64 {
        self.factor.factor()
    }
}

impl<P, S, F> Estimator<P> for Adaptive<S, F>
where
    P: Manifold,
    S: State<P>,
    F: GaussianFilter<P, S>,
    DefaultAllocator: Alloc<P::D> + Alloc<S::D>,
{
    fn predict(&mut self, dt: Seconds) -> Result<(), EstimateError> {
        self.filter.predict(dt)
    }

    fn correct(&mut self, z: &dyn Measurement<P>) -> Result<Innovation, EstimateError> {
        let innovation = match self.noise {
            Noise::Process => self.filter.correct(z)?,
            Noise::Measurement => self.filter.correct(&Scaled { z, factor: self.factor.factor() })?,
        };
        if self.factor.push(&innovation) && self.noise == Noise::Process {
            self.filter.scale_process_noise(self.factor.factor());
        }
        Ok(innovation)
    }

    fn pose(&self) -> Gaussian<P> {
        self.filter.pose()
    }

    fn reset(&mut self, prior: &Gaussian<P>) -> Result<(), EstimateError> {
        self.filter.reset(prior)
    }
}

/// A measurement with the covariance of its noise multiplied by a factor.
pub struct Scaled<'a, P: Manifold>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// The measurement.
    pub z: &'a dyn Measurement<P>,
    /// The factor, positive.
    pub factor: f64,
}

impl<P: Manifold> Measurement<P> for Scaled<'_, P>
where
    DefaultAllocator: Alloc<P::D>,
{
    fn fits(&self, at: &P) -> Result<(), EstimateError> {
        self.z.fits(at)
    }
    fn log_likelihoods(&self, poses: &[P], out: &mut [f64]) {
        self.z.log_likelihoods(poses, out);
        out.iter_mut().for_each(|l| *l /= self.factor);
    }
    fn importances(&self, poses: &[P], placed: &[usize], out: &mut [f64]) {
        self.z.importances(poses, placed, out);
        out.iter_mut().for_each(|l| *l /= self.factor);
    }
    fn residuals(&self, at: &P, out: &mut Linearized<P>) {
        self.z.residuals(at, out);
        out.variances.iter_mut().for_each(|v| *v *= self.factor);
    }
    fn normal_equations(&self, at: &P, out: &mut NormalEquations<P>) {
        self.z.normal_equations(at, out);
        out.information /= self.factor;
        out.gradient /= self.factor;
        out.cost /= self.factor;
    }
    fn normalized_residuals(&self, poses: &[P], out: &mut Vec<f64>) -> Option<usize> {
        let rows = self.z.normalized_residuals(poses, out)?;
        let scale = 1.0 / self.factor.sqrt();
        out.iter_mut().for_each(|r| *r *= scale);
        Some(rows)
    }
    fn quality(&self, at: &P) -> Quality {
        self.z.quality(at)
    }
    fn level(&self) -> Level {
        self.z.level()
    }
}
