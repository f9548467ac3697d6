//! Data association: which detection belongs to which target.

use vt_core::agent::{Association, Associator, Costs};

/// Suboptimal nearest neighbour: the cheapest pair first, then the cheapest of the rest, and so on; a target keeps no
/// detection that costs more than its miss.
#[derive(Clone, Debug, Default)]
pub struct NearestNeighbour {
    order: Vec<(usize, usize)>,
    taken: Vec<bool>,
}

impl Associator for NearestNeighbour {
    fn associate(&mut self, costs: &Costs, out: &mut Association) {
        let n = costs.detections;
        out.weights.clear();
        out.weights.resize(costs.targets * n, 0.0);
        self.order.clear();
        let pairs = (0..costs.targets).flat_map(|t| (0..n).map(move |d| (t, d)));
        self.order.extend(pairs.filter(|&(t, d)| costs.pair[t * n + d] < costs.miss[t]));
        self.order.sort_by(|a, b| {
            costs.pair[a.0 * n + a.1].total_cmp(&costs.pair[b.0 * n + b.1]).then_with(|| a.cmp(b))
        });
        self.taken.clear();
        self.taken.resize(n, false);
        for &(t, d) in &self.order {
            let row = &mut out.weights[t * n..(t + 1) * n];
            if !self.taken[d] && row.iter().all(|&w| w == 0.0) {
                row[d] = 1.0;
                self.taken[d] = true;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cheapest_pairs_win_and_expensive_ones_stay_free() {
        let costs = Costs {
            targets: 3,
            detections: 3,
            pair: vec![4.0, 1.0, f64::INFINITY, 2.0, 0.5, f64::INFINITY, 9.0, 9.0, 30.0],
            miss: vec![9.0, 9.0, 20.0],
        };
        let mut out = Association::default();
        NearestNeighbour::default().associate(&costs, &mut out);
        assert_eq!(out.weights, [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn nothing_to_associate_is_no_fault() {
        let mut out = Association::default();
        NearestNeighbour::default()
            .associate(&Costs { targets: 2, miss: vec![1.0; 2], ..Costs::default() }, &mut out);
        assert!(out.weights.is_empty());
    }
}
