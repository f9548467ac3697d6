//! Points in time and signed spans between them. Nothing in this project assumes a frame rate.

use core::ops::{Add, Sub};

/// A point in time: nanoseconds since an epoch that all sensors of a run share, at the **middle of the exposure**.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Timestamp(pub i64);

/// A signed span of time in seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd)]
pub struct Seconds(pub f64);

impl Timestamp {
    /// The time `s` seconds after the epoch, rounded to a nanosecond.
    pub fn from_seconds(s: f64) -> Self {
        Self((s * 1e9).round() as i64)
    }

    /// Seconds since the epoch.
    pub fn seconds(self) -> f64 {
        self.0 as f64 * 1e-9
    }
}

impl Sub for Timestamp {
    type Output = Seconds;
    fn sub(self, earlier: Self) -> Seconds {
        Seconds(Self(self.0.saturating_sub(earlier.0)).seconds())
    }
}

impl Add<Seconds> for Timestamp {
    type Output = Self;
    fn add(self, span: Seconds) -> Self {
        Self(self.0.saturating_add(Self::from_seconds(span.0).0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_are_signed_and_do_not_overflow() {
        let a = Timestamp::from_seconds(1.5);
        assert_eq!((a - Timestamp(0)).0, 1.5);
        assert_eq!((Timestamp(0) - a).0, -1.5);
        assert_eq!(a + Seconds(-0.5), Timestamp(1_000_000_000));
        assert!((Timestamp(i64::MAX) - Timestamp(i64::MIN)).0.is_finite());
    }
}
