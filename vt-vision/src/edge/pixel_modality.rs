//! The edge modality at pixel level: contour likelihood on an edge map, for particle filters.

use core::marker::PhantomData;

use nalgebra::{DefaultAllocator, Point3};
use vt_core::agent::{Visibility, Warp};
use vt_core::belief::Gaussian;
use vt_core::error::MeasureError;
use vt_core::evidence::{Evidence, EvidenceKey};
use vt_core::frame::{Roi, SensorId};
use vt_core::manifold::{Alloc, Manifold};
use vt_core::measurement::{Measurement, Modality};
use vt_core::sketch::{Mark, Role};
use vt_models::visibility::EdgeSite;

use super::params::EdgeParams;
use super::pixels::{ContourPoint, EdgePixels, weight};
use crate::edge_map::{EdgeMap, EdgeMapProcessing};
use crate::search_region::{check_prior, search_region};
use crate::turns::Turns;

/// Pixel-level edge modality of one target. It needs the evidence of [`EdgeMapProcessing`] with its own
/// `min_contrast`; the contour that is visible at the prior serves all hypotheses of the frame.
pub struct EdgePixelModality<P: Manifold, W: Warp<P, Body = Point3<f64>>, V>
where
    DefaultAllocator: Alloc<P::D>,
{
    params: EdgeParams,
    needs: [EvidenceKey; 1],
    visibility: V,
    probe: f64,
    pixels: EdgePixels<P, W>,
    seen: bool,
}

impl<P, W, V> EdgePixelModality<P, W, V>
where
    P: Manifold,
    W: Warp<P, Body = Point3<f64>>,
    V: Visibility<P, Feature = EdgeSite>,
    DefaultAllocator: Alloc<P::D>,
{
    /// A modality that looks with `warp` at the contours from `visibility` in the grey pictures of `sensor`.
    /// `diameter` is the size of the model in metres.
    pub fn new(params: EdgeParams, sensor: SensorId, warp: W, visibility: V, diameter: f64) -> Self {
        let pixels = EdgePixels {
            warp,
            map: Default::default(),
            contour: vec![],
            sigma: params.sigma,
            clutter: params.miss_probability * params.clutter_density,
            range: params.range[0],
            weight: 1.0,
            pose: PhantomData,
        };
        let needs = [EdgeMapProcessing::key_for(sensor, params.min_contrast)];
        Self { params, needs, visibility, probe: 1e-4 * diameter, pixels, seen: false }
    }

    /// The processing unit whose evidence this modality reads.
    pub fn processing(&self) -> EdgeMapProcessing {
        EdgeMapProcessing::new(self.needs[0].sensor, self.params.min_contrast)
    }
}

impl<P, W, V> Modality<P> for EdgePixelModality<P, W, V>
where
    P: Manifold,
    W: Warp<P, Body = Point3<f64>>,
    V: Visibility<P, Feature = EdgeSite>,
    DefaultAllocator: Alloc<P::D>,
{
    fn needs(&self) -> &[EvidenceKey] {
        &self.needs
    }

    /// Box around the contour of the frame before at the predicted pose, widened by three predicted deviations and
    /// the range of the search; all of the picture before the first frame.
    fn region(&self, prior: &Gaussian<P>) -> Option<Roi> {
        let points = self.pixels.contour.iter().map(|c| &c.point);
        search_region(&self.pixels.warp, points, prior, 3.0, self.params.range[0] + 4.0)
    }

    fn measure(
        &mut self,
        evidence: &Evidence,
        prior: &Gaussian<P>,
    ) -> Result<Option<&dyn Measurement<P>>, MeasureError> {
        self.seen = false;
        check_prior(prior)?;
        evidence.frame(self.needs[0].sensor)?;
        self.pixels.map = evidence.get::<Turns<EdgeMap>>(&self.needs[0])?.now().clone();
        let sites = self.visibility.visible(&prior.mean);
        if sites.is_empty() {
            return Ok(None);
        }
        let spacing = sites.iter().map(|s| f64::from(s.weight)).sum::<f64>() / sites.len() as f64;
        self.pixels.weight = weight(spacing, self.params.correlation_length, self.params.temperature);
        self.pixels.contour.clear();
        self.pixels.contour.extend(sites.iter().map(|s| ContourPoint {
            point: s.p_in_object,
            probe: s.tangent * self.probe,
            edge: s.edge,
        }));
        self.seen = true;
        Ok(self.last())
    }

    fn last(&self) -> Option<&dyn Measurement<P>> {
        self.seen.then_some(&self.pixels as &dyn Measurement<P>)
    }

    fn sketch(&self, pose: &P, out: &mut Vec<Mark>) {
        let mut before = None;
        self.pixels.each(pose, |c, _, y, normal, vote, found| {
            if let Some((edge, from)) = before
                && edge == c.edge
            {
                out.push(Mark::Segment { from, to: y.into(), role: Role::Model });
            }
            before = Some((c.edge, y.into()));
            match vote.best {
                Some((k, p)) => {
                    let to = y + normal * found[k];
                    let role = if p > 0.5 { Role::Inlier } else { Role::Outlier };
                    out.push(Mark::Segment { from: y.into(), to: to.into(), role });
                }
                None => out.push(Mark::Point { at: y.into(), role: Role::Missing }),
            }
        });
    }
}
