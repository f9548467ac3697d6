//! The edge modality: model contour against image edges (RAPiD, Harris 1990; Drummond and Cipolla 2002).

use nalgebra::{DefaultAllocator, Dim, Point3};
use vt_core::agent::{Posed, Visibility, Warp};
use vt_core::belief::{Gaussian, cholesky};
use vt_core::dynamics::semidefinite_root;
use vt_core::error::MeasureError;
use vt_core::evidence::{Evidence, EvidenceKey};
use vt_core::frame::SensorId;
use vt_core::manifold::{Alloc, Manifold, Square, Tangent};
use vt_core::measurement::{Level, Measurement, Modality, NormalEquations};
use vt_core::pose_measurement::PoseMeasurement;
use vt_core::sketch::Mark;

use super::features::{EdgeFeatures, EdgeRow};
use super::memory::AppearanceMemory;
use super::mixture::EdgeMixture;
use super::params::EdgeParams;
use super::residuals::Residuals;
use super::rivals::Rivals;
use crate::edge_search::{EdgeCandidate, NOISE_GAIN};
use crate::noise::noise_deviation;
use crate::pyramid::{Pyramid, PyramidProcessing};
use vt_models::visibility::EdgeSite;

/// Edge modality of one target.
///
/// A frame is measured in a few rounds of searching edges along the normals of the visible contour and of aligning
/// the contour with all of them at once, at a scale that shrinks from the predicted uncertainty to the noise of
/// localisation. What is handed out depends on the level: matched edges, or the aligned pose with its information.
pub struct EdgeModality<P: Manifold, W: Warp<P, Body = Point3<f64>>, V>
where
    DefaultAllocator: Alloc<P::D>,
{
    pub(super) params: EdgeParams,
    sensor: SensorId,
    needs: Vec<EvidenceKey>,
    pub(super) visibility: V,
    /// Length by which a contour point is moved along its tangent to find the contour's direction in the image.
    pub(super) probe: f64,
    pub(super) features: EdgeFeatures<P, W>,
    object: Option<PoseMeasurement<P>>,
    pub(super) equations: Option<NormalEquations<P>>,
    pub(super) memory: AppearanceMemory,
    pub(super) found: Vec<EdgeCandidate>,
    /// Smallest step that counts as an edge in this frame, grey levels.
    pub(super) min_contrast: f64,
    noise: Vec<u16>,
    residuals: Residuals,
    rivals: Rivals,
    seen: bool,
    /// Whether the frame before was measured, too: then the contour is near its prediction.
    pub(super) followed: bool,
}

/// Lines for which there is room from the start; with more, the buffers grow once.
const ROOM: usize = 1024;

/// An edge must stand out from what noise alone does by this factor.
pub(super) const NOISE_FACTOR: f64 = 4.0;

impl<P, W, V> EdgeModality<P, W, V>
where
    P: Manifold,
    W: Warp<P, Body = Point3<f64>>,
    V: Visibility<P, Feature = EdgeSite>,
    DefaultAllocator: Alloc<P::D>,
{
    /// A modality that looks with `warp` at the contours from `visibility` in the grey pictures of `sensor`.
    /// `diameter` is the size of the model in metres.
    pub fn new(params: EdgeParams, sensor: SensorId, warp: W, visibility: V, diameter: f64) -> Self {
        let mut mixture =
            EdgeMixture::new(warp, params.sigma, params.miss_probability, params.clutter_density);
        mixture.lines.reserve(ROOM);
        mixture.edges.reserve(ROOM * params.max_candidates);
        let coarse = params.coarse_levels;
        let needs = if coarse > 0 { vec![PyramidProcessing::key_for(sensor, coarse)] } else { vec![] };
        Self {
            params,
            sensor,
            needs,
            visibility,
            probe: 1e-4 * diameter,
            features: EdgeFeatures { rows: Vec::with_capacity(ROOM), mixture },
            object: None,
            equations: None,
            memory: AppearanceMemory::new(0.03 * diameter),
            found: Vec::with_capacity(params.max_candidates + 1),
            min_contrast: params.min_contrast,
            noise: vec![],
            residuals: Residuals::default(),
            rivals: Rivals::with_capacity(ROOM),
            seen: false,
            followed: false,
        }
    }

    /// The pose that the last call of `measure` found, at object level.
    pub fn object(&self) -> Option<&PoseMeasurement<P>> {
        self.object.as_ref().filter(|_| self.seen)
    }

    /// Matches to every line its most probable edge at `pose`, estimates the noise of localisation and remembers what
    /// the object looks like beside them.
    fn associate(&mut self, pose: &P) {
        let EdgeFeatures { rows, mixture } = &mut self.features;
        rows.clear();
        self.residuals.clear();
        let posed = mixture.warp.at(pose);
        let sigma = self.params.sigma;
        for line in &mixture.lines {
            let Some(y) = posed.locate(&line.point) else { continue };
            let u = line.normal.dot(&y.coords);
            self.residuals.expect(line.weight);
            let Some((k, probability)) = mixture.vote(line, u, sigma).best else { continue };
            let edge = &mixture.edges[line.first as usize + k];
            if probability > 0.5 {
                self.memory.observe(line.edge, &line.point, &line.tangent, line.contour, edge.sides);
            }
            self.residuals.add(line.edge, line.weight, probability, edge.position - u);
            rows.push(EdgeRow {
                edge: line.edge,
                point: line.point,
                normal: line.normal,
                position: edge.position,
                variance: 1.0 / line.weight,
                weight: probability,
            });
        }
        let variance = self.residuals.variance(pose.dim().value(), self.params.localization, sigma);
        mixture.sigma = variance.sqrt().max(sigma);
        let variance = variance * self.residuals.inflation();
        for row in rows.iter_mut() {
            row.variance *= variance;
        }
        self.rivals.leave_out(&posed, rows);
    }

    /// The pose that fits the matched edges best, with their information.
    fn solve(&mut self, pose: &mut P, root: &Square<P>) {
        let equations = self.equations.get_or_insert_with(|| NormalEquations::empty(pose));
        for _ in 0..3 {
            self.features.normal_equations(pose, equations);
            let mut system = root.tr_mul(&(&equations.information * root));
            let trace = system.trace();
            for k in 0..system.nrows() {
                system[(k, k)] += 1e-12 * trace + f64::MIN_POSITIVE;
            }
            let Some(factor) = cholesky(system) else { break };
            let next = pose.retract(&(root * factor.solve(&root.tr_mul(&equations.gradient))));
            if !next.is_finite() {
                break;
            }
            *pose = next;
        }
        self.features.normal_equations(pose, equations);
    }
}

impl<P, W, V> Modality<P> for EdgeModality<P, W, V>
where
    P: Manifold,
    W: Warp<P, Body = Point3<f64>>,
    V: Visibility<P, Feature = EdgeSite>,
    DefaultAllocator: Alloc<P::D>,
{
    fn needs(&self) -> &[EvidenceKey] {
        &self.needs
    }

    /// The pyramid is read only where the contour of the frame before is predicted with more uncertainty than the
    /// longest search range.
    fn needs_near(&self, prior: &Gaussian<P>) -> &[EvidenceKey] {
        let mixture = &self.features.mixture;
        let longest = (self.params.range[1] / 3.0).powi(2);
        let narrow = |j: &Tangent<P>| (&prior.covariance * j).dot(j) <= 0.5 * longest;
        if !mixture.lines.is_empty() && mixture.lines.iter().all(|l| narrow(&l.jacobian)) {
            return &[];
        }
        &self.needs
    }

    fn measure(
        &mut self,
        evidence: &Evidence,
        prior: &Gaussian<P>,
    ) -> Result<Option<&dyn Measurement<P>>, MeasureError> {
        self.followed = std::mem::take(&mut self.seen);
        if !prior.is_finite() {
            return Err(MeasureError::Prediction("the predicted pose is not finite"));
        }
        let image = evidence.frame(self.sensor)?.grey()?;
        let noise = noise_deviation(image, &mut self.noise);
        self.min_contrast = self.params.min_contrast.max(NOISE_FACTOR * NOISE_GAIN * noise);
        // Under a narrow prediction nobody asked for it.
        let pyramid = self.needs.first().and_then(|key| evidence.get::<Pyramid>(key).ok());
        let root = semidefinite_root(&prior.covariance);
        let Some(mut pose) = self.locate(image, pyramid, prior, &root) else { return Ok(None) };
        self.associate(&pose);
        if self.features.rows.is_empty() {
            return Ok(None);
        }
        if self.params.level == Level::Object {
            self.solve(&mut pose, &root);
            let quality = self.features.quality(&pose);
            let information = self.equations.as_ref().map(|e| e.information.clone());
            self.object = information.map(|a| PoseMeasurement::new(pose, a, quality));
        }
        self.seen = true;
        Ok(self.last())
    }

    fn last(&self) -> Option<&dyn Measurement<P>> {
        if !self.seen {
            return None;
        }
        match self.params.level {
            Level::Object => self.object.as_ref().map(|o| o as &dyn Measurement<P>),
            _ => Some(&self.features),
        }
    }

    fn forget(&mut self) {
        self.memory.clear();
        self.seen = false;
    }

    fn sketch(&self, pose: &P, out: &mut Vec<Mark>) {
        super::sketch::draw(&self.features.mixture, pose, out);
    }
}
