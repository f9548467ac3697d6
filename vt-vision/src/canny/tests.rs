use image::{Luma, Rgb};
use proptest::prelude::*;

use super::*;
use crate::gaussian::Gaussian;

fn fixed(low: f64, high: f64) -> CannyParams {
    CannyParams::new(Thresholds::Fixed { low, high }).unwrap()
}

/// Sizes one step before and after a pixel on the line of its gradient, between the two neighbours that the line passes. The
/// positive direction of the nearer axis is after; `size` gives that of a neighbour.
fn interpolated(gx: i16, gy: i16, size: impl Fn(isize, isize) -> f32) -> (f32, f32) {
    let (major, minor) = (gx.abs().max(gy.abs()), gx.abs().min(gy.abs()));
    let turn = if (gx < 0) == (gy < 0) { 1 } else { -1 };
    let (straight, slanted) = if gx.abs() >= gy.abs() { ((1, 0), (1, turn)) } else { ((0, 1), (turn, 1)) };
    let share = f32::from(minor) / f32::from(major.max(1));
    let mix = |sign: isize| {
        let at = |d: (isize, isize)| size(sign * d.0, sign * d.1);
        at(straight) * (1.0 - share) + at(slanted) * share
    };
    (mix(-1), mix(1))
}

/// Waves and spots.
fn picture(width: u32, height: u32, seed: u32) -> GrayImage {
    GrayImage::from_fn(width, height, |x, y| {
        let wave = vt_core::math::sin(f64::from(x * (seed % 5 + 1)) * 0.13 + f64::from(y * y) * 0.021);
        let spot = if (x / 5 * 7 + y / 6 * 3 + seed).is_multiple_of(4) { 60.0 } else { 0.0 };
        Luma([(90.0 + 60.0 * wave + spot) as u8])
    })
}

proptest! {
    #[test]
    fn thinning_agrees_with_the_interpolation_pixel_by_pixel(
        g in prop::collection::vec((-60i16..60, -60i16..60), 8 * 3), l1 in any::<bool>(),
    ) {
        let norm = if l1 { Norm::L1 } else { Norm::L2 };
        let (gx, gy): (Vec<i16>, Vec<i16>) = g.into_iter().unzip();
        let mut sizes = vec![0.0; 24];
        magnitude(&gx, &gy, norm, &mut sizes);
        for k in 0..24 {
            let (x, y) = (f64::from(gx[k]), f64::from(gy[k]));
            let exact = if l1 { x.abs() + y.abs() } else { (x * x + y * y).sqrt() };
            prop_assert!((f64::from(sizes[k]) - exact).abs() < 1e-4);
        }
        let mut classes = [9; 6];
        let rows = [&sizes[..8], &sizes[8..16], &sizes[16..]];
        suppress(rows, &gx[9..15], &gy[9..15], [20.0, 50.0], &mut classes);
        for (k, class) in (9usize..15).zip(classes) {
            let size = |dx: isize, dy: isize| sizes[k.wrapping_add_signed(dx + 8 * dy)];
            let (before, after) = interpolated(gx[k], gy[k], size);
            let here = size(0, 0);
            if (here - before).abs().min((here - after).abs()) < 1e-3 {
                continue;
            }
            let peak = here > before && here > after && here > 20.0;
            prop_assert_eq!(class, if !peak { 0 } else if here > 50.0 { STRONG } else { WEAK });
        }
    }

    #[test]
    fn weak_pixels_stay_where_chains_lead_to_strong_ones(
        (width, height) in (1usize..12, 1usize..12), draws in prop::collection::vec(0u8..12, 144),
    ) {
        let class = |k: usize| match draws[k] { 0 => STRONG, 1..=5 => WEAK, _ => 0 };
        let mut h = Hysteresis::default();
        let room = h.begin(width, height);
        let mut truth = vec![vec![0; width + 2]; height + 2];
        for y in 0..height {
            for x in 0..width {
                truth[y + 1][x + 1] = class(y * width + x);
                room[(y + 1) * (width + 2) + x + 1] = class(y * width + x);
            }
        }
        for _ in 0..width * height {
            for y in 1..=height {
                for x in 1..=width {
                    let touches = truth[y - 1..=y + 1].iter().any(|row| row[x - 1..=x + 1].contains(&STRONG));
                    if truth[y][x] == WEAK && touches {
                        truth[y][x] = STRONG;
                    }
                }
            }
        }
        h.spread();
        let mut mask = vec![7; width * height];
        h.mask(&mut mask);
        for (k, &m) in mask.iter().enumerate() {
            let strong = truth[k / width + 1][k % width + 1] == STRONG;
            prop_assert_eq!(m, if strong { 255 } else { 0 });
        }
    }

    #[test]
    fn a_region_has_the_edges_of_the_whole(
        (width, height) in (1u32..40, 1u32..40), seed in 0u32..99, color in any::<bool>(),
        (x, y, w, h) in (0u32..40, 0u32..40, 0u32..40, 0u32..40),
    ) {
        // With one threshold no chain leads out of the region.
        let (params, grey) = (fixed(8.0, 8.0), picture(width, height, seed));
        let rgb = RgbImage::from_fn(width, height, |x, y| {
            let v = grey.get_pixel(x, y)[0];
            Rgb([v, 255 - v, v / 2])
        });
        let (mut whole, mut part) = (Canny::default(), Canny::default());
        let roi = Some(Roi { x, y, width: w, height: h });
        if color {
            whole.compute_color(&rgb, None, &params);
            part.compute_color(&rgb, roi, &params);
        } else {
            whole.compute(&grey, None, &params);
            part.compute(&grey, roi, &params);
        }
        let region = part.mask().region();
        prop_assert_eq!(region, clip(roi, (width, height), 2));
        let mut seen = 0;
        for v in region.y..region.y + region.height {
            for u in region.x..region.x + region.width {
                prop_assert_eq!(part.get(u, v), whole.get(u, v));
                prop_assert_eq!(part.contrast(u, v), whole.contrast(u, v));
                seen += usize::from(part.get(u, v).is_some());
            }
        }
        prop_assert_eq!(seen, part.edges().count());
    }
}

#[test]
fn a_disc_has_a_closed_rim_at_its_place() {
    for (offset, inside, outside) in [(0.0, 50, 200), (0.3, 180, 90), (0.77, 20, 60)] {
        let (centre, radius) = (Point2::new(30.0 + offset, 29.6), 15.2);
        let image = GrayImage::from_fn(60, 60, |x, y| {
            let mut share = 0;
            for i in 0..64 {
                let (u, v) = (f64::from(i % 8) / 8.0 - 0.4375, f64::from(i / 8) / 8.0 - 0.4375);
                let at = Point2::new(f64::from(x) + u, f64::from(y) + v);
                share += i32::from((at - centre).norm() < radius);
            }
            Luma([(outside + (inside - outside) * share / 64) as u8])
        });
        let mut canny = Canny::default();
        for norm in [Norm::L1, Norm::L2] {
            canny.compute(&image, None, &CannyParams { norm, ..fixed(5.0, 10.0) });
            let mut sectors = [0; 36];
            let mut squares = 0.0;
            for (x, y, edge) in canny.edges() {
                let d = edge.at - centre;
                assert!((d.norm() - radius).abs() < 0.2, "{edge:?}");
                squares += (d.norm() - radius).powi(2);
                let outwards = d.normalize() * f64::from((outside - inside).signum());
                assert!(outwards.dot(&edge.direction) > 0.99, "{edge:?}");
                assert!((edge.at - Point2::new(f64::from(x), f64::from(y))).amax() <= 0.5);
                sectors[((vt_core::math::atan2(d.y, d.x).to_degrees() + 360.0) / 10.0) as usize % 36] += 1;
            }
            let count = canny.edges().count();
            assert!(sectors.iter().all(|&n| (1..=5).contains(&n)), "{sectors:?}");
            let deviation = (squares / count as f64).sqrt();
            assert!(deviation < 0.08, "{norm:?} {deviation}");
        }
    }
}

#[test]
fn colours_of_one_grey_level_have_an_edge() {
    let colours = [[200, 50, 60], [60, 120, 69]].map(Rgb);
    let image = RgbImage::from_fn(30, 20, |x, _| colours[usize::from(x >= 15)]);
    let mut evidence = CannyEvidence::default();
    let frame = Frame {
        sensor: SensorId(0),
        number: 0,
        time: vt_core::time::Timestamp(0),
        payload: Payload::Rgb(image.into()),
    };
    for (color, found) in [(false, 0), (true, 16)] {
        evidence.compute(&frame, None, &CannyParams { color, ..fixed(10.0, 30.0) }).unwrap();
        let edges = evidence.edges.now();
        assert_eq!(edges.edges().count(), found, "{color}");
        assert!(edges.edges().all(|(_, _, e)| (e.at.x - 14.5).abs() < 0.01 && e.direction.x.abs() > 0.999));
    }
}

#[test]
fn shares_of_pixels_follow_the_contrast() {
    let bright = picture(80, 60, 3);
    let dim = GrayImage::from_fn(80, 60, |x, y| Luma([bright.get_pixel(x, y)[0] / 2]));
    let params = CannyParams::new(Thresholds::Share { below: 0.85, ratio: 0.4, least: 2.0 }).unwrap();
    let mut canny = Canny::default();
    let [of_bright, of_dim] = [&bright, &dim].map(|image| {
        canny.compute(image, None, &params);
        canny.edges().count()
    });
    assert!(of_bright > 300 && of_bright.abs_diff(of_dim) < of_bright / 20, "{of_bright} {of_dim}");
    canny.compute(&GrayImage::from_pixel(80, 60, Luma([7])), None, &params);
    assert_eq!(canny.edges().count(), 0);
}

#[test]
fn parameters_out_of_range_are_named() {
    let wrong = |thresholds| CannyParams::new(thresholds).unwrap_err().to_string();
    assert!(wrong(Thresholds::Fixed { low: 5.0, high: 4.0 }).contains("low"));
    assert!(wrong(Thresholds::Fixed { low: 5.0, high: f64::NAN }).contains("high"));
    assert!(wrong(Thresholds::Share { below: 1.1, ratio: 0.4, least: 0.0 }).contains("below"));
    assert!(wrong(Thresholds::Share { below: 0.9, ratio: -0.4, least: 0.0 }).contains("ratio"));
    let (a, b) =
        (fixed(5.0, 6.0), CannyParams { blur: Some(Gaussian::new(1.1).unwrap()), ..fixed(5.0, 6.0) });
    assert_ne!(CannyProcessing::key_for(SensorId(0), &a), CannyProcessing::key_for(SensorId(0), &b));
}
