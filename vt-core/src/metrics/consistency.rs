//! Whether covariances are honest: normalised squared errors against the χ² distribution.

use crate::math;

/// Interval that holds the mean of `samples` independent χ² values of `dof` degrees of freedom with probability
/// `confidence`, equal tails (Bar-Shalom, Li, Kirubarajan, 2001, §5.4.2).
pub fn mean_chi_square_interval(dof: f64, samples: usize, confidence: f64) -> (f64, f64) {
    let (n, tail) = (samples as f64, 0.5 * (1.0 - confidence));
    (math::chi_square_quantile(tail, n * dof) / n, math::chi_square_quantile(1.0 - tail, n * dof) / n)
}

/// Running record of normalised squared errors: NEES (estimate against truth, [`crate::belief::Gaussian::nees`]) or
/// NIS (prediction against measurement).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Consistency {
    sum: f64,
    dof: f64,
    samples: usize,
}

impl Consistency {
    /// Adds a value with its degrees of freedom.
    pub fn push(&mut self, value: f64, dof: usize) {
        self.sum += value;
        self.dof += dof as f64;
        self.samples += 1;
    }

    /// Number of values.
    pub fn samples(&self) -> usize {
        self.samples
    }

    /// Mean value; the mean number of degrees of freedom when covariances are honest. `None` without values.
    pub fn mean(&self) -> Option<f64> {
        (self.samples > 0).then(|| self.sum / self.samples as f64)
    }

    /// Mean per degree of freedom: above 1 overconfident, below 1 too cautious. `None` without degrees of freedom.
    pub fn ratio(&self) -> Option<f64> {
        (self.dof > 0.0).then(|| self.sum / self.dof)
    }

    /// Probability of a sum at least this large from honest covariances and independent values: near 0 overconfident,
    /// near 1 too cautious. `None` without degrees of freedom.
    pub fn p_value(&self) -> Option<f64> {
        (self.dof > 0.0).then(|| math::chi_square_survival(self.sum, self.dof))
    }

    /// True when the sum lies in the central interval of this probability.
    pub fn is_consistent(&self, confidence: f64) -> bool {
        let tail = 0.5 * (1.0 - confidence);
        self.p_value().is_some_and(|p| p >= tail && p <= 1.0 - tail)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector6;

    use super::*;
    use crate::belief::Gaussian;
    use crate::lie::{LieGroup, SE3};
    use crate::manifold::Manifold;
    use crate::random::{Random, Stream};

    #[test]
    fn the_interval_is_that_of_the_textbook() {
        // 50 runs, two degrees of freedom, 95 %: [1.5, 2.6] in the book's example.
        let (low, high) = mean_chi_square_interval(2.0, 50, 0.95);
        assert!((low - 1.4844).abs() < 1e-3 && (high - 2.5912).abs() < 1e-3, "{low} {high}");
    }

    #[test]
    fn honest_beliefs_pass_and_others_do_not() {
        let sigmas = Vector6::new(0.01, 0.02, 0.03, 0.1, 0.2, 0.05);
        let pose = SE3::exp(&Vector6::new(0.3, -1.2, 0.7, 0.5, -0.9, 1.1));
        let mut random = Random::new(3, Stream::Sim, 0, 0, 0);
        let mut records = [Consistency::default(); 3];
        for _ in 0..2000 {
            let truth = pose.retract(&sigmas.map(|s| s * random.normal()));
            for (record, claim) in records.iter_mut().zip([1.0, 0.8, 1.2]) {
                let belief = Gaussian::from_sigmas(pose, &(sigmas * claim));
                record.push(belief.nees(&truth).expect("regular"), 6);
            }
        }
        let [honest, proud, shy] = records;
        assert!(honest.is_consistent(0.999) && !proud.is_consistent(0.999) && !shy.is_consistent(0.999));
        assert!(proud.p_value() < Some(1e-6) && shy.p_value() > Some(1.0 - 1e-6));
        assert!((honest.mean().expect("values") - 6.0).abs() < 0.4 && honest.samples() == 2000);
        assert!((proud.ratio().expect("values") / honest.ratio().expect("values") - 1.0 / 0.64).abs() < 1e-9);
        assert_eq!((Consistency::default().mean(), Consistency::default().p_value()), (None, None));
    }
}
