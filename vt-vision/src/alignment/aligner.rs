//! The descent from coarse to fine.

use std::sync::Arc;

use image::GrayImage;
use nalgebra::{DefaultAllocator, Point2};
use vt_core::batch::{LANES, Row};
use vt_core::belief::{Gaussian, cholesky};
use vt_core::lie::PlanarMotion;
use vt_core::manifold::{Alloc, Square, Tangent};
use vt_core::report::StopReason;
use vt_core::robust::{Robust, mad_scale};

use super::covariance::covariance;
use super::measure::{Influence, Measure, Pair};
use super::params::{AlignmentError, AlignmentParams, Method};
use super::planes::{Planes, level_from_picture, map, region_about};
use super::regression::Curve;
use super::steepest::{self, Gradients, Matrix8, Seen};
use super::template::{Level, Template, scaled};

/// Longest step of a corner, pixels of the level.
const LONGEST_STEP: f64 = 8.0;

/// Least scale of the grey-level residuals: rounding.
const LEAST_SCALE: f64 = 0.5;

/// The scale of the residuals is found anew as long as a corner moves farther than this many pixels of the level; then it is held, or
/// weights and pose might chase each other.
const STILL: f64 = 0.03;

/// How many times longer the last step on a coarse level may be: the finer ones go on from there.
const COARSE_TOLERANCE: f64 = 10.0;

/// Where a picture shows the template.
#[derive(Clone, Debug)]
pub struct Aligned<P: PlanarMotion>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// `picture_from_model`.
    pub pose: P,
    /// Covariance of the error in the tangent space at `pose`, from the data alone: white noise of template and picture, of
    /// the size that the grey levels show. It knows nothing of errors that all points share (lens, shape, occluders).
    pub covariance: Square<P>,
    /// How alike template and picture are: correlation with the best line (SSD: its magnitude; ZNCC) or curve (SCV), at most 1; mutual
    /// information in nats; normalised mutual information, 1 to 2. This, `inside`, `inliers` and the covariance are those of where
    /// the last step began.
    pub score: f64,
    /// Share of the points in the picture.
    pub inside: f64,
    /// Mean robust weight of the points in the picture; 1 without an M-estimator.
    pub inliers: f64,
    /// Steps on all levels.
    pub iterations: u32,
    /// Why the descent on the finest level ended.
    pub stop: StopReason,
}

impl<P: PlanarMotion> Aligned<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// Whether the last step was negligible.
    pub fn converged(&self) -> bool {
        self.stop == StopReason::SmallStep
    }

    /// Pose and covariance as a belief.
    pub fn belief(&self) -> Gaussian<P> {
        Gaussian { mean: self.pose.clone(), covariance: self.covariance.clone() }
    }
}

/// Aligns a template with one picture after another, in buffers of its own.
pub struct Aligner<P> {
    template: Arc<Template<P>>,
    measure: Box<dyn Measure>,
    planes: Planes,
    seen: Seen,
    weights: Vec<Row>,
    influence: Influence,
    scratch: Gradients,
    residuals: Vec<f64>,
    sorted: Vec<f64>,
    /// Scale of the residuals.
    noise: f64,
    curve: Curve,
}

impl<P: PlanarMotion> Aligner<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// An aligner of this template.
    pub fn new(template: impl Into<Arc<Template<P>>>) -> Self {
        let template = template.into();
        let measure = template.params.similarity.measure();
        let (planes, seen, influence, scratch, curve) = Default::default();
        let (weights, residuals, sorted) = Default::default();
        Self {
            template,
            measure,
            planes,
            seen,
            weights,
            influence,
            scratch,
            residuals,
            sorted,
            noise: 1.0,
            curve,
        }
    }

    /// The template.
    pub fn template(&self) -> &Template<P> {
        &self.template
    }

    /// Looks for the template in `picture` from the pose `start` (`picture_from_model`).
    ///
    /// # Errors
    /// [`AlignmentError`] where there is nothing to be found from there.
    pub fn align(&mut self, picture: &GrayImage, start: &P) -> Result<Aligned<P>, AlignmentError> {
        if !start.is_finite() {
            return Err(AlignmentError::Start);
        }
        let template = self.template.clone();
        let params = &template.params;
        let nowhere = AlignmentError::OutOfPicture { inside: 0, points: template.levels[0].points.count };
        let corners = corners(&template, start).ok_or_else(|| nowhere.clone())?;
        let region = region_about(&corners, params.reach, picture.dimensions()).ok_or(nowhere)?;
        let coarsest = template.levels.last().map_or(0, |l| l.number as usize);
        self.planes.compute(picture, region, &template.kernel, coarsest + 1);
        let mut found = Descent { pose: start.clone(), iterations: 0, stop: StopReason::Iterations };
        for (k, level) in template.levels.iter().enumerate().rev() {
            match self.descend(&template, level, found.clone()) {
                Ok(better) => found = better,
                // A coarse level shows less of the template than a fine one.
                Err(error) if k == 0 => return Err(error),
                Err(_) => {}
            }
        }
        let level = &template.levels[0];
        let covariance = self.covariance(&template, level, &found.pose).ok_or(AlignmentError::Singular)?;
        let points = level.points.count as f64;
        let total: f64 = self.weights.as_flattened().iter().sum();
        Ok(Aligned {
            pose: found.pose,
            covariance,
            score: self.measure.score(),
            inside: self.seen.count as f64 / points,
            inliers: total / self.seen.count as f64,
            iterations: found.iterations,
            stop: found.stop,
        })
    }

    /// Steps on one level.
    fn descend(
        &mut self,
        template: &Template<P>,
        level: &Level,
        mut at: Descent<P>,
    ) -> Result<Descent<P>, AlignmentError> {
        let params = &template.params;
        let pixel = f64::from(1u32 << level.number);
        let coarse = if level.number > params.finest { COARSE_TOLERANCE } else { 1.0 };
        let (mut curvature, mut moved) = (None, f64::INFINITY);
        for step in 0..params.iterations {
            self.look(template, level, &at.pose)?;
            self.compare(params, level, step == 0, moved > STILL * pixel)?;
            let h = self.curvature(params, level, &mut curvature);
            let g = steepest::sum(&level.points, self.slope(params, level));
            let (h, g) = (template.basis.matrix(&at.pose, &h), template.basis.vector(&at.pose, &g));
            let d = cholesky(h)
                .or_else(|| cholesky(template.basis.matrix(&at.pose, &level.curvature)))
                .ok_or(AlignmentError::Singular)?
                .solve(&g);
            (at.pose, moved) =
                stepped(template, &at.pose, d, LONGEST_STEP * pixel).ok_or(AlignmentError::Singular)?;
            at.iterations += 1;
            if moved <= coarse * params.tolerance * pixel {
                at.stop = StopReason::SmallStep;
                return Ok(at);
            }
        }
        at.stop = StopReason::Iterations;
        Ok(at)
    }

    /// Reads the picture at the points.
    fn look(&mut self, template: &Template<P>, level: &Level, pose: &P) -> Result<(), AlignmentError> {
        let points = &level.points;
        let Some(view) = self.planes.level(level.number as usize) else {
            return Err(AlignmentError::OutOfPicture { inside: 0, points: points.count });
        };
        let m = level_from_picture(level.number) * scaled(&pose.matrix(), template.scale);
        self.seen.resize(points.x.len());
        self.seen.look(&view, &m, points);
        let enough = self.seen.count as f64 >= template.params.least_inside * points.count as f64;
        if enough {
            Ok(())
        } else {
            Err(AlignmentError::OutOfPicture { inside: self.seen.count, points: points.count })
        }
    }

    /// Evaluates the measure; with an M-estimator under the weights before, then under those of its residuals, in units of their
    /// scale now (`scaled`) or before.
    fn compare(
        &mut self,
        params: &AlignmentParams,
        level: &Level,
        first: bool,
        scaled: bool,
    ) -> Result<(), AlignmentError> {
        let Self { seen, weights, influence, measure, curve, .. } = self;
        if first || params.robust.is_none() {
            weights.clone_from(&seen.inside);
        }
        for (w, inside) in weights.iter_mut().zip(&seen.inside) {
            (0..LANES).for_each(|k| w[k] = if inside[k] > 0.0 { w[k] } else { 0.0 });
        }
        let pair = Pair { template: &level.grey, picture: &seen.level, weight: weights };
        if first {
            measure.begin(pair);
        }
        measure.evaluate(pair, influence).ok_or(AlignmentError::Flat)?;
        if params.similarity.is_information() {
            // What a grey level does in the mean, wherever it is, tells no motion. Over all of a picture it would vanish; over
            // some points it would move the optimum.
            let Influence { by_template, by_picture } = influence;
            curve.centre(&level.grey, by_template, weights).ok_or(AlignmentError::Flat)?;
            if params.method == Method::Esm {
                curve.centre(&seen.level, by_picture, weights).ok_or(AlignmentError::Flat)?;
            }
        }
        if let Some(kind) = params.robust {
            self.reweigh(kind, scaled);
            let Self { seen, weights, influence, measure, .. } = self;
            let pair = Pair { template: &level.grey, picture: &seen.level, weight: weights };
            measure.evaluate(pair, influence).ok_or(AlignmentError::Flat)?;
        }
        Ok(())
    }

    /// Weights by the residuals, in units of the scale that was found or that of now.
    fn reweigh(&mut self, kind: Robust, scaled: bool) {
        let Self { seen, weights, measure, residuals, sorted, noise, .. } = self;
        let Some(all) = measure.residuals() else { return };
        if scaled {
            residuals.clear();
            for (r, inside) in all.iter().zip(&seen.inside) {
                residuals.extend((0..LANES).filter(|&k| inside[k] > 0.0).map(|k| r[k]));
            }
            *noise = mad_scale(residuals, LEAST_SCALE, sorted);
        }
        for ((w, r), inside) in weights.iter_mut().zip(all).zip(&seen.inside) {
            (0..LANES).for_each(|k| w[k] = inside[k] * kind.weight(r[k] / *noise));
        }
    }

    /// Curvature for the step; `kept` is that of the level.
    fn curvature(&mut self, params: &AlignmentParams, level: &Level, kept: &mut Option<Matrix8>) -> Matrix8 {
        let inverse = params.method == Method::InverseCompositional;
        if params.similarity.is_information() {
            return level.curvature;
        }
        if let (Some(kept), true, None) = (&kept, inverse, params.robust) {
            return *kept;
        }
        let pair = Pair { template: &level.grey, picture: &self.seen.level, weight: &self.weights };
        let picture = (!inverse).then_some(&self.seen.slope);
        let h = self.measure.curvature(pair, &level.points, &level.gradient, picture, &mut self.scratch);
        *kept.insert(h)
    }

    /// What each point adds to the negative gradient of the cost.
    fn slope(&mut self, params: &AlignmentParams, level: &Level) -> &Gradients {
        let Self { scratch, influence, seen, .. } = self;
        scratch.resize(level.points.x.len());
        let inverse = params.method == Method::InverseCompositional;
        let mix = |b: usize, out: &mut Row, t: &Row, i: &Row| {
            let (by_template, by_picture) = (&influence.by_template[b], &influence.by_picture[b]);
            if inverse {
                (0..LANES).for_each(|k| out[k] = by_template[k] * t[k]);
            } else {
                (0..LANES).for_each(|k| out[k] = 0.5 * (by_template[k] * t[k] - by_picture[k] * i[k]));
            }
        };
        for b in 0..level.points.x.len() {
            mix(b, &mut scratch.x[b], &level.gradient.x[b], &seen.slope.x[b]);
            mix(b, &mut scratch.y[b], &level.gradient.y[b], &seen.slope.y[b]);
        }
        scratch
    }

    /// Covariance at the end; see [`covariance`].
    fn covariance(&mut self, template: &Template<P>, level: &Level, pose: &P) -> Option<Square<P>> {
        let Self { scratch, influence, seen, measure, weights, .. } = self;
        let pair = Pair { template: &level.grey, picture: &seen.level, weight: weights };
        let information = template.params.similarity.is_information();
        let mut curvature =
            |slope: &Gradients| measure.curvature(pair, &level.points, &level.gradient, Some(slope), scratch);
        // The mixed derivative: products of the template's gradients with the picture's have no noise in the mean, where squares
        // of either would promise too much. Of a square of their sum it is what changes its sign with one of them.
        let mut h = curvature(&seen.slope);
        let mean = h;
        if !information {
            let Gradients { x, y } = &mut seen.slope;
            x.iter_mut().chain(y).flatten().for_each(|v| *v = -*v);
            h -= curvature(&seen.slope);
        }
        scratch.resize(level.points.x.len());
        for b in 0..level.points.x.len() {
            let noise = &influence.by_template[b];
            for k in 0..LANES {
                scratch.x[b][k] = noise[k] * level.gradient.x[b][k];
                scratch.y[b][k] = noise[k] * level.gradient.y[b][k];
            }
        }
        let noise = steepest::squares(&level.points, scratch, &seen.inside);
        let [h, noise, squares, correlated] =
            [&h, &noise, &level.squares, &level.correlated].map(|m| template.basis.matrix(pose, m));
        let smoothing = template.params.smoothing;
        // Rounding of both pictures, as much of it as the smoothing leaves.
        let rounding = 2.0 / 12.0 / (4.0 * core::f64::consts::PI * smoothing * smoothing).max(1.0);
        let second = if information { &level.curvature } else { &mean };
        let second = template.basis.matrix(pose, second);
        covariance::<P>([h, second], noise, squares, &correlated, rounding)
    }
}

#[derive(Clone)]
struct Descent<P> {
    pose: P,
    iterations: u32,
    stop: StopReason,
}

/// Corners in the picture; `None` where one has no image.
fn corners<P: PlanarMotion>(template: &Template<P>, pose: &P) -> Option<[Point2<f64>; 4]>
where
    DefaultAllocator: Alloc<P::D>,
{
    let m = pose.matrix();
    let mut images = template.corners;
    for image in &mut images {
        *image = map(&m, image)?;
    }
    Some(images)
}

/// The pose after a step, which is cut where it moves a corner farther than `longest` pixels, and how far it does.
fn stepped<P: PlanarMotion>(
    template: &Template<P>,
    pose: &P,
    mut d: Tangent<P>,
    longest: f64,
) -> Option<(P, f64)>
where
    DefaultAllocator: Alloc<P::D>,
{
    let from = corners(template, pose)?;
    for _ in 0..8 {
        let next = pose.retract(&d);
        let moved = corners(template, &next)
            .filter(|_| next.is_finite())
            .map(|to| from.iter().zip(&to).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max));
        match moved {
            Some(moved) if moved <= longest => return Some((next, moved)),
            Some(moved) if moved.is_finite() => d *= 0.9 * longest / moved,
            _ => d *= 0.25,
        }
    }
    None
}
