//! Adaptation of a reference to what is seen of the target, held by an anchor (paper §7; K. Nummiaro, E. Koller-Meier, L. Van
//! Gool, "An adaptive color-based particle filter", 2003).
//!
//! ```text
//! x ← (1 − a) x + a z,   a = 1 − exp(−Δt / τ)        what was seen of late
//! reference = w x₀ + (1 − w) x                        never less than w of what it was at the start
//! ```
//!
//! Without the anchor (`w = 0`) each step adds its own error to the reference, and the errors add up; with it the reference
//! stays within `1 − w` of the start, whatever was seen.

use vt_core::error::ConfigError;
use vt_core::math;
use vt_core::time::Timestamp;

/// How a reference follows what is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdaptationParams {
    /// Time constant τ in seconds.
    pub time: f64,
    /// Share `w` of the reference that stays as it was at the start, 0 to 1.
    pub anchor: f64,
}

impl Default for AdaptationParams {
    fn default() -> Self {
        Self { time: 1.0, anchor: 0.5 }
    }
}

impl AdaptationParams {
    /// Checks all ranges.
    ///
    /// # Errors
    /// [`ConfigError::Parameter`] with the first parameter that is out of its range.
    pub fn check(self) -> Result<Self, ConfigError> {
        if !(self.time > 0.0 && self.time.is_finite()) {
            return Err(ConfigError::parameter("adapt.time", self.time, "a positive time"));
        }
        if !(0.0..=1.0).contains(&self.anchor) {
            return Err(ConfigError::parameter("adapt.anchor", self.anchor, "a share from 0 to 1"));
        }
        Ok(self)
    }
}

/// Numbers that describe a target, as they were at the start and as they were seen of late.
#[derive(Clone, Debug)]
pub(crate) struct Adaptation {
    params: AdaptationParams,
    /// `x₀`; empty before the start.
    anchor: Vec<f64>,
    /// `x`.
    recent: Vec<f64>,
    /// `z`.
    seen: Vec<f64>,
    /// When something was seen last.
    last: Option<Timestamp>,
}

impl Adaptation {
    pub fn new(params: AdaptationParams) -> Self {
        Self { params, anchor: vec![], recent: vec![], seen: vec![], last: None }
    }

    /// Takes these numbers as the anchor, unless there is one.
    pub fn start(&mut self, reference: impl Iterator<Item = f64>) {
        if self.anchor.is_empty() {
            self.anchor.extend(reference);
            self.recent.clone_from(&self.anchor);
        }
    }

    /// Takes what is seen as the anchor.
    pub fn start_from_seen(&mut self) {
        self.anchor.clone_from(&self.seen);
        self.recent.clone_from(&self.seen);
    }

    /// Room for what is seen, empty.
    pub fn seen(&mut self) -> &mut Vec<f64> {
        self.seen.clear();
        &mut self.seen
    }

    /// Takes in what is seen at a time; the reference from here on.
    pub fn blend(&mut self, now: Timestamp) -> impl Iterator<Item = f64> {
        // Of the first time it is not known how long it lasted.
        let elapsed = self.last.map_or(0.0, |last| (now - last).0.max(0.0));
        self.last = Some(now);
        let a = 1.0 - math::exp(-elapsed / self.params.time);
        self.recent.iter_mut().zip(&self.seen).for_each(|(x, z)| *x += a * (z - *x));
        let w = self.params.anchor;
        self.anchor.iter().zip(&self.recent).map(move |(x0, x)| w * x0 + (1.0 - w) * x)
    }

    /// Forgets all that was seen and the anchor.
    pub fn forget(&mut self) {
        self.anchor.clear();
        self.last = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(seconds: f64) -> Timestamp {
        Timestamp((seconds * 1e9) as i64)
    }

    /// Sees `z` at these times and returns the reference.
    fn follow(params: AdaptationParams, x0: f64, z: f64, times: &[f64]) -> f64 {
        let mut a = Adaptation::new(params);
        a.start([x0].into_iter());
        let mut reference = f64::NAN;
        for &t in times {
            a.seen().push(z);
            reference = a.blend(at(t)).next().expect("one number");
        }
        reference
    }

    #[test]
    fn the_reference_approaches_what_is_seen_by_time_and_not_by_frames() {
        let params = AdaptationParams { time: 2.0, anchor: 0.25 };
        let exact = 3.0 + 0.75 * (5.0 - 3.0) * (1.0 - math::exp(-0.5));
        let (few, many): (Vec<f64>, Vec<f64>) =
            ((0..=2).map(|k| 0.5 * f64::from(k)).collect(), (0..=50).map(|k| 0.02 * f64::from(k)).collect());
        for times in [few, many] {
            assert!((follow(params, 3.0, 5.0, &times) - exact).abs() < 1e-9);
        }
    }

    #[test]
    fn the_anchor_holds_whatever_is_seen() {
        let times: Vec<f64> = (0..2000).map(f64::from).collect();
        let held = follow(AdaptationParams { time: 1.0, anchor: 0.4 }, 1.0, 0.0, &times);
        assert!((held - 0.4).abs() < 1e-12, "{held}");
        assert!(follow(AdaptationParams { time: 1.0, anchor: 0.0 }, 1.0, 0.0, &times) < 1e-12);
    }

    #[test]
    fn the_first_start_is_the_anchor_until_it_is_forgotten() {
        let mut a = Adaptation::new(AdaptationParams { anchor: 1.0, ..AdaptationParams::default() });
        for start in [1.0, 7.0] {
            a.start([start].into_iter());
            a.seen().push(4.0);
            assert!(a.blend(at(start)).eq([1.0]));
        }
        a.forget();
        a.start([7.0].into_iter());
        a.seen().push(4.0);
        assert!(a.blend(at(9.0)).eq([7.0]));
    }

    #[test]
    fn parameters_out_of_range_are_named() {
        let wrong = |time, anchor| AdaptationParams { time, anchor }.check().unwrap_err().to_string();
        assert!(wrong(0.0, 0.5).contains("time") && wrong(f64::NAN, 0.5).contains("time"));
        assert!(wrong(1.0, 1.1).contains("anchor") && wrong(1.0, f64::NAN).contains("anchor"));
        assert!(AdaptationParams::default().check().is_ok());
    }
}
