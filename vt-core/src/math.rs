//! The one door to transcendental functions.
//!
//! The platform's `sin` or `exp` differ in the last bit between systems, and one bit is enough to send a particle
//! filter another way. All crates of this project call these pure-Rust versions instead (`nalgebra` is built with
//! `libm-force`), and clippy refuses the others. `f64::sqrt` is exact by IEEE 754 and may be used directly.

mod gamma;
mod normal;

pub use gamma::{chi_square_cdf, chi_square_quantile, chi_square_survival, gamma_p, gamma_q, ln_gamma};
pub(crate) use normal::normal_pair;
pub use normal::{normal_cdf, normal_quantile};

/// True when no value is NaN or infinite. Without an early exit, so that it runs on whole vectors.
#[inline]
pub fn all_finite(values: &[f64]) -> bool {
    const EXPONENT: u64 = 0x7ff0_0000_0000_0000;
    !values.iter().fold(false, |bad, v| bad | (v.to_bits() & EXPONENT == EXPONENT))
}

/// Sine of an angle in radians.
#[inline]
pub fn sin(x: f64) -> f64 {
    libm::sin(x)
}

/// Cosine of an angle in radians.
#[inline]
pub fn cos(x: f64) -> f64 {
    libm::cos(x)
}

/// Sine and cosine of an angle in radians.
#[inline]
pub fn sin_cos(x: f64) -> (f64, f64) {
    libm::sincos(x)
}

/// Tangent of an angle in radians.
#[inline]
pub fn tan(x: f64) -> f64 {
    libm::tan(x)
}

/// Arc cosine in radians; the argument is clamped to `[-1, 1]`.
#[inline]
pub fn acos(x: f64) -> f64 {
    libm::acos(x.clamp(-1.0, 1.0))
}

/// Arc sine in radians; the argument is clamped to `[-1, 1]`.
#[inline]
pub fn asin(x: f64) -> f64 {
    libm::asin(x.clamp(-1.0, 1.0))
}

/// Arc tangent in radians.
#[inline]
pub fn atan(x: f64) -> f64 {
    libm::atan(x)
}

/// Angle of the vector `(x, y)` in radians, in `(-π, π]`.
#[inline]
pub fn atan2(y: f64, x: f64) -> f64 {
    libm::atan2(y, x)
}

/// Exponential.
#[inline]
pub fn exp(x: f64) -> f64 {
    libm::exp(x)
}

/// Exponential with a relative error below 1e-10 and no table, for likelihoods in inner loops; 0 below -708.
#[inline(always)]
pub fn exp_fast(x: f64) -> f64 {
    let underflows = x < -708.0;
    // x = k ln 2 + r with |r| ≤ ln 2 / 2; the polynomial is the Taylor series of exp on that interval.
    let x = x.clamp(-708.0, 709.0);
    // Adding 1.5·2⁵² rounds to the nearest integer without a call.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    let rounded = x * core::f64::consts::LOG2_E + ROUND;
    let k = rounded - ROUND;
    let r = (x - k * 6.931_471_803_691_238e-1) - k * 1.908_214_929_270_587_7e-10;
    let r2 = r * r;
    let low = 1.0 + r + r2 * (0.5 + r * (1.0 / 6.0));
    let middle = 1.0 / 24.0 + r * (1.0 / 120.0) + r2 * (1.0 / 720.0 + r * (1.0 / 5040.0));
    let high = 1.0 / 40_320.0 + r * (1.0 / 362_880.0);
    let polynomial = low + r2 * r2 * (middle + r2 * r2 * high);
    // The integer is in the last bits of `rounded`, and what is before it falls off the end.
    let power = f64::from_bits((rounded.to_bits() << 52).wrapping_add(1023 << 52));
    if underflows { 0.0 } else { polynomial * power }
}

/// [`exp_fast`] of all `x`, in place.
pub fn exp_all(x: &mut [f64]) {
    crate::batch::vectorized(
        #[inline(always)]
        || x.iter_mut().for_each(|x| *x = exp_fast(*x)),
    );
}

/// `exp(x) - 1`, accurate near zero.
#[inline]
pub fn exp_m1(x: f64) -> f64 {
    libm::expm1(x)
}

/// Natural logarithm.
#[inline]
pub fn ln(x: f64) -> f64 {
    libm::log(x)
}

/// `ln(1 + x)`, accurate near zero.
#[inline]
pub fn ln_1p(x: f64) -> f64 {
    libm::log1p(x)
}

/// Logarithm to base 10.
#[inline]
pub fn log10(x: f64) -> f64 {
    libm::log10(x)
}

/// `x` to the power `y`.
#[inline]
pub fn pow(x: f64, y: f64) -> f64 {
    libm::pow(x, y)
}

/// Length of the vector `(x, y)` without overflow.
#[inline]
pub fn hypot(x: f64, y: f64) -> f64 {
    libm::hypot(x, y)
}

/// Hyperbolic tangent.
#[inline]
pub fn tanh(x: f64) -> f64 {
    libm::tanh(x)
}

/// Cube root.
#[inline]
pub fn cbrt(x: f64) -> f64 {
    libm::cbrt(x)
}

/// Error function.
#[inline]
pub fn erf(x: f64) -> f64 {
    libm::erf(x)
}

/// `1 - erf(x)`, accurate where it is small.
#[inline]
pub fn erfc(x: f64) -> f64 {
    libm::erfc(x)
}

/// Logistic function `1 / (1 + exp(-x))`, without overflow.
#[inline]
pub fn logistic(x: f64) -> f64 {
    if x >= 0.0 {
        1.0 / (1.0 + exp(-x))
    } else {
        let e = exp(x);
        e / (1.0 + e)
    }
}

/// `ln Σ exp(x_i)` without overflow; `-∞` for an empty slice or one that holds `-∞` only.
pub fn log_sum_exp(x: &[f64]) -> f64 {
    let top = x.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if !top.is_finite() {
        return top;
    }
    top + ln(x.iter().map(|&v| exp(v - top)).sum())
}

/// Angle brought to `(-π, π]`.
pub fn wrap_angle(x: f64) -> f64 {
    use core::f64::consts::{PI, TAU};
    let y = x - TAU * (x / TAU).round();
    if y <= -PI { y + TAU } else { y }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn logistic_is_symmetric_and_saturates() {
        assert_eq!(logistic(0.0), 0.5);
        for x in [0.1, 3.0, 40.0, 800.0] {
            assert!((logistic(x) + logistic(-x) - 1.0).abs() < 1e-15, "{x}");
        }
    }

    #[test]
    fn the_fast_exponential_agrees_with_the_exact_one() {
        for k in -70_700..7_000 {
            let x = f64::from(k) * 0.01 + 0.003;
            assert!((exp_fast(x) / exp(x) - 1.0).abs() < 1e-10, "{x}");
        }
        let many: Vec<f64> = (-3000..3000).map(|k| f64::from(k) * 0.31).collect();
        let mut powers = many.clone();
        exp_all(&mut powers);
        assert!(powers.iter().zip(&many).all(|(p, x)| *p == exp_fast(*x)));
        assert_eq!(exp_fast(0.0), 1.0);
        assert_eq!(exp_fast(-1e9), 0.0);
        assert!(exp_fast(1e9).is_finite() && exp_fast(f64::NAN).is_nan());
    }

    #[test]
    fn log_sum_exp_survives_large_and_empty_input() {
        assert!((log_sum_exp(&[1000.0, 1000.0]) - 1000.0 - ln(2.0)).abs() < 1e-12);
        assert_eq!(log_sum_exp(&[]), f64::NEG_INFINITY);
        assert_eq!(log_sum_exp(&[f64::NEG_INFINITY; 3]), f64::NEG_INFINITY);
    }

    #[test]
    fn wrapped_angles_lie_in_the_half_open_interval() {
        use core::f64::consts::PI;
        for k in -5..=5 {
            let x = wrap_angle(0.3 + f64::from(k) * 2.0 * PI);
            assert!((x - 0.3).abs() < 1e-12);
        }
        assert_eq!(wrap_angle(-PI), PI);
        assert_eq!(wrap_angle(PI), PI);
    }
}
