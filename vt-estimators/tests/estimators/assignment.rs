//! Nearest neighbour against exhaustive search.

use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use vt_core::agent::{Association, Associator, Costs};
use vt_estimators::association::NearestNeighbour;

fn associate(costs: &Costs) -> Vec<Option<usize>> {
    let mut out = Association::default();
    NearestNeighbour::default().associate(costs, &mut out);
    assert_eq!(out.weights.len(), costs.targets * costs.detections);
    assert!(out.weights.iter().all(|w| *w == 0.0 || *w == 1.0), "hard");
    (0..costs.targets)
        .map(|t| {
            let row = &out.weights[t * costs.detections..(t + 1) * costs.detections];
            assert!(row.iter().sum::<f64>() <= 1.0, "a target has one detection at most");
            row.iter().position(|w| *w == 1.0)
        })
        .collect()
}

fn total(costs: &Costs, chosen: &[Option<usize>]) -> f64 {
    let one = |(t, d): (usize, &Option<usize>)| match d {
        Some(d) => costs.pair[t * costs.detections + d],
        None => costs.miss[t],
    };
    chosen.iter().enumerate().map(one).sum()
}

/// The cheapest of all assignments, by trying all.
fn cheapest(costs: &Costs, chosen: &mut Vec<Option<usize>>) -> f64 {
    if chosen.len() == costs.targets {
        return total(costs, chosen);
    }
    let free = (0..costs.detections).filter(|d| !chosen.contains(&Some(*d))).map(Some);
    let choices: Vec<Option<usize>> = free.chain([None]).collect();
    let try_one = |choice| {
        chosen.push(choice);
        let cost = cheapest(costs, chosen);
        chosen.pop();
        cost
    };
    choices.into_iter().map(try_one).fold(f64::INFINITY, f64::min)
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 300, rng_seed: RngSeed::Fixed(4), failure_persistence: None, ..ProptestConfig::default()
    })]

    #[test]
    fn every_pick_is_the_cheapest_that_remains(
        (targets, detections) in (0_usize..5, 0_usize..5),
        raw in prop::collection::vec(0.0..1.0_f64, 25),
        gates in prop::collection::vec(0.1..1.2_f64, 5),
    ) {
        let mut pair = raw[..targets * detections].to_vec();
        pair.iter_mut().filter(|c| **c > 0.8).for_each(|c| *c = f64::INFINITY);
        let costs = Costs { targets, detections, pair, miss: gates[..targets].to_vec() };
        let found = associate(&costs);

        // One pick after the other, each by a search of the whole table.
        let mut expected = vec![None; targets];
        loop {
            let mut best: Option<(f64, usize, usize)> = None;
            for t in (0..targets).filter(|t| expected[*t].is_none()) {
                for d in (0..detections).filter(|d| !expected.contains(&Some(*d))) {
                    let c = costs.pair[t * detections + d];
                    if c < costs.miss[t] && best.is_none_or(|(least, ..)| c < least) {
                        best = Some((c, t, d));
                    }
                }
            }
            let Some((_, t, d)) = best else { break };
            expected[t] = Some(d);
        }
        prop_assert_eq!(&found, &expected);

        // Every pick is worth it, hence better than no association; never better than the best.
        let greedy = total(&costs, &found);
        prop_assert!(greedy <= costs.miss.iter().sum::<f64>());
        prop_assert!(greedy >= cheapest(&costs, &mut vec![]) - 1e-12);
        // With one target or one detection there is nothing to trade: it is the best.
        if targets.min(detections) == 1 && costs.miss.windows(2).all(|m| m[0] == m[1]) {
            prop_assert!((greedy - cheapest(&costs, &mut vec![])).abs() < 1e-12);
        }
    }
}

/// What greed costs: the pair at 1 leaves 9, where 2 + 3 was to be had.
#[test]
fn the_sum_need_not_be_the_least() {
    let costs = Costs { targets: 2, detections: 2, pair: vec![1.0, 2.0, 3.0, 9.0], miss: vec![20.0; 2] };
    assert_eq!(associate(&costs), [Some(0), Some(1)]);
    assert_eq!((total(&costs, &associate(&costs)), cheapest(&costs, &mut vec![])), (10.0, 5.0));
}

#[test]
fn costs_that_are_no_numbers_are_no_pairs() {
    let costs = Costs { targets: 1, detections: 2, pair: vec![f64::NAN, 3.0], miss: vec![5.0] };
    assert_eq!(associate(&costs), [Some(1)]);
}
