//! Direct alignment of a flat template with a picture, from coarse to fine, under any motion of the plane.
//!
//! ```text
//! min over p:  C(T(x_k), I(W(p) x_k)),   p ← p · Exp(δ),   H δ = −∂C/∂δ
//! ```
//!
//! A [`Template`] is made once: points `x_k` where the reference picture is steep, with their grey levels and gradients on
//! every level of a pyramid. An [`Aligner`] finds it in pictures. The parts can be changed for each other
//! ([`AlignmentParams`]):
//!
//! | [`Similarity`] | holds while the light | steps |
//! |---|---|---|
//! | SSD | changes gain and bias, of either sign | Gauss–Newton |
//! | ZNCC | changes gain and bias | Gauss–Newton |
//! | SCV | maps grey levels by any curve | Gauss–Newton |
//! | MI, NMI | relates grey levels in any way | Newton |
//!
//! | [`Method`] | slopes | source |
//! |---|---|---|
//! | inverse compositional | of the template | S. Baker, I. Matthews, "Lucas-Kanade 20 years on", 2004 |
//! | ESM | mean of template and picture | S. Benhimane, E. Malis, "Homography-based 2D visual tracking and servoing", 2007 |
//!
//! Points are given in the plane of the model with the origin in the template's middle; poses map them to pixels of the
//! picture, whose centres are integers. Nothing is allocated after the first picture of a size.
//!
//! ```
//! use image::{GrayImage, Luma};
//! use vt_core::lie::Vector;
//! use vt_core::nalgebra::Vector2;
//! use vt_vision::alignment::{Aligner, AlignmentParams, Template};
//!
//! let shown_at = |shift: f64| GrayImage::from_fn(160, 120, |x, y| {
//!     let wave = |v: f64| vt_core::math::sin(0.2 * v);
//!     let (x, y) = (f64::from(x) - shift, f64::from(y));
//!     Luma([(128.0 + 50.0 * wave(x) * wave(y) + 40.0 * wave(0.4 * x + y)) as u8])
//! });
//! let middle = Vector(Vector2::new(80.0, 60.0));
//! let template = Template::new(AlignmentParams::default(), &shown_at(0.0), [80.0, 60.0], &middle)?;
//! let found = Aligner::new(template).align(&shown_at(3.4), &middle)?;
//! assert!(found.converged() && found.score > 0.99);
//! assert!((found.pose.0 - Vector2::new(83.4, 60.0)).norm() < 0.02);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod aligner;
mod covariance;
mod information;
mod measure;
mod params;
mod planes;
mod regression;
mod steepest;
mod template;
#[cfg(test)]
mod tests;

pub use aligner::{Aligned, Aligner};
pub use params::{AlignmentError, AlignmentParams, Method, Similarity, TemplateError};
pub use template::Template;

impl Similarity {
    /// The one line that a new measure adds.
    fn measure(self) -> Box<dyn measure::Measure> {
        match self {
            Self::Ssd | Self::Zncc | Self::Scv => Box::new(regression::Regression::new(self)),
            Self::MutualInformation | Self::NormalizedMutualInformation => {
                Box::new(information::Information::new(self))
            }
        }
    }
}
