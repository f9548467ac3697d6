//! Partitioned sampling.

use nalgebra::DefaultAllocator;
use vt_core::agent::Dynamics;
use vt_core::belief::State;
use vt_core::error::EstimateError;
use vt_core::manifold::{Alloc, Manifold};
use vt_core::measurement::Measurement;
use vt_core::random::{Random, Stream};

use super::ParticleFilter;
use super::cloud::{evaluate, likelihoods};

impl<P, S, M> ParticleFilter<P, S, M>
where
    P: Manifold,
    S: State<P>,
    M: Dynamics<S>,
    DefaultAllocator: Alloc<P::D> + Alloc<S::D>,
{
    /// Places part after part: weighted resampling by the importance of the parts placed so far, the others without noise;
    /// after the last part weights by the likelihood. Weighted resampling draws by `w g` and leaves the weight `1 / g`,
    /// which changes no expectation, whatever the `g`.
    pub(super) fn place_parts(&mut self, z: &dyn Measurement<P>) -> Result<(f64, u32), EstimateError> {
        let columns = self.diffusion.columns();
        let stages = self.diffusion.ends.len();
        self.next.copy_from(&self.cloud);
        let mut evidence = 0.0;
        for stage in 0..stages - 1 {
            let (next, placed) = (&mut self.next, self.diffusion.ends[stage]);
            let known = &self.diffusion.placed[stage];
            next.follow(&self.diffusion, placed);
            evaluate(&next.poses, &mut next.likelihoods, |poses, out| z.importances(poses, known, out))?;
            next.logs.iter_mut().zip(&next.likelihoods).for_each(|(w, g)| *w += g);
            evidence += next.normalize()?;
            let p = &self.params;
            let mut random = Random::new(p.seed, Stream::Resample, p.target, self.frame, 1 + stage as u32);
            p.resampling.draw(&next.weights, next.len(), &mut random, &mut self.chosen);
            self.spare.choose_paths(next, &self.chosen, placed, columns);
            self.spare.logs.iter_mut().zip(&self.spare.likelihoods).for_each(|(w, g)| *w -= g);
            core::mem::swap(&mut self.next, &mut self.spare);
        }
        let next = &mut self.next;
        next.follow(&self.diffusion, columns);
        likelihoods(z, &next.poses, &mut next.likelihoods)?;
        next.logs.iter_mut().zip(&next.likelihoods).for_each(|(w, l)| *w += l);
        evidence += next.normalize()?;
        self.commit();
        Ok((evidence, stages as u32))
    }
}
