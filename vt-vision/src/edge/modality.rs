//! The edge modality: model contour against image edges (RAPiD, Harris 1990; Drummond and Cipolla 2002).

use image::GrayImage;
use nalgebra::{DefaultAllocator, Point2, Point3, Vector2};
use vt_core::agent::{Posed, Visibility, Warp};
use vt_core::belief::{Gaussian, cholesky};
use vt_core::dynamics::semidefinite_root;
use vt_core::error::MeasureError;
use vt_core::evidence::{Evidence, EvidenceKey};
use vt_core::frame::SensorId;
use vt_core::manifold::{Alloc, Manifold, Square};
use vt_core::math;
use vt_core::measurement::{Level, Measurement, Modality, NormalEquations};
use vt_core::pose_measurement::PoseMeasurement;
use vt_core::sketch::Mark;

use super::features::{EdgeFeatures, EdgeRow};
use super::memory::AppearanceMemory;
use super::mixture::{EdgeMixture, Line, LineEdge};
use super::params::{EdgeParams, Hypotheses};
use crate::edge_search::{EdgeCandidate, NOISE_GAIN, SearchLine, Searched, search};
use crate::noise::noise_deviation;
use crate::pyramid::{Pyramid, PyramidProcessing, to_level};
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
    params: EdgeParams,
    sensor: SensorId,
    needs: Vec<EvidenceKey>,
    visibility: V,
    /// Length by which a contour point is moved along its tangent to find the contour's direction in the image.
    probe: f64,
    features: EdgeFeatures<P, W>,
    object: Option<PoseMeasurement<P>>,
    equations: Option<NormalEquations<P>>,
    memory: AppearanceMemory,
    found: Vec<EdgeCandidate>,
    /// Smallest step that counts as an edge in this frame, grey levels.
    min_contrast: f64,
    noise: Vec<u16>,
    deviations: Vec<f64>,
    seen: bool,
}

/// Lines for which there is room from the start; with more, the buffers grow once.
const ROOM: usize = 1024;

/// An edge must stand out from what noise alone does by this factor.
pub(super) const NOISE_FACTOR: f64 = 4.0;

/// Stop aligning when the contour moves less than this on average, pixels.
const STILL: f64 = 0.01;

/// Search again when the contour moved more than this on average since the last search, pixels.
const MOVED: f64 = 1.0;

/// Weight of the prior's information in the alignment: it decides where the data are silent and nothing else.
const TIE: f64 = 1e-3;

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
        let clutter = params.miss_probability * params.clutter_density;
        let mut mixture = EdgeMixture::new(warp, params.sigma, clutter);
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
            deviations: Vec::with_capacity(ROOM),
            seen: false,
        }
    }

    /// The pose that the last call of `measure` found, at object level.
    pub fn object(&self) -> Option<&PoseMeasurement<P>> {
        self.object.as_ref().filter(|_| self.seen)
    }

    /// Searches edges along the normals of the contour at `pose`, whose error has the covariance `spread`, in the
    /// picture of a pyramid level. Returns the root mean square of the predicted deviation along the normals in pixels
    /// of the full picture, `None` without any line.
    fn search(&mut self, image: &GrayImage, level: u32, pose: &P, spread: &Square<P>) -> Option<f64> {
        let pixel = f64::from(1u32 << level);
        let mixture = &mut self.features.mixture;
        mixture.lines.clear();
        mixture.edges.clear();
        let posed = mixture.warp.at(pose);
        let mut squares = 0.0;
        let slack = self.params.range[0] * pixel / 3.0;
        let sites = self.visibility.visible(pose);
        // Of two contours that almost coincide in the image neither can be told from the other, and the image edge
        // that is found lies between them; such sites bias the tilt of a flat view.
        let clear = sites.iter().filter(|s| !s.ambiguous).count();
        let drop_ambiguous = 4 * clear >= sites.len();
        for site in sites {
            if site.ambiguous && drop_ambiguous {
                continue;
            }
            let Some((y, j)) = posed.linearize(&site.p_in_object) else { continue };
            let Some(ahead) = posed.locate(&(site.p_in_object + site.tangent * self.probe)) else { continue };
            let direction = ahead - y;
            let length = direction.norm();
            if length.is_nan() || length <= 0.0 {
                continue;
            }
            let normal = Vector2::new(-direction.y, direction.x) / length;
            let j = j.tr_mul(&normal);
            let deviation2 = (spread * &j).dot(&j).max(0.0);
            let range = (3.0 * deviation2.sqrt() / pixel).clamp(self.params.range[0], self.params.range[1]);
            let at = Point2::new(to_level(y.x, level), to_level(y.y, level));
            let line = SearchLine { at, normal, range };
            self.found.clear();
            let (contrast, most) = (self.min_contrast, self.params.max_candidates);
            if search(image, &line, contrast, most, &mut self.found) == Searched::Outside {
                continue;
            }
            if self.params.hypotheses == Hypotheses::Single {
                let nearest =
                    self.found.iter().copied().min_by(|a, b| a.offset.abs().total_cmp(&b.offset.abs()));
                self.found.clear();
                self.found.extend(nearest);
            }
            let searched_at = normal.dot(&y.coords);
            let first = mixture.edges.len() as u32;
            let known = self.memory.recall(site.edge, &site.p_in_object, &site.tangent);
            // Where the contour is predicted, an edge is the more probable the nearer it is.
            let gate = -0.5 / (deviation2 + slack * slack);
            mixture.edges.extend(self.found.iter().map(|c| LineEdge {
                position: searched_at + c.offset * pixel,
                sides: c.sides,
                prior: AppearanceMemory::weight(known, site.contour, c.sides)
                    * math::exp_fast((c.offset * pixel).powi(2) * gate),
            }));
            squares += deviation2;
            mixture.lines.push(Line {
                point: site.p_in_object,
                normal,
                searched_at,
                jacobian: j,
                first,
                count: self.found.len() as u32,
                edge: site.edge,
                contour: site.contour,
                tangent: site.tangent,
                weight: 1.0 - math::exp_fast(-f64::from(site.weight) / self.params.correlation_length),
            });
        }
        let lines = mixture.lines.len();
        (lines > 0).then(|| (squares / lines as f64).sqrt())
    }

    /// Lowest pyramid level, at most `levels`, on which the longest search range covers three predicted deviations.
    fn coarsest(&mut self, pose: &P, spread: &Square<P>, levels: u32) -> u32 {
        let posed = self.features.mixture.warp.at(pose);
        let sites = self.visibility.visible(pose);
        let mut widest = 0.0f64;
        for (_, j) in sites.iter().filter_map(|s| posed.linearize(&s.p_in_object)) {
            for row in 0..2 {
                let j = j.row(row).transpose();
                widest = widest.max((spread * &j).dot(&j));
            }
        }
        let needed = 3.0 * widest.sqrt();
        (0..levels).find(|&l| needed <= self.params.range[1] * f64::from(1u32 << l)).unwrap_or(levels)
    }

    /// Moves `pose` to the nearest maximum of the contour likelihood, from the scale `sigma` down to `last`, in
    /// pixels. `root` is a root of the prior covariance: the pose moves in its span only, and where the
    /// data are silent not at all. The contour is linearised at the pose of the search; whoever uses the result
    /// linearises anew. Returns the root mean square motion of the contour in pixels.
    fn align(&mut self, pose: &mut P, root: &Square<P>, mut sigma: f64, last: f64) -> f64 {
        let mixture = &self.features.mixture;
        let equations = self.equations.get_or_insert_with(|| NormalEquations::empty(pose));
        let mut delta = pose.zero();
        let mut scale = 1.0;
        for _ in 0..self.params.iterations {
            let weight = mixture.linear_equations(&delta, sigma, equations);
            let mut system = root.tr_mul(&(&equations.information * root));
            for k in 0..system.nrows() {
                system[(k, k)] += TIE;
            }
            let Some(factor) = cholesky(system) else { break };
            let step = root * factor.solve(&root.tr_mul(&equations.gradient));
            scale = if weight > 0.0 { sigma * sigma / weight } else { 0.0 };
            let motion = ((&equations.information * &step).dot(&step) * scale).max(0.0).sqrt();
            delta += step;
            if sigma <= last && motion < STILL {
                break;
            }
            sigma = if motion < 0.1 * sigma { last } else { (0.5 * sigma).max(last) };
        }
        let next = pose.retract(&delta);
        if !next.is_finite() {
            return 0.0;
        }
        *pose = next;
        ((&equations.information * &delta).dot(&delta) * scale).max(0.0).sqrt()
    }

    /// Matches to every line its most probable edge at `pose`, estimates the scale of the residuals and remembers
    /// what the object looks like beside them.
    fn associate(&mut self, pose: &P) {
        let EdgeFeatures { rows, mixture } = &mut self.features;
        rows.clear();
        self.deviations.clear();
        let posed = mixture.warp.at(pose);
        let sigma = self.params.sigma;
        for line in &mixture.lines {
            let Some(y) = posed.locate(&line.point) else { continue };
            let u = line.normal.dot(&y.coords);
            let Some((k, probability)) = mixture.vote(line, u, sigma).best else { continue };
            let edge = &mixture.edges[line.first as usize + k];
            if probability > 0.5 {
                self.deviations.push((edge.position - u).abs());
                self.memory.observe(line.edge, &line.point, &line.tangent, line.contour, edge.sides);
            }
            rows.push(EdgeRow {
                point: line.point,
                normal: line.normal,
                position: edge.position,
                variance: 1.0 / line.weight,
                weight: probability,
            });
        }
        let scale = match self.deviations.len() {
            0 => sigma,
            n => {
                let (_, median, _) = self.deviations.select_nth_unstable_by(n / 2, f64::total_cmp);
                (1.4826 * *median).max(sigma)
            }
        };
        mixture.sigma = scale;
        for row in rows {
            row.variance *= scale * scale;
        }
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

    fn measure(
        &mut self,
        evidence: &Evidence,
        prior: &Gaussian<P>,
    ) -> Result<Option<&dyn Measurement<P>>, MeasureError> {
        self.seen = false;
        if !prior.is_finite() {
            return Err(MeasureError::Prediction("the predicted pose is not finite"));
        }
        let image = evidence.frame(self.sensor)?.grey()?;
        let noise = noise_deviation(image, &mut self.noise);
        self.min_contrast = self.params.min_contrast.max(NOISE_FACTOR * NOISE_GAIN * noise);
        let pyramid = match self.needs.first() {
            Some(key) => Some(evidence.get::<Pyramid>(key)?),
            None => None,
        };
        let root = semidefinite_root(&prior.covariance);
        let mut pose = prior.mean.clone();
        let mut spread = prior.covariance.clone();
        let [least, most] = self.params.range;
        let start = pyramid.map_or(0, |p| self.coarsest(&pose, &spread, p.levels.len() as u32));
        for level in (1..=start).rev() {
            let Some(image) = pyramid.and_then(|p| p.levels.get(level as usize - 1)) else { continue };
            let pixel = f64::from(1u32 << level);
            let Some(deviation) = self.search(image, level, &pose, &spread) else { break };
            self.align(&mut pose, &root, deviation.clamp(pixel, 0.5 * most * pixel), pixel);
            spread.fill(0.0);
        }
        for _ in 0..self.params.searches {
            let Some(deviation) = self.search(image, 0, &pose, &spread) else { return Ok(None) };
            let sigma = self.params.sigma;
            let first = if start > 0 { least } else { deviation };
            if self.align(&mut pose, &root, first.clamp(sigma, 0.5 * most), sigma) < MOVED {
                break;
            }
            // The next search starts near the contour: only the least range is needed.
            spread.fill(0.0);
        }
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
    }

    fn sketch(&self, pose: &P, out: &mut Vec<Mark>) {
        super::sketch::draw(&self.features.mixture, pose, out);
    }
}
