//! Noise by which particles move: the root of its covariance, and what of it is not drawn.

use nalgebra::{DefaultAllocator, Dim};
use vt_core::agent::Dynamics;
use vt_core::batch::{LANES, Row, vectorized, with_rows};
use vt_core::belief::symmetrize;
use vt_core::dynamics::{pivoted_root, semidefinite_root};
use vt_core::error::EstimateError;
use vt_core::manifold::{Alloc, Manifold, Square};
use vt_core::time::Seconds;

/// `x ⊞ L n` for many `x` at once, with standard normal `n`.
///
/// Where coordinates are placed in an order, or some not at all, `L` is lower triangular in that order. Its first columns
/// draw the pose; the rest of each state moves along by its regression on the pose, `C_rp C_pp⁻¹`, and the covariance that
/// remains, `C_rr − C_rp C_pp⁻¹ C_pr`, is that of the other columns: a Kalman filter of the rest that measures the pose,
/// with one gain and one Riccati equation for all particles.
#[derive(Clone, Debug)]
pub(super) struct Diffusion<S: Manifold>
where
    DefaultAllocator: Alloc<S::D>,
{
    /// Entries of `L` that are not zero, by row: row, column, value.
    entries: Vec<(usize, usize, f64)>,
    size: S::D,
    /// Coordinates in the order in which they are placed; empty where no order matters.
    order: Vec<usize>,
    /// Number of columns that are drawn by the end of each part; the last is that of all.
    pub ends: Vec<usize>,
    /// Coordinates of the pose that are placed by the end of each part.
    pub placed: Vec<Vec<usize>>,
    marginal: bool,
    remainder: Square<S>,
}

impl<S: Manifold> Diffusion<S>
where
    DefaultAllocator: Alloc<S::D>,
{
    /// For states of this size with a pose of dimension `pose`, placed in these parts (none: all at once).
    pub fn new(size: S::D, pose: usize, parts: &[Vec<usize>], marginal: bool) -> Self {
        let all = size.value();
        let orders = if marginal || pose == 0 { 1 } else { all / pose };
        let parts = if parts.is_empty() { vec![(0..pose).collect()] } else { parts.to_vec() };
        let (mut order, mut ends, mut placed) = (vec![], vec![], vec![]);
        for (k, part) in parts.iter().enumerate() {
            placed.push(parts[..=k].concat());
            for derivative in 0..orders {
                order.extend(part.iter().map(|k| derivative * pose + k));
            }
            ends.push(order.len());
        }
        // What is not drawn.
        order.extend(order.len()..all);
        if !marginal && parts.len() == 1 {
            order.clear();
        }
        let remainder = Square::<S>::zeros_generic(size, size);
        Self { entries: vec![], size, order, ends, placed, marginal, remainder }
    }

    /// Number of normal numbers a particle.
    pub fn columns(&self) -> usize {
        self.ends.last().copied().unwrap_or(0)
    }

    /// Number of coordinates of a state.
    pub fn rows(&self) -> usize {
        self.size.value()
    }

    /// Covariance of what is not drawn.
    pub fn remainder(&self) -> &Square<S> {
        &self.remainder
    }

    /// The noise of a step from the state `at`, after the diffusion `before`.
    pub fn prepare(
        &mut self,
        dynamics: &impl Dynamics<S>,
        at: &S,
        dt: Seconds,
        before: &Self,
    ) -> Result<(), EstimateError> {
        if self.order.is_empty() {
            self.set(&dynamics.noise_root(at, dt));
        } else {
            let mut covariance = dynamics.noise(at, dt);
            if self.marginal {
                let f = dynamics.jacobian(at, dt);
                covariance += &f * &before.remainder * f.transpose();
            }
            self.spread(&covariance);
        }
        let finite =
            self.entries.iter().all(|e| e.2.is_finite()) && self.remainder.iter().all(|v| v.is_finite());
        if finite { Ok(()) } else { Err(EstimateError::NotFinite("the process noise")) }
    }

    /// Noise of this covariance.
    pub fn spread(&mut self, covariance: &Square<S>) {
        if self.order.is_empty() {
            self.set(&pivoted_root(covariance));
            return;
        }
        let order = &self.order;
        let n = order.len();
        let ordered =
            Square::<S>::from_fn_generic(self.size, self.size, |r, c| covariance[(order[r], order[c])]);
        let lower = semidefinite_root(&ordered);
        let mut root = Square::<S>::zeros_generic(self.size, self.size);
        for r in 0..n {
            for c in 0..n {
                root[(order[r], c)] = lower[(r, c)];
            }
        }
        self.set(&root);
        self.remainder.fill(0.0);
        for c in self.columns()..n {
            self.remainder.ger(1.0, &root.column(c), &root.column(c), 1.0);
        }
        symmetrize(&mut self.remainder);
    }

    fn set(&mut self, root: &Square<S>) {
        self.entries.clear();
        for r in 0..root.nrows() {
            let row = (0..self.columns()).map(|c| (r, c, root[(r, c)]));
            self.entries.extend(row.filter(|e| e.2 != 0.0));
        }
    }

    /// Gives `steps` the noise that the first `columns` of the `normals` make.
    pub fn noise(&self, normals: &[Row], columns: usize, steps: &mut [Row]) {
        vectorized(
            #[inline(always)]
            || {
                let mut entries = self.entries.as_slice();
                for (r, step) in steps.iter_mut().enumerate() {
                    let (row, others) = entries.split_at(entries.iter().take_while(|e| e.0 == r).count());
                    entries = others;
                    for first in (0..LANES).step_by(16) {
                        let mut sum = [0.0; 16];
                        for &(_, c, v) in row.iter().filter(|e| e.1 < columns) {
                            let normals = &normals[c][first..first + 16];
                            sum.iter_mut().zip(normals).for_each(|(sum, n)| *sum += v * n);
                        }
                        step[first..first + 16].copy_from_slice(&sum);
                    }
                }
            },
        );
    }

    /// Moves `states` by the first `columns` of the `normals`.
    pub fn apply(&self, normals: &[Row], columns: usize, states: &mut [S]) {
        with_rows(self.size.value(), |steps| {
            self.noise(normals, columns, steps);
            S::retract_each(states, |s| s, steps);
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Const, Matrix4, SMatrix};
    use vt_core::lie::Vector;

    /// What the normal numbers make has the covariance that was asked for, in every order.
    #[test]
    fn noise_and_remainder_make_up_the_covariance() {
        let side = Matrix4::from_fn(|r, c| if r == c { 2.0 } else { 0.3 * (r as f64) - 0.2 * (c as f64) });
        let covariance = side * side.transpose();
        for (parts, marginal) in
            [(vec![], false), (vec![], true), (vec![vec![1], vec![0]], false), (vec![vec![1], vec![0]], true)]
        {
            let mut diffusion = Diffusion::<Vector<4>>::new(Const, 2, &parts, marginal);
            diffusion.spread(&covariance);
            let columns = diffusion.columns();
            let mut root = SMatrix::<f64, 4, 4>::zeros();
            for c in 0..columns {
                let mut normals = vec![[0.0; LANES]; columns];
                normals[c] = [1.0; LANES];
                let mut steps = vec![[9.0; LANES]; 4];
                diffusion.noise(&normals, columns, &mut steps);
                for r in 0..4 {
                    assert!(steps[r].iter().all(|v| *v == steps[r][0]));
                    root[(r, c)] = steps[r][0];
                }
            }
            let found = root * root.transpose() + diffusion.remainder();
            assert!((found - covariance).amax() < 1e-12, "{parts:?}, {marginal}: {found} {covariance}");
        }
    }
}
