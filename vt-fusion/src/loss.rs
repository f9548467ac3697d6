//! Loss detection: is the estimate still that of the target? (paper §6; FIELD.md §2.19, "loss test set")

use nalgebra::Vector6;
use vt_core::agent::LossDetector;
use vt_core::math;
use vt_core::report::{Assessment, Status, Verdict};

/// Turns a per-step probability into a condition that does not flicker.
#[derive(Clone, Copy, Debug)]
pub struct Hysteresis {
    /// Steps in a row, each more likely a loss than not, after which the target counts as lost.
    pub on: u32,
    /// Steps in a row, each more likely none, after which a lost target counts as lost no longer.
    pub off: u32,
    /// Probability of a loss above which a step is doubtful.
    pub doubt: f64,
    bad: u32,
    good: u32,
    status: Status,
}

impl Default for Hysteresis {
    fn default() -> Self {
        Self::new(3, 5)
    }
}

impl Hysteresis {
    /// Lost after `on` bad steps in a row, no longer after `off` good ones; bad steps are doubtful.
    pub fn new(on: u32, off: u32) -> Self {
        Self { on, off, doubt: 0.5, bad: 0, good: 0, status: Status::Tracking }
    }

    /// Steps are doubtful above the probability `doubt` of a loss.
    #[must_use]
    pub fn doubtful_above(self, doubt: f64) -> Self {
        Self { doubt, ..self }
    }

    /// Takes in the probability of one step.
    pub fn step(&mut self, loss_probability: f64) -> Status {
        (self.bad, self.good) = if loss_probability > 0.5 {
            (self.bad.saturating_add(1), 0)
        } else {
            (0, self.good.saturating_add(1))
        };
        let lost = self.bad >= self.on || self.status == Status::Lost && self.good < self.off;
        self.status = match lost {
            true => Status::Lost,
            false if loss_probability > self.doubt => Status::Doubtful,
            false => Status::Tracking,
        };
        self.status
    }

    /// Starts again as tracked.
    pub fn reset(&mut self) {
        *self = Self::new(self.on, self.off).doubtful_above(self.doubt);
    }
}

/// Signs of loss in the figures of one step: what the model below weighs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LossSigns {
    /// Share of contour (pixels, matches) that is not supported: `1 − inlier ratio`.
    pub unsupported: f64,
    /// Mean log-likelihood ratio against clutter, in nats.
    pub log_ratio: f64,
    /// Normalised root mean square of the inliers, 3 at most.
    pub misfit: f64,
    /// `ln(1 + NIS / dof)`: surprise of the measurement.
    pub surprise: f64,
    /// Scaled log-determinant of the covariance per degree of freedom, from −20 to 20.
    pub spread: f64,
}

impl LossSigns {
    /// The signs of a step; `None` when it had no measurement.
    pub fn new(figures: &Assessment) -> Option<Self> {
        let q = figures.quality.filter(|q| q.expected > 0)?;
        let innovation = figures.innovation.filter(|i| i.dof > 0);
        Some(Self {
            unsupported: 1.0 - q.inlier_ratio,
            log_ratio: q.log_ratio,
            misfit: q.normalized_rms.min(3.0),
            surprise: innovation.map_or(0.0, |i| math::ln_1p(i.nis / i.dof as f64)),
            spread: spread(figures),
        })
    }
}

/// Deviations of a rigid pose against which the default [`LossWeights`] expect the spread to be judged: of the position 2 % of the
/// body's `diameter` in metres, of the orientation 1 deg in radians, in tangent order.
pub fn tolerated(diameter: f64) -> Vector6<f64> {
    Vector6::from_fn(|k, _| if k < 3 { 0.02 * diameter } else { 1f64.to_radians() })
}

fn spread(figures: &Assessment) -> f64 {
    figures.log_det.unwrap_or(0.0).clamp(-20.0, 20.0)
}

/// Weights of the logistic model `p = 1 / (1 + exp(−(bias + Σ w x)))` over [`LossSigns`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LossWeights {
    /// Constant.
    pub bias: f64,
    /// Of [`LossSigns::unsupported`].
    pub unsupported: f64,
    /// Of [`LossSigns::log_ratio`].
    pub log_ratio: f64,
    /// Of [`LossSigns::misfit`].
    pub misfit: f64,
    /// Of [`LossSigns::surprise`].
    pub surprise: f64,
    /// Of [`LossSigns::spread`].
    pub spread: f64,
    /// Least log-odds that one step can tell, negative: how much a good step vouches for those after it.
    pub least: f64,
}

impl Default for LossWeights {
    /// Fitted to the edge tracker on simulated scenes (`docs/loss.md`), where the spread is judged against
    /// [`tolerated`]. Unsupported contour adds nothing to the likelihood ratio there;
    /// its weight is for evidence without one.
    fn default() -> Self {
        Self {
            bias: 5.3,
            unsupported: 0.0,
            log_ratio: -1.2,
            misfit: 0.2,
            surprise: 1.4,
            spread: 1.3,
            least: -4.4,
        }
    }
}

impl LossWeights {
    /// Log-odds of a loss.
    pub fn log_odds(&self, x: &LossSigns) -> f64 {
        self.bias
            + self.unsupported * x.unsupported
            + self.log_ratio * x.log_ratio
            + self.misfit * x.misfit
            + self.surprise * x.surprise
            + self.spread * x.spread
    }
}

/// Several signs of loss in one logistic model, with a memory of the steps before and hysteresis.
#[derive(Clone, Copy, Debug)]
pub struct FusedLoss {
    weights: LossWeights,
    memory: f64,
    hysteresis: Hysteresis,
    /// Log-odds of a loss so far.
    log_odds: Option<f64>,
}

/// Largest log-odds that one step can tell: what comes next must be able to outweigh it soon.
const MOST: f64 = 8.0;

impl Default for FusedLoss {
    fn default() -> Self {
        Self::new(LossWeights::default(), Self::MEMORY, Hysteresis::default().doubtful_above(Self::DOUBT))
    }
}

impl FusedLoss {
    /// Share of the log-odds that the default keeps from step to step.
    pub const MEMORY: f64 = 0.5;

    /// Probability of a loss above which a step of the default is doubtful: a wrong pose that looks right and says that it is certain
    /// is seldom likelier than not.
    pub const DOUBT: f64 = 0.2;

    /// A detector with these weights and this hysteresis, which keeps the share `memory` (0 to 1) of its log-odds from
    /// step to step.
    pub fn new(weights: LossWeights, memory: f64, hysteresis: Hysteresis) -> Self {
        Self { weights, memory: memory.clamp(0.0, 1.0), hysteresis, log_odds: None }
    }

    /// Log-odds of a loss from one step's figures alone. A step without a measurement is as likely a loss as not:
    /// it says nothing about the target, and the spread of the prediction grows by itself.
    pub fn log_odds(&self, figures: &Assessment) -> f64 {
        let x = match LossSigns::new(figures) {
            Some(signs) => self.weights.log_odds(&signs),
            None => 0.1 + spread(figures).max(0.0),
        };
        if x.is_nan() { MOST } else { x.max(self.weights.least).min(MOST) }
    }
}

impl LossDetector for FusedLoss {
    fn assess(&mut self, figures: &Assessment) -> Verdict {
        let new = self.log_odds(figures);
        // The steps before do not vouch for a target that is not seen.
        let old = self.log_odds.filter(|_| LossSigns::new(figures).is_some());
        let log_odds = old.map_or(new, |old| self.memory * old + (1.0 - self.memory) * new);
        self.log_odds = Some(log_odds);
        let loss_probability = math::logistic(log_odds);
        Verdict { status: self.hysteresis.step(loss_probability), loss_probability }
    }

    fn reset(&mut self) {
        self.log_odds = None;
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
            log_ratio: 5.0 * inlier_ratio,
            normalized_rms: 0.5,
        };
        let innovation = Innovation { nis, dof: 6, ..Innovation::default() };
        Assessment { quality: Some(quality), innovation: Some(innovation), log_det: Some(-3.0) }
    }

    #[test]
    fn log_odds_fall_with_support_and_grow_with_surprise() {
        let d = FusedLoss::default();
        assert!(d.log_odds(&figures(0.9, 6.0)) < -1.0);
        assert!(d.log_odds(&figures(0.1, 600.0)) > 1.0);
        assert!(d.log_odds(&figures(0.7, 600.0)) > d.log_odds(&figures(0.7, 6.0)));
        assert!(d.log_odds(&Assessment::default()) > 0.0);
        assert_eq!(d.log_odds(&figures(f64::NAN, 6.0)), MOST);
    }

    #[test]
    fn one_bad_step_among_good_ones_is_no_loss_but_several_are() {
        let (good, bad) = (figures(0.95, 6.0), figures(0.0, 1e9));
        let mut d = FusedLoss::default();
        let mut status = |f: &Assessment| d.assess(f).status;
        for _ in 0..5 {
            assert_eq!(status(&good), Status::Tracking);
        }
        assert_ne!(status(&bad), Status::Lost);
        assert_ne!(status(&good), Status::Lost);
        for _ in 0..3 {
            assert_eq!(status(&good), Status::Tracking);
        }
        let delay = (0..10).position(|_| status(&bad) == Status::Lost);
        assert!(delay.is_some_and(|d| d <= 3), "{delay:?}");
        d.reset();
        assert_eq!(d.assess(&good).status, Status::Tracking);
    }

    #[test]
    fn without_memory_a_verdict_depends_on_its_step_alone() {
        let mut d = FusedLoss::new(LossWeights::default(), 0.0, Hysteresis::default());
        d.assess(&figures(0.0, 1e9));
        let f = figures(0.8, 6.0);
        assert_eq!(d.assess(&f).loss_probability, math::logistic(d.log_odds(&f)));
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
    fn doubt_begins_before_a_loss_is_likely() {
        let mut h = Hysteresis::new(2, 2).doubtful_above(0.1);
        let seen: Vec<Status> = [0.1, 0.2, 0.6, 0.2, 0.7, 0.8, 0.2, 0.2, 0.05].map(|p| h.step(p)).to_vec();
        use Status::{Doubtful as D, Lost as L, Tracking as T};
        assert_eq!(seen, [T, D, D, D, D, L, L, D, T]);
        h.reset();
        assert_eq!((h.step(0.2), h.step(0.05)), (D, T));
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
