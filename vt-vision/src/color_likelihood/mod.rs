//! Colour likelihood: the histogram under a warped kernel against that of a reference (P. Pérez, C. Hue, J. Vermaak,
//! M. Gangnet, "Color-based probabilistic tracking", 2002; K. Nummiaro, E. Koller-Meier, L. Van Gool, "An adaptive
//! color-based particle filter", 2003; paper Fig. 6).
//!
//! ```text
//! P(z | p) ∝ exp(−λ Σ_parts D²),    D² = 1 − Σ_u √(q*_u q_u(p)) = ½ ‖√q* − √q(p)‖²
//! ```
//!
//! The second form of the distance is a sum of squares, so that the residual `√q* − √q` makes the same likelihood fit for
//! Gauss–Newton and Kalman filters. Its Jacobian is that of the kernel, which moves over the pixels with the pose (G. Hager,
//! M. Dewan, C. Stewart, "Multiple kernel tracking with SSD", 2004): pixels of a lattice that is fixed in the picture
//! enter with Epanechnikov's weight `1 − r²` at their place in the object, and so `q(p)` is continuous.
//!
//! **Knobs.** `lambda` (20) is the inverse temperature: the estimator reports the effective number of particles, and where
//! one particle takes all the weight λ is too high. `samples` bounds the pixels that a part looks at: the lattice is as wide
//! as it must be for the predicted size. `columns × rows` parts know where in the object a colour is. `background` weighs
//! down colours which a ring around the object shares with it (D. Comaniciu, V. Ramesh, P. Meer, "Kernel-based object
//! tracking", 2003), in reference and hypothesis alike: it also counters the liking of plain histograms for small regions.
//!
//! `adapt` lets the reference follow what is seen, see [`crate::adaptation`]; weights of the surroundings stay those of the start.
//!
//! Pixels outside of the picture are a class of their own that the reference does not have.

mod adaptation;
mod kernel;
mod likelihood;
mod modality;
mod params;
mod search;

pub use kernel::KernelPart;
pub use likelihood::ColorLikelihood;
pub use modality::ColorModality;
pub use params::ColorParams;
pub use search::{ColorSearch, ColorSearchParams};
