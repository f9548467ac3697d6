//! M-estimators: costs that outliers cannot dominate, and the scale that they need.
//!
//! For a residual `r` in units of its scale, `ρ(r)` is the cost, `ψ = ρ'` the influence and `w = ψ / r` the weight of
//! iteratively reweighted least squares.
//!
//! | kind | `ρ(r)` | `w(r)` | `ψ` at infinity | 95 % constant |
//! |---|---|---|---|---|
//! | [`Robust::Square`] | `r²/2` | `1` | grows | – |
//! | [`Robust::Huber`] | `r²/2`, beyond `k`: `k·abs(r) - k²/2` | `min(1, k/abs(r))` | `k` | 1.345 |
//! | [`Robust::StudentT`] | `(ν+1)/2 · ln(1 + r²/ν)` | `(ν+1)/(ν+r²)` | → 0 as `1/r` | – |
//! | [`Robust::Cauchy`] | `c²/2 · ln(1 + r²/c²)` | `1/(1 + r²/c²)` | → 0 as `1/r` | 2.385 |
//! | [`Robust::GemanMcClure`] | `c²/2 · r²/(c² + r²)` | `1/(1 + r²/c²)²` | → 0 as `1/r³` | 3.787 |
//! | [`Robust::Welsch`] | `c²/2 · (1 - exp(-r²/c²))` | `exp(-r²/c²)` | → 0 fast | 2.985 |
//! | [`Robust::Tukey`] | `c²/6 · (1 - (1 - r²/c²)³)`, beyond `c`: `c²/6` | `(1 - r²/c²)²`, beyond: 0 | 0 | 4.685 |
//!
//! The constants give 95 % efficiency on normal residuals of unit deviation. Only Square and Huber are convex: the
//! others need a start near the solution (Tukey after a Huber start). The Student-t weight is the likelihood's own
//! and reaches `(ν+1)/ν > 1` at zero. Sources: P. Huber, E. Ronchetti, "Robust Statistics", 2009; P. Holland,
//! R. Welsch, "Robust regression using iteratively reweighted least-squares", 1977; the Geman–McClure constant is
//! computed in the tests.

use crate::error::ConfigError;
use crate::math;

/// An M-estimator with its constant in units of the residual's scale; see the [table](self).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Robust {
    /// Least squares.
    Square,
    /// Huber with bend `k`.
    Huber(f64),
    /// Likelihood of Student's t with `ν` degrees of freedom.
    StudentT(f64),
    /// Cauchy (Lorentz) with half-weight point `c`.
    Cauchy(f64),
    /// Geman–McClure with quarter-weight point `c`.
    GemanMcClure(f64),
    /// Welsch (Leclerc) with `c`.
    Welsch(f64),
    /// Tukey's biweight, zero beyond `c`.
    Tukey(f64),
}

impl Robust {
    /// Huber with 95 % efficiency.
    pub const HUBER: Self = Self::Huber(1.345);
    /// Cauchy with 95 % efficiency.
    pub const CAUCHY: Self = Self::Cauchy(2.385);
    /// Geman–McClure with 95 % efficiency.
    pub const GEMAN_MCCLURE: Self = Self::GemanMcClure(3.787);
    /// Welsch with 95 % efficiency.
    pub const WELSCH: Self = Self::Welsch(2.985);
    /// Tukey with 95 % efficiency.
    pub const TUKEY: Self = Self::Tukey(4.685);

    /// This estimator, if its constant is positive and finite.
    ///
    /// # Errors
    /// When it is not.
    pub fn checked(self) -> Result<Self, ConfigError> {
        match self {
            Self::Square => Ok(self),
            Self::Huber(c)
            | Self::StudentT(c)
            | Self::Cauchy(c)
            | Self::GemanMcClure(c)
            | Self::Welsch(c)
            | Self::Tukey(c) => {
                if c > 0.0 && c.is_finite() {
                    Ok(self)
                } else {
                    Err(ConfigError::parameter("robust constant", c, "a positive number"))
                }
            }
        }
    }

    /// Cost `ρ(r)`, zero at zero.
    pub fn rho(self, r: f64) -> f64 {
        let s = r * r;
        match self {
            Self::Square => 0.5 * s,
            Self::Huber(k) if r.abs() <= k => 0.5 * s,
            Self::Huber(k) => k * (r.abs() - 0.5 * k),
            Self::StudentT(nu) => 0.5 * (nu + 1.0) * math::ln_1p(s / nu),
            Self::Cauchy(c) => 0.5 * c * c * math::ln_1p(s / (c * c)),
            Self::GemanMcClure(c) => 0.5 * c * c * (s / (c * c + s)),
            Self::Welsch(c) => -0.5 * c * c * math::exp_m1(-s / (c * c)),
            Self::Tukey(c) => {
                let u = (1.0 - s / (c * c)).max(0.0);
                c * c / 6.0 * (1.0 - u * u * u)
            }
        }
    }

    /// Influence `ψ(r) = ρ'(r)`.
    pub fn psi(self, r: f64) -> f64 {
        r * self.weight(r)
    }

    /// Weight `w(r) = ψ(r) / r`, its limit at zero.
    pub fn weight(self, r: f64) -> f64 {
        let s = r * r;
        match self {
            Self::Square => 1.0,
            Self::Huber(k) if r.abs() <= k => 1.0,
            Self::Huber(k) => k / r.abs(),
            Self::StudentT(nu) => (nu + 1.0) / (nu + s),
            Self::Cauchy(c) => 1.0 / (1.0 + s / (c * c)),
            Self::GemanMcClure(c) => {
                let u = 1.0 / (1.0 + s / (c * c));
                u * u
            }
            Self::Welsch(c) => math::exp(-s / (c * c)),
            Self::Tukey(c) => {
                let u = (1.0 - s / (c * c)).max(0.0);
                u * u
            }
        }
    }
}

/// Robust standard deviation of residuals that are zero in the mean: `1.4826 · median |r|`, at least `floor`.
///
/// The median is about zero, not about the residuals' own median, because a common shift is an error too. The floor
/// (a known noise level, or what quantisation leaves) keeps weights meaningful when more than half the residuals
/// vanish. Residuals that are not finite are left out; without any, the floor. `scratch` is storage to use again.
pub fn mad_scale(residuals: &[f64], floor: f64, scratch: &mut Vec<f64>) -> f64 {
    scratch.clear();
    scratch.extend(residuals.iter().filter(|r| r.is_finite()).map(|r| r.abs()));
    let n = scratch.len();
    if n == 0 {
        return floor;
    }
    let (below, &mut upper, _) = scratch.select_nth_unstable_by(n / 2, f64::total_cmp);
    let median = if n % 2 == 1 {
        upper
    } else {
        // The largest of the lower half is the other middle value.
        0.5 * (upper + below.iter().copied().fold(0.0, f64::max))
    };
    // 1 / Φ⁻¹(3/4)
    (1.482_602_218_505_602 * median).max(floor)
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Robust; 7] = [
        Robust::Square,
        Robust::HUBER,
        Robust::StudentT(5.0),
        Robust::CAUCHY,
        Robust::GEMAN_MCCLURE,
        Robust::WELSCH,
        Robust::TUKEY,
    ];

    fn grid() -> impl Iterator<Item = f64> {
        (-2000..=2000).map(|k| f64::from(k) * 0.005 + 0.0007)
    }

    #[test]
    fn influence_is_the_slope_of_the_cost() {
        for kind in ALL {
            for r in grid() {
                let h = 1e-5;
                let slope = (kind.rho(r + h) - kind.rho(r - h)) / (2.0 * h);
                assert!((kind.psi(r) - slope).abs() < 1e-6, "{kind:?} at {r}: {} {slope}", kind.psi(r));
            }
        }
    }

    #[test]
    fn costs_are_even_and_grow_weights_fall() {
        for kind in ALL {
            assert_eq!(kind.rho(0.0), 0.0);
            let (mut rho, mut weight) = (0.0, kind.weight(0.0));
            for r in grid().filter(|r| *r > 0.0) {
                assert!(
                    kind.rho(r) >= rho && kind.weight(r) <= weight && kind.weight(r) >= 0.0,
                    "{kind:?} at {r}"
                );
                assert_eq!(
                    (kind.rho(r), kind.weight(r), kind.psi(r)),
                    (kind.rho(-r), kind.weight(-r), -kind.psi(-r))
                );
                assert!((kind.weight(r) * r - kind.psi(r)).abs() < 1e-15);
                (rho, weight) = (kind.rho(r), kind.weight(r));
            }
            // Near zero all are least squares, up to the factor of Student's t.
            assert!((kind.rho(1e-4) / (0.5e-8 * kind.weight(0.0)) - 1.0).abs() < 1e-6, "{kind:?}");
        }
    }

    #[test]
    fn asymptotes_are_those_of_the_table() {
        assert_eq!(Robust::HUBER.psi(1e9), 1.345);
        assert_eq!(Robust::TUKEY.weight(4.686), 0.0);
        assert!((Robust::TUKEY.rho(100.0) - 4.685 * 4.685 / 6.0).abs() < 1e-14);
        assert!((Robust::CAUCHY.psi(1e6) * 1e6 / (2.385 * 2.385) - 1.0).abs() < 1e-9);
        assert!((Robust::StudentT(5.0).psi(1e6) * 1e6 / 6.0 - 1.0).abs() < 1e-9);
        assert!((Robust::GEMAN_MCCLURE.rho(1e9) - 0.5 * 3.787 * 3.787).abs() < 1e-9);
        assert!((Robust::WELSCH.rho(1e9) - 0.5 * 2.985 * 2.985).abs() < 1e-12);
    }

    #[test]
    fn constants_have_95_percent_efficiency() {
        for kind in [Robust::HUBER, Robust::CAUCHY, Robust::GEMAN_MCCLURE, Robust::WELSCH, Robust::TUKEY] {
            // (E ψ')² / E ψ² under the normal density; E ψ' = E r ψ by parts.
            let (mut slope, mut power, h) = (0.0, 0.0, 0.001);
            for k in -10_000..10_000 {
                let x = (f64::from(k) + 0.5) * h;
                let p = math::exp(-0.5 * x * x) * h / core::f64::consts::TAU.sqrt();
                slope += p * x * kind.psi(x);
                power += p * kind.psi(x) * kind.psi(x);
            }
            assert!((slope * slope / power - 0.95).abs() < 3e-5, "{kind:?}: {}", slope * slope / power);
        }
    }

    #[test]
    fn constants_are_checked() {
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(Robust::Huber(bad).checked().is_err() && Robust::StudentT(bad).checked().is_err());
        }
        assert_eq!(Robust::TUKEY.checked(), Ok(Robust::TUKEY));
    }

    #[test]
    fn the_scale_is_that_of_the_majority() {
        let mut scratch = vec![];
        // Quantiles of a normal with deviation 3, and a third of gross errors.
        let mut r: Vec<f64> = (1..1000).map(|k| 3.0 * math::normal_quantile(f64::from(k) / 1000.0)).collect();
        assert!((mad_scale(&r, 0.0, &mut scratch) - 3.0).abs() < 0.01);
        r.extend([1e6; 400]);
        assert!(mad_scale(&r, 0.0, &mut scratch) < 6.0);
        // About zero: a shift counts.
        assert!((mad_scale(&[2.0, 2.0, 2.0], 0.1, &mut scratch) - 2.0 * 1.4826).abs() < 1e-3);
        assert!((mad_scale(&[1.0, -3.0, 5.0, 7.0], 0.0, &mut scratch) - 4.0 * 1.482602).abs() < 1e-5);
        assert_eq!(mad_scale(&[0.0; 9], 0.3, &mut scratch), 0.3);
        assert_eq!(mad_scale(&[f64::NAN, f64::INFINITY], 0.3, &mut scratch), 0.3);
        assert_eq!(mad_scale(&[], 0.3, &mut scratch), 0.3);
        let storage = scratch.capacity();
        mad_scale(&r, 0.0, &mut scratch);
        assert_eq!(scratch.capacity(), storage);
    }
}
