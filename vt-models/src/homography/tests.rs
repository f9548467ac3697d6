use super::*;
use proptest::prelude::*;
use vt_core::agent::{Posed, Warp};
use vt_core::laws::group;
use vt_core::random::{Random, Stream};

use crate::warp::PlanarWarp;

/// A square of 120 pixels, tilted.
fn tilted() -> SL3 {
    SL3::from_matrix(&Matrix3::new(1.1, 0.1, 200.0, -0.05, 0.9, 150.0, 4e-4, -6e-4, 1.0)).unwrap()
}

/// Points of the square with noise of one pixel, the first `wrong` of every ten anywhere.
fn noisy(count: u32, wrong: u32, noise: f64, random: &mut Random) -> Vec<Pair<Point2<f64>>> {
    let (warp, truth) = (PlanarWarp::default(), tilted());
    let pair = |k: u32| {
        let body = Point2::new(120.0 * random.uniform() - 60.0, 120.0 * random.uniform() - 60.0);
        let error = Vector2::new(random.normal(), random.normal()) * noise;
        let anywhere = Point2::new(640.0 * random.uniform(), 480.0 * random.uniform());
        let seen = if k % 10 < wrong { anywhere } else { warp.at(&truth).locate(&body).unwrap() + error };
        Pair { body, seen, deviation: 1.0 }
    };
    (0..count).map(pair).collect()
}

fn farthest(a: &SL3, b: &SL3) -> f64 {
    let warp = PlanarWarp::default();
    let at = |h: &SL3, x: f64, y: f64| warp.at(h).locate(&Point2::new(x, y)).unwrap();
    let corners = [(-60.0, -60.0), (60.0, -60.0), (60.0, 60.0), (-60.0, 60.0)];
    corners.iter().map(|&(x, y)| (at(a, x, y) - at(b, x, y)).norm()).fold(0.0, f64::max)
}

proptest! {
    #[test]
    fn exact_pairs_give_the_exact_homography(
        truth in group::<SL3>(0.5), points in prop::collection::vec(prop::array::uniform2(-0.4..0.4f64), 0..20),
        unit in prop_oneof![Just(1.0), Just(500.0)],
    ) {
        let warp = PlanarWarp::default();
        let corners = [[-0.4, -0.4], [0.4, -0.4], [0.4, 0.4], [-0.4, 0.4]];
        let pair = |x: &[f64; 2]| {
            let seen = warp.at(&truth).locate(&Point2::from(*x))?;
            Some(Pair { body: Point2::from(*x), seen: seen * unit, deviation: 1.0 })
        };
        let Some(pairs) = corners.iter().chain(&points).map(pair).collect::<Option<Vec<_>>>() else { return Ok(()) };
        let found = fit(pairs.iter()).unwrap();
        for pair in &pairs {
            let off = (warp.at(&found).locate(&pair.body).unwrap() - pair.seen).norm();
            prop_assert!(off < 1e-7 * unit * (1.0 + pair.seen.coords.norm()), "{}", off);
        }
    }

    /// Whatever the pairs are, a search ends, does not panic, and is the same again.
    #[test]
    fn any_pairs_are_searched(
        seed in any::<u64>(), count in 0u32..60, wrong in 0u32..11, ordered in any::<bool>(), grid in any::<bool>(), bad in any::<bool>(),
    ) {
        let mut random = Random::new(seed, Stream::Sim, 0, 0, 0);
        let mut pairs = noisy(count, wrong, 1.0, &mut random);
        for pair in &mut pairs {
            if grid {
                // Many equal and collinear points.
                pair.body = (pair.body / 60.0).map(f64::round);
                pair.seen = (pair.seen / 100.0).map(f64::round);
            }
            if bad && random.index(8) == 0 {
                pair.seen.x = [f64::NAN, f64::INFINITY, 1e200][random.index(3)];
            }
        }
        let params = ConsensusParams { ordered, most_samples: 300, ..ConsensusParams::default() };
        let mut search = Consensus::default();
        let mut run = || {
            let found = search.find(&pairs, &params, &mut Random::new(seed, Stream::Reinit, 0, 1, 0));
            (found, search.agreeing().to_vec())
        };
        let (found, agreeing) = run();
        prop_assert_eq!(&(found, agreeing.clone()), &run());
        prop_assert_eq!(found.is_some(), agreeing.len() >= 8);
    }
}

#[test]
fn the_majority_need_not_agree() {
    let mut search = Consensus::default();
    for trial in 0..50 {
        let mut random = Random::new(11, Stream::Sim, 0, trial, 0);
        let pairs = noisy(200, 6, 1.0, &mut random);
        let params = ConsensusParams { ordered: false, ..ConsensusParams::default() }.check().unwrap();
        let found = search.find(&pairs, &params, &mut random).unwrap();
        assert!(farthest(&found.homography, &tilted()) < 4.0, "{trial}");
        let right = search.agreeing().iter().filter(|&&k| k % 10 >= 6).count();
        assert!(
            right >= 68 && search.agreeing().len() - right <= 4,
            "{right} of {}",
            search.agreeing().len()
        );
        assert!(found.samples < 500);
    }
}

#[test]
fn order_saves_samples() {
    let (mut search, mut sums) = (Consensus::default(), [0; 2]);
    for trial in 0..40 {
        let mut random = Random::new(12, Stream::Sim, 0, trial, 0);
        let mut pairs = noisy(300, 7, 1.0, &mut random);
        // Right ones first, with some errors among them.
        let mut order: Vec<(f64, usize)> =
            (0..300).map(|k| (f64::from(u8::from(k % 10 < 7)) + random.uniform() * 1.3, k)).collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        pairs = order.iter().map(|&(_, k)| pairs[k]).collect();
        // A tenth of the samples is plenty where the first pairs can be trusted.
        for (sum, ordered) in sums.iter_mut().zip([true, false]) {
            let params = ConsensusParams { ordered, ..ConsensusParams::default() };
            let found = search.find(&pairs, &params, &mut random).unwrap();
            assert!(farthest(&found.homography, &tilted()) < 5.0);
            *sum += found.samples;
        }
    }
    assert!(10 * sums[0] < sums[1], "{sums:?}");
}

/// Something small that is there twice may have the matches that are trusted most.
#[test]
fn a_few_that_agree_come_first_in_vain() {
    let mut search = Consensus::default();
    for first in [8, 12] {
        for trial in 0..30 {
            let mut random = Random::new(15, Stream::Sim, 0, trial, 0);
            let mut pairs = noisy(220, 0, 0.5, &mut random);
            for pair in &mut pairs[..first] {
                pair.seen =
                    pair.body + Vector2::new(400.0 + 0.5 * random.normal(), 100.0 + 0.5 * random.normal());
            }
            search.find(&pairs, &ConsensusParams::default(), &mut random).unwrap();
            assert!(search.agreeing().len() > 190, "{first} {trial}: {}", search.agreeing().len());
        }
    }
}

#[test]
fn chance_and_lines_are_no_plane() {
    let (mut search, params) =
        (Consensus::default(), ConsensusParams { least_pairs: 10, ..ConsensusParams::default() });
    for trial in 0..20 {
        let mut random = Random::new(13, Stream::Sim, 0, trial, 0);
        assert_eq!(search.find(&noisy(60, 10, 1.0, &mut random), &params, &mut random), None);
        let mut line = noisy(60, 0, 0.5, &mut random);
        for pair in &mut line {
            pair.body.y = 0.3 * pair.body.x;
            pair.seen = PlanarWarp::default().at(&tilted()).locate(&pair.body).unwrap();
        }
        assert_eq!(search.find(&line, &params, &mut random), None);
        assert!(search.agreeing().is_empty());
    }
}

/// Parameters that nobody has checked, and numbers whose squares are beyond all bounds.
#[test]
fn odd_parameters_and_sizes_do_no_harm() {
    let mut random = Random::new(14, Stream::Sim, 0, 0, 0);
    let exact = noisy(20, 0, 0.0, &mut random);
    let mut search = Consensus::default();
    for (least_pairs, count) in [(0, 20), (0, 5), (0, 3), (usize::MAX, 20)] {
        let params = ConsensusParams { least_pairs, ..ConsensusParams::default() };
        let found = search.find(&exact[..count], &params, &mut random);
        assert_eq!(found.is_some(), least_pairs == 0 && count > 3, "{least_pairs} {count}");
    }
    for size in [1e-200, 1e160, 1e300] {
        let sized =
            |p: &Pair<Point2<f64>>| Pair { body: p.body * size, seen: p.seen * size, deviation: size };
        let huge: Vec<_> = exact.iter().map(sized).collect();
        let _ = (fit(huge.iter()), search.find(&huge, &ConsensusParams::default(), &mut random));
    }
}

#[test]
fn parameters_out_of_range_are_refused() {
    let good = ConsensusParams::default();
    for bad in [
        ConsensusParams { deviations: 0.0, ..good },
        ConsensusParams { confidence: 1.0, ..good },
        ConsensusParams { most_samples: 0, ..good },
        ConsensusParams { least_pairs: 4, ..good },
    ] {
        assert!(bad.check().is_err());
    }
}
