//! Similarities by regression of the picture's grey levels on the template's: SSD with gain and bias, ZNCC, SCV.
//!
//! All three explain the picture as `I ≈ f(T)` and look at `r = f(T) − I`: `f` is a line, or for SCV the continuous
//! polygon that fits best (where R. Richa et al., "Visual tracking using the sum of conditional variance", 2011, take the
//! mean in each bin, which does not explain a change of gain exactly). `f` is found anew in every step, so by the envelope
//! theorem the derivatives of the cost are those with `f` held (variable projection; L. Kaufman, 1975).
//!
//! ```text
//! SSD, SCV:  C = ½ Σ w r²                          ∂C/∂t = w f'(t) r        ∂C/∂i = −w r
//! ZNCC:      C = 1 − ρ,  t̂, î centred, of length 1   ∂C/∂t = w (ρ t̂ − î)/‖t‖  ∂C/∂i = w (ρ î − t̂)/‖i‖
//! ```
//!
//! Curvature: Gauss–Newton's `Σ w J Jᵀ` with `J = f' ∇T G` or the mean of that and the picture's `∇I G`, less what `f` explains.

use nalgebra::{Cholesky, Const, SMatrix, SVector};
use vt_core::batch::{LANES, Row, vectorized};

use super::measure::{Influence, Measure, Pair};
use super::params::Similarity;
use super::steepest::{self, Gradients, Matrix8, NOTHING, Points, add, add_products, whole};

/// Knots of the curve of SCV.
pub(super) const KNOTS: usize = 16;

/// Variance of grey levels below which a picture is flat.
const FLAT: f64 = 0.25;

/// Weight of the curve's bends against a knot's share of the points: enough where a knot has none.
const STIFFNESS: f64 = 1e-3;

/// A continuous polygon over grey levels of the template.
#[derive(Clone, Debug)]
pub(super) struct Curve {
    low: f64,
    /// Knots a grey level.
    density: f64,
    factor: Option<Cholesky<f64, Const<KNOTS>>>,
    values: SVector<f64, KNOTS>,
}

impl Default for Curve {
    fn default() -> Self {
        Self { low: 0.0, density: 1.0, factor: None, values: SVector::zeros() }
    }
}

impl Curve {
    /// Knot below a grey level, and how far it lies towards the next one.
    #[inline(always)]
    fn place(&self, level: f64) -> (usize, f64) {
        let at = ((level - self.low) * self.density).clamp(0.0, (KNOTS - 1) as f64);
        let knot = (at as usize).min(KNOTS - 2);
        (knot, at - knot as f64)
    }

    /// The curve over `levels` that fits `values` best; `None` without weights.
    pub fn fit(&mut self, levels: &[Row], values: &[Row], weights: &[Row]) -> Option<()> {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        let mut sum = 0.0;
        for (levels, weights) in levels.iter().zip(weights) {
            for k in (0..LANES).filter(|&k| weights[k] > 0.0) {
                (low, high) = (low.min(levels[k]), high.max(levels[k]));
                sum += weights[k];
            }
        }
        if low >= high {
            return None;
        }
        (self.low, self.density) = (low, (KNOTS - 1) as f64 / (high - low));
        let (mut diagonal, mut beside, mut right) = ([0.0; KNOTS], [0.0; KNOTS], SVector::zeros());
        for ((levels, values), weights) in levels.iter().zip(values).zip(weights) {
            for k in (0..LANES).filter(|&k| weights[k] > 0.0) {
                let (knot, u) = self.place(levels[k]);
                let (w, v) = (weights[k], 1.0 - u);
                diagonal[knot] += w * v * v;
                diagonal[knot + 1] += w * u * u;
                beside[knot] += w * u * v;
                right[knot] += w * v * values[k];
                right[knot + 1] += w * u * values[k];
            }
        }
        let mut gram = SMatrix::<f64, KNOTS, KNOTS>::from_diagonal(&diagonal.into());
        for k in 0..KNOTS - 1 {
            (gram[(k, k + 1)], gram[(k + 1, k)]) = (beside[k], beside[k]);
        }
        let stiffness = STIFFNESS * sum / KNOTS as f64;
        for k in 1..KNOTS - 1 {
            let bend = [1.0, -2.0, 1.0];
            for (i, a) in bend.iter().enumerate() {
                for (j, b) in bend.iter().enumerate() {
                    gram[(k - 1 + i, k - 1 + j)] += stiffness * a * b;
                }
            }
        }
        let factor = Cholesky::new(gram)?;
        self.values = factor.solve(&right);
        self.factor = Some(factor);
        Some(())
    }

    /// Takes from `values` the curve over `levels` that fits them best; `None` without weights.
    pub fn centre(&mut self, levels: &[Row], values: &mut [Row], weights: &[Row]) -> Option<()> {
        self.fit(levels, values, weights)?;
        for ((values, levels), weights) in values.iter_mut().zip(levels).zip(weights) {
            (0..LANES).filter(|&k| weights[k] > 0.0).for_each(|k| values[k] -= self.at(levels[k])[0]);
        }
        Some(())
    }

    /// Value and slope at a grey level of the template.
    #[inline(always)]
    pub fn at(&self, level: f64) -> [f64; 2] {
        let (knot, u) = self.place(level);
        let step = self.values[knot + 1] - self.values[knot];
        [self.values[knot] + u * step, step * self.density]
    }

    /// Cost of the curve's own bends, part of what [`Curve::fit`] minimises.
    fn bending(&self, sum: f64) -> f64 {
        let v = &self.values;
        let bends = (1..KNOTS - 1).map(|k| v[k - 1] - 2.0 * v[k] + v[k + 1]);
        0.5 * STIFFNESS * sum / KNOTS as f64 * bends.map(|b| b * b).sum::<f64>()
    }

    /// What the curve explains of `Σ w J Jᵀ`.
    fn explained(&self, pair: Pair, points: &Points, g: &Gradients) -> Matrix8 {
        let Some(factor) = &self.factor else { return Matrix8::zeros() };
        let mut cross = SMatrix::<f64, KNOTS, 8>::zeros();
        for b in 0..points.x.len() {
            let j = steepest::rows(&points.x[b], &points.y[b], &g.x[b], &g.y[b]);
            let w = &pair.weight[b];
            for k in (0..LANES).filter(|&k| w[k] > 0.0) {
                let (knot, u) = self.place(pair.template[b][k]);
                let (here, next) = (w[k] * (1.0 - u), w[k] * u);
                for r in 0..8 {
                    cross[(knot, r)] += here * j[r][k];
                    cross[(knot + 1, r)] += next * j[r][k];
                }
            }
        }
        cross.tr_mul(&factor.solve(&cross))
    }
}

/// Moments of the grey levels, about their means.
#[derive(Clone, Copy, Debug, Default)]
struct Line {
    sum: f64,
    mean: [f64; 2],
    /// Lengths of template and picture.
    length: [f64; 2],
    correlation: f64,
}

impl Line {
    fn fit(pair: Pair) -> Option<Self> {
        let mut s = [[0.0; 8]; 6];
        for ((t, i), w) in pair.template.iter().zip(pair.picture).zip(pair.weight) {
            vectorized(
                #[inline(always)]
                || {
                    let (mut wt, mut wi) = (NOTHING, NOTHING);
                    for k in 0..LANES {
                        (wt[k], wi[k]) = (w[k] * t[k], w[k] * i[k]);
                    }
                    add(&mut s[0], w);
                    add(&mut s[1], &wt);
                    add(&mut s[2], &wi);
                    add_products(&mut s[3], &wt, t);
                    add_products(&mut s[4], &wt, i);
                    add_products(&mut s[5], &wi, i);
                },
            );
        }
        let [n, t, i, tt, ti, ii] = s.map(whole);
        let (tt, ti, ii) = (tt - t * t / n, ti - t * i / n, ii - i * i / n);
        if !(n > 0.0 && tt > FLAT * n && ii > FLAT * n) {
            return None;
        }
        let length = [tt.sqrt(), ii.sqrt()];
        Some(Self { sum: n, mean: [t / n, i / n], length, correlation: ti / (length[0] * length[1]) })
    }

    /// Ratio of the deviations.
    fn ratio(&self) -> f64 {
        self.length[1] / self.length[0]
    }
}

/// SSD, ZNCC or SCV.
#[derive(Clone, Debug)]
pub(super) struct Regression {
    similarity: Similarity,
    line: Line,
    curve: Curve,
    residual: Vec<Row>,
    /// How much of the template's slope the picture should show.
    gain: Vec<Row>,
    score: f64,
}

impl Regression {
    pub fn new(similarity: Similarity) -> Self {
        let (line, curve) = Default::default();
        Self { similarity, line, curve, residual: vec![], gain: vec![], score: 0.0 }
    }

    /// The best curve; returns the cost.
    fn by_curve(&mut self, pair: Pair, out: &mut Influence) -> Option<f64> {
        self.curve.fit(pair.template, pair.picture, pair.weight)?;
        let mut squares = 0.0;
        for b in 0..pair.template.len() {
            let (residual, gain) = (&mut self.residual[b], &mut self.gain[b]);
            let (i, w) = (&pair.picture[b], &pair.weight[b]);
            for k in 0..LANES {
                let [value, slope] = self.curve.at(pair.template[b][k]);
                (residual[k], gain[k]) = (value - i[k], slope);
                let wr = w[k] * residual[k];
                squares += wr * residual[k];
                (out.by_template[b][k], out.by_picture[b][k]) = (wr * slope, -wr);
            }
        }
        let variance = self.line.length[1] * self.line.length[1];
        self.score = (1.0 - squares / variance).max(0.0).sqrt();
        Some(0.5 * squares + self.curve.bending(self.line.sum))
    }

    /// The best line; returns the cost.
    fn by_line(&mut self, pair: Pair, out: &mut Influence) -> f64 {
        let Line { mean, length, correlation, .. } = self.line;
        let slope = self.line.ratio() * correlation;
        let normalized = self.similarity == Similarity::Zncc;
        // Derivatives are a t̂ + b î.
        let (by_t, by_i, gain) = if normalized {
            let (t, i) = (1.0 / length[0], 1.0 / length[1]);
            ([correlation * t, -t], [-i, correlation * i], self.line.ratio())
        } else {
            let [lt, li] = [slope * length[0], length[1]];
            ([slope * lt, -slope * li], [-lt, li], slope)
        };
        let (of_t, of_i) = (1.0 / length[0], 1.0 / length[1]);
        for b in 0..pair.template.len() {
            let (t, i, w) = (&pair.template[b], &pair.picture[b], &pair.weight[b]);
            let (residual, gains) = (&mut self.residual[b], &mut self.gain[b]);
            let (by_template, by_picture) = (&mut out.by_template[b], &mut out.by_picture[b]);
            vectorized(
                #[inline(always)]
                || {
                    for k in 0..LANES {
                        let (t, i) = (t[k] - mean[0], i[k] - mean[1]);
                        residual[k] = slope * t - i;
                        gains[k] = gain;
                        let (t, i) = (t * of_t, i * of_i);
                        by_template[k] = w[k] * (by_t[0] * t + by_t[1] * i);
                        by_picture[k] = w[k] * (by_i[0] * t + by_i[1] * i);
                    }
                },
            );
        }
        self.score = if normalized { correlation } else { correlation.abs() };
        let unexplained = 1.0 - correlation * correlation;
        if normalized { 1.0 - correlation } else { 0.5 * length[1] * length[1] * unexplained }
    }

    /// What a line explains of `Σ w J Jᵀ`.
    fn explained_by_line(&self, pair: Pair, points: &Points, g: &Gradients) -> Matrix8 {
        let [ones, levels] = steepest::moments(points, g, pair.weight, pair.template);
        let levels = levels - ones * self.line.mean[0];
        let squared = self.line.length[0] * self.line.length[0];
        ones * ones.transpose() / self.line.sum + levels * levels.transpose() / squared
    }
}

impl Measure for Regression {
    fn begin(&mut self, _: Pair) {}

    fn evaluate(&mut self, pair: Pair, out: &mut Influence) -> Option<f64> {
        let blocks = pair.template.len();
        self.line = Line::fit(pair)?;
        for rows in [&mut self.residual, &mut self.gain, &mut out.by_template, &mut out.by_picture] {
            rows.resize(blocks, NOTHING);
        }
        match self.similarity {
            Similarity::Scv => self.by_curve(pair, out),
            _ => Some(self.by_line(pair, out)),
        }
    }

    fn curvature(
        &mut self,
        pair: Pair,
        points: &Points,
        template: &Gradients,
        picture: Option<&Gradients>,
        mixed: &mut Gradients,
    ) -> Matrix8 {
        mixed.resize(points.x.len());
        for b in 0..points.x.len() {
            let gain = &self.gain[b];
            let mix = |of: fn(&Gradients) -> &Vec<Row>, out: &mut Row| {
                let t = &of(template)[b];
                match picture {
                    Some(picture) => {
                        let i = &of(picture)[b];
                        (0..LANES).for_each(|k| out[k] = 0.5 * (gain[k] * t[k] + i[k]));
                    }
                    None => (0..LANES).for_each(|k| out[k] = gain[k] * t[k]),
                }
            };
            mix(|g| &g.x, &mut mixed.x[b]);
            mix(|g| &g.y, &mut mixed.y[b]);
        }
        let all = steepest::squares(points, mixed, pair.weight);
        match self.similarity {
            Similarity::Scv => all - self.curve.explained(pair, points, mixed),
            Similarity::Zncc => {
                let squared = self.line.length[1] * self.line.length[1];
                (all - self.explained_by_line(pair, points, mixed)) / squared
            }
            _ => all - self.explained_by_line(pair, points, mixed),
        }
    }

    fn score(&self) -> f64 {
        self.score
    }

    fn residuals(&self) -> Option<&[Row]> {
        Some(&self.residual)
    }
}
