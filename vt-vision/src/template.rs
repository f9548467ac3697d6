//! Template likelihood: zero-mean normalised cross-correlation of a warped patch with its reference (S. Baker, I. Matthews,
//! "Lucas-Kanade 20 years on", 2004; G. Evangelidis, E. Psarakis, "Parametric image alignment using ECC", 2008).
//!
//! ```text
//! P(z | p) ∝ exp(−λ (1 − NCC)),    1 − NCC = ½ ‖t̂ − î(p)‖²
//! ```
//!
//! with `t̂`, `î` the grey levels of template and picture less their means, of unit length: changes of brightness and
//! contrast do not count. The residual `t̂ − î` makes the same likelihood fit for Gauss–Newton, with the exact derivative of
//! the bilinear interpolation. `lambda` is the inverse temperature. `adapt` lets the template follow what is seen, see
//! [`crate::adaptation`].
//!
//! A derivative tells the way to the template only as far as its structures are wide. With `smoothing`, template and picture are both
//! smoothed as far as the prediction is uncertain: the likelihood is that of the smoothed pictures, and its linear form
//! holds over the prior (coarse to fine; B. Lucas, T. Kanade, "An iterative image registration technique", 1981).

use std::sync::Arc;

use image::GrayImage;
use nalgebra::{DefaultAllocator, Point2, U1, Vector2};
use vt_core::agent::{Posed, Warp};
use vt_core::belief;
use vt_core::error::{ConfigError, MeasureError};
use vt_core::evidence::{Evidence, EvidenceKey};
use vt_core::frame::{Payload, SensorId};
use vt_core::lie::PlanarMotion;
use vt_core::manifold::{Alloc, Tangent};
use vt_core::measurement::{Level, Linearized, Measurement, Modality, NormalEquations, Quality};
use vt_core::sketch::Mark;
use vt_core::time::Timestamp;
use vt_models::warp::PlanarWarp;

use crate::adaptation::{Adaptation, AdaptationParams};
use crate::color::grey_of;
use crate::gaussian::{Blur, Gaussian};
use crate::rectangle::Rectangle;
use crate::search_region::{check_prior, search_region};
use crate::turns::Turns;

/// Parameters of a [`TemplateModality`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TemplateParams {
    /// Inverse temperature λ: the likelihood of no correlation is `e^−λ`.
    pub lambda: f64,
    /// About how many points of the patch are compared.
    pub samples: usize,
    /// Least share of the points that must be in the picture; below it nothing correlates.
    pub least_inside: f64,
    /// Width of the smoothing, as a deviation, in predicted deviations of the patch's corners; 0 for pictures as they are.
    pub smoothing: f64,
    /// How the template follows what is seen; `None` for not at all.
    pub adapt: Option<AdaptationParams>,
}

impl Default for TemplateParams {
    fn default() -> Self {
        Self { lambda: 20.0, samples: 400, least_inside: 0.5, smoothing: 0.0, adapt: None }
    }
}

impl TemplateParams {
    /// Checks all ranges.
    ///
    /// # Errors
    /// [`ConfigError::Parameter`] with the first parameter that is out of its range.
    pub fn check(self) -> Result<Self, ConfigError> {
        if !(self.lambda > 0.0 && self.lambda.is_finite()) {
            return Err(ConfigError::parameter("lambda", self.lambda, "a positive number"));
        }
        if !(16..=1_000_000).contains(&self.samples) {
            return Err(ConfigError::parameter("samples", self.samples, "16 to a million"));
        }
        if !(self.least_inside > 0.0 && self.least_inside <= 1.0) {
            return Err(ConfigError::parameter("least_inside", self.least_inside, "above 0, at most 1"));
        }
        if !(self.smoothing >= 0.0 && self.smoothing.is_finite()) {
            return Err(ConfigError::parameter("smoothing", self.smoothing, "zero or a positive number"));
        }
        if self.adapt.is_some() && self.smoothing > 0.0 {
            return Err(ConfigError::parameter(
                "smoothing",
                self.smoothing,
                "zero where the template adapts",
            ));
        }
        self.adapt.map(AdaptationParams::check).transpose()?;
        Ok(self)
    }
}

/// Variance of grey levels below which a patch is flat and correlates with nothing.
const FLAT: f64 = 0.25;

/// Deviation of the grey levels of a template that was adapted.
const CONTRAST: f64 = 64.0;

/// A correlation above this supports the template.
const SIMILAR: f64 = 0.6;

/// Widths of the smoothing, as deviations in pixels, for which a template is kept beside that of the picture as it is. Finer steps change
/// nothing that matters; where the prediction is less certain than the widest, there would be nothing left of most objects.
const WIDTHS: [f64; 6] = [1.0, 1.4, 2.0, 2.8, 4.0, 5.6];

/// Predicted deviations within which the picture is smoothed.
const DEVIATIONS: f64 = 6.0;

/// The picture of a frame and the template that is looked for in it.
pub struct TemplateLikelihood<P> {
    warp: PlanarWarp<P>,
    params: TemplateParams,
    picture: Arc<GrayImage>,
    points: Vec<Point2<f64>>,
    /// Grey levels of the template at the points, as it is and at each of [`WIDTHS`]; empty without one.
    templates: Vec<Vec<f64>>,
    /// The one that `picture` is compared with.
    scale: usize,
}

/// Grey level and gradient of the bilinear interpolation; `None` outside of the pixel centres.
#[inline]
fn interpolate(picture: &GrayImage, at: &Point2<f64>) -> Option<(f64, Vector2<f64>)> {
    let (width, height) = picture.dimensions();
    let inside =
        at.x >= 0.0 && at.y >= 0.0 && at.x < f64::from(width) - 1.0 && at.y < f64::from(height) - 1.0;
    if !inside {
        return None;
    }
    let (x, y) = (at.x as usize, at.y as usize);
    let (u, v) = (at.x - x as f64, at.y - y as f64);
    let start = y * width as usize + x;
    let pair = |k: usize| [0, 1].map(|i| f64::from(picture.as_raw()[k + i]));
    let ([a, b], [c, d]) = (pair(start), pair(start + width as usize));
    let (above, below) = (a + u * (b - a), c + u * (d - c));
    Some((above + v * (below - above), Vector2::new((b - a) + v * ((d - c) - (b - a)), below - above)))
}

/// Sums over the points in the picture.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    count: f64,
    image: f64,
    image_squared: f64,
    template: f64,
    template_squared: f64,
    product: f64,
}

impl Sums {
    #[inline]
    fn add(&mut self, image: f64, template: f64) {
        self.count += 1.0;
        self.image += image;
        self.image_squared += image * image;
        self.template += template;
        self.template_squared += template * template;
        self.product += image * template;
    }

    /// Means, lengths of picture and template less their means, and their correlation; `None` where one is flat.
    fn correlation(&self) -> Option<([f64; 2], [f64; 2], f64)> {
        let n = self.count;
        let image = self.image_squared - self.image * self.image / n;
        let template = self.template_squared - self.template * self.template / n;
        if !(image > FLAT * n && template > FLAT * n) {
            return None;
        }
        let lengths = [image.sqrt(), template.sqrt()];
        let product = self.product - self.image * self.template / n;
        Some(([self.image / n, self.template / n], lengths, product / (lengths[0] * lengths[1])))
    }
}

impl<P: PlanarMotion> TemplateLikelihood<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// Grey levels of the template at the points, smoothed like the picture.
    fn levels(&self) -> &[f64] {
        self.templates.get(self.scale).map_or(&[], Vec::as_slice)
    }

    /// Sums over the points in the picture.
    fn sums(&self, posed: &impl Posed<P, Body = Point2<f64>>) -> Option<Sums> {
        let mut sums = Sums::default();
        for (point, &level) in self.points.iter().zip(self.levels()) {
            if let Some((image, _)) = posed.locate(point).and_then(|y| interpolate(&self.picture, &y)) {
                sums.add(image, level);
            }
        }
        (sums.count >= self.params.least_inside * self.points.len() as f64).then_some(sums)
    }

    /// Correlation of the picture at `pose` with the template; 0 where there is none.
    pub fn correlation(&self, pose: &P) -> f64 {
        let sums = self.sums(&self.warp.at(pose));
        sums.and_then(|s| s.correlation()).map_or(0.0, |(_, _, ncc)| ncc)
    }

    /// Calls `f(residual, Jacobian)` for every point in the picture; returns the correlation.
    fn rows(&self, at: &P, mut f: impl FnMut(f64, Tangent<P>)) -> f64 {
        let posed = self.warp.at(at);
        let Some((mean, length, ncc)) = self.sums(&posed).and_then(|s| s.correlation()) else { return 0.0 };
        let each = |f: &mut dyn FnMut(f64, f64, Tangent<P>)| {
            for (point, &level) in self.points.iter().zip(self.levels()) {
                let Some((y, j)) = posed.linearize(point) else { continue };
                let Some((image, gradient)) = interpolate(&self.picture, &y) else { continue };
                f(
                    (image - mean[0]) / length[0],
                    (level - mean[1]) / length[1],
                    j.tr_mul(&gradient) / length[0],
                );
            }
        };
        // ∂î = (1 − î îᵀ)(1 − 1 1ᵀ/n) ∂I / ‖I − Ī‖
        let (mut sum, mut along) = (Tangent::<P>::zeros_generic(at.dim(), U1), at.zero());
        let mut count = 0.0;
        each(&mut |image, _, slope| {
            sum += &slope;
            along += slope * image;
            count += 1.0;
        });
        sum /= count;
        each(&mut |image, template, slope| f(template - image, slope - &sum - &along * image));
        ncc
    }

    /// Takes the grey levels at `pose` at all widths; `false` where not all of the patch is in the picture or it is flat.
    fn learn(&mut self, kernels: &[Gaussian], corners: &[Point2<f64>], pose: &P) -> bool {
        let posed = self.warp.at(pose);
        let certain = belief::Gaussian::from_sigmas(pose.clone(), &pose.zero());
        let region = search_region(&self.warp, corners.iter(), &certain, 0.0, 2.0);
        let (mut blur, mut smooth) = (Blur::default(), GrayImage::default());
        self.templates.clear();
        for kernel in core::iter::once(None).chain(kernels.iter().map(Some)) {
            let mut source = &*self.picture;
            if let Some(kernel) = kernel {
                blur.picture(source, region, kernel, &mut smooth);
                source = &smooth;
            }
            let level = |x: &Point2<f64>| Some(interpolate(source, &posed.locate(x)?)?.0);
            let Some(levels) = self.points.iter().map(level).collect::<Option<Vec<f64>>>() else { break };
            let mut sums = Sums::default();
            levels.iter().for_each(|&l| sums.add(l, l));
            // What smoothing wipes out is no template; finer ones are.
            if sums.correlation().is_none() {
                break;
            }
            self.templates.push(levels);
        }
        !self.templates.is_empty()
    }

    /// Blends the grey levels at `pose`, less their mean and of unit length, into the template of the same kind; not where the
    /// patch is flat or not all of it is in the picture.
    fn adapt(&mut self, adaptation: &mut Adaptation, pose: &P, now: Timestamp) {
        let posed = self.warp.at(pose);
        let Some(([mean, own], [length, of_template], _)) =
            self.sums(&posed).and_then(|sums| sums.correlation())
        else {
            return;
        };
        // Smoothed templates do not adapt.
        let Some(levels) = self.templates.first_mut() else { return };
        adaptation.start(levels.iter().map(|level| (level - own) / of_template));
        let seen = adaptation.seen();
        let level = |x| Some((interpolate(&self.picture, &posed.locate(x)?)?.0 - mean) / length);
        seen.extend(self.points.iter().map_while(level));
        if seen.len() == self.points.len() {
            // Of a contrast that is far from flat.
            let scale = CONTRAST * (self.points.len() as f64).sqrt();
            levels.iter_mut().zip(adaptation.blend(now)).for_each(|(level, x)| *level = scale * x);
        }
    }
}

impl<P: PlanarMotion> Measurement<P> for TemplateLikelihood<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    fn log_likelihoods(&self, poses: &[P], out: &mut [f64]) {
        for (pose, l) in poses.iter().zip(out) {
            *l = -self.params.lambda * (1.0 - self.correlation(pose));
        }
    }

    /// `t̂ − î` of every point in the picture.
    fn residuals(&self, at: &P, out: &mut Linearized<P>) {
        out.clear();
        let variance = 1.0 / self.params.lambda;
        self.rows(at, |r, j| out.push(r, j, variance, 1.0));
    }

    fn normal_equations(&self, at: &P, out: &mut NormalEquations<P>) {
        out.clear();
        let ncc = self.rows(at, |r, j| out.add(r, &j, self.params.lambda));
        out.cost = self.params.lambda * (1.0 - ncc);
    }

    /// One row; its share is the correlation.
    fn quality(&self, at: &P) -> Quality {
        let ncc = self.correlation(at);
        let inliers = usize::from(ncc > SIMILAR);
        let squares = 2.0 * self.params.lambda * (1.0 - ncc) / self.points.len() as f64;
        Quality {
            expected: 1,
            inliers,
            inlier_ratio: ncc.clamp(0.0, 1.0),
            log_ratio: self.params.lambda * (ncc - SIMILAR),
            normalized_rms: if inliers > 0 { squares.max(0.0).sqrt() } else { 0.0 },
        }
    }

    fn level(&self) -> Level {
        Level::Pixel
    }
}

/// Pixel-level template modality of a rectangular target of a known size about the origin. It reads frames themselves.
/// Without a template it takes that of the first frame, at the predicted pose.
pub struct TemplateModality<P> {
    sensor: SensorId,
    rectangle: Rectangle,
    likelihood: TemplateLikelihood<P>,
    kernels: Vec<Gaussian>,
    blur: Blur,
    /// Grey pictures of colour frames.
    pictures: Turns<GrayImage>,
    /// The pictures, smoothed around the target.
    smoothed: Turns<GrayImage>,
    /// No picture.
    nothing: Arc<GrayImage>,
    adaptation: Option<Adaptation>,
    given: bool,
    /// The target was seen and trusted with this template.
    settled: bool,
    seen: bool,
}

impl<P: PlanarMotion> TemplateModality<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// A modality for an object of `width × height` in its own units, seen by `sensor` under `warp`.
    ///
    /// # Errors
    /// [`ConfigError`] for parameters and sizes out of range.
    pub fn new(
        params: TemplateParams,
        sensor: SensorId,
        warp: PlanarWarp<P>,
        size: [f64; 2],
    ) -> Result<Self, ConfigError> {
        let (params, rectangle) = (params.check()?, Rectangle::new(size)?);
        let kernels = WIDTHS.map(Gaussian::new).into_iter().collect::<Result<_, _>>()?;
        let points = rectangle.lattice(params.samples);
        let (picture, templates) = Default::default();
        let likelihood = TemplateLikelihood { warp, params, picture, points, templates, scale: 0 };
        let (blur, pictures, smoothed) = Default::default();
        Ok(Self {
            sensor,
            rectangle,
            likelihood,
            kernels,
            blur,
            pictures,
            smoothed,
            nothing: Arc::default(),
            adaptation: params.adapt.map(Adaptation::new),
            given: false,
            settled: false,
            seen: false,
        })
    }

    /// Takes the template from a picture that shows the object at `pose`.
    ///
    /// # Errors
    /// [`ConfigError::Mismatch`] where the object is not whole in the picture, or without structure.
    pub fn with_reference(mut self, picture: &GrayImage, pose: &P) -> Result<Self, ConfigError> {
        self.likelihood.picture = Arc::new(picture.clone());
        self.given = self.learn(pose);
        if self.given {
            return Ok(self);
        }
        let found =
            format!("a patch that is flat or not whole in a picture of {:?} pixels", picture.dimensions());
        Err(ConfigError::Mismatch {
            found,
            expected: "a pose at which the picture shows a textured object".into(),
        })
    }

    fn learn(&mut self, pose: &P) -> bool {
        self.likelihood.learn(&self.kernels, &self.rectangle.corners(), pose)
    }

    /// Smooths the picture around the target as far as the prediction is uncertain, and no farther than there is a template.
    fn smooth(&mut self, prior: &belief::Gaussian<P>) {
        let Self { likelihood, rectangle, kernels, blur, smoothed, .. } = self;
        let wanted = likelihood.params.smoothing * deviation(&likelihood.warp, &rectangle.corners(), prior);
        let widest = likelihood.templates.len().saturating_sub(1);
        likelihood.scale = WIDTHS.iter().take_while(|&&w| w <= wanted).count().min(widest);
        let Some(width) = likelihood.scale.checked_sub(1) else { return };
        let kernel = &kernels[width];
        let margin = f64::from(kernel.reach()) + 2.0;
        let region = search_region(&likelihood.warp, rectangle.corners().iter(), prior, DEVIATIONS, margin);
        let smooth = smoothed.turn();
        smooth.clone_from(&likelihood.picture);
        blur.picture(&likelihood.picture, region, kernel, smooth);
        likelihood.picture = smoothed.now().clone();
    }
}

/// Predicted deviation of a coordinate of the points' images, root mean square over them, pixels.
fn deviation<P: PlanarMotion>(
    warp: &PlanarWarp<P>,
    points: &[Point2<f64>],
    prior: &belief::Gaussian<P>,
) -> f64
where
    DefaultAllocator: Alloc<P::D>,
{
    let posed = warp.at(&prior.mean);
    let (mut sum, mut count) = (0.0, 0.0);
    for (_, j) in points.iter().filter_map(|x| posed.linearize(x)) {
        for row in 0..2 {
            let j = j.row(row).transpose();
            sum += (&prior.covariance * &j).dot(&j).max(0.0);
            count += 1.0;
        }
    }
    if count > 0.0 { (sum / count).sqrt() } else { 0.0 }
}

impl<P: PlanarMotion> Modality<P> for TemplateModality<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    fn needs(&self) -> &[EvidenceKey] {
        &[]
    }

    fn measure(
        &mut self,
        evidence: &Evidence,
        prior: &belief::Gaussian<P>,
    ) -> Result<Option<&dyn Measurement<P>>, MeasureError> {
        self.seen = false;
        check_prior(prior)?;
        let frame = evidence.frame(self.sensor)?;
        if let Payload::Grey(picture) = &frame.payload {
            self.likelihood.picture = picture.clone();
        } else {
            // The measurement may still hold the picture of the frame before.
            self.likelihood.picture = self.nothing.clone();
            grey_of(frame, self.pictures.turn())?;
            self.likelihood.picture = self.pictures.now().clone();
        }
        self.seen = !self.likelihood.templates.is_empty() || self.learn(&prior.mean);
        self.smooth(prior);
        Ok(self.last())
    }

    fn last(&self) -> Option<&dyn Measurement<P>> {
        self.seen.then_some(&self.likelihood as &dyn Measurement<P>)
    }

    /// A template that was given stays.
    fn forget(&mut self) {
        self.revert();
        if !self.given {
            self.likelihood.templates.clear();
            self.adaptation.iter_mut().for_each(Adaptation::forget);
            self.settled = false;
        }
    }

    fn adapt(&mut self, evidence: &Evidence, posterior: &belief::Gaussian<P>) -> Result<(), MeasureError> {
        check_prior(posterior)?;
        let now = evidence.frame(self.sensor)?.time;
        self.settled = true;
        if let Some(adaptation) = &mut self.adaptation {
            self.likelihood.adapt(adaptation, &posterior.mean, now);
        }
        Ok(())
    }

    /// What was learnt in trusted steps stays, which its anchor holds. A template that was never trusted goes.
    fn revert(&mut self) {
        if !self.given && !self.settled {
            self.likelihood.templates.clear();
        }
    }

    fn sketch(&self, pose: &P, out: &mut Vec<Mark>) {
        self.rectangle.sketch(&self.likelihood.warp, pose, out);
    }
}
