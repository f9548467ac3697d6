//! Sub-pixel search for intensity edges along the normal of a predicted contour (RAPiD, Harris 1990; oriented
//! masks and contrast after Bouthemy's moving edges).
//!
//! The search runs along the image row or column that lies nearer to the normal. A contour is not changed by sliding
//! a point along itself, so the starting point slides until it sits exactly on the row or column; the profile then
//! consists of true pixels, not of interpolated ones, and a parabola through the gradient maximum is exact for a step
//! edge seen by square pixels. Three neighbouring rows are averaged along the direction of the contour (the oriented
//! mask), each shifted by the contour's slope.

use image::GrayImage;
use nalgebra::{Point2, Vector2};

/// Step in grey levels that pixel noise of one grey level makes on a search line by itself, standard deviation.
pub const NOISE_GAIN: f64 = 0.65;

/// Longest half range in pixels along the row or column.
pub const MAX_REACH: usize = 96;

/// Longest profile: the reach on both sides, plus two pixels for the derivative and one for the maximum.
const MAX_PROFILE: usize = 2 * (MAX_REACH + 5) + 1;

/// An edge found on a search line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgeCandidate {
    /// Signed distance from the predicted contour along its normal, pixels.
    pub offset: f64,
    /// Step height in grey levels, positive when it brightens along the normal.
    pub contrast: f64,
    /// Grey levels beside the edge, two to three pixels before and after it along the normal.
    pub sides: [f32; 2],
}

/// What became of a search.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Searched {
    /// The line was searched; candidates may still be none.
    Done,
    /// The predicted point lies outside the picture or too near its border to be searched.
    Outside,
}

/// A search line: where the contour is predicted and in which direction it is searched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SearchLine {
    /// Predicted contour point, pixels.
    pub at: Point2<f64>,
    /// Unit normal of the contour.
    pub normal: Vector2<f64>,
    /// Half range along the normal, pixels.
    pub range: f64,
}

/// Appends the edges along `line` with at least `min_contrast` grey levels to `out`, in order of position, the
/// strongest `max_candidates` only.
pub fn search(
    image: &GrayImage,
    line: &SearchLine,
    min_contrast: f64,
    max_candidates: usize,
    out: &mut Vec<EdgeCandidate>,
) -> Searched {
    let (width, height) = (image.width() as usize, image.height() as usize);
    let n = line.normal;
    let along_row = n.x.abs() >= n.y.abs();
    // In the frame of the scan: `s` runs along the row (column), `t` across it.
    let (s0, t0, ns, nt, s_size, t_size) = if along_row {
        (line.at.x, line.at.y, n.x, n.y, width, height)
    } else {
        (line.at.y, line.at.x, n.y, n.x, height, width)
    };
    if !(s0.is_finite() && t0.is_finite() && line.range > 0.0) || s_size < 8 || t_size < 3 || ns == 0.0 {
        return Searched::Outside;
    }
    // Truncation is cheaper than rounding; t0 is not negative here.
    if !(t0 >= 0.5 && t0 < t_size as f64 - 1.5 && s0 >= 0.0 && s0 <= (s_size - 1) as f64) {
        return Searched::Outside;
    }
    let t_line = (t0 + 0.5) as usize;
    // On the contour, ns ds + nt dt = 0.
    let slope = -nt / ns;
    let s_on = s0 + slope * (t_line as f64 - t0);
    let reach = (line.range / ns.abs()).min(MAX_REACH as f64);
    // The derivative needs two pixels beyond the first and last maximum, the maximum one more, the shift of the
    // neighbouring rows (at most one pixel and its interpolation) two more.
    let first = ((s_on - reach) as i64 - 4).max(2);
    let last = ((s_on + reach) as i64 + 4).min(s_size as i64 - 3);
    if last - first < 7 {
        return Searched::Outside;
    }
    let (first, len) = (first as usize, ((last - first) as usize + 1).min(MAX_PROFILE));
    let mut profile = [0.0f32; MAX_PROFILE];
    let profile = &mut profile[..len];
    let pixels = image.as_raw();
    if along_row {
        sheared_mean(pixels, (t_line - 1) * width + first, width, slope, profile);
    } else {
        let start = first * width + t_line - 1;
        sheared_mean_strided(pixels, start, width, slope, profile);
    }
    maxima(profile, first as f64 - s_on, ns, line.range, min_contrast, max_candidates, out);
    Searched::Done
}

/// Shift of the rows before and after the contour's row: whole pixels and the remaining fraction.
fn shifts(slope: f64) -> [(isize, f32); 2] {
    [-slope, slope].map(|shift| {
        let whole = if shift < 0.0 { shift as isize - 1 } else { shift as isize };
        (whole, (shift - whole as f64) as f32)
    })
}

/// Mean of three rows with weights 1 2 1, the outer ones shifted by the slope of the contour. `start` is the first
/// pixel of the profile in the row **before** the contour's.
fn sheared_mean(pixels: &[u8], start: usize, width: usize, slope: f64, out: &mut [f32]) {
    let len = out.len();
    let [(i0, f0), (i2, f2)] = shifts(slope);
    let row = |base: usize, shift: isize| &pixels[base.wrapping_add_signed(shift)..][..len + 1];
    let (a, c) = (row(start, i0), row(start + 2 * width, i2));
    let b = &pixels[start + width..][..len];
    for k in 0..len {
        let before = f32::from(a[k]) * (1.0 - f0) + f32::from(a[k + 1]) * f0;
        let after = f32::from(c[k]) * (1.0 - f2) + f32::from(c[k + 1]) * f2;
        out[k] = 0.25 * (before + after) + 0.5 * f32::from(b[k]);
    }
}

/// The same along a column: `start` is the first pixel of the profile in the column before the contour's.
fn sheared_mean_strided(pixels: &[u8], start: usize, width: usize, slope: f64, out: &mut [f32]) {
    let [(i0, f0), (i2, f2)] = shifts(slope);
    let w = width as isize;
    let mut a = start.wrapping_add_signed(i0 * w);
    let mut b = start + 1;
    let mut c = (start + 2).wrapping_add_signed(i2 * w);
    let (mut a_now, mut c_now) = (f32::from(pixels[a]), f32::from(pixels[c]));
    for v in out.iter_mut() {
        let (a_next, c_next) = (f32::from(pixels[a + width]), f32::from(pixels[c + width]));
        let before = a_now * (1.0 - f0) + a_next * f0;
        let after = c_now * (1.0 - f2) + c_next * f2;
        *v = 0.25 * (before + after) + 0.5 * f32::from(pixels[b]);
        (a_now, c_now) = (a_next, c_next);
        a += width;
        b += width;
        c += width;
    }
}

/// Local maxima of the absolute gradient of `profile`, whose sample 0 lies `origin` scan pixels from the contour.
fn maxima(
    profile: &[f32],
    origin: f64,
    ns: f64,
    range: f64,
    min_contrast: f64,
    max_candidates: usize,
    out: &mut Vec<EdgeCandidate>,
) {
    // Smoothed central difference (1 2 0 -2 -1)/8; a step of height h answers with 3h/8.
    const STEP: f32 = 3.0 / 8.0;
    let len = profile.len();
    let mut gradient = [0.0f32; MAX_PROFILE];
    let gradient = &mut gradient[..len];
    for (g, p) in gradient[2..len - 2].iter_mut().zip(profile.windows(5)) {
        *g = 0.125 * (p[4] - p[0]) + 0.25 * (p[3] - p[1]);
    }
    let threshold = min_contrast as f32 * STEP;
    let begin = out.len();
    for k in 3..len - 3 {
        let g = gradient[k];
        let size = g.abs();
        if size < threshold || size < (gradient[k - 1] * g.signum()) || size <= (gradient[k + 1] * g.signum())
        {
            continue;
        }
        let (before, after) = (gradient[k - 1], gradient[k + 1]);
        let curvature = 2.0 * g - before - after;
        let fraction = if curvature != 0.0 { 0.5 * (after - before) / curvature } else { 0.0 };
        let offset = (origin + k as f64 + f64::from(fraction.clamp(-0.5, 0.5))) * ns;
        if offset.abs() > range {
            continue;
        }
        let contrast = f64::from(g / STEP) * ns.signum();
        let (before, after) =
            (0.5 * (profile[k - 2] + profile[k - 3]), 0.5 * (profile[k + 2] + profile[k + 3]));
        let sides = if ns > 0.0 { [before, after] } else { [after, before] };
        out.push(EdgeCandidate { offset, contrast, sides });
        if out.len() - begin > max_candidates {
            let weakest =
                (begin..out.len()).min_by(|&a, &b| out[a].contrast.abs().total_cmp(&out[b].contrast.abs()));
            if let Some(weakest) = weakest {
                out.remove(weakest);
            }
        }
    }
    if ns < 0.0 {
        out[begin..].reverse();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Luma;
    use proptest::prelude::*;

    /// A half-plane `n·x > c` seen by square pixels (16×16 sub-samples), dark 40, bright 200.
    fn half_plane(n: Vector2<f64>, c: f64) -> GrayImage {
        GrayImage::from_fn(64, 64, |x, y| {
            let mut bright = 0;
            for i in 0..16 {
                for j in 0..16 {
                    let (u, v) = (f64::from(i) / 16.0 - 15.0 / 32.0, f64::from(j) / 16.0 - 15.0 / 32.0);
                    bright += i32::from(n.x * (f64::from(x) + u) + n.y * (f64::from(y) + v) > c);
                }
            }
            Luma([(40.0 + 160.0 * f64::from(bright) / 256.0).round() as u8])
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 200, rng_seed: proptest::test_runner::RngSeed::Fixed(1), ..Default::default() })]

        /// Direction, position and polarity of a step edge are found to a twentieth of a pixel from anywhere in
        /// range, whatever the direction of the normal.
        #[test]
        fn step_edges_are_found_to_a_twentieth_pixel(
            angle in 0.0..core::f64::consts::TAU,
            shift in -6.0..6.0f64,
            along in -8.0..8.0f64,
            fraction in 0.0..1.0f64,
        ) {
            let (s, c) = vt_core::math::sin_cos(angle);
            let n = Vector2::new(c, s);
            let centre = Point2::new(31.0 + fraction, 32.0 - fraction);
            let image = half_plane(n, n.dot(&centre.coords));
            let at = centre + Vector2::new(-s, c) * along - n * shift;
            let mut found = vec![];
            let line = SearchLine { at, normal: n, range: 9.0 };
            prop_assert_eq!(search(&image, &line, 20.0, 4, &mut found), Searched::Done);
            prop_assert_eq!(found.len(), 1);
            prop_assert!((found[0].offset - shift).abs() < 0.05, "offset {} instead of {shift}", found[0].offset);
            prop_assert!(found[0].contrast > 120.0, "contrast {}", found[0].contrast);
            prop_assert!(found[0].sides[0] < 60.0 && found[0].sides[1] > 180.0, "sides {:?}", found[0].sides);
        }
    }

    #[test]
    fn candidates_come_in_order_and_the_strongest_stay() {
        let steps = [(10, 60u8), (20, 160), (30, 100), (44, 120)];
        let image = GrayImage::from_fn(64, 16, |x, _| {
            Luma([steps.iter().rev().find(|s| x >= s.0).map_or(20, |s| s.1)])
        });
        let mut line = SearchLine { at: Point2::new(28.0, 8.0), normal: Vector2::new(1.0, 0.0), range: 25.0 };
        let mut found = vec![];
        search(&image, &line, 15.0, 3, &mut found);
        let offsets: Vec<f64> = found.iter().map(|c| c.offset).collect();
        assert_eq!(offsets, [-18.5, -8.5, 1.5]);
        assert!(found[2].contrast < 0.0 && found[1].contrast > 0.0);
        line.normal = Vector2::new(-1.0, 0.0);
        found.clear();
        search(&image, &line, 15.0, 3, &mut found);
        let offsets: Vec<f64> = found.iter().map(|c| c.offset).collect();
        assert_eq!(offsets, [-1.5, 8.5, 18.5]);
        assert!(found[0].contrast > 0.0);
    }

    #[test]
    fn lines_outside_or_at_the_border_never_panic() {
        let image = half_plane(Vector2::new(1.0, 0.0), 30.0);
        let mut found = vec![];
        for (x, y) in
            [(-1.0, 5.0), (0.0, 0.0), (63.0, 63.0), (63.4, 10.0), (f64::NAN, 3.0), (1e300, 0.0), (5.0, 62.6)]
        {
            for angle in 0..48 {
                let (s, c) = vt_core::math::sin_cos(f64::from(angle) * 0.131);
                for range in [0.0, 0.4, 7.0, 90.0, 1e9, f64::NAN] {
                    let line = SearchLine { at: Point2::new(x, y), normal: Vector2::new(c, s), range };
                    search(&image, &line, 5.0, 4, &mut found);
                }
            }
        }
        let tiny = GrayImage::new(3, 2);
        let line = SearchLine { at: Point2::new(1.0, 1.0), normal: Vector2::new(1.0, 0.0), range: 5.0 };
        assert_eq!(search(&tiny, &line, 5.0, 4, &mut found), Searched::Outside);
    }
}
