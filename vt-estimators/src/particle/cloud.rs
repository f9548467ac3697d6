//! Particles with their weights, poses and paths.

use nalgebra::DefaultAllocator;
use rayon::prelude::*;
use vt_core::batch::{LANES, Row, with_rows};
use vt_core::belief::State;
use vt_core::error::EstimateError;
use vt_core::manifold::{Alloc, Manifold};
use vt_core::math;
use vt_core::measurement::Measurement;
use vt_core::random::Source;

use super::diffusion::Diffusion;

/// Hypotheses that a measurement gets at once; a fixed number, so that threads do not change it.
const BATCH: usize = 256;

/// Particles. All lists have one entry each, but for those of paths, which not every method keeps.
#[derive(Clone, Debug)]
pub(super) struct Cloud<P, S> {
    pub states: Vec<S>,
    /// Those of `states`.
    pub poses: Vec<P>,
    /// Normalised.
    pub weights: Vec<f64>,
    /// Logarithms of the weights.
    pub logs: Vec<f64>,
    /// Where particles would be without noise.
    pub ahead: Vec<S>,
    /// Standard normal numbers that moved them from there: for each [`LANES`] particles a row each coordinate.
    pub noise: Vec<Row>,
    /// Log-likelihoods.
    pub likelihoods: Vec<f64>,
}

impl<P, S> Default for Cloud<P, S> {
    fn default() -> Self {
        let (weights, logs, likelihoods) = (vec![], vec![], vec![]);
        Self { states: vec![], poses: vec![], weights, logs, ahead: vec![], noise: vec![], likelihoods }
    }
}

impl<P: Manifold, S: State<P>> Cloud<P, S>
where
    DefaultAllocator: Alloc<P::D> + Alloc<S::D>,
{
    /// Becomes a copy of `other` in the storage that it has.
    pub fn copy_from(&mut self, other: &Self) {
        let Self { states, poses, weights, logs, ahead, noise, likelihoods } = other;
        self.states.clone_from(states);
        self.poses.clone_from(poses);
        self.weights.clone_from(weights);
        self.logs.clone_from(logs);
        self.ahead.clone_from(ahead);
        self.noise.clone_from(noise);
        self.likelihoods.clone_from(likelihoods);
    }

    pub fn len(&self) -> usize {
        self.weights.len()
    }

    /// The heaviest particle.
    pub fn heaviest(&self) -> Option<&S> {
        let (heaviest, _) = self.weights.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1))?;
        self.states.get(heaviest)
    }

    pub fn equal_weights(&mut self, count: usize) {
        let w = 1.0 / count as f64;
        self.weights.clear();
        self.weights.resize(count, w);
        self.logs.clear();
        self.logs.resize(count, math::ln(w));
    }

    /// Makes `count` particles, of equal weight: `place` says where those of a chunk were, `go` moves them by noise or without.
    /// Paths are remembered where `keep` says so. `any` is any state.
    pub fn scatter(
        &mut self,
        (count, any): (usize, &S),
        place: impl Fn(usize, &mut [S]) + Sync,
        go: impl Fn(&mut [S], Option<&[Row]>) + Sync,
        diffusion: &Diffusion<S>,
        (source, frame): (&Source, u64),
        keep: bool,
    ) -> Result<(), EstimateError> {
        self.equal_weights(count);
        self.states.resize(count, any.clone());
        self.poses.resize(count, any.pose().clone());
        let columns = diffusion.columns();
        let draw =
            |chunk: usize, normals: &mut [Row]| source.normal_rows(frame, (chunk * LANES) as u32, normals);
        let finish = |states: &[S], poses: &mut [P]| {
            poses.iter_mut().zip(states.iter()).for_each(|(pose, s)| pose.clone_from(s.pose()));
            states.iter().all(S::is_finite)
        };
        let both = self.states.par_chunks_mut(LANES).zip(self.poses.par_chunks_mut(LANES)).enumerate();
        let finite = if keep {
            self.ahead.resize(count, any.clone());
            self.noise.resize(both.len() * columns, [0.0; LANES]);
            let paths = self.ahead.par_chunks_mut(LANES).zip(self.noise.par_chunks_mut(columns.max(1)));
            let moved = both.zip(paths).map(|((k, (states, poses)), (ahead, normals))| {
                place(k, ahead);
                go(ahead, None);
                states.clone_from_slice(ahead);
                draw(k, normals);
                diffusion.apply(normals, columns, states);
                finish(states, poses)
            });
            moved.reduce(|| true, |a, b| a & b)
        } else {
            let moved = both.map(|(k, (states, poses))| {
                place(k, states);
                with_rows(columns + diffusion.rows(), |rows| {
                    let (normals, steps) = rows.split_at_mut(columns);
                    draw(k, normals);
                    diffusion.noise(normals, columns, steps);
                    go(states, Some(steps));
                });
                finish(states, poses)
            });
            moved.reduce(|| true, |a, b| a & b)
        };
        if finite { Ok(()) } else { Err(EstimateError::NotFinite("a predicted particle")) }
    }

    fn set_poses(&mut self) {
        self.poses.clear();
        self.poses.extend(self.states.iter().map(|s| s.pose().clone()));
    }

    /// Puts the particles where their paths lead: moved by the first `columns` of their noise.
    pub fn follow(&mut self, diffusion: &Diffusion<S>, columns: usize) {
        self.states.clone_from(&self.ahead);
        let states = self.states.par_chunks_mut(LANES);
        let noise = self.noise.par_chunks(diffusion.columns().max(1));
        states.zip(noise).for_each(|(states, normals)| diffusion.apply(normals, columns, states));
        self.set_poses();
    }

    /// The paths of the `chosen` particles of `from`: the first `columns` of `all` coordinates of their noise, the others
    /// those of the particles in their places. `likelihoods` go along.
    pub fn choose_paths(&mut self, from: &Self, chosen: &[usize], columns: usize, all: usize) {
        self.equal_weights(chosen.len());
        self.ahead.clear();
        self.ahead.extend(chosen.iter().map(|&k| from.ahead[k].clone()));
        self.likelihoods.clear();
        self.likelihoods.extend(chosen.iter().map(|&k| from.likelihoods[k]));
        self.noise.clone_from(&from.noise);
        for (to, &k) in chosen.iter().enumerate() {
            for c in 0..columns {
                self.noise[to / LANES * all + c][to % LANES] = from.noise[k / LANES * all + c][k % LANES];
            }
        }
    }

    /// Turns unnormalised `logs` into weights, and gives the logarithm of their sum.
    pub fn normalize(&mut self) -> Result<f64, EstimateError> {
        let top = self.logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if !top.is_finite() {
            return Err(EstimateError::ZeroLikelihood);
        }
        self.weights.clear();
        self.weights.extend(self.logs.iter().map(|l| l - top));
        math::exp_all(&mut self.weights);
        let total: f64 = self.weights.iter().sum();
        let log_sum = top + math::ln(total);
        self.logs.iter_mut().for_each(|l| *l -= log_sum);
        self.weights.iter_mut().for_each(|w| *w /= total);
        Ok(log_sum)
    }
}

/// Log-likelihoods of `poses`; replaces the content of `out`.
pub(super) fn likelihoods<P: Manifold>(
    z: &dyn Measurement<P>,
    poses: &[P],
    out: &mut Vec<f64>,
) -> Result<(), EstimateError>
where
    DefaultAllocator: Alloc<P::D>,
{
    evaluate(poses, out, |poses, out| z.log_likelihoods(poses, out))
}

/// Logarithms that `f` gives for batches of `poses`; replaces the content of `out`.
pub(super) fn evaluate<P: Manifold>(
    poses: &[P],
    out: &mut Vec<f64>,
    f: impl Fn(&[P], &mut [f64]) + Sync,
) -> Result<(), EstimateError>
where
    DefaultAllocator: Alloc<P::D>,
{
    out.clear();
    out.resize(poses.len(), 0.0);
    poses.par_chunks(BATCH).zip(out.par_chunks_mut(BATCH)).for_each(|(poses, out)| f(poses, out));
    if out.iter().any(|&l| l.is_nan() || l == f64::INFINITY) {
        return Err(EstimateError::NotFinite("the likelihood"));
    }
    Ok(())
}
