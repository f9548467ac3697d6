//! The homography that most pairs agree with: random samples of four, the good ones improved on all pairs that agree.
//!
//! M. Fischler and R. Bolles, "Random sample consensus", 1981, with truncated quadratic costs (P. Torr, A. Zisserman, "MLESAC",
//! 2000), local optimisation (O. Chum, J. Matas, J. Kittler, "Locally optimized RANSAC", 2003), and samples from the most trusted
//! pairs first (O. Chum, J. Matas, "Matching with PROSAC", 2005).

use nalgebra::{Matrix2, Point2, Vector2};
use vt_core::agent::{Posed, Warp};
use vt_core::error::ConfigError;
use vt_core::least_squares::symmetric_eigen;
use vt_core::lie::SL3;
use vt_core::math;
use vt_core::random::Random;

use super::fit;
use crate::reprojection::Pair;
use crate::warp::PlanarWarp;

/// Pairs of a sample.
const SAMPLE: usize = 4;

/// Factors of the bound under which pairs agree, one for each improvement of a sample's homography.
const WIDENING: [f64; 6] = [3.0, 2.0, 1.5, 1.0, 1.0, 1.0];

/// Fewest samples of ordered pairs: a few wrong ones that agree may come first, and by these alone a search would end at once. Enough
/// for a dozen of them.
const LEAST_SAMPLES: u32 = 50;

/// Least sine of an angle of a triangle of a sample.
const LEAST_SINE: f64 = 0.05;

/// Least ratio of the principal deviations of the points that agree: what lies along a line determines no homography.
const LEAST_SPREAD: f64 = 0.02;

/// When pairs agree, and how long is searched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConsensusParams {
    /// Largest distance of a pair that agrees, in its deviations; three hold 98.9 % of what is normal in two coordinates.
    pub deviations: f64,
    /// Probability that at least one sample had pairs only that agree; then the search ends.
    pub confidence: f64,
    /// Most samples. Ordered ones take in at most one more pair a sample: what lies farther back than this is only fitted to.
    pub most_samples: u32,
    /// Fewest pairs that must agree.
    pub least_pairs: usize,
    /// Whether pairs come in the order of falling trust, as by the ratio of their matches: the first ones are tried first, and after
    /// 50 samples may end the search by themselves. False for pairs in any other order.
    pub ordered: bool,
}

impl Default for ConsensusParams {
    fn default() -> Self {
        Self { deviations: 3.0, confidence: 0.999, most_samples: 2000, least_pairs: 8, ordered: true }
    }
}

impl ConsensusParams {
    /// Checks the parameters.
    ///
    /// # Errors
    /// [`ConfigError::Parameter`] with the first that is out of its range.
    pub fn check(self) -> Result<Self, ConfigError> {
        if !(self.deviations > 0.0 && self.deviations.is_finite()) {
            return Err(ConfigError::parameter("deviations", self.deviations, "a positive number"));
        }
        if !(self.confidence > 0.0 && self.confidence < 1.0) {
            return Err(ConfigError::parameter("confidence", self.confidence, "between 0 and 1"));
        }
        if self.most_samples == 0 {
            return Err(ConfigError::parameter("most_samples", self.most_samples, "at least 1"));
        }
        if self.least_pairs <= SAMPLE {
            return Err(ConfigError::parameter(
                "least_pairs",
                self.least_pairs,
                "more than 4, which always agree",
            ));
        }
        Ok(self)
    }
}

/// What a search found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// Fitted to pairs that agree, in algebraic error; that of the best sample where no fit is better.
    pub homography: SL3,
    /// Sum over all pairs of the squared distance in deviations, at most that of a pair that just agrees.
    pub cost: f64,
    /// Samples drawn.
    pub samples: u32,
}

/// Search with buffers that are used again.
#[derive(Clone, Debug, Default)]
pub struct Consensus {
    agreeing: Vec<u32>,
    trial: Vec<u32>,
}

impl Consensus {
    /// Indices of the pairs that agree with what was found last.
    pub fn agreeing(&self) -> &[u32] {
        &self.agreeing
    }

    /// Searches for the homography that most pairs agree with. None where too few do, or where these lie along a line. The same
    /// pairs and random numbers give the same result.
    pub fn find(
        &mut self,
        pairs: &[Pair<Point2<f64>>],
        params: &ConsensusParams,
        random: &mut Random,
    ) -> Option<Found> {
        self.agreeing.clear();
        let count = pairs.len();
        if count < params.least_pairs.max(SAMPLE) {
            return None;
        }
        let mut growth = Growth::new(count, params);
        let mut best: Option<Found> = None;
        let least = if params.ordered { LEAST_SAMPLES.min(params.most_samples) } else { 0 };
        let (mut among, mut needed) = (count, f64::INFINITY);
        let mut samples = 0;
        while samples < params.most_samples && (samples < least || f64::from(samples) < needed) {
            if samples >= least {
                growth.limit(among);
            }
            samples += 1;
            let sample = growth.sample(samples, random);
            let Some(homography) = from_sample(sample.map(|k| &pairs[k])) else { continue };
            let most = best.map_or(f64::INFINITY, |b| b.cost);
            let Some(cost) = agreement(&homography, pairs, params, 1.0, most, &mut self.trial) else {
                continue;
            };
            let found = self.improve(pairs, params, Found { homography, cost, samples });
            // The trial holds those that agree.
            core::mem::swap(&mut self.agreeing, &mut self.trial);
            best = Some(found);
            (among, needed) = self.enough(count, params);
        }
        let found = best.filter(|_| self.agreeing.len() >= params.least_pairs && self.is_spread(pairs));
        if found.is_none() {
            self.agreeing.clear();
        }
        found.map(|f| Found { samples, ..f })
    }

    /// Fits to pairs that agree under ever smaller bounds and keeps the best; leaves those that agree with it in the trial.
    fn improve(&mut self, pairs: &[Pair<Point2<f64>>], params: &ConsensusParams, start: Found) -> Found {
        let mut best = start;
        // A sample is seldom as exact as its pairs: others that belong to it lie beyond the bound.
        agreement(&start.homography, pairs, params, WIDENING[0], f64::INFINITY, &mut self.trial);
        for &wide in &WIDENING[1..] {
            let Some(homography) = fit(self.trial.iter().map(|&k| &pairs[k as usize])) else { break };
            let cost = agreement(&homography, pairs, params, wide, f64::INFINITY, &mut self.trial);
            if let Some(cost) = cost.filter(|&c| c < best.cost) {
                best = Found { homography, cost, ..best };
            }
        }
        agreement(&best.homography, pairs, params, 1.0, f64::INFINITY, &mut self.trial);
        best
    }

    /// From how many of the first pairs samples need to be taken, and how many samples, so that one of them with the given confidence
    /// has pairs only that agree. Where pairs are not ordered, from all.
    fn enough(&self, count: usize, params: &ConsensusParams) -> (usize, f64) {
        let needed = |agreeing: usize, among: usize| {
            let share = agreeing as f64 / among as f64;
            let pure = share.powi(SAMPLE as i32).min(1.0 - 1e-12);
            math::ln_1p(-params.confidence) / math::ln_1p(-pure)
        };
        let mut best = (count, needed(self.agreeing.len(), count));
        if params.ordered {
            // The share is highest just after a pair that agrees. Few pairs might agree by chance.
            for (k, &last) in (1..).zip(&self.agreeing).skip(params.least_pairs.saturating_sub(1)) {
                let samples = needed(k, last as usize + 1);
                if samples < best.1 {
                    best = (last as usize + 1, samples);
                }
            }
        }
        best
    }

    /// Whether the points that agree spread in two directions, on the plane and in the picture.
    fn is_spread(&self, pairs: &[Pair<Point2<f64>>]) -> bool {
        let wide = |at: fn(&Pair<Point2<f64>>) -> Point2<f64>| {
            let points = || self.agreeing.iter().map(|&k| at(&pairs[k as usize]).coords);
            let mean = points().sum::<Vector2<f64>>() / self.agreeing.len() as f64;
            let scatter: Matrix2<f64> = points().map(|p| (p - mean) * (p - mean).transpose()).sum();
            let (values, _) = symmetric_eigen(&scatter);
            values.min() > LEAST_SPREAD * LEAST_SPREAD * values.max()
        };
        wide(|p| p.body) && wide(|p| p.seen)
    }
}

/// Cost of a homography, none as soon as it reaches `most`, and the pairs that agree with it under a bound that is wider by a factor.
fn agreement(
    homography: &SL3,
    pairs: &[Pair<Point2<f64>>],
    params: &ConsensusParams,
    wide: f64,
    most: f64,
    agreeing: &mut Vec<u32>,
) -> Option<f64> {
    agreeing.clear();
    let (warp, limit) = (PlanarWarp::default(), params.deviations * params.deviations);
    let posed = warp.at(homography);
    let mut cost = 0.0;
    for (k, pair) in (0..).zip(pairs) {
        let off = posed.locate(&pair.body).map_or(f64::INFINITY, |y| (pair.seen - y).norm_squared());
        let off = off / (pair.deviation * pair.deviation);
        if off <= limit * wide * wide {
            agreeing.push(k);
        }
        cost += off.min(limit);
        if cost >= most {
            return None;
        }
    }
    Some(cost)
}

/// The homography of four pairs. None where three points are nearly on a line, or where corners change their sense: what is seen
/// from the front keeps it.
fn from_sample(sample: [&Pair<Point2<f64>>; SAMPLE]) -> Option<SL3> {
    let (from, to) = (sample.map(|p| p.body), sample.map(|p| p.seen));
    let corner = |p: &[Point2<f64>; SAMPLE], [a, b, c]: [usize; 3]| {
        let (u, v) = (p[b] - p[a], p[c] - p[a]);
        let area = u.perp(&v);
        (area.abs() > LEAST_SINE * u.norm() * v.norm()).then_some(area)
    };
    for triple in [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]] {
        if corner(&from, triple)? * corner(&to, triple)? <= 0.0 {
            return None;
        }
    }
    SL3::from_points(&from, &to)
}

/// From how many of the first pairs samples are taken (PROSAC, §2.1).
struct Growth {
    count: usize,
    pool: usize,
    /// Samples of the pool among as many of all as are drawn at most, and the number of the last sample of the pool.
    expected: f64,
    last: f64,
}

impl Growth {
    fn new(count: usize, params: &ConsensusParams) -> Self {
        let part = |k: usize| (SAMPLE - k) as f64 / (count - k) as f64;
        let expected = f64::from(params.most_samples) * (0..SAMPLE).map(part).product::<f64>();
        Self { count, pool: if params.ordered { SAMPLE } else { count }, expected, last: 1.0 }
    }

    /// Takes samples from so many of the first pairs only.
    fn limit(&mut self, count: usize) {
        self.count = count;
        self.pool = self.pool.min(count);
    }

    /// Indices of the sample with this number, counted from one.
    fn sample(&mut self, number: u32, random: &mut Random) -> [usize; SAMPLE] {
        while self.pool < self.count && f64::from(number) > self.last {
            self.pool += 1;
            let next = self.expected * self.pool as f64 / (self.pool - SAMPLE) as f64;
            self.last += (next - self.expected).ceil();
            self.expected = next;
        }
        let mut sample = [usize::MAX; SAMPLE];
        // The last of the pool is new, and any sample of the others has had its turn.
        let (free, among) =
            if self.pool < self.count { (SAMPLE - 1, self.pool - 1) } else { (SAMPLE, self.count) };
        sample[free..].fill(self.pool - 1);
        // R. Floyd's way to distinct numbers.
        for (k, top) in (among - free..among).enumerate() {
            let drawn = random.index(top + 1);
            sample[k] = if sample[..k].contains(&drawn) { top } else { drawn };
        }
        sample
    }
}
