//! Oriented chamfer: contour points to the nearest edges, by distance and angle (H. Barrow et al., "Parametric
//! correspondence and chamfer matching", 1977; D. Gavrila, "Multi-feature hierarchical template matching using distance
//! transforms", 1998).

use core::marker::PhantomData;
use std::sync::Arc;

use nalgebra::{DefaultAllocator, Vector2};
use vt_core::agent::Warp;
use vt_core::belief::Gaussian;
use vt_core::error::{ConfigError, MeasureError};
use vt_core::evidence::{Evidence, EvidenceKey};
use vt_core::frame::{Roi, SensorId};
use vt_core::manifold::{Alloc, Manifold, Tangent};
use vt_core::measurement::{Level, Linearized, Measurement, Modality, NormalEquations, Quality};
use vt_core::sketch::Mark;
use vt_models::contour::Contour;

use super::modality::{check_count, sketch_contour};
use super::places::{Place, places};
use crate::canny::{Canny, CannyParams};
use crate::distance_transform::{DistanceTransform, EdgeDistance, EdgeDistanceProcessing};
use crate::edge_map::EdgePixel;
use crate::search_region::{check_prior, search_region};

/// Parameters of a [`ChamferModality`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChamferParams {
    /// Distance of an edge from the contour, as a standard deviation, pixels.
    pub sigma: f64,
    /// Sine of the angle between contour and edge, as a standard deviation.
    pub angle: f64,
    /// Deviations at which a point counts as without an edge.
    pub truncation: f64,
    /// Temperature τ, the divisor of the log-likelihood; by default an eighth of the number of points, which then count as
    /// eight independent ones.
    pub temperature: Option<f64>,
}

impl Default for ChamferParams {
    fn default() -> Self {
        Self { sigma: 2.0, angle: 0.3, truncation: 3.0, temperature: None }
    }
}

impl ChamferParams {
    /// Checks all ranges.
    ///
    /// # Errors
    /// [`ConfigError::Parameter`] with the first parameter that is out of its range.
    pub fn check(self) -> Result<Self, ConfigError> {
        let temperature = self.temperature.unwrap_or(1.0);
        for (key, v) in [
            ("sigma", self.sigma),
            ("angle", self.angle),
            ("truncation", self.truncation),
            ("temperature", temperature),
        ] {
            if !(v > 0.0 && v.is_finite()) {
                return Err(ConfigError::parameter(key, v, "a positive number"));
            }
        }
        Ok(self)
    }
}

/// `ln P(z | p) = −1/2τ Σ min(r²/σ² + s²/σ_s², μ²)` with the distance `r = g · (m − y)` of a contour point `y` from the line
/// through its nearest edge `m` with the gradient's direction `g`, and the sine `s` between `g` and the contour's normal.
///
/// The distance from the line and not from the pixel: along an edge, an edge says nothing.
pub struct ChamferLikelihood<P: Manifold, W: Warp<P>>
where
    DefaultAllocator: Alloc<P::D>,
{
    warp: W,
    contour: Contour<W::Body>,
    edges: Arc<Canny>,
    distance: Arc<DistanceTransform>,
    params: ChamferParams,
    /// `1 / τ`.
    weight: f64,
    pose: PhantomData<fn() -> P>,
}

/// A contour point that has an edge.
struct Pair {
    edge: EdgePixel,
    distance: f64,
    sine: f64,
    /// Squared deviations.
    squared: f64,
}

impl<P: Manifold, W: Warp<P>> ChamferLikelihood<P, W>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// The nearest edge of a place, unless it is too far.
    #[inline]
    fn pair(&self, place: &Place) -> Option<Pair> {
        let (x, y) = (place.y.x + 0.5, place.y.y + 0.5);
        // Truncation rounds positive numbers down.
        if !(x >= 0.0 && y >= 0.0 && x < f64::from(u16::MAX) && y < f64::from(u16::MAX)) {
            return None;
        }
        let (far, [u, v]) = self.distance.get(x as u32, y as u32)?;
        let most = self.params.truncation;
        if f64::from(far) > most * self.params.sigma + 1.0 {
            return None;
        }
        let edge = self.edges.get(u, v)?;
        let distance = edge.direction.dot(&(edge.at - place.y));
        let sine = cross(&place.normal, &edge.direction);
        let [a, b] = [distance / self.params.sigma, sine / self.params.angle];
        let squared = a * a + b * b;
        (squared < most * most).then_some(Pair { edge, distance, sine, squared })
    }

    /// Calls `f(residual, Jacobian, variance)` for both rows of every point that has an edge; returns the cost.
    fn rows(&self, at: &P, mut f: impl FnMut(f64, Tangent<P>, f64)) -> f64 {
        let posed = self.warp.at(at);
        let (sigma, angle) = (self.params.sigma, self.params.angle);
        let mut sum = 0.0;
        places::<P, W>(&posed, &self.contour, |place| {
            let Some(pair) = self.pair(&place) else { return sum += self.params.truncation.powi(2) };
            sum += pair.squared;
            let direction = pair.edge.direction;
            let along = Place { normal: direction, ..place };
            let (Some((own, _)), Some((_, turn))) = (
                along.derivatives::<P, W>(&posed, &self.contour),
                place.derivatives::<P, W>(&posed, &self.contour),
            ) else {
                return;
            };
            f(pair.distance, own, sigma * sigma / self.weight);
            let slope = turn * -cross(&place.tangent(), &direction);
            f(-pair.sine, slope, angle * angle / self.weight);
        });
        0.5 * self.weight * sum
    }
}

fn cross(a: &Vector2<f64>, b: &Vector2<f64>) -> f64 {
    a.x * b.y - a.y * b.x
}

impl<P: Manifold, W: Warp<P>> Measurement<P> for ChamferLikelihood<P, W>
where
    DefaultAllocator: Alloc<P::D>,
{
    fn log_likelihoods(&self, poses: &[P], out: &mut [f64]) {
        let truncated = self.params.truncation.powi(2);
        for (pose, l) in poses.iter().zip(out) {
            let mut sum = 0.0;
            places::<P, W>(&self.warp.at(pose), &self.contour, |place| {
                sum += self.pair(&place).map_or(truncated, |pair| pair.squared);
            });
            *l = -0.5 * self.weight * sum;
        }
    }

    /// Distance and sine of every contour point that has an edge.
    fn residuals(&self, at: &P, out: &mut Linearized<P>) {
        out.clear();
        self.rows(at, |r, j, variance| out.push(r, j, variance, 1.0));
    }

    fn normal_equations(&self, at: &P, out: &mut NormalEquations<P>) {
        out.clear();
        let cost = self.rows(at, |r, j, variance| out.add(r, &j, 1.0 / variance));
        out.cost = cost;
    }

    fn quality(&self, at: &P) -> Quality {
        let mut q = Quality::default();
        let (mut squares, mut ratio) = (0.0, 0.0);
        places::<P, W>(&self.warp.at(at), &self.contour, |place| {
            q.expected += 1;
            if let Some(pair) = self.pair(&place) {
                q.inliers += 1;
                squares += (pair.distance / self.params.sigma).powi(2);
                ratio += 0.5 * (self.params.truncation.powi(2) - pair.squared);
            }
        });
        let expected = (q.expected as f64).max(1.0);
        q.inlier_ratio = q.inliers as f64 / expected;
        q.log_ratio = ratio / expected;
        q.normalized_rms = (squares / (q.inliers as f64).max(1.0)).sqrt();
        q
    }

    fn level(&self) -> Level {
        Level::Pixel
    }
}

/// Pixel-level chamfer modality of one target. It needs the evidence of [`EdgeDistanceProcessing`].
pub struct ChamferModality<P: Manifold, W: Warp<P>>
where
    DefaultAllocator: Alloc<P::D>,
{
    canny: CannyParams,
    needs: [EvidenceKey; 1],
    likelihood: ChamferLikelihood<P, W>,
    seen: bool,
}

impl<P: Manifold, W: Warp<P>> ChamferModality<P, W>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// A modality that looks with `warp` for `contour` among the edges that `canny` finds in the pictures of `sensor`.
    ///
    /// # Errors
    /// [`ConfigError`] for parameters out of range, and for a contour with too few or too many points.
    pub fn new(
        params: ChamferParams,
        canny: CannyParams,
        sensor: SensorId,
        warp: W,
        contour: Contour<W::Body>,
    ) -> Result<Self, ConfigError> {
        let params = params.check()?;
        check_count(&contour)?;
        let needs = [EdgeDistanceProcessing::key_for(sensor, &canny)];
        let weight = 1.0 / params.temperature.unwrap_or(contour.points().len() as f64 / 8.0);
        let (edges, distance) = Default::default();
        let likelihood =
            ChamferLikelihood { warp, contour, edges, distance, params, weight, pose: PhantomData };
        Ok(Self { canny, needs, likelihood, seen: false })
    }

    /// The processing unit whose evidence this modality reads.
    pub fn processing(&self) -> EdgeDistanceProcessing {
        EdgeDistanceProcessing::new(self.needs[0].sensor, self.canny.clone())
    }
}

impl<P: Manifold, W: Warp<P>> Modality<P> for ChamferModality<P, W>
where
    DefaultAllocator: Alloc<P::D>,
{
    fn needs(&self) -> &[EvidenceKey] {
        &self.needs
    }

    /// Box around the contour at the predicted pose, widened by four predicted deviations and the distance at which edges
    /// no longer count.
    fn region(&self, prior: &Gaussian<P>) -> Option<Roi> {
        let params = &self.likelihood.params;
        let points = self.likelihood.contour.points().iter();
        search_region(&self.likelihood.warp, points, prior, 4.0, params.sigma * params.truncation + 4.0)
    }

    fn measure(
        &mut self,
        evidence: &Evidence,
        prior: &Gaussian<P>,
    ) -> Result<Option<&dyn Measurement<P>>, MeasureError> {
        self.seen = false;
        check_prior(prior)?;
        evidence.frame(self.needs[0].sensor)?;
        let found = evidence.get::<EdgeDistance>(&self.needs[0])?;
        self.likelihood.edges = found.edges().now().clone();
        self.likelihood.distance = found.distance().now().clone();
        self.seen = !self.likelihood.distance.distance().values().is_empty();
        Ok(self.last())
    }

    fn last(&self) -> Option<&dyn Measurement<P>> {
        self.seen.then_some(&self.likelihood as &dyn Measurement<P>)
    }

    fn sketch(&self, pose: &P, out: &mut Vec<Mark>) {
        sketch_contour(&self.likelihood.warp.at(pose), &self.likelihood.contour, out);
    }
}
