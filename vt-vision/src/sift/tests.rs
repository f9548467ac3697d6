use super::*;
use crate::matching::{MatchParams, Matcher};
use image::Luma;
use nalgebra::Vector2;
use proptest::prelude::*;
use vt_core::random::{Random, Stream};

/// A Gaussian blob: centre, deviation along x, stretch along y, height in grey levels.
type Blob = (Point2<f64>, f64, f64, f64);

/// Blobs on grey, drawn under a similarity `x ↦ scale · R(turn) x + shift`.
fn draw(size: (u32, u32), blobs: &[Blob], scale: f64, turn: f64, shift: Vector2<f64>) -> GrayImage {
    let (s, c) = math::sin_cos(turn);
    GrayImage::from_fn(size.0, size.1, |u, v| {
        let d = (Vector2::new(f64::from(u), f64::from(v)) - shift) / scale;
        let p = Point2::new(c * d.x + s * d.y, c * d.y - s * d.x);
        let grey: f64 = blobs
            .iter()
            .map(|(centre, sigma, stretch, height)| {
                let (x, y) = ((p.x - centre.x) / sigma, (p.y - centre.y) / (sigma * stretch));
                height * math::exp(-0.5 * (x * x + y * y))
            })
            .sum();
        Luma([(128.0 + grey).round().clamp(0.0, 255.0) as u8])
    })
}

fn sift(change: impl FnOnce(&mut SiftParams)) -> Sift {
    let mut params = SiftParams::default();
    change(&mut params);
    Sift::new(params).unwrap()
}

/// Many blobs of many sizes in a square of this side about the origin.
fn crowd(seed: u64, count: u32, half: f64) -> Vec<Blob> {
    let mut random = Random::new(seed, Stream::Sim, 0, 0, 0);
    (0..count)
        .map(|k| {
            let mut at = || half * (2.0 * random.uniform() - 1.0);
            let centre = Point2::new(at(), at());
            let sigma = 2.0 * math::pow(2.0, 1.5 * random.uniform());
            let height = if k % 2 == 0 { 60.0 } else { -60.0 };
            (centre, sigma, 0.6 + 0.3 * random.uniform(), height)
        })
        .collect()
}

/// A blob of deviation `t` is the strongest extremum at `t / √k` with the ratio `k` of the two Gaussians, at its centre whatever the
/// octave.
#[test]
fn blobs_are_found_at_their_centres_and_scales() {
    for doubled in [true, false] {
        let mut sift = sift(|p| p.doubled = doubled);
        for t in [3.0, 4.2, 6.0, 9.5, 13.0] {
            // Over five parts of a pixel of octaves up to the third: what parabolas are off by between pixels adds up to nothing.
            let mut sum = Vector2::zeros();
            for k in 0..5 {
                let centre = Point2::new(80.0 + 0.8 * f64::from(k), 70.0 + 0.8 * f64::from(2 * k % 5));
                let picture = draw((164, 146), &[(centre, t, 1.0, 100.0)], 1.0, 0.0, Vector2::zeros());
                sift.compute(&picture, None);
                let strongest =
                    sift.keypoints().iter().max_by(|a, b| a.response.total_cmp(&b.response)).unwrap();
                let error = (strongest.at - centre) / strongest.spacing;
                assert!(error.norm() < 0.08, "{t} at {centre}: {strongest:?}");
                sum += error;
                let expected = t * math::pow(2.0, -1.0 / 6.0);
                assert!((strongest.scale / expected - 1.0).abs() < 0.06, "{t}: {strongest:?}");
            }
            assert!(sum.norm() / 5.0 < 0.025, "{t}: {sum}");
        }
    }
}

/// Keypoints of a turned and scaled picture lie where the map says, without a shift, turned and scaled with it.
#[test]
fn keypoints_move_with_the_picture() {
    let blobs = crowd(4, 90, 70.0);
    let centre = Vector2::new(100.0, 100.0);
    let first = draw((200, 200), &blobs, 1.0, 0.0, centre);
    for root in [true, false] {
        let [mut a, mut b] = [sift(|p| p.root = root), sift(|p| p.root = root)];
        a.compute(&first, None);
        let mut matcher = Matcher::default();
        for (scale, turn, shift) in
            [(1.0, 0.0, (0.37, 0.61)), (1.0, 2.5, (0.0, 0.0)), (1.3, -0.7, (3.2, -1.4))]
        {
            let shift = centre + Vector2::new(shift.0, shift.1);
            b.compute(&draw((220, 220), &blobs, scale, turn, shift), None);
            let (s, c) = math::sin_cos(turn);
            let pairs = matcher.compute(a.descriptors(), b.descriptors(), &MatchParams::default());
            let (mut count, mut bias, mut square) = (0.0, Vector2::zeros(), 0.0);
            for pair in pairs {
                let (p, q) = (a.keypoints()[pair.first], b.keypoints()[pair.second]);
                let d = p.at.coords - centre;
                let error =
                    q.at.coords - (Vector2::new(c * d.x - s * d.y, s * d.x + c * d.y) * scale + shift);
                let turned = math::wrap_angle(q.angle - p.angle - turn).abs();
                let grown = math::ln(q.scale / (p.scale * scale)).abs();
                if error.norm() < 1.5 * scale && turned < 0.2 && grown < 0.2 {
                    count += 1.0;
                    bias += error;
                    square += error.norm_squared();
                }
            }
            assert!(
                count > 0.9 * pairs.len() as f64 && count > 60.0,
                "{count} of {} matches, {scale} {turn}",
                pairs.len()
            );
            let deviation = (square / count).sqrt();
            assert!((bias / count).norm() < 3.0 * deviation / f64::sqrt(count) + 0.01, "{}", bias / count);
            assert!(deviation < 0.3 * scale, "{deviation}");
        }
    }
}

#[test]
fn a_region_finds_what_the_picture_has_there() {
    let picture = draw((320, 240), &crowd(7, 400, 170.0), 1.0, 0.0, Vector2::new(160.0, 120.0));
    let (mut whole, mut part) = (sift(|_| ()), sift(|_| ()));
    whole.compute(&picture, None);
    let roi = Roi { x: 70, y: 55, width: 150, height: 120 };
    part.compute(&picture, Some(roi));
    let inside = |p: &Point2<f64>| (70.0..220.0).contains(&p.x) && (55.0..175.0).contains(&p.y);
    assert!(part.keypoints().iter().all(|k| inside(&k.at)) && part.keypoints().len() > 50);
    let small = |s: &Sift| {
        let all = s.keypoints().iter().zip(s.descriptors());
        let near = all.filter(|(k, _)| inside(&k.at) && k.scale < 1.8);
        near.map(|(k, d)| (*k, *d)).collect::<Vec<_>>()
    };
    let (expected, found) = (small(&whole), small(&part));
    assert!(expected.len() > 10);
    for (k, d) in &expected {
        let same = found.iter().any(|(other, e)| {
            (k.at - other.at).norm() < 1e-3 && d.0.iter().zip(e.0).all(|(a, b)| a.abs_diff(b) <= 1)
        });
        assert!(same, "{k:?}");
    }
    for roi in [Roi { x: 400, y: 0, width: 10, height: 10 }, Roi { x: 5, y: 5, width: 0, height: 9 }] {
        part.compute(&picture, Some(roi));
        assert!(part.keypoints().is_empty() && part.descriptors().is_empty());
    }
}

#[test]
fn threads_do_not_change_a_bit() {
    let picture = draw((300, 260), &crowd(9, 300, 130.0), 1.0, 0.3, Vector2::new(150.0, 130.0));
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut sift = sift(|_| ());
        pool.install(|| (0..2).for_each(|_| sift.compute(&picture, None)));
        (sift.keypoints().to_vec(), sift.descriptors().to_vec())
    };
    let one = run(1);
    assert!(one.0.len() > 100 && one == run(3));
}

#[test]
fn the_budget_keeps_the_strongest() {
    let picture = draw((300, 260), &crowd(9, 300, 130.0), 1.0, 0.3, Vector2::new(150.0, 130.0));
    let (mut all, mut some) = (sift(|_| ()), sift(|p| p.budget = 40));
    all.compute(&picture, None);
    some.compute(&picture, None);
    assert_eq!((some.keypoints().len(), some.descriptors().len()), (40, 40));
    let weakest = some.keypoints().iter().map(|k| k.response).fold(f64::INFINITY, f64::min);
    let stronger = all.keypoints().iter().filter(|k| k.response > weakest).count();
    assert!(stronger < 40, "{stronger}");
}

#[test]
fn descriptors_have_their_length() {
    let picture = draw((200, 200), &crowd(4, 90, 70.0), 1.0, 0.0, Vector2::new(100.0, 100.0));
    for root in [true, false] {
        let mut sift = sift(|p| p.root = root);
        sift.compute(&picture, None);
        for d in sift.descriptors() {
            let squared: f64 = d.0.iter().map(|&v| f64::from(v) * f64::from(v)).sum();
            assert!((squared.sqrt() / 512.0 - 1.0).abs() < 0.02, "{root} {}", squared.sqrt());
        }
    }
}

#[test]
fn parameters_out_of_range_are_refused() {
    let bad: [fn(&mut SiftParams); 7] = [
        |p| p.layers = 0,
        |p| p.sigma = f64::NAN,
        |p| p.input_blur = 0.8,
        |p| p.contrast = 0.0,
        |p| p.edge = f64::INFINITY,
        |p| p.budget = 0,
        |p| p.octaves = 0,
    ];
    for change in bad {
        let mut params = SiftParams::default();
        change(&mut params);
        assert!(Sift::new(params).is_err(), "{params:?}");
    }
}

proptest! {
    #[test]
    fn any_picture_of_any_size_is_read(
        (width, height) in (1u32..90, 1u32..70), seed in any::<u64>(), flat in any::<bool>(), doubled in any::<bool>(),
        (x, y, w, h) in (0u32..90, 0u32..90, 0u32..99, 0u32..99), whole in any::<bool>(), layers in 1usize..5,
    ) {
        let mut random = Random::new(seed, Stream::Sim, 0, 0, 0);
        let picture = GrayImage::from_fn(width, height, |_, _| Luma([if flat { 9 } else { random.index(256) as u8 }]));
        let mut sift = sift(|p| (p.doubled, p.layers, p.sigma) = (doubled, layers, 1.6));
        let roi = (!whole).then_some(Roi { x, y, width: w, height: h });
        sift.compute(&picture, roi);
        prop_assert_eq!(sift.keypoints().len(), sift.descriptors().len());
        for k in sift.keypoints() {
            prop_assert!((-1.0..f64::from(width) + 1.0).contains(&k.at.x) && (-1.0..f64::from(height) + 1.0).contains(&k.at.y));
            prop_assert!(k.scale > 0.0 && k.angle.is_finite() && k.response > 0.0);
        }
    }
}
