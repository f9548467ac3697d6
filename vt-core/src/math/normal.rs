//! The normal distribution.

use super::{erfc, ln};

/// Probability that a standard normal variable is at most `x`.
pub fn normal_cdf(x: f64) -> f64 {
    0.5 * erfc(-x * core::f64::consts::FRAC_1_SQRT_2)
}

/// The `x` with `normal_cdf(x) = p`, to about one part in 10¹⁵; `-∞` at 0, `∞` at 1, NaN outside.
///
/// Rational approximations AS 241 (PPND16): M. Wichura, "The percentage points of the normal distribution", 1988.
pub fn normal_quantile(p: f64) -> f64 {
    let q = p - 0.5;
    if q.abs() <= 0.425 {
        let r = 0.180625 - q * q;
        return q * polynomial(&CENTRE_NUMERATOR, r) / polynomial(&CENTRE_DENOMINATOR, r);
    }
    let tail = if q < 0.0 { p } else { 1.0 - p };
    if tail <= 0.0 {
        return if tail == 0.0 { f64::INFINITY.copysign(q) } else { f64::NAN };
    }
    let r = (-ln(tail)).sqrt();
    let x = if r <= 5.0 {
        polynomial(&NEAR_NUMERATOR, r - 1.6) / polynomial(&NEAR_DENOMINATOR, r - 1.6)
    } else {
        polynomial(&FAR_NUMERATOR, r - 5.0) / polynomial(&FAR_DENOMINATOR, r - 5.0)
    };
    x.copysign(q)
}

/// `c_0 + c_1 x + …`
#[inline]
fn polynomial(coefficients: &[f64; 8], x: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c)
}

/// Two independent standard normal numbers from 64 random bits, without a branch: `r cos φ` and `r sin φ` with
/// `r = √(-2 ln u)` (Box and Muller 1958).
#[inline(always)]
pub(crate) fn normal_pair(radius: u32, angle: u32) -> [f64; 2] {
    // The middle of the cell, so that 0 and 1 cannot occur.
    let u = (real(radius.into()) + 0.5) * (1.0 / (1_u64 << 32) as f64);
    let r = (-2.0 * ln_short(u)).sqrt();
    // An angle within 45° of an axis; the two bits above say of which.
    let quarter = f64::from_bits((f64::to_bits(core::f64::consts::FRAC_PI_2)) - (30 << 52));
    let t = (real((angle & 0x3FFF_FFFF).into()) + 0.5) * quarter - core::f64::consts::FRAC_PI_4;
    let z = t * t;
    let s = t * (1.0 - z * (1.0 / 6.0 - z * (1.0 / 120.0 - z * (1.0 / 5040.0 - z * (1.0 / 362_880.0)))));
    let c = 1.0
        - z * (0.5 - z * (1.0 / 24.0 - z * (1.0 / 720.0 - z * (1.0 / 40_320.0 - z * (1.0 / 3_628_800.0)))));
    let swap = 0_u64.wrapping_sub(u64::from(angle >> 30) & 1);
    let sign = u64::from(angle >> 31) << 63;
    let (s, c) = (s.to_bits(), c.to_bits());
    let difference = (s ^ c) & swap;
    [r * f64::from_bits(c ^ difference ^ sign), r * f64::from_bits(s ^ difference ^ sign)]
}

/// An integer below 2⁵², by its bits.
#[inline(always)]
fn real(x: u64) -> f64 {
    const TWO_52: f64 = 4_503_599_627_370_496.0;
    f64::from_bits(TWO_52.to_bits() | x) - TWO_52
}

/// Logarithm of a normal number, to about 1e-11.
#[inline(always)]
fn ln_short(x: f64) -> f64 {
    // x = 2^k m with m around 1; ln m = 2 atanh s.
    let above = x.to_bits().wrapping_sub(core::f64::consts::FRAC_1_SQRT_2.to_bits());
    let m = f64::from_bits(x.to_bits().wrapping_sub(above & (0xFFF << 52)));
    let k = real((above >> 52) ^ 0x800) - 2048.0;
    let s = (m - 1.0) / (m + 1.0);
    let z = s * s;
    let series = 2.0 / 5.0 + z * (2.0 / 7.0 + z * (2.0 / 9.0 + z * (2.0 / 11.0)));
    k * core::f64::consts::LN_2 + s * (2.0 + z * (2.0 / 3.0 + z * series))
}

const CENTRE_NUMERATOR: [f64; 8] = [
    3.3871328727963665,
    133.14166789178438,
    1971.5909503065513,
    13731.69376550946,
    45921.95393154987,
    67265.7709270087,
    33430.57558358813,
    2509.0809287301227,
];
const CENTRE_DENOMINATOR: [f64; 8] = [
    1.0,
    42.31333070160091,
    687.1870074920579,
    5394.196021424751,
    21213.794301586597,
    39307.89580009271,
    28729.085735721943,
    5226.495278852854,
];
const NEAR_NUMERATOR: [f64; 8] = [
    1.4234371107496835,
    4.630337846156546,
    5.769497221460691,
    3.6478483247632045,
    1.2704582524523684,
    0.2417807251774506,
    0.022723844989269184,
    0.0007745450142783414,
];
const NEAR_DENOMINATOR: [f64; 8] = [
    1.0,
    2.053191626637759,
    1.6763848301838038,
    0.6897673349851,
    0.14810397642748008,
    0.015198666563616457,
    0.0005475938084995345,
    1.0507500716444169e-09,
];
const FAR_NUMERATOR: [f64; 8] = [
    6.657904643501103,
    5.463784911164114,
    1.7848265399172913,
    0.29656057182850487,
    0.026532189526576124,
    0.0012426609473880784,
    2.7115555687434876e-05,
    2.0103343992922881e-07,
];
const FAR_DENOMINATOR: [f64; 8] = [
    1.0,
    0.599832206555888,
    0.1369298809227358,
    0.014875361290850615,
    0.0007868691311456133,
    1.8463183175100548e-05,
    1.421511758316446e-07,
    2.0442631033899397e-15,
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_invert_the_distribution() {
        for k in 1..2000 {
            let p = f64::from(k) / 2000.0;
            assert!((normal_cdf(normal_quantile(p)) / p - 1.0).abs() < 1e-14, "{p}");
        }
        for e in 4..300 {
            let p = super::super::pow(10.0, -f64::from(e));
            assert!((normal_cdf(normal_quantile(p)) / p - 1.0).abs() < 1e-11, "{p}");
        }
    }

    #[test]
    fn pairs_are_the_formula() {
        use super::super::{cos, sin};
        for k in 0..100_000_u32 {
            let (a, b) = (k.wrapping_mul(2_654_435_761), k.wrapping_mul(0x9E37_79B1).rotate_left(7));
            let r = (-2.0 * ln((f64::from(a) + 0.5) / 4_294_967_296.0)).sqrt();
            let t = (f64::from(b & 0x3FFF_FFFF) + 0.5) / f64::from(1 << 30) * core::f64::consts::FRAC_PI_2
                - core::f64::consts::FRAC_PI_4;
            let (x, y) = if b >> 30 & 1 == 0 { (cos(t), sin(t)) } else { (sin(t), cos(t)) };
            let sign = if b >> 31 == 0 { r } else { -r };
            let [found_x, found_y] = normal_pair(a, b);
            assert!((found_x - sign * x).abs() < 2e-8 && (found_y - sign * y).abs() < 2e-8, "{k}");
        }
        // The largest and the smallest radius.
        let [x, y] = normal_pair(0, 0);
        assert!((super::super::hypot(x, y) - 6.76).abs() < 0.01, "{x} {y}");
        assert!(normal_pair(u32::MAX, 5).iter().all(|v| v.abs() < 2e-5));
    }

    #[test]
    fn tables_agree() {
        // Standard normal table.
        for (p, x) in
            [(0.5, 0.0), (0.975, 1.959963984540054), (0.99, 2.3263478740408408), (0.9999, 3.719016485455709)]
        {
            assert!((normal_quantile(p) - x).abs() < 1e-14 * 4.0, "{p}");
            assert!((normal_quantile(1.0 - p) + x).abs() < 1e-11, "{p}");
        }
        assert_eq!(normal_quantile(0.0), f64::NEG_INFINITY);
        assert_eq!(normal_quantile(1.0), f64::INFINITY);
        assert!(
            normal_quantile(-0.1).is_nan()
                && normal_quantile(1.1).is_nan()
                && normal_quantile(f64::NAN).is_nan()
        );
    }
}
