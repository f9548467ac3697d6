//! Gradients by length and direction.

/// Length of a gradient, and its direction in eighths of a turn from x towards y, 0 to 8. Exact to 2e-5 of an eighth.
///
/// A polynomial of our own, so that rows of gradients become vector instructions and have the same bits everywhere.
#[inline(always)]
pub fn polar(x: f32, y: f32) -> (f32, f32) {
    let (a, b) = (x.abs(), y.abs());
    let (low, high) = if a < b { (a, b) } else { (b, a) };
    // Without a gradient the direction does not matter, but it must be a number.
    let t = low / (high + f32::MIN_POSITIVE);
    let s = t * t;
    // 4/π arctan t with the least largest error.
    let p = ((0.026_540_663 * s - 0.108_424_12) * s + 0.229_385_75) * s - 0.420_557_1;
    let eighth = t * (p * s + 1.273_069_3);
    let quarter = if a < b { 2.0 - eighth } else { eighth };
    let half = if x < 0.0 { 4.0 - quarter } else { quarter };
    ((x * x + y * y).sqrt(), if y < 0.0 { 8.0 - half } else { half })
}

#[cfg(test)]
mod tests {
    use super::*;
    use vt_core::math;

    #[test]
    fn directions_are_those_of_the_arc_tangent() {
        for k in 0..3600 {
            let angle = f64::from(k) * core::f64::consts::TAU / 3600.0;
            let (s, c) = math::sin_cos(angle);
            let (length, eighths) = polar((3.0 * c) as f32, (3.0 * s) as f32);
            let off = math::wrap_angle(f64::from(eighths) * core::f64::consts::FRAC_PI_4 - angle);
            assert!((length - 3.0).abs() < 1e-5 && off.abs() < 2e-5, "{angle}: {off}");
            assert!((0.0..=8.0).contains(&eighths));
        }
        assert_eq!(polar(0.0, 0.0), (0.0, 0.0));
    }
}
