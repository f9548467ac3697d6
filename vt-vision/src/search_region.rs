//! Where a model may be seen, for modalities that restrict their search.

use nalgebra::DefaultAllocator;
use vt_core::agent::{Posed, Warp};
use vt_core::belief::Gaussian;
use vt_core::error::MeasureError;
use vt_core::frame::Roi;
use vt_core::manifold::{Alloc, Manifold};

/// Box around the images of `points` under the prior, widened by `deviations` predicted standard deviations of each point and
/// `margin` pixels. `None`, all of the picture, without points and where one cannot be projected.
pub(crate) fn search_region<'a, P: Manifold, W: Warp<P>>(
    warp: &W,
    points: impl Iterator<Item = &'a W::Body>,
    prior: &Gaussian<P>,
    deviations: f64,
    margin: f64,
) -> Option<Roi>
where
    W::Body: 'a,
    DefaultAllocator: Alloc<P::D>,
{
    let posed = warp.at(&prior.mean);
    let mut bounds: Option<[f64; 4]> = None;
    for point in points {
        let (y, j) = posed.linearize(point)?;
        let [x_margin, y_margin] = [0, 1].map(|row| {
            let j = j.row(row).transpose();
            deviations * (&prior.covariance * &j).dot(&j).max(0.0).sqrt() + margin
        });
        let b = bounds.get_or_insert([f64::INFINITY, f64::INFINITY, 0.0, 0.0]);
        *b = [
            b[0].min(y.x - x_margin),
            b[1].min(y.y - y_margin),
            b[2].max(y.x + x_margin),
            b[3].max(y.y + y_margin),
        ];
    }
    let [left, top, right, bottom] = bounds?.map(|v| v.clamp(0.0, f64::from(u16::MAX)) as u32);
    Some(Roi { x: left, y: top, width: right.saturating_sub(left), height: bottom.saturating_sub(top) })
}

/// Refuses a prior that is not finite.
pub(crate) fn check_prior<P: Manifold>(prior: &Gaussian<P>) -> Result<(), MeasureError>
where
    DefaultAllocator: Alloc<P::D>,
{
    if prior.is_finite() { Ok(()) } else { Err(MeasureError::Prediction("the predicted pose is not finite")) }
}
