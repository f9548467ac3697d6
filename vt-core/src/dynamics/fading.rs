//! Integrals of `exp(−t/τ)` over a step, by series where `Δ/τ` is small.

use crate::math;

/// With `u = Δ/τ` and `E = exp(−u)`; at `u = 0` the limits `1, 1, 1/2, 1/12`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fading {
    /// `E`.
    pub end: f64,
    /// `(1 − E)/u`: share of the mean velocity that an acceleration brings per time.
    pub mean: f64,
    /// `(u − 1 + E)/u²`: displacement by an acceleration, per time squared.
    pub path: f64,
    /// `(1/Δ³) ∫ (t − Δ/2) v(t) dt` of the velocity by a unit acceleration: how late the displacement comes.
    pub late: f64,
}

impl Fading {
    pub fn new(u: f64) -> Self {
        if u.abs() < 0.5 {
            // Coefficients (−1)^j/(j+1)!, (−1)^j/(j+2)!, (−1)^j (j+1)/(2 (j+3)!).
            let (mut mean, mut path, mut late) = (0.0, 0.0, 0.0);
            let (mut power, mut factorial) = (1.0, 1.0);
            for j in 0..16 {
                let j = f64::from(j);
                factorial *= j + 1.0;
                mean += power / factorial;
                path += power / (factorial * (j + 2.0));
                late += 0.5 * (j + 1.0) * power / (factorial * (j + 2.0) * (j + 3.0));
                power *= -u;
            }
            return Self { end: 1.0 - u * mean, mean, path, late };
        }
        let end = math::exp(-u);
        let gone = 1.0 - end;
        let late = gone / (2.0 * u * u) - (gone - end * u) / (u * u * u);
        Self { end, mean: gone / u, path: (u - gone) / (u * u), late }
    }
}
