//! Contour likelihood along the normals of a warped outline (M. Isard, A. Blake, "Condensation", 1998; paper Fig. 5).
//!
//! Every hypothesis warps the points of a [`Contour`](vt_models::contour::Contour), takes its normals from their warped
//! neighbours, and looks at the edges that it meets on them. With edges at distances `ν_m` of a point,
//!
//! ```text
//! P(z | p) ∝ Π_normals ( 1 + 1/(√(2π) σ q λ) Σ_m exp(−ν_m² / 2σ²) )^(1/τ)
//! ```
//!
//! or, with one hypothesis a normal, `exp(−min(ν², μ²)/2σ²)` of the nearest edge, `μ² = 2σ² ln(1/(√(2π) σ q λ))`. A normal
//! without edges, and one outside of the picture, says nothing: it is missing, neither good nor bad.
//!
//! **Peakedness.** Normals of one contour are not independent, and as many as there are make the likelihood so narrow that
//! one particle takes all the weight. The temperature τ divides the logarithm; with `τ = M/8`, the default, `M`
//! normals count as eight independent ones. The estimator reports the effective number of particles in
//! [`Innovation`](vt_core::report::Innovation); a third to a half of the number is healthy, and τ is the knob.
//!
//! **Oriented chamfer** ([`ChamferModality`]) is the other way: every contour point goes to the nearest edge, by a distance transform,
//! whatever its direction, and the angle between both counts as well as the distance.
//!
//! **Speed.** Edges come from [`Canny`](crate::canny) and are kept as bits of rows and columns once a frame, so that one
//! shift shows all edges on a normal.

mod chamfer;
mod likelihood;
mod lines;
mod modality;
mod params;
mod places;
mod search;

pub use chamfer::{ChamferLikelihood, ChamferModality, ChamferParams};
pub use likelihood::ContourLikelihood;
pub use lines::{EdgeLines, REACH};
pub use modality::ContourModality;
pub use params::{ContourParams, MOST_SAMPLES};
pub use search::{ChamferSearch, ChamferSearchParams};
