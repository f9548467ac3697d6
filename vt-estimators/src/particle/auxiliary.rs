//! The auxiliary particle filter.

use nalgebra::DefaultAllocator;
use vt_core::agent::Dynamics;
use vt_core::belief::State;
use vt_core::error::EstimateError;
use vt_core::manifold::{Alloc, Manifold};
use vt_core::measurement::Measurement;
use vt_core::random::{Random, Stream};

use super::ParticleFilter;
use super::cloud::likelihoods;

impl<P, S, M> ParticleFilter<P, S, M>
where
    P: Manifold,
    S: State<P>,
    M: Dynamics<S>,
    DefaultAllocator: Alloc<P::D> + Alloc<S::D>,
{
    /// Chooses particles by `w P(z|μ)`, with `μ` where they go without noise, and weights them by `P(z|s) / P(z|μ)`.
    ///
    /// The noise of the particle in a place stays: it does not know who was chosen. The evidence is the product of the
    /// mean weights of both stages (Pitt 2002), which is unbiased.
    pub(super) fn look_ahead(&mut self, z: &dyn Measurement<P>) -> Result<(f64, u32), EstimateError> {
        let (now, next, spare) = (&self.cloud, &mut self.next, &mut self.spare);
        spare.copy_from(now);
        spare.follow(&self.diffusion, 0);
        likelihoods(z, &spare.poses, &mut spare.likelihoods)?;
        spare.logs.iter_mut().zip(&spare.likelihoods).for_each(|(w, l)| *w += l);
        let Ok(first) = spare.normalize() else {
            // No particle would be likely without noise: there is nothing to look ahead to.
            return self.weigh(z);
        };
        let p = &self.params;
        let mut random = Random::new(p.seed, Stream::Resample, p.target, self.frame, 1);
        p.resampling.draw(&spare.weights, spare.len(), &mut random, &mut self.chosen);
        next.choose_paths(spare, &self.chosen, 0, self.diffusion.columns());
        next.follow(&self.diffusion, self.diffusion.columns());
        likelihoods(z, &next.poses, &mut spare.logs)?;
        for ((log, l), ahead) in next.logs.iter_mut().zip(&spare.logs).zip(&next.likelihoods) {
            *log += l - ahead;
        }
        let second = next.normalize()?;
        self.commit();
        Ok((first + second, 2))
    }
}
