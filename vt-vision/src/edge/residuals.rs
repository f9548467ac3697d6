//! Noise of edge localisation, from the residuals of the matched contour.

/// Independent edge points that the expected localisation weighs as much as: with fewer matches it decides, with more
/// the picture does.
const TRUST: f64 = 6.0;

/// Share of wrong matches per share of contour without a match: where much of it has no edge, some of the edges are
/// those of something else, within the tolerance of a match.
const WRONG: f64 = 0.2;

/// Pairs of neighbours that the expected correlation weighs as much as.
const PAIRS: f64 = 10.0;

/// Highest correlation of neighbouring lines that is believed.
const MOST: f64 = 0.98;

/// Sums over the matched lines of one contour, in the order along its edges.
#[derive(Clone, Debug, Default)]
pub(super) struct Residuals {
    /// Weight of all lines of the contour.
    all: f64,
    count: f64,
    squares: f64,
    pairs: f64,
    power: f64,
    product: f64,
    expected: f64,
    before: Option<(u32, f64)>,
}

impl Residuals {
    pub fn clear(&mut self) {
        *self = Self::default();
    }

    /// A line of the contour, whether it was matched or not.
    pub fn expect(&mut self, weight: f64) {
        self.all += weight;
    }

    /// A line of the model edge `edge` that counts as `weight` independent ones, matched with `probability` at the
    /// distance `residual` (px) from the contour.
    pub fn add(&mut self, edge: u32, weight: f64, probability: f64, residual: f64) {
        self.count += weight * probability;
        self.squares += weight * probability * residual * residual;
        if probability <= 0.5 {
            self.before = None;
            return;
        }
        if let Some((other, r)) = self.before
            && other == edge
        {
            self.pairs += 1.0;
            self.power += 0.5 * (residual * residual + r * r);
            self.product += residual * r;
            self.expected += 1.0 - weight;
        }
        self.before = Some((edge, residual));
    }

    /// Variance of localisation (px²): mean of the scaled inverse χ² that `expected` (px) and the residuals give,
    /// which have lost `parameters` degrees of freedom to the pose, and of matches within `tolerance` (px, standard
    /// deviation) that are wrong.
    pub fn variance(&self, parameters: usize, expected: f64, tolerance: f64) -> f64 {
        let free = (self.count - parameters as f64).max(0.0);
        let unsupported = if self.all > 0.0 { 1.0 - self.count / self.all } else { 0.0 };
        let matched = (TRUST * expected * expected + self.squares) / (TRUST + free - 2.0);
        matched + WRONG * unsupported * tolerance * tolerance
    }

    /// How many times fewer independent lines there are than the correlation length says, by the correlation that
    /// neighbours have in this picture: for a first-order process the effective number is `(1 − ρ)/(1 + ρ)` of all,
    /// and the site weights are `1 − ρ₀`. Pulled to the expected correlation where there are few pairs.
    pub fn inflation(&self) -> f64 {
        if self.power <= 0.0 {
            return 1.0;
        }
        let expected = self.expected / self.pairs;
        let seen = self.pairs * self.product / self.power;
        let rho = ((PAIRS * expected + seen) / (PAIRS + self.pairs)).clamp(0.0, MOST);
        (1.0 - expected).max(1.0 - MOST) / (1.0 - rho)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vt_core::random::{Random, Stream};

    /// `n` lines of one edge with residuals of a first-order process of deviation `s` and correlation `rho`.
    fn process(n: usize, s: f64, rho: f64, weight: f64) -> Residuals {
        let mut random = Random::new(0, Stream::Sim, 0, 0, 0);
        let mut r = Residuals::default();
        let mut x = s * random.normal();
        for _ in 0..n {
            r.add(0, weight, 1.0, x);
            x = rho * x + (1.0 - rho * rho).sqrt() * s * random.normal();
        }
        r
    }

    #[test]
    fn few_residuals_leave_the_expected_noise_and_many_replace_it() {
        let prior = Residuals::default().variance(6, 0.05, 1.0);
        assert!(
            (prior - TRUST / (TRUST - 2.0) * 0.05f64.powi(2)).abs() < 1e-15,
            "mean of the scaled inverse χ²: {prior}"
        );
        let v = process(4000, 0.3, 0.0, 1.0).variance(6, 0.05, 1.0);
        assert!((v.sqrt() - 0.3).abs() < 0.02, "{v}");
    }

    #[test]
    fn contour_without_matches_widens_by_the_tolerance_of_a_match() {
        let [half, none] = [1.0, 0.0].map(|unmatched| {
            let mut r = process(400, 0.1, 0.0, 1.0);
            (0..400).for_each(|_| r.expect(1.0));
            (0..400).for_each(|_| r.expect(unmatched));
            r.variance(6, 0.05, 2.0)
        });
        assert!((half - none - WRONG * 0.5 * 4.0).abs() < 1e-12, "{half} {none}");
    }

    #[test]
    fn correlation_that_is_as_expected_changes_nothing_and_more_of_it_widens() {
        let as_expected = process(4000, 0.3, 0.6, 0.4).inflation();
        assert!((as_expected - 1.0).abs() < 0.15, "{as_expected}");
        assert!(process(4000, 0.3, 0.9, 0.4).inflation() > 3.0);
        assert!(process(4000, 0.3, 0.0, 0.4).inflation() < 0.6);
        assert_eq!(Residuals::default().inflation(), 1.0);
    }

    #[test]
    fn lines_of_different_edges_are_no_neighbours() {
        let mut r = Residuals::default();
        for k in 0..20 {
            r.add(k, 1.0, 1.0, 0.5);
        }
        assert_eq!(r.inflation(), 1.0);
    }
}
