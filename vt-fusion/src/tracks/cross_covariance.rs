//! The cross-covariance of two tracks of one object.

use nalgebra::DefaultAllocator;
use vt_core::agent::Dynamics;
use vt_core::belief::Gaussian;
use vt_core::manifold::{Alloc, Manifold, Square};
use vt_core::time::Seconds;

use super::inverse;

/// `C = E[e_a e_bᵀ]` of two tracks of one object with measurements of their own, each error in the chart at its own
/// mean (Bar-Shalom, "On the track-to-track correlation problem", 1981):
///
/// ```text
/// prediction   C ← F_a C F_bᵀ + Q            Q: the noise of the object's motion, which both share
/// correction   C ← (1 − K_a H_a) C (1 − K_b H_b)ᵀ,   where 1 − K H = P⁺ (P⁻)⁻¹
/// ```
///
/// It is that of filters of the whole state `S`. Of poses alone it is exact where the pose is the state.
#[derive(Clone, Debug)]
pub struct CrossCovariance<S: Manifold>(pub Square<S>)
where
    DefaultAllocator: Alloc<S::D>;

impl<S: Manifold> CrossCovariance<S>
where
    DefaultAllocator: Alloc<S::D>,
{
    /// Of tracks that start from one and the same belief.
    pub fn of_common_prior(prior: &Gaussian<S>) -> Self {
        Self(prior.covariance.clone())
    }

    /// Of tracks with errors that have nothing in common.
    pub fn independent(at: &S) -> Self {
        Self(Square::<S>::zeros_generic(at.dim(), at.dim()))
    }

    /// The object moves; `means` are those before.
    pub fn predict(&mut self, motion: &dyn Dynamics<S>, means: [&S; 2], dt: Seconds) {
        let [a, b] = means.map(|m| motion.jacobian(m, dt));
        let carried = a * &self.0 * b.transpose();
        self.0 = carried + motion.noise(means[0], dt);
    }

    /// Both tracks were corrected: `prediction` and `posterior` of each.
    pub fn correct(&mut self, a: [&Gaussian<S>; 2], b: [&Gaussian<S>; 2]) {
        self.0 = kept(a) * &self.0 * kept(b).transpose();
    }
}

/// `1 − K H`, from the chart at the prediction to that at the posterior.
fn kept<S: Manifold>([prediction, posterior]: [&Gaussian<S>; 2]) -> Square<S>
where
    DefaultAllocator: Alloc<S::D>,
{
    let before = inverse::<S>(&prediction.covariance);
    if S::FLAT {
        return &posterior.covariance * before;
    }
    // P⁺ = G (1 − K H) P⁻ Gᵀ with G that moves to the chart at the posterior.
    let n = prediction.mean.dim();
    let moved = prediction.mean.retract_jacobian(&prediction.mean.local(&posterior.mean));
    let back = moved.try_inverse().unwrap_or_else(|| Square::<S>::identity_generic(n, n));
    &posterior.covariance * back.transpose() * before
}
