//! Two classes told apart by one direction (Fisher, "The use of multiple measurements in taxonomic problems", 1936): colours of a target
//! against those around it.

use image::RgbImage;
use nalgebra::{SMatrix, SVector};
use thiserror::Error;
use vt_core::error::ConfigError;
use vt_core::frame::Roi;
use vt_core::math;

use crate::color::rows;
use crate::plane::{Plane, area, clip};

/// Why two classes cannot be told apart.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum DiscriminantError {
    /// Too few samples to have a covariance.
    #[error("class {class} has a weight of {weight}; expected more than 1")]
    TooFew {
        /// 1 or 2.
        class: usize,
        /// Sum of the weights of its samples.
        weight: f64,
    },
    /// Both classes have the same mean, or one is not finite.
    #[error("the means of both classes are the same, or not finite")]
    NoDirection,
    /// A parameter is out of its range.
    #[error(transparent)]
    Config(#[from] ConfigError),
}

/// Mean and covariance of the samples of a class.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClassStatistics<const N: usize> {
    weight: f64,
    mean: SVector<f64, N>,
    scatter: SMatrix<f64, N, N>,
}

impl<const N: usize> Default for ClassStatistics<N> {
    fn default() -> Self {
        Self { weight: 0.0, mean: SVector::zeros(), scatter: SMatrix::zeros() }
    }
}

impl<const N: usize> ClassStatistics<N> {
    /// Adds a sample (Welford's recursion).
    pub fn add(&mut self, sample: &SVector<f64, N>, weight: f64) {
        if weight <= 0.0 {
            return;
        }
        self.weight += weight;
        let from = sample - self.mean;
        self.mean += from * (weight / self.weight);
        self.scatter += from * (sample - self.mean).transpose() * weight;
    }

    /// Sum of the weights.
    pub fn weight(&self) -> f64 {
        self.weight
    }

    /// Mean of the samples.
    pub fn mean(&self) -> &SVector<f64, N> {
        &self.mean
    }

    /// Covariance of the samples; zero for a single one.
    pub fn covariance(&self) -> SMatrix<f64, N, N> {
        let covariance = self.scatter / (self.weight - 1.0).max(1.0);
        (covariance + covariance.transpose()) * 0.5
    }
}

impl ClassStatistics<3> {
    /// Adds the colours (red, green, blue; 0 to 255) of the part of a region that lies in the picture and not in `without`.
    pub fn add_region(&mut self, image: &RgbImage, region: Roi, without: Option<Roi>) {
        let region = clip(Some(region), image.dimensions(), 0);
        for (y, row) in (region.y..).zip(rows(image, region)) {
            for (x, p) in (region.x..).zip(row.chunks_exact(3)) {
                let left_out =
                    without.is_some_and(|r| x.wrapping_sub(r.x) < r.width && y.wrapping_sub(r.y) < r.height);
                if !left_out {
                    self.add(&SVector::from([p[0], p[1], p[2]].map(f64::from)), 1.0);
                }
            }
        }
    }
}

/// Direction `w = (S₁ + S₂ + ε I)⁻¹ (μ₁ − μ₂)`; along it, both classes are Gaussians of their own variance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FisherDiscriminant<const N: usize> {
    direction: SVector<f64, N>,
    means: [f64; 2],
    variances: [f64; 2],
    /// Coefficients of the log-odds of the first class in the score: square, linear, constant.
    odds: [f64; 3],
}

/// Parameters of [`FisherDiscriminant::fit`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DiscriminantParams {
    /// `ε` over the mean variance of both classes: keeps directions in which samples do not vary from deciding alone.
    pub regularization: f64,
    /// Probability of the first class before the sample is seen, between 0 and 1.
    pub prior: f64,
    /// Least deviation of a sample along every axis, such as that of rounding to whole numbers.
    pub least_deviation: f64,
}

impl Default for DiscriminantParams {
    fn default() -> Self {
        Self { regularization: 1e-3, prior: 0.5, least_deviation: 0.3 }
    }
}

impl DiscriminantParams {
    /// Checks all ranges.
    ///
    /// # Errors
    /// [`ConfigError::Parameter`] with the first parameter that is out of its range.
    pub fn check(self) -> Result<Self, ConfigError> {
        let Self { regularization, prior, least_deviation } = self;
        if !(regularization >= 0.0 && regularization.is_finite()) {
            return Err(ConfigError::parameter("regularization", regularization, "0 or more"));
        }
        if !(prior > 0.0 && prior < 1.0) {
            return Err(ConfigError::parameter("prior", prior, "between 0 and 1"));
        }
        if !(least_deviation > 0.0 && least_deviation.is_finite()) {
            return Err(ConfigError::parameter("least_deviation", least_deviation, "a positive number"));
        }
        Ok(self)
    }
}

impl<const N: usize> FisherDiscriminant<N> {
    /// Fits the direction and the two Gaussians.
    ///
    /// # Errors
    /// [`DiscriminantError`]: classes of too few samples or with the same mean, parameters out of range.
    pub fn fit(
        first: &ClassStatistics<N>,
        second: &ClassStatistics<N>,
        params: &DiscriminantParams,
    ) -> Result<Self, DiscriminantError> {
        let DiscriminantParams { regularization, prior, least_deviation } = params.check()?;
        for (class, statistics) in [(1, first), (2, second)] {
            if statistics.weight.is_nan() || statistics.weight <= 1.0 {
                return Err(DiscriminantError::TooFew { class, weight: statistics.weight });
            }
        }
        let floor = SMatrix::<f64, N, N>::identity() * (least_deviation * least_deviation);
        let covariances = [first, second].map(|s| s.covariance() + floor);
        let within = covariances[0] + covariances[1];
        let epsilon = regularization * within.trace() / N as f64;
        let apart = first.mean - second.mean;
        let within = within + SMatrix::identity() * epsilon;
        let direction = within.cholesky().map(|c| c.solve(&apart)).ok_or(DiscriminantError::NoDirection)?;
        let norm = direction.norm();
        if !(norm > 0.0 && norm.is_finite()) {
            return Err(DiscriminantError::NoDirection);
        }
        let direction = direction / norm;
        let means = [first, second].map(|s| direction.dot(&s.mean));
        let variances = covariances.map(|s| (s * direction).dot(&direction));
        // ln p(y | 1) − ln p(y | 2) + ln of the prior's odds.
        let [a, b] = variances.map(|v| 0.5 / v);
        let constant = b * means[1] * means[1] - a * means[0] * means[0]
            + 0.5 * math::ln(variances[1] / variances[0])
            + math::ln(prior / (1.0 - prior));
        let odds = [b - a, 2.0 * (a * means[0] - b * means[1]), constant];
        Ok(Self { direction, means, variances, odds })
    }

    /// Unit vector along which the classes differ most for their spread; the first class has the greater mean.
    pub fn direction(&self) -> &SVector<f64, N> {
        &self.direction
    }

    /// Means of the scores of both classes.
    pub fn means(&self) -> [f64; 2] {
        self.means
    }

    /// Variances of the scores of both classes.
    pub fn variances(&self) -> [f64; 2] {
        self.variances
    }

    /// Coordinate of a sample along the direction.
    #[inline]
    pub fn score(&self, sample: &SVector<f64, N>) -> f64 {
        self.direction.dot(sample)
    }

    /// Logarithm of the odds of the first class at a score.
    #[inline]
    pub fn log_odds(&self, score: f64) -> f64 {
        let [square, linear, constant] = self.odds;
        (square * score + linear) * score + constant
    }

    /// Probability of the first class at a score.
    pub fn posterior(&self, score: f64) -> f64 {
        math::logistic(self.log_odds(score))
    }

    /// Score between the two means at which both classes are equally probable; none where one class is the more probable at both
    /// means.
    pub fn threshold(&self) -> Option<f64> {
        let [mut high, mut low] = self.means;
        if !(self.log_odds(high) > 0.0 && self.log_odds(low) < 0.0) {
            return None;
        }
        // One sign change of a parabola between them: halving is as exact as the numbers.
        for _ in 0..200 {
            let middle = 0.5 * (low + high);
            if self.log_odds(middle) < 0.0 { low = middle } else { high = middle }
        }
        Some(0.5 * (low + high))
    }
}

/// Posterior of the first class for all colours of a picture, by a table over the score.
#[derive(Clone, Debug, Default)]
pub struct ColorPosterior {
    table: Vec<u8>,
}

/// Steps of the score in the table.
const STEPS: usize = 1024;

impl ColorPosterior {
    /// 255 times the posterior of the first class for every pixel of the picture, inside `roi` only when one is given; off by what
    /// the score changes in a 1024th of its range. Scores beyond the mean of a class count as that mean: what lies on the far side of the
    /// second class is not of the first, however wide that is.
    pub fn compute(
        &mut self,
        image: &RgbImage,
        roi: Option<Roi>,
        discriminant: &FisherDiscriminant<3>,
        out: &mut Plane<u8>,
    ) {
        let direction = discriminant.direction;
        let low: f64 = direction.iter().map(|w| w.min(0.0) * 255.0).sum();
        let high: f64 = direction.iter().map(|w| w.max(0.0) * 255.0).sum();
        let step = (high - low) / (STEPS - 1) as f64;
        self.table.clear();
        let [first, second] = discriminant.means;
        let score = |k: usize| (low + step * k as f64).clamp(second, first);
        let bytes = (0..STEPS).map(|k| (255.0 * discriminant.posterior(score(k))).round() as u8);
        self.table.extend(bytes);
        let region = clip(roi, image.dimensions(), 0);
        out.reserve(area(image.dimensions()));
        let values = out.reshape(region);
        let [r, g, b] = [0, 1, 2].map(|k| (direction[k] / step) as f32);
        let offset = 0.5 - (low / step) as f32;
        for (row, out) in rows(image, region).zip(values.chunks_exact_mut(region.width.max(1) as usize)) {
            for (p, o) in row.chunks_exact(3).zip(out) {
                let place = f32::from(p[0]) * r + f32::from(p[1]) * g + f32::from(p[2]) * b + offset;
                *o = self.table[(place as usize).min(STEPS - 1)];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Vector3};
    use proptest::prelude::*;
    use vt_core::random::{Random, Stream};

    fn draw(seed: u64, mean: Vector3<f64>, root: &Matrix3<f64>, count: u64) -> Vec<Vector3<f64>> {
        let mut random = Random::new(seed, Stream::Sim, 0, 0, 0);
        let mut normal = || random.normal();
        (0..count).map(|_| mean + root * Vector3::from_fn(|_, _| normal())).collect()
    }

    fn statistics(samples: &[Vector3<f64>]) -> ClassStatistics<3> {
        let mut s = ClassStatistics::default();
        samples.iter().for_each(|x| s.add(x, 1.0));
        s
    }

    proptest! {
        #[test]
        fn the_direction_separates_best_and_the_posterior_is_bayes(
            seed in 0u64..1000, angles in prop::collection::vec(-1.0..1.0f64, 3), prior in 0.05..0.95f64, place in -1.0..2.0f64,
        ) {
            let root = Matrix3::new(9.0, 0.0, 0.0, 5.0, 4.0, 0.0, -2.0, 3.0, 6.0);
            let first = statistics(&draw(seed, Vector3::new(120.0, 80.0, 60.0), &root, 200));
            let second = statistics(&draw(seed + 5000, Vector3::new(90.0, 100.0, 70.0), &(root * 1.7), 300));
            let params = DiscriminantParams { regularization: 0.0, prior, least_deviation: 1e-6 };
            let fisher = FisherDiscriminant::fit(&first, &second, &params).unwrap();
            let separation = |w: &Vector3<f64>| {
                let within = first.covariance() + second.covariance();
                (w.dot(&(first.mean() - second.mean()))).powi(2) / (within * w).dot(w)
            };
            let other = fisher.direction() + Vector3::from_vec(angles);
            prop_assert!(separation(fisher.direction()) >= separation(&other) - 1e-9);
            prop_assert!(fisher.means()[0] > fisher.means()[1]);

            let [m, n] = fisher.means();
            let y = n + place * (m - n);
            let density = |k: usize| {
                let (mean, variance) = (fisher.means()[k], fisher.variances()[k]);
                math::exp(-0.5 * (y - mean).powi(2) / variance) / variance.sqrt()
            };
            let exact = prior * density(0) / (prior * density(0) + (1.0 - prior) * density(1));
            prop_assert!((fisher.posterior(y) - exact).abs() < 1e-9);
            if let Some(threshold) = fisher.threshold() {
                prop_assert!(threshold > n && threshold < m);
                prop_assert!((fisher.posterior(threshold) - 0.5).abs() < 1e-9);
            }
        }

        #[test]
        fn statistics_are_those_of_all_samples(values in prop::collection::vec(prop::array::uniform3(0.0..255.0f64), 2..30)) {
            let samples: Vec<Vector3<f64>> = values.into_iter().map(Vector3::from).collect();
            let found = statistics(&samples);
            let n = samples.len() as f64;
            let mean = samples.iter().sum::<Vector3<f64>>() / n;
            let covariance = samples.iter().map(|s| (s - mean) * (s - mean).transpose()).sum::<Matrix3<f64>>() / (n - 1.0);
            prop_assert!((found.mean() - mean).amax() < 1e-9 && (found.covariance() - covariance).amax() < 1e-8);
        }
    }

    #[test]
    fn a_target_is_told_from_its_surroundings() {
        let target = Roi { x: 20, y: 15, width: 12, height: 10 };
        let image = RgbImage::from_fn(60, 40, |x, y| {
            let inside = (20..32).contains(&x) && (15..25).contains(&y);
            let noise = ((x * 7 + y * 13) % 9) as u8;
            image::Rgb(if inside { [150 + noise, 90, 60 + noise] } else { [90 + noise, 95, 90 - noise] })
        });
        let (mut first, mut second) = (ClassStatistics::default(), ClassStatistics::default());
        first.add_region(&image, target, None);
        second.add_region(&image, Roi { x: 10, y: 5, width: 32, height: 30 }, Some(target));
        assert_eq!((first.weight(), second.weight()), (120.0, 840.0));
        let fisher = FisherDiscriminant::fit(&first, &second, &DiscriminantParams::default()).unwrap();
        let (mut posterior, mut plane) = (ColorPosterior::default(), Plane::default());
        posterior.compute(&image, None, &fisher, &mut plane);
        for (k, &byte) in (0u32..).zip(plane.values()) {
            let (x, y) = (k % 60, k / 60);
            let inside = (20..32).contains(&x) && (15..25).contains(&y);
            assert_eq!(byte > 127, inside, "{x} {y}");
            let p = image.get_pixel(x, y).0.map(f64::from);
            let [high, low] = fisher.means();
            let exact = 255.0 * fisher.posterior(fisher.score(&p.into()).clamp(low, high));
            assert!((f64::from(byte) - exact).abs() < 25.0, "{byte} {exact}");
        }
    }

    #[test]
    fn classes_that_cannot_be_told_apart_are_refused() {
        let samples = draw(1, Vector3::repeat(50.0), &Matrix3::identity(), 30);
        let (class, one) = (statistics(&samples), statistics(&samples[..1]));
        let fit = |a: &_, b: &_, p: DiscriminantParams| FisherDiscriminant::fit(a, b, &p);
        let params = DiscriminantParams::default();
        assert_eq!(fit(&class, &one, params), Err(DiscriminantError::TooFew { class: 2, weight: 1.0 }));
        assert_eq!(fit(&class, &class, params), Err(DiscriminantError::NoDirection));
        for prior in [0.0, 1.0, f64::NAN] {
            let error = fit(&class, &one, DiscriminantParams { prior, ..params }).unwrap_err();
            assert!(error.to_string().contains("prior"));
        }
        // Samples without any spread have that of rounding.
        let (mut a, mut b) = (ClassStatistics::<1>::default(), ClassStatistics::default());
        for _ in 0..5 {
            a.add(&SVector::from([10.0]), 1.0);
            b.add(&SVector::from([12.0]), 1.0);
        }
        let fisher = FisherDiscriminant::fit(&a, &b, &params).unwrap();
        assert!((fisher.threshold().unwrap() + 11.0).abs() < 1e-9 && fisher.posterior(-10.0) > 0.99);
    }
}
