//! The incomplete gamma function and the χ² distribution that it gives.

use super::{exp, ln, normal_quantile};

/// `ln |Γ(x)|`.
pub fn ln_gamma(x: f64) -> f64 {
    libm::lgamma(x)
}

/// Regularised lower incomplete gamma function `P(a, x) = ∫₀ˣ t^{a-1} e^{-t} dt / Γ(a)`; NaN unless `a > 0`, `x ≥ 0`.
pub fn gamma_p(a: f64, x: f64) -> f64 {
    both(a, x).0
}

/// `Q(a, x) = 1 - P(a, x)`, accurate where it is small.
pub fn gamma_q(a: f64, x: f64) -> f64 {
    both(a, x).1
}

/// `P` and `Q`: the series below `a + 1`, the continued fraction (modified Lentz) above.
fn both(a: f64, x: f64) -> (f64, f64) {
    if !(a > 0.0 && x >= 0.0 && a.is_finite()) {
        return (f64::NAN, f64::NAN);
    }
    if x == 0.0 {
        return (0.0, 1.0);
    }
    if x == f64::INFINITY {
        return (1.0, 0.0);
    }
    let front = exp(a * ln(x) - x - ln_gamma(a));
    // Both converge in about √a terms near x = a.
    let limit = 200 + 20 * a.sqrt() as usize;
    if x < a + 1.0 {
        let (mut term, mut sum) = (1.0 / a, 1.0 / a);
        for k in 1..limit {
            term *= x / (a + k as f64);
            sum += term;
            if term < sum * 1e-17 {
                break;
            }
        }
        let p = (front * sum).min(1.0);
        (p, 1.0 - p)
    } else {
        const TINY: f64 = 1e-300;
        let mut b = x + 1.0 - a;
        let mut c = 1.0 / TINY;
        let mut d = 1.0 / b;
        let mut h = d;
        for k in 1..limit {
            let an = -(k as f64) * (k as f64 - a);
            b += 2.0;
            d = an * d + b;
            c = b + an / c;
            d = 1.0 / if d.abs() < TINY { TINY } else { d };
            c = if c.abs() < TINY { TINY } else { c };
            h *= d * c;
            if (d * c - 1.0).abs() < 1e-16 {
                break;
            }
        }
        let q = (front * h).min(1.0);
        (1.0 - q, q)
    }
}

/// Probability that a χ² variable with `dof` degrees of freedom is at most `x`.
pub fn chi_square_cdf(x: f64, dof: f64) -> f64 {
    gamma_p(0.5 * dof, 0.5 * x)
}

/// Probability that a χ² variable with `dof` degrees of freedom exceeds `x`, accurate where it is small.
pub fn chi_square_survival(x: f64, dof: f64) -> f64 {
    gamma_q(0.5 * dof, 0.5 * x)
}

/// The `x` with `chi_square_cdf(x, dof) = p`: the gate that an honest value passes with probability `p`.
/// NaN unless `0 ≤ p ≤ 1` and `dof > 0`.
pub fn chi_square_quantile(p: f64, dof: f64) -> f64 {
    if !((0.0..=1.0).contains(&p) && dof > 0.0 && dof.is_finite()) {
        return f64::NAN;
    }
    if p == 0.0 || p == 1.0 {
        return if p == 0.0 { 0.0 } else { f64::INFINITY };
    }
    // Start of Wilson and Hilferty, or the first term of the series in the lower tail; then Newton, or bisection
    // where it leaves the bracket.
    let c = 2.0 / (9.0 * dof);
    let cube = 1.0 - c + normal_quantile(p) * c.sqrt();
    let (mut low, mut high) = (0.0, dof + 10.0);
    while chi_square_cdf(high, dof) < p && high < 1e300 {
        (low, high) = (high, high * 2.0);
    }
    let a = 0.5 * dof;
    let mut x =
        if cube > 0.3 { dof * cube * cube * cube } else { 2.0 * exp((ln(p) + ln_gamma(a + 1.0)) / a) };
    for _ in 0..200 {
        if !(x > low && x < high) {
            x = 0.5 * (low + high);
        }
        let (below, above) = both(a, 0.5 * x);
        // The smaller tail carries the digits.
        let error = if p < 0.5 { below - p } else { (1.0 - p) - above };
        if error > 0.0 {
            high = x;
        } else {
            low = x;
        }
        let density = 0.5 * exp((a - 1.0) * ln(0.5 * x) - 0.5 * x - ln_gamma(a));
        let next = x - error / density;
        if (next - x).abs() <= 2e-16 * x || high - low <= 2e-16 * high {
            return x;
        }
        x = next;
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_agree() {
        // Percentage points of χ², any statistics text; more digits from closed forms where they exist.
        for (p, dof, x) in [
            (0.95, 1.0, 3.841458820694124),
            (0.99, 2.0, 9.210340371976182),
            (0.95, 3.0, 7.814727903251179),
            (0.99, 6.0, 16.811893829770927),
            (0.95, 6.0, 12.591587243743977),
            (0.025, 6.0, 1.237344245791203),
            (0.999, 6.0, 22.457744484825323),
            (0.95, 100.0, 124.34211340400407),
            (0.05, 100.0, 77.92946516501726),
        ] {
            assert!(
                (chi_square_quantile(p, dof) / x - 1.0).abs() < 1e-12,
                "{p} {dof}: {}",
                chi_square_quantile(p, dof)
            );
        }
    }

    #[test]
    fn two_degrees_of_freedom_are_exponential() {
        for k in 1..400 {
            let x = f64::from(k) * 0.1;
            assert!((chi_square_survival(x, 2.0) / exp(-0.5 * x) - 1.0).abs() < 1e-13, "{x}");
        }
    }

    #[test]
    fn one_degree_of_freedom_is_a_squared_normal() {
        for k in 1..60 {
            let x = f64::from(k) * 0.1;
            let expected = super::super::erfc(x * core::f64::consts::FRAC_1_SQRT_2);
            assert!((chi_square_survival(x * x, 1.0) / expected - 1.0).abs() < 1e-12, "{x}");
        }
    }

    #[test]
    fn quantiles_invert_the_distribution_far_out() {
        for dof in [0.3, 1.0, 2.0, 5.0, 40.0, 1000.0, 1e5] {
            for p in [1e-12, 1e-6, 0.01, 0.3, 0.5, 0.7, 0.99, 1.0 - 1e-9] {
                let x = chi_square_quantile(p, dof);
                let tail = if p < 0.5 {
                    chi_square_cdf(x, dof) / p
                } else {
                    chi_square_survival(x, dof) / (1.0 - p)
                };
                assert!((tail - 1.0).abs() < 1e-9, "{p} {dof}: {x} {tail}");
            }
        }
        assert_eq!((chi_square_quantile(0.0, 3.0), chi_square_quantile(1.0, 3.0)), (0.0, f64::INFINITY));
        assert!(chi_square_quantile(1.5, 3.0).is_nan() && chi_square_quantile(0.5, -1.0).is_nan());
        assert!(gamma_p(-1.0, 1.0).is_nan() && gamma_q(1.0, -1.0).is_nan());
        assert_eq!((gamma_p(2.0, 0.0), gamma_q(2.0, f64::INFINITY)), (0.0, 0.0));
    }
}
