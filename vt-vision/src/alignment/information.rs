//! Mutual information of the grey levels of template and picture, and its normalised form.
//!
//! The joint histogram is smoothed by cubic B-splines (Parzen windows), `p_ab = Σ w β_a(t) β_b(i) / Σ w`, so that it
//! has derivatives (P. Viola, W. Wells, 1997; P. Thévenaz, M. Unser, 2000; for tracking G. Panin, A. Knoll, "Mutual
//! information-based 3D object tracking", 2008; N. Dowson, R. Bowden, 2008; A. Dame, E. Marchand, "Second-order
//! optimization of mutual information for real-time image registration", 2012). With the entropies `H_T`, `H_I`, `H_TI` of template, picture and both, `MI = H_T + H_I − H_TI` and
//! `NMI = (H_T + H_I) / H_TI`.
//!
//! **Curvature.** The products of first derivatives of `p` alone have the wrong sign at the optimum: the term with second
//! derivatives must stay. It needs the picture's second derivatives when only one of the two moves. But when both move
//! together nothing changes, so at the optimum the curvature is the negative *mixed* derivative, by a motion of the template
//! and one of the picture, and that takes first derivatives only:
//!
//! ```text
//! ∂_T ∂_I H_TI = − Σ_ab ∂_T p_ab ∂_I p_abᵀ / p_ab − Σ_k (w/Σw) Σ_ab β'_a(t) β'_b(i) ln p_ab  J_T J_Iᵀ
//! ```

use vt_core::batch::{LANES, Row};
use vt_core::math;

use super::measure::{Influence, Measure, Pair};
use super::params::Similarity;
use super::steepest::{self, Gradients, Matrix8, NOTHING, Points, Vector8};

/// Bins of the grey levels of each picture.
pub(super) const BINS: usize = 8;

/// Share of the range of grey levels by which it is widened on both sides.
const MARGIN: f64 = 0.02;

/// Entropies of pictures without contrast.
const FLAT: f64 = 1e-6;

type Table = [[f64; BINS]; BINS];

/// Values and slopes of the four B-splines that reach a grey level, from bin `first` on.
#[derive(Clone, Copy, Debug, Default)]
struct Window {
    first: usize,
    value: [f64; 4],
    slope: [f64; 4],
}

/// From grey levels to bins.
#[derive(Clone, Copy, Debug, Default)]
struct Range {
    low: f64,
    high: f64,
}

impl Range {
    /// That of the levels with a weight, a little wider.
    fn of(levels: &[Row], weights: &[Row]) -> Self {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for (levels, weights) in levels.iter().zip(weights) {
            for k in (0..LANES).filter(|&k| weights[k] > 0.0) {
                (low, high) = (low.min(levels[k]), high.max(levels[k]));
            }
        }
        let margin = MARGIN * (high - low);
        Self { low: low - margin, high: high + margin }
    }

    /// Levels beyond the range count as its ends, where they have no slope.
    #[inline(always)]
    fn window(&self, level: f64) -> Window {
        let density = (BINS - 3) as f64 / (self.high - self.low);
        let free = (level - self.low) * density;
        let at = free.clamp(0.0, (BINS - 3) as f64);
        let first = (at as usize).min(BINS - 4);
        let u = at - first as f64;
        let v = 1.0 - u;
        let value = [
            v * v * v / 6.0,
            (4.0 + u * u * (3.0 * u - 6.0)) / 6.0,
            (4.0 + v * v * (3.0 * v - 6.0)) / 6.0,
            u * u * u / 6.0,
        ];
        let d = if free == at { 0.5 * density } else { 0.0 };
        let slope = [-v * v * d, u * (3.0 * u - 4.0) * d, -v * (3.0 * v - 4.0) * d, u * u * d];
        Window { first, value, slope }
    }
}

/// The joint histogram and what follows from it.
#[derive(Clone, Copy, Debug, Default)]
struct Joint {
    p: Table,
    /// Logarithms of `p`, zero where there is nothing.
    log: Table,
    log_template: [f64; BINS],
    log_picture: [f64; BINS],
    /// Entropies of template, picture and both, nats.
    entropy: [f64; 3],
}

impl Joint {
    fn new(p: Table) -> Self {
        let log_of = |p: f64| if p > 1e-300 { math::ln(p) } else { 0.0 };
        let of_template = p.map(|row| row.iter().sum::<f64>());
        let of_picture: [f64; BINS] = core::array::from_fn(|b| p.iter().map(|row| row[b]).sum());
        let log = p.map(|row| row.map(log_of));
        let (log_template, log_picture) = (of_template.map(log_of), of_picture.map(log_of));
        let entropy = |p: &[f64], log: &[f64]| -p.iter().zip(log).map(|(p, l)| p * l).sum::<f64>();
        let both = entropy(p.as_flattened(), log.as_flattened());
        let entropy = [entropy(&of_template, &log_template), entropy(&of_picture, &log_picture), both];
        Self { p, log, log_template, log_picture, entropy }
    }
}

/// Mutual information or its normalised form.
#[derive(Clone, Debug)]
pub(super) struct Information {
    normalized: bool,
    /// Ranges of template and picture.
    ranges: [Range; 2],
    windows: Vec<[Window; 2]>,
    joint: Joint,
    total: f64,
}

impl Information {
    pub fn new(similarity: Similarity) -> Self {
        let normalized = similarity == Similarity::NormalizedMutualInformation;
        Self { normalized, ranges: Default::default(), windows: vec![], joint: Joint::default(), total: 0.0 }
    }

    /// The similarity, its derivatives by the three entropies, and the second ones by two of them of which one is `H_TI`.
    fn of_entropies(&self) -> (f64, [f64; 3], [f64; 3]) {
        let [t, i, both] = self.joint.entropy;
        if !self.normalized {
            return (t + i - both, [1.0, 1.0, -1.0], [0.0; 3]);
        }
        let (c, s) = (1.0 / both, (t + i) / both);
        (s, [c, c, -s * c], [-c * c, -c * c, 2.0 * s * c * c])
    }
}

impl Measure for Information {
    fn begin(&mut self, pair: Pair) {
        self.ranges = [Range::of(pair.template, pair.weight), Range::of(pair.picture, pair.weight)];
        // Those of the template stay while the picture moves.
        self.windows.resize(pair.template.len() * LANES, Default::default());
        for (windows, level) in self.windows.iter_mut().zip(pair.template.as_flattened()) {
            windows[0] = self.ranges[0].window(*level);
        }
    }

    fn evaluate(&mut self, pair: Pair, out: &mut Influence) -> Option<f64> {
        let blocks = pair.template.len();
        for rows in [&mut out.by_template, &mut out.by_picture] {
            rows.resize(blocks, NOTHING);
        }
        if !self.ranges.iter().all(|r| r.high > r.low) {
            return None;
        }
        let (mut p, mut sum) = (Table::default(), 0.0);
        for b in 0..blocks {
            let w = &pair.weight[b];
            for k in (0..LANES).filter(|&k| w[k] > 0.0) {
                let t = self.windows[b * LANES + k][0];
                let i = self.ranges[1].window(pair.picture[b][k]);
                for a in 0..4 {
                    let value = w[k] * t.value[a];
                    let row = &mut p[t.first + a][i.first..][..4];
                    for c in 0..4 {
                        row[c] += value * i.value[c];
                    }
                }
                sum += w[k];
                self.windows[b * LANES + k][1] = i;
            }
        }
        self.total = sum;
        self.joint = Joint::new(p.map(|row| row.map(|p| p / sum)));
        let [t, i, _] = self.joint.entropy;
        if !(t > FLAT && i > FLAT) {
            return None;
        }
        let (value, by, _) = self.of_entropies();
        // −∂S/∂p_ab but for a constant, which sums to nothing.
        let j = &self.joint;
        let change: Table = core::array::from_fn(|a| {
            core::array::from_fn(|b| {
                by[0] * j.log_template[a] + by[1] * j.log_picture[b] + by[2] * j.log[a][b]
            })
        });
        for b in 0..blocks {
            let w = &pair.weight[b];
            let (by_template, by_picture) = (&mut out.by_template[b], &mut out.by_picture[b]);
            (*by_template, *by_picture) = (NOTHING, NOTHING);
            for k in (0..LANES).filter(|&k| w[k] > 0.0) {
                let [t, i] = &self.windows[b * LANES + k];
                let (mut slope, mut across) = (0.0, 0.0);
                for a in 0..4 {
                    let row = &change[t.first + a][i.first..][..4];
                    let (mut by_value, mut by_slope) = (0.0, 0.0);
                    for c in 0..4 {
                        by_value += row[c] * i.value[c];
                        by_slope += row[c] * i.slope[c];
                    }
                    slope += t.slope[a] * by_value;
                    across += t.value[a] * by_slope;
                }
                (by_template[k], by_picture[k]) = (w[k] * slope / sum, w[k] * across / sum);
            }
        }
        Some(-value)
    }

    fn curvature(
        &mut self,
        pair: Pair,
        points: &Points,
        template: &Gradients,
        picture: Option<&Gradients>,
        _: &mut Gradients,
    ) -> Matrix8 {
        let picture = picture.unwrap_or(template);
        let mut by_template = [[[0.0; 8]; BINS]; BINS];
        let mut by_picture = by_template;
        let mut mixed = [[0.0; 8]; 8];
        for b in 0..points.x.len() {
            let (x, y, w) = (&points.x[b], &points.y[b], &pair.weight[b]);
            let of_template = steepest::rows(x, y, &template.x[b], &template.y[b]);
            let of_picture = steepest::rows(x, y, &picture.x[b], &picture.y[b]);
            for k in (0..LANES).filter(|&k| w[k] > 0.0) {
                let [t, i] = &self.windows[b * LANES + k];
                let share = w[k] / self.total;
                let jt: [f64; 8] = core::array::from_fn(|r| share * of_template[r][k]);
                let ji: [f64; 8] = core::array::from_fn(|r| of_picture[r][k]);
                let mut both = 0.0;
                for a in 0..4 {
                    for c in 0..4 {
                        let (row, column) = (t.first + a, i.first + c);
                        let (st, si) = (t.slope[a] * i.value[c], share * t.value[a] * i.slope[c]);
                        both += t.slope[a] * i.slope[c] * self.joint.log[row][column];
                        let (bt, bi) = (&mut by_template[row][column], &mut by_picture[row][column]);
                        for r in 0..8 {
                            bt[r] += st * jt[r];
                            bi[r] += si * ji[r];
                        }
                    }
                }
                for r in 0..8 {
                    for c in 0..8 {
                        mixed[r][c] += both * jt[r] * ji[c];
                    }
                }
            }
        }
        let j = &self.joint;
        // First derivatives of the entropies, and the mixed one of H_TI.
        let (mut t_t, mut i_i, mut both_t, mut both_i) =
            (Vector8::zeros(), Vector8::zeros(), Vector8::zeros(), Vector8::zeros());
        let mut second = -Matrix8::from_fn(|r, c| mixed[r][c]);
        for a in 0..BINS {
            for b in 0..BINS {
                let (by_t, by_i) = (Vector8::from(by_template[a][b]), Vector8::from(by_picture[a][b]));
                t_t -= by_t * j.log_template[a];
                i_i -= by_i * j.log_picture[b];
                both_t -= by_t * j.log[a][b];
                both_i -= by_i * j.log[a][b];
                if j.p[a][b] > 1e-300 {
                    second -= by_t * by_i.transpose() / j.p[a][b];
                }
            }
        }
        let (_, by, twice) = self.of_entropies();
        let mut out = second * by[2];
        out += (t_t * both_i.transpose()) * twice[0] + (both_t * i_i.transpose()) * twice[1];
        out += (both_t * both_i.transpose()) * twice[2];
        0.5 * (out + out.transpose())
    }

    fn score(&self) -> f64 {
        self.of_entropies().0
    }

    fn residuals(&self) -> Option<&[Row]> {
        None
    }
}
