//! Where a window may have slid to.

use nalgebra::{Matrix2, Point2, SymmetricEigen, Vector2};
use vt_core::math;

use super::Window;
use crate::plane::{Plane, intersection};

/// Steps over half of the window, and over half of the gate, at least.
const FINENESS: f64 = 8.0;

/// Part of a predicted variance that must be gone for a direction to count as measured.
const LEARNT: f64 = 0.1;

/// Variance of a direction that is not measured, over the predicted one.
const UNKNOWN: f64 = 1e3;

/// How much a mass says about where its object is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MassLikelihood {
    /// Mass of the object under the kernel that is as good as all of it: more says no more, because others have mass too.
    pub enough: f64,
    /// Log-likelihood that a place loses where all mass is missing.
    pub sharpness: f64,
    /// Likelihood of any place when the object is hidden, over that of a place with its mass.
    pub hidden: f64,
}

impl MassLikelihood {
    /// Of a place with so much mass, where the window that starts at the prediction comes to rest at one with `most`: no other is better
    /// than that, however much mass it has.
    fn at(&self, mass: f64, most: f64) -> f64 {
        let share = (mass.min(most) / self.enough).clamp(0.0, 1.0);
        math::exp(self.sharpness * (share - 1.0)) + self.hidden
    }
}

/// A place of the mass relative to the predicted one, with what is not known of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placed {
    /// From the prediction, pixels.
    pub shift: Vector2<f64>,
    /// Square pixels.
    pub covariance: Matrix2<f64>,
}

/// Kernel masses of a window at places about the predicted one.
///
/// The kernel is Epanechnikov's, `1 − (u² + v²) / 2` with `u` and `v` from −1 to 1 over the window: its mass is greatest
/// where a window that slides to the mean place of what is in it comes to rest (Comaniciu and Meer, "Mean shift", 2002).
#[derive(Clone, Debug, Default)]
pub struct Places {
    /// Rows of one column of places: sums of weights, and of weights times `u²`.
    rows: Vec<[f64; 2]>,
    /// Shift and mass of each place, column by column.
    masses: Vec<(Vector2<f64>, f64)>,
    /// Places in a column.
    column: usize,
}

impl Places {
    /// Looks at all places up to `range` from the window, each pixel having `clutter` (0 to 1) less than its weight.
    pub fn compute(&mut self, plane: &Plane<u8>, window: &Window, range: Vector2<f64>, clutter: f64) {
        self.masses.clear();
        let half = window.half;
        let steps = [0, 1].map(|k| (FINENESS * (range[k] / half[k]).max(1.0)).ceil());
        let along = |k: usize| {
            let n = if range[k] > 0.0 { steps[k] } else { 0.0 };
            (0..=2 * n as usize).map(move |i| (i as f64 - n) * range[k] / n.max(1.0))
        };
        let reach = Window { half: half + range, ..*window };
        let all = intersection(plane.region(), reach.pixels());
        self.column = along(1).count();
        // What a gate of the object's size takes, so that none wants memory later.
        self.masses.reserve((4 * FINENESS as usize + 1).pow(2));
        self.rows.reserve((6.0 * half.y) as usize + 2);
        for dx in along(0) {
            let x = window.centre.x + dx;
            let column =
                Window { centre: Point2::new(x, window.centre.y), half: Vector2::new(half.x, reach.half.y) };
            let part = intersection(all, column.pixels());
            self.rows.clear();
            self.rows.extend((part.y..part.y + part.height).map(|y| {
                (part.x..).zip(plane.row(y, part)).fold([0.0; 2], |[sum, squares], (px, &w)| {
                    let (w, u) = (f64::from(w) / 255.0 - clutter, (f64::from(px) - x) / half.x);
                    [sum + w, squares + w * u * u]
                })
            }));
            for dy in along(1) {
                let y = window.centre.y + dy;
                let inside = Window { centre: Point2::new(x, y), half }.pixels();
                let inside = intersection(part, inside);
                let first = (inside.y - part.y) as usize;
                let rows = (inside.y..).zip(&self.rows[first..first + inside.height as usize]);
                let mass = rows.fold(0.0, |mass, (py, [sum, squares])| {
                    let v = (f64::from(py) - y) / half.y;
                    mass + (1.0 - 0.5 * v * v) * sum - 0.5 * squares
                });
                self.masses.push((Vector2::new(dx, dy), mass));
            }
        }
    }

    /// Mass where the window comes to rest that starts at the prediction.
    fn most(&self) -> f64 {
        let (n, rows) = (self.masses.len(), self.column.max(1));
        let mut at = n / 2;
        while let Some(best) = (0..n)
            .filter(|k| (k / rows).abs_diff(at / rows) <= 1 && (k % rows).abs_diff(at % rows) <= 1)
            .max_by(|&a, &b| self.masses[a].1.total_cmp(&self.masses[b].1))
            .filter(|&k| self.masses[k].1 > self.masses[at].1)
        {
            at = best;
        }
        self.masses.get(at).map_or(0.0, |p| p.1)
    }

    /// Mass at the place nearest to a shift.
    pub fn near(&self, shift: Vector2<f64>) -> Option<f64> {
        let distance = |p: &(Vector2<f64>, f64)| (p.0 - shift).norm_squared();
        self.masses.iter().min_by(|a, b| distance(a).total_cmp(&distance(b))).map(|p| p.1)
    }

    /// The Gaussian measurement that takes a prediction with the covariance `gate` to the mean and covariance of the places under
    /// prediction and likelihood. `None` where that teaches nothing: nothing is seen, or too much.
    pub fn measurement(&self, gate: &Matrix2<f64>, likelihood: &MassLikelihood) -> Option<Placed> {
        let root = gate.cholesky()?.l();
        let inverse = root.try_inverse()?;
        let most = self.most();
        let (mut total, mut first, mut second) = (0.0, Vector2::zeros(), Matrix2::zeros());
        for (shift, mass) in &self.masses {
            let white = inverse * shift;
            let weight = math::exp(-0.5 * white.norm_squared()) * likelihood.at(*mass, most);
            total += weight;
            first += white * weight;
            second += white * white.transpose() * weight;
        }
        let mean: Vector2<f64> = first / total;
        // Of a grid that is as coarse as the mass is sharp.
        let SymmetricEigen { eigenvectors, eigenvalues } =
            SymmetricEigen::new(second / total - mean * mean.transpose());
        let kept = eigenvalues.map(|v| v.max(1e-3));
        if !kept.iter().any(|v| *v < 1.0 - LEARNT) {
            return None;
        }
        let mean = eigenvectors.transpose() * mean;
        let (mut shift, mut variance) = (Vector2::zeros(), Vector2::repeat(UNKNOWN));
        for k in (0..2).filter(|&k| kept[k] < 1.0 - LEARNT) {
            shift[k] = mean[k] / (1.0 - kept[k]);
            variance[k] = kept[k] / (1.0 - kept[k]);
        }
        let axes: Matrix2<f64> = root * eigenvectors;
        let covariance = axes * Matrix2::new(variance.x, 0.0, 0.0, variance.y) * axes.transpose();
        Some(Placed { shift: axes * shift, covariance: (covariance + covariance.transpose()) * 0.5 })
    }
}
