//! From a broad likelihood to the true one in layers.

use nalgebra::DefaultAllocator;
use rayon::prelude::*;
use vt_core::agent::Dynamics;
use vt_core::batch::{LANES, Row, dot};
use vt_core::belief::State;
use vt_core::dynamics::semidefinite_root;
use vt_core::error::EstimateError;
use vt_core::manifold::{Alloc, Manifold, Square};
use vt_core::math;
use vt_core::measurement::Measurement;
use vt_core::random::{Random, Source, Stream};

use super::ParticleFilter;
use super::cloud::likelihoods;

/// Parameters of the annealed particle filter.
///
/// Layer by layer particles are weighted by `P(z|s)^(β_m − β_{m−1})`, drawn again and diffused, from `β_0 = 0` to 1. Each
/// `β` is found by bisection such that a given share of the particles survives, `1 / (N Σ w²)`; the diffusion shrinks
/// with the particles (J. Deutscher, A. Blake, I. Reid, "Articulated body motion capture by annealed particle filtering",
/// 2000). Unlike there, a diffused particle is accepted by the rule of Metropolis for the posterior of its layer, with the
/// noise of the last step as its coordinates; so the result is the posterior and not only its peak, and its covariance
/// and evidence are honest (P. Del Moral, A. Doucet, A. Jasra, "Sequential Monte Carlo samplers", 2006).
///
/// One evaluation a particle for the start and for each diffusion. Where the likelihood is broad there is one layer and
/// nothing is diffused.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Annealing {
    /// Share of the particles that survives a layer.
    pub survival: f64,
    /// Diffusions a layer.
    pub moves: u32,
    /// Most layers; the last one goes to `β = 1` whatever survives.
    pub most_layers: u32,
}

impl Default for Annealing {
    fn default() -> Self {
        Self { survival: 0.5, moves: 2, most_layers: 40 }
    }
}

/// Share of accepted diffusions above which their length grows and below which it shrinks.
const ACCEPTED: (f64, f64) = (0.2, 0.4);

/// The largest exponent up to 1 at which this share survives: `β` itself where fewer do already.
fn next_exponent(logs: &[f64], likelihoods: &[f64], beta: f64, survival: f64, scratch: &mut Vec<f64>) -> f64 {
    let top = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let peak = likelihoods.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let mut survives = |share: f64| {
        scratch.clear();
        scratch.extend(
            logs.iter()
                .zip(likelihoods)
                .map(|(w, l)| if share > 0.0 { w - top + share * (l - peak) } else { w - top }),
        );
        math::exp_all(scratch);
        let (sum, squares) = scratch.iter().fold((0.0, 0.0), |(s, q), w| (s + w, q + w * w));
        sum * sum >= survival * logs.len() as f64 * squares
    };
    let (mut low, mut high) = (0.0, 1.0 - beta);
    if survives(high) {
        return 1.0;
    }
    if !survives(low) {
        return beta;
    }
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if survives(middle) { low = middle } else { high = middle }
    }
    beta + low
}

impl<P, S, M> ParticleFilter<P, S, M>
where
    P: Manifold,
    S: State<P>,
    M: Dynamics<S>,
    DefaultAllocator: Alloc<P::D> + Alloc<S::D>,
{
    pub(super) fn anneal(
        &mut self,
        z: &dyn Measurement<P>,
        a: Annealing,
    ) -> Result<(f64, u32), EstimateError> {
        self.next.copy_from(&self.cloud);
        likelihoods(z, &self.next.poses, &mut self.next.likelihoods)?;
        let columns = self.diffusion.columns();
        // The optimal length of random walks in many dimensions (Roberts, Gelman and Gilks 1997).
        let mut scale = 2.38 / (columns.max(1) as f64).sqrt();
        let (mut beta, mut evidence) = (0.0, 0.0);
        for layer in 1.. {
            let next = &mut self.next;
            let before = beta;
            if layer >= a.most_layers {
                beta = 1.0;
            } else {
                beta = next_exponent(&next.logs, &next.likelihoods, beta, a.survival, &mut self.spare.logs);
            }
            if beta > before {
                let share = beta - before;
                next.logs.iter_mut().zip(&next.likelihoods).for_each(|(w, l)| *w += share * l);
            }
            evidence += next.normalize()?;
            if beta >= 1.0 {
                self.commit();
                return Ok((evidence, layer));
            }
            let p = &self.params;
            let mut random = Random::new(p.seed, Stream::Resample, p.target, self.frame, layer);
            p.resampling.draw(&next.weights, next.len(), &mut random, &mut self.chosen);
            self.spare.choose_paths(next, &self.chosen, columns, columns);
            self.spare.follow(&self.diffusion, columns);
            core::mem::swap(&mut self.next, &mut self.spare);
            for round in 0..a.moves {
                let accepted = self.metropolis(z, beta, scale, u64::from(layer) << 16 | u64::from(round))?;
                if accepted < ACCEPTED.0 {
                    scale *= 0.7;
                } else if accepted > ACCEPTED.1 {
                    scale *= 1.4;
                }
            }
        }
        Err(EstimateError::ZeroLikelihood)
    }

    /// Moves the noise of every particle by a normal step of `scale` deviations of all, or leaves it; gives the share of
    /// moved ones.
    fn metropolis(
        &mut self,
        z: &dyn Measurement<P>,
        beta: f64,
        scale: f64,
        round: u64,
    ) -> Result<f64, EstimateError> {
        let columns = self.diffusion.columns();
        let root = semidefinite_root(&self.spread_of_noise(columns)) * scale;
        let p = &self.params;
        let source = Source::new(p.seed, Stream::Move, p.target);
        let address = self.frame << 32 | round;
        let (next, spare) = (&mut self.next, &mut self.spare);
        spare.copy_from(next);
        spare.noise.par_chunks_mut(columns.max(1)).enumerate().for_each(|(chunk, noise)| {
            vt_core::batch::with_rows(columns, |steps| {
                source.normal_rows(address, (chunk * LANES) as u32, steps);
                for r in 0..columns {
                    for (c, step) in steps.iter().enumerate().take(r + 1) {
                        let factor = root[(r, c)];
                        noise[r].iter_mut().zip(step).for_each(|(n, s)| *n += factor * s);
                    }
                }
            });
        });
        spare.follow(&self.diffusion, columns);
        likelihoods(z, &spare.poses, &mut spare.likelihoods)?;
        let mut moved = 0;
        for k in 0..next.len() {
            let (chunk, lane) = (k / LANES * columns, k % LANES);
            let length = |noise: &[Row]| -> f64 {
                noise[chunk..chunk + columns].iter().map(|r| r[lane] * r[lane]).sum()
            };
            let gain = beta * (spare.likelihoods[k] - next.likelihoods[k]);
            let odds = gain - 0.5 * (length(&spare.noise) - length(&next.noise));
            // Addresses of uniform numbers are those of the normal ones, which have another key.
            if math::ln(1.0 - source.at(address, k as u32).uniform()) < odds {
                moved += 1;
                next.likelihoods[k] = spare.likelihoods[k];
                core::mem::swap(&mut next.states[k], &mut spare.states[k]);
                core::mem::swap(&mut next.poses[k], &mut spare.poses[k]);
                for row in chunk..chunk + columns {
                    next.noise[row][lane] = spare.noise[row][lane];
                }
            }
        }
        Ok(f64::from(moved) / next.len() as f64)
    }

    /// Covariance of the particles' noise in its first `columns` coordinates, zero elsewhere.
    fn spread_of_noise(&self, columns: usize) -> Square<S> {
        let n = self.next.len();
        let mut covariance = self.diffusion.remainder() * 0.0;
        let mut mean = self.next.ahead[0].zero();
        for (chunk, noise) in self.next.noise.chunks(columns.max(1)).enumerate() {
            let mut present = [0.0; LANES];
            present[..(n - chunk * LANES).min(LANES)].fill(1.0 / n as f64);
            for r in 0..columns {
                mean[r] += dot(&present, &noise[r]);
                let mut weighted = present;
                weighted.iter_mut().zip(&noise[r]).for_each(|(w, x)| *w *= x);
                for c in 0..=r {
                    covariance[(r, c)] += dot(&weighted, &noise[c]);
                }
            }
        }
        covariance.ger(-1.0, &mean, &mean, 1.0);
        covariance.fill_upper_triangle_with_lower_triangle();
        covariance
    }
}
