//! Lie groups of motions, with closed-form Jacobians.
//!
//! Conventions: perturbations act on the right, `x ⊞ d = x · Exp(d)`; tangent vectors hold the translation first,
//! then the rotation, then the logarithm of the scale. `J_l`, `J_r` are the left and right Jacobians:
//! `Exp(d + ε) = Exp(J_l(d) ε) Exp(d) = Exp(d) Exp(J_r(d) ε)` to first order.
//!
//! | group | moves | tangent | dimension |
//! |---|---|---|---|
//! | [`SO2`] | plane, rotation | `θ` | 1 |
//! | [`SE2`] | plane, rigid | `ρx ρy θ` | 3 |
//! | [`TranslationScale`] | plane, translation and scale | `v σ` | 3 |
//! | [`Sim2`] | plane, rigid and scale | `v θ σ` | 4 |
//! | [`Affine2`] | plane, affine | `v θ σ`, stretch, shear | 6 |
//! | [`SL3`] | plane, homographies | those of [`Affine2`], tilt | 8 |
//! | [`SO3`] | space, rotation | `ω` | 3 |
//! | [`SE3`] | space, rigid | `v ω` | 6 |
//! | [`Sim3`] | space, rigid and scale | `v ω σ` | 7 |
//! | [`Vector`] | `R^n` by translation | the components | `N` |
//! | [`Product`] | both parts | those of the first, those of the second | sum |
//!
//! [`PlanarMotion`] is what all motions of the plane have in common for warps of pictures.
//! [`DynVector`] is `R^n` with a dimension known at run time; it is a manifold without a static identity.
//!
//! Everything is written for any real scalar, so that dual numbers run through the code that `f64` runs through.
//! Source of the closed forms: J. Solà, J. Deray, D. Atchuthan, "A micro Lie theory for state estimation in
//! robotics", 2018; T. Barfoot, "State Estimation for Robotics", 2017, §7.1; the series are our own.

use core::fmt::Debug;

use nalgebra::{DefaultAllocator, Dim, OMatrix, OVector, RealField};

use crate::manifold::Alloc;

mod coordinates;
mod planar;
mod product;
mod projective;
mod se2;
mod se3;
mod series;
mod sim2;
mod sim3;
mod so2;
mod so3;
mod spiral;
mod translation_scale;
mod vector;

pub use planar::{PlanarMotion, image_of_plane_point, picture_from_plane};
pub use product::Product;
pub use projective::{Affine2, SL3};
pub use se2::SE2;
pub use se3::SE3;
pub use sim2::Sim2;
pub use sim3::Sim3;
pub use so2::SO2;
pub use so3::SO3;
pub use translation_scale::TranslationScale;
pub use vector::{DynVector, Vector, VectorSpace};

/// A Lie group of motions over the scalar `T`.
///
/// Laws, checked by `lie_group_laws!` (feature `laws`): the group axioms, `Log(Exp(d)) = d`, `(a b) · p = a · (b · p)`,
/// `a Exp(d) a⁻¹ = Exp(Ad_a d)`, and every Jacobian against central differences and dual numbers.
pub trait LieGroup<T: RealField + Copy = f64>: Clone + Debug + Send + Sync + 'static
where
    DefaultAllocator: Alloc<Self::Dim>,
{
    /// Dimension of the tangent space.
    type Dim: Dim;
    /// What the group acts on.
    type Point;
    /// The same group over another scalar, such as dual numbers.
    type Over<U: RealField + Copy>: LieGroup<U, Dim = Self::Dim>;

    /// The motion that moves nothing.
    fn identity() -> Self;

    /// `self · other`: first `other`, then `self`.
    fn compose(&self, other: &Self) -> Self;

    /// The motion that undoes this one.
    fn inverse(&self) -> Self;

    /// The motion reached from the identity along `d`.
    fn exp(d: &OVector<T, Self::Dim>) -> Self;

    /// The shortest tangent vector with `exp(log) = self`; rotation angles lie in `[0, π]`.
    fn log(&self) -> OVector<T, Self::Dim>;

    /// The image of a point.
    fn act(&self, p: &Self::Point) -> Self::Point;

    /// `Ad`: `self · Exp(d) · self⁻¹ = Exp(Ad d)`.
    fn adjoint(&self) -> OMatrix<T, Self::Dim, Self::Dim>;

    /// `J_l(d)`: `Exp(d + ε) = Exp(J_l ε) Exp(d)` to first order.
    fn left_jacobian(d: &OVector<T, Self::Dim>) -> OMatrix<T, Self::Dim, Self::Dim>;

    /// `J_l(d)⁻¹`; grows without bound where a rotation angle approaches `2π`.
    fn left_jacobian_inverse(d: &OVector<T, Self::Dim>) -> OMatrix<T, Self::Dim, Self::Dim>;

    /// `J_r(d) = J_l(-d)`: `Exp(d + ε) = Exp(d) Exp(J_r ε)` to first order.
    fn right_jacobian(d: &OVector<T, Self::Dim>) -> OMatrix<T, Self::Dim, Self::Dim> {
        Self::left_jacobian(&-d)
    }

    /// `J_r(d)⁻¹`: `Log(Exp(d) Exp(ε)) = d + J_r⁻¹ ε` to first order.
    fn right_jacobian_inverse(d: &OVector<T, Self::Dim>) -> OMatrix<T, Self::Dim, Self::Dim> {
        Self::left_jacobian_inverse(&-d)
    }
}

/// Makes a Lie group a manifold with closed-form Jacobians, and names the blocks of its tangent vectors; further items of the
/// trait may follow.
macro_rules! manifold_of_group {
    ([$($generic:tt)*] $group:ty, $dim:ty, |$x:ident| $size:expr, [$(($name:expr, $len:expr)),*] $(, $($more:tt)*)?) => {
        impl<$($generic)*> crate::manifold::Manifold for $group {
            type D = $dim;
            fn dim(&self) -> $dim {
                let $x = self;
                $size
            }
            #[inline]
            fn retract(&self, d: &crate::manifold::Tangent<Self>) -> Self {
                crate::lie::LieGroup::compose(self, &<Self as crate::lie::LieGroup>::exp(d))
            }
            #[inline]
            fn local(&self, other: &Self) -> crate::manifold::Tangent<Self> {
                let relative = crate::lie::LieGroup::compose(&crate::lie::LieGroup::inverse(self), other);
                crate::lie::LieGroup::log(&relative)
            }
            fn retract_jacobian(&self, d: &crate::manifold::Tangent<Self>) -> crate::manifold::Square<Self> {
                <Self as crate::lie::LieGroup>::right_jacobian(d)
            }
            fn transport(&self, d: &crate::manifold::Tangent<Self>) -> crate::manifold::Square<Self> {
                crate::lie::LieGroup::adjoint(&<Self as crate::lie::LieGroup>::exp(&-d))
            }
            fn blocks(&self) -> Vec<(String, usize)> {
                vec![$(($name.to_string(), $len)),*]
            }
            $($($more)*)?
        }
    };
}
use manifold_of_group;

#[cfg(test)]
mod tests;
