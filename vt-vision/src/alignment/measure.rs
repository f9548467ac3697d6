//! What every similarity tells the optimiser.

use vt_core::batch::Row;

use super::steepest::{Gradients, Matrix8, Points};

/// Grey levels of template and picture at the same points.
#[derive(Clone, Copy)]
pub(super) struct Pair<'a> {
    pub template: &'a [Row],
    pub picture: &'a [Row],
    /// Zero for points that do not count.
    pub weight: &'a [Row],
}

/// Derivatives of the cost by each grey level.
#[derive(Clone, Debug, Default)]
pub(super) struct Influence {
    pub by_template: Vec<Row>,
    pub by_picture: Vec<Row>,
}

/// A similarity as a cost, lower the more alike. A picture that moves by `δ` looks to first order like a template that moves
/// by `−δ`; hence both derivatives tell the gradient, and the negative mixed derivative tells the curvature.
pub(super) trait Measure: Send + Sync {
    /// Called where the descent on a level begins.
    fn begin(&mut self, pair: Pair);

    /// Cost and its derivatives by the grey levels, the weights held; `None` where the picture is flat.
    fn evaluate(&mut self, pair: Pair, out: &mut Influence) -> Option<f64>;

    /// Curvature in the coordinates of SL(3) where [`Measure::evaluate`] was called last: of a picture with the gradients
    /// `picture`, or the template's own without.
    fn curvature(
        &mut self,
        pair: Pair,
        points: &Points,
        template: &Gradients,
        picture: Option<&Gradients>,
        scratch: &mut Gradients,
    ) -> Matrix8;

    /// How alike the two were at the last call: see [`super::Aligned::score`].
    fn score(&self) -> f64;

    /// Template as the picture should show it, less the picture, where there is such a thing.
    fn residuals(&self) -> Option<&[Row]>;
}
