//! Loss detection: is the estimate still that of the target? (paper §6; FIELD.md §2.19, "loss test set")

use vt_core::agent::LossDetector;
use vt_core::math;
use vt_core::report::{Assessment, Status, Verdict};

/// Turns a per-step probability of loss into a condition that does not flicker.
#[derive(Clone, Copy, Debug)]
pub struct Hysteresis {
    /// Doubtful steps in a row after which the target counts as lost.
    pub on: u32,
    /// Good steps in a row after which a doubtful or lost target counts as tracked again.
    pub off: u32,
    doubtful: u32,
    good: u32,
    status: Status,
}

impl Default for Hysteresis {
    fn default() -> Self {
        Self::new(3, 5)
    }
}

impl Hysteresis {
    /// Lost after `on` doubtful steps in a row, tracked again after `off` good ones.
    pub fn new(on: u32, off: u32) -> Self {
        Self { on, off, doubtful: 0, good: 0, status: Status::Tracking }
    }

    /// Takes in the probability of one step.
    pub fn step(&mut self, loss_probability: f64) -> Status {
        if loss_probability > 0.5 {
            self.doubtful += 1;
            self.good = 0;
            if self.doubtful >= self.on {
                self.status = Status::Lost;
            } else if self.status == Status::Tracking {
                self.status = Status::Doubtful;
            }
        } else {
            self.good += 1;
            self.doubtful = 0;
            let needed = if self.status == Status::Lost { self.off } else { 1 };
            if self.good >= needed {
                self.status = Status::Tracking;
            }
        }
        self.status
    }

    /// Starts again as tracked.
    pub fn reset(&mut self) {
        *self = Self::new(self.on, self.off);
    }
}

/// Weights of the logistic model `p = 1 / (1 + exp(−(bias + Σ w x)))` over the figures of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LossWeights {
    /// Constant.
    pub bias: f64,
    /// Of the share of contour (pixels, matches) that is not supported: `1 − inlier ratio`.
    pub unsupported: f64,
    /// Of the mean log-likelihood ratio against clutter, in nats.
    pub log_ratio: f64,
    /// Of `ln(1 + NIS / dof)`: surprise of the measurement.
    pub surprise: f64,
    /// Of the scaled log-determinant of the covariance per degree of freedom, above zero.
    pub spread: f64,
}

impl Default for LossWeights {
    /// An expert's prior: half of the contour unsupported or a covariance ten times the design deviation is doubtful.
    fn default() -> Self {
        Self { bias: -5.0, unsupported: 10.0, log_ratio: -0.25, surprise: 0.4, spread: 1.0 }
    }
}

/// Several signs of loss in one logistic model, with hysteresis.
#[derive(Clone, Copy, Debug, Default)]
pub struct FusedLoss {
    weights: LossWeights,
    hysteresis: Hysteresis,
}

impl FusedLoss {
    /// A detector with these weights and this hysteresis.
    pub fn new(weights: LossWeights, hysteresis: Hysteresis) -> Self {
        Self { weights, hysteresis }
    }

    /// Probability of loss from one step's figures alone. A step without a measurement is as likely a loss as not:
    /// it says nothing about the target, and the spread of the prediction grows by itself.
    pub fn probability(&self, figures: &Assessment) -> f64 {
        let w = &self.weights;
        let spread = w.spread * figures.log_det.unwrap_or(0.0).max(0.0);
        let Some(q) = figures.quality.filter(|q| q.expected > 0) else {
            return math::logistic(0.1 + spread);
        };
        let surprise =
            figures.innovation.filter(|i| i.dof > 0).map_or(0.0, |i| math::ln_1p(i.nis / i.dof as f64));
        let x = w.bias
            + w.unsupported * (1.0 - q.inlier_ratio)
            + w.log_ratio * q.log_ratio
            + w.surprise * surprise
            + spread;
        if x.is_nan() { 1.0 } else { math::logistic(x) }
    }
}

impl LossDetector for FusedLoss {
    fn assess(&mut self, figures: &Assessment) -> Verdict {
        let loss_probability = self.probability(figures);
        Verdict { status: self.hysteresis.step(loss_probability), loss_probability }
    }

    fn reset(&mut self) {
        self.hysteresis.reset();
    }
}

/// Side of the threshold on which a covariance test fires.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// Lost when the spread is above the threshold: a lost filter spreads.
    Above,
    /// Lost when it is below: the paper's literal text, `det(Σ) < d`. Fires on the best estimates.
    Below,
}

/// The paper's test alone: scaled log-determinant of the pose covariance per degree of freedom.
#[derive(Clone, Copy, Debug)]
pub struct CovarianceLoss {
    /// `ln` of the squared ratio between the spread and its design value at which the target counts as lost.
    pub threshold: f64,
    /// Side that fires.
    pub direction: Direction,
    /// Memory.
    pub hysteresis: Hysteresis,
}

impl LossDetector for CovarianceLoss {
    fn assess(&mut self, figures: &Assessment) -> Verdict {
        let loss_probability = match figures.log_det {
            None => 1.0,
            Some(v) if self.direction == Direction::Above => math::logistic(v - self.threshold),
            Some(v) => math::logistic(self.threshold - v),
        };
        Verdict { status: self.hysteresis.step(loss_probability), loss_probability }
    }

    fn reset(&mut self) {
        self.hysteresis.reset();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vt_core::measurement::Quality;
    use vt_core::report::Innovation;

    fn figures(inlier_ratio: f64, nis: f64) -> Assessment {
        let quality = Quality {
            expected: 100,
            inliers: 0,
            inlier_ratio,
            log_ratio: 4.0 * inlier_ratio,
            normalized_rms: 1.0,
        };
        let innovation = Innovation { nis, dof: 6, ..Innovation::default() };
        Assessment { quality: Some(quality), innovation: Some(innovation), log_det: Some(-3.0) }
    }

    #[test]
    fn probability_falls_with_support_and_grows_with_surprise() {
        let d = FusedLoss::default();
        assert!(d.probability(&figures(0.9, 6.0)) < 0.05);
        assert!(d.probability(&figures(0.3, 6.0)) > 0.5);
        assert!(d.probability(&figures(0.7, 600.0)) > d.probability(&figures(0.7, 6.0)));
        assert!(d.probability(&Assessment::default()) > 0.5);
        assert_eq!(d.probability(&figures(f64::NAN, 6.0)), 1.0);
    }

    #[test]
    fn status_changes_after_three_doubtful_and_five_good_steps() {
        let mut h = Hysteresis::new(3, 5);
        let seen: Vec<Status> =
            [0.1, 0.9, 0.1, 0.9, 0.9, 0.9, 0.1, 0.1, 0.1, 0.1, 0.1].map(|p| h.step(p)).to_vec();
        use Status::{Doubtful as D, Lost as L, Tracking as T};
        assert_eq!(seen, [T, D, T, D, D, L, L, L, L, L, T]);
    }

    #[test]
    fn the_literal_covariance_test_fires_on_the_other_side() {
        let make =
            |direction| CovarianceLoss { threshold: 2.0, direction, hysteresis: Hysteresis::new(1, 1) };
        let wide = Assessment { log_det: Some(5.0), ..Assessment::default() };
        assert_eq!(make(Direction::Above).assess(&wide).status, Status::Lost);
        assert_eq!(make(Direction::Below).assess(&wide).status, Status::Tracking);
    }
}
