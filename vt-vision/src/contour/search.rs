//! Search of the whole picture for an outline: where a lost flat target may be.
//!
//! Chamfer matching from coarse to fine (H. Barrow et al., 1977; G. Borgefors, "Hierarchical chamfer matching", 1988):
//! the squared deviations of [`ChamferLikelihood`](super::ChamferLikelihood) are tabulated for cells of the picture and
//! directions of the contour, summed along the outline at every place, angle and scale, and the best of them are fitted to
//! the edges at full resolution.

use nalgebra::{DefaultAllocator, Matrix2, Point2, Vector2};
use rayon::prelude::*;
use vt_core::agent::{Posed, Reinitializer, Warp};
use vt_core::belief::Gaussian;
use vt_core::error::{ConfigError, MeasureError};
use vt_core::evidence::{Evidence, EvidenceKey};
use vt_core::frame::SensorId;
use vt_core::least_squares::LeastSquares;
use vt_core::lie::{PlanarMotion, Sim2};
use vt_core::manifold::{Alloc, Square};
use vt_core::math;
use vt_core::measurement::Modality;
use vt_models::contour::{Contour, normal};
use vt_models::warp::PlanarWarp;

use super::chamfer::{ChamferModality, ChamferParams};
use crate::canny::CannyParams;
use crate::distance_transform::{EdgeDistance, EdgeDistanceProcessing};
use crate::search_region::check_prior;

/// Parameters of a [`ChamferSearch`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChamferSearchParams {
    /// Angles that are searched: as far from the last trusted one, radians, up to π.
    pub turn: f64,
    /// Scales that are searched: the largest factor, from 1, between them and the last trusted one, either way.
    pub magnification: f64,
    /// Most proposals for a picture.
    pub proposals: usize,
    /// How distances and angles are weighed.
    pub chamfer: ChamferParams,
}

impl Default for ChamferSearchParams {
    fn default() -> Self {
        let turn = core::f64::consts::FRAC_PI_4;
        Self { turn, magnification: 1.3, proposals: 6, chamfer: ChamferParams::default() }
    }
}

impl ChamferSearchParams {
    /// Checks all ranges.
    ///
    /// # Errors
    /// [`ConfigError::Parameter`] with the first parameter that is out of its range.
    pub fn check(self) -> Result<Self, ConfigError> {
        if !(0.0..=core::f64::consts::PI).contains(&self.turn) {
            return Err(ConfigError::parameter("turn", self.turn, "an angle from 0 to half a turn"));
        }
        if !(1.0..=4.0).contains(&self.magnification) {
            return Err(ConfigError::parameter("magnification", self.magnification, "a factor from 1 to 4"));
        }
        if self.proposals == 0 {
            return Err(ConfigError::parameter("proposals", 0, "at least 1"));
        }
        self.chamfer.check()?;
        Ok(self)
    }
}

/// Side of a cell of the coarse search, pixels.
const CELL: u32 = 6;

/// Directions of the contour that are told apart in half a turn.
const DIRECTIONS: usize = 16;

/// Steps of the angle, radians, and of the logarithm of the scale: at a distance of ten cells from the middle they move a point by a cell.
const STEP: f64 = 0.1;

/// Cost of a contour point without an edge.
const NO_EDGE: u8 = 255;

/// Share of the worst cost above which a place is none: no more of the outline has edges than chance gives.
const WORST: f64 = 0.7;

/// Places kept for each angle and scale, and overall for the fit.
const KEPT: usize = 4;
const FITTED: usize = 32;

/// Proposes where an outline may be in the picture, about as large and as turned as it was last; of a space without angle or scale only places.
/// It needs the evidence of [`EdgeDistanceProcessing`].
pub struct ChamferSearch<P: PlanarMotion>
where
    DefaultAllocator: Alloc<P::D>,
{
    params: ChamferSearchParams,
    needs: [EvidenceKey; 1],
    modality: ChamferModality<P, PlanarWarp<P>>,
    contour: Contour<Point2<f64>>,
    /// Middle of the contour's points.
    middle: Point2<f64>,
    costs: CostTable,
    last_trusted: Option<f64>,
}

/// Squared deviations by direction and cell, with a border of cells without edges.
#[derive(Default)]
struct CostTable {
    width: usize,
    height: usize,
    border: usize,
    /// `DIRECTIONS` planes of `(height + 2 border) (width + 2 border)` cells.
    values: Vec<u8>,
}

/// An outline at one angle and scale: the table's offset of each point from the middle.
struct Posture {
    linear: Matrix2<f64>,
    similarity: Sim2,
    starts: Vec<usize>,
}

struct Hit {
    cost: u16,
    posture: usize,
    cell: [usize; 2],
}

impl<P: PlanarMotion> ChamferSearch<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    /// A search for `contour` among the edges that `canny` finds in the pictures of `sensor`.
    ///
    /// # Errors
    /// [`ConfigError`] for parameters out of range, and for a contour with too few or too many points.
    pub fn new(
        params: ChamferSearchParams,
        canny: CannyParams,
        sensor: SensorId,
        contour: Contour<Point2<f64>>,
    ) -> Result<Self, ConfigError> {
        let params = params.check()?;
        let needs = [EdgeDistanceProcessing::key_for(sensor, &canny)];
        let warp = PlanarWarp::<P>::default();
        let modality = ChamferModality::new(params.chamfer, canny, sensor, warp, contour.clone())?;
        let sum: Vector2<f64> = contour.points().iter().map(|p| p.coords).sum();
        let middle = Point2::origin() + sum / contour.points().len() as f64;
        Ok(Self { params, needs, modality, contour, middle, costs: CostTable::default(), last_trusted: None })
    }

    /// Tries the last trusted belief first, with its deviations multiplied by a factor.
    #[must_use]
    pub fn with_last_trusted(self, factor: Option<f64>) -> Self {
        Self { last_trusted: factor, ..self }
    }

    /// The processing unit whose evidence is read.
    pub fn processing(&self) -> EdgeDistanceProcessing {
        self.modality.processing()
    }

    /// Angles and scales about those of the last pose, those alone that the space has.
    fn postures(&self, last: &P) -> Vec<Posture> {
        let known = last.similarity();
        let steps = |range: f64| {
            let n = (range / STEP).round() as i32;
            (-n..=n).map(|k| f64::from(k) * STEP)
        };
        let mut postures: Vec<Posture> = vec![];
        for turn in steps(self.params.turn) {
            for growth in steps(math::ln(self.params.magnification)) {
                let similarity = Sim2::new(0.0, 0.0, known.angle() + turn, known.scale * math::exp(growth));
                let (_, linear) = P::of(&similarity).about(&Point2::origin());
                if postures.iter().all(|p| (p.linear - linear).amax() > 1e-9 * linear.amax()) {
                    postures.push(Posture { linear, similarity, starts: vec![] });
                }
            }
        }
        postures
    }

    /// Offsets of the contour's points from its middle, in cells, with the number of their direction.
    fn offsets(&self, linear: &Matrix2<f64>) -> Vec<(usize, [i32; 2])> {
        let points = self.contour.points();
        let at = |k: usize| Point2::origin() + linear * (points[k] - self.middle);
        let offset = |(k, &[before, after]): (usize, &[u32; 2])| {
            let n = normal(&at(before as usize), &at(after as usize))?;
            let cells = at(k) / f64::from(CELL);
            Some((direction(&n), [cells.x.round() as i32, cells.y.round() as i32]))
        };
        self.contour.links().iter().enumerate().filter_map(offset).collect()
    }

    /// The poses whose outline is cheapest in cells, best first.
    fn coarse(&mut self, found: &EdgeDistance, last: &P) -> Vec<P> {
        let region = found.distance().now().distance().region();
        let cells = [region.width, region.height].map(|n| (n / CELL) as usize);
        let mut postures = self.postures(last);
        let offsets: Vec<_> = postures.iter().map(|p| self.offsets(&p.linear)).collect();
        let reach = |offsets: &Vec<(usize, [i32; 2])>| {
            offsets.iter().flat_map(|o| o.1).map(i32::unsigned_abs).max().unwrap_or(0) as usize
        };
        // An outline that is larger than the picture is not looked for.
        let most = cells[0].max(cells[1]);
        let border = offsets.iter().map(reach).filter(|r| *r <= most).max().unwrap_or(0);
        self.costs.fill(found, &self.params.chamfer, cells, border);
        for (posture, offsets) in postures.iter_mut().zip(&offsets) {
            if reach(offsets) <= border {
                posture.starts.extend(offsets.iter().map(|(d, o)| self.costs.start(*d, *o)));
            }
        }
        let costs = &self.costs;
        let best = |(k, posture): (usize, &Posture)| {
            let mut hits = costs.best(&posture.starts);
            hits.iter_mut().for_each(|h| h.posture = k);
            hits
        };
        let hits: Vec<Vec<Hit>> = postures.par_iter().enumerate().map(best).collect();
        let mut hits: Vec<Hit> = hits.into_iter().flatten().collect();
        // The order of equals is that of postures and places, whatever the number of threads.
        hits.sort_by_key(|h| h.cost);
        hits.truncate(FITTED);
        let pose = |hit: &Hit| {
            let posture = &postures[hit.posture];
            let place =
                |cell: usize, first: u32| f64::from(first + cell as u32 * CELL) + 0.5 * f64::from(CELL - 1);
            let at = Vector2::new(place(hit.cell[0], region.x), place(hit.cell[1], region.y));
            let shift = at - posture.linear * self.middle.coords;
            let s = &posture.similarity;
            P::of(&Sim2::new(shift.x, shift.y, s.angle(), s.scale))
        };
        hits.iter().map(pose).collect()
    }

    /// Root mean square distance between the outlines at two poses; infinite where one has none.
    fn distance(&self, a: &P, b: &P) -> f64 {
        let warp = PlanarWarp::default();
        let (a, b) = (warp.at(a), warp.at(b));
        let squared = |x| Some((a.locate(x)? - b.locate(x)?).norm_squared());
        let points = self.contour.points();
        let sum: Option<f64> = points.iter().map(squared).sum();
        sum.map_or(f64::INFINITY, |s| (s / points.len() as f64).sqrt())
    }
}

/// The belief about `pose` that knows every contour point to `deviation` pixels, as if it were measured so; `None` where the points do not
/// determine the pose.
fn spread<P: PlanarMotion>(pose: &P, contour: &Contour<Point2<f64>>, deviation: f64) -> Option<Gaussian<P>>
where
    DefaultAllocator: Alloc<P::D>,
{
    let (warp, n) = (PlanarWarp::default(), pose.dim());
    let posed = warp.at(pose);
    let mut information = Square::<P>::zeros_generic(n, n);
    for point in contour.points() {
        let (_, j) = posed.linearize(point)?;
        information += j.tr_mul(&j);
    }
    information /= contour.points().len() as f64 * deviation * deviation;
    Some(Gaussian { mean: pose.clone(), covariance: information.cholesky()?.inverse() })
}

/// Number of the direction of a normal, either way.
fn direction(normal: &Vector2<f64>) -> usize {
    let turns = math::atan2(normal.y, normal.x) / core::f64::consts::PI;
    ((turns - turns.floor()) * DIRECTIONS as f64) as usize % DIRECTIONS
}

impl CostTable {
    fn stride(&self) -> usize {
        self.width + 2 * self.border
    }

    fn fill(&mut self, found: &EdgeDistance, params: &ChamferParams, cells: [usize; 2], border: usize) {
        let [width, height] = cells;
        (self.width, self.height, self.border) = (width, height, border);
        let (stride, rows) = (self.stride(), height + 2 * border);
        self.values.clear();
        self.values.resize(DIRECTIONS * stride * rows, NO_EDGE);
        // A place is known to a cell.
        let sigma = params.sigma.max(0.75 * f64::from(CELL));
        let most = params.truncation.powi(2);
        let (edges, distance) = (found.edges().now(), found.distance().now());
        let first = distance.distance().region();
        let normals: [Vector2<f64>; DIRECTIONS] = core::array::from_fn(|d| {
            let angle = (d as f64 + 0.5) * core::f64::consts::PI / DIRECTIONS as f64;
            Vector2::new(math::cos(angle), math::sin(angle))
        });
        for v in 0..height {
            for u in 0..width {
                let x = first.x + u as u32 * CELL + CELL / 2;
                let y = first.y + v as u32 * CELL + CELL / 2;
                let Some((far, [ex, ey])) = distance.get(x, y) else { continue };
                if f64::from(far) > params.truncation * sigma + 1.0 {
                    continue;
                }
                let Some(edge) = edges.get(ex, ey) else { continue };
                let at = Point2::new(f64::from(x) - 0.5, f64::from(y) - 0.5);
                let along = (edge.direction.dot(&(edge.at - at)) / sigma).powi(2);
                for (d, n) in normals.iter().enumerate() {
                    let sine = (n.x * edge.direction.y - n.y * edge.direction.x) / params.angle;
                    let squared = (along + sine * sine).min(most);
                    self.values[(d * rows + border + v) * stride + border + u] =
                        (squared / most * f64::from(NO_EDGE)) as u8;
                }
            }
        }
    }

    /// Where the values lie of a point with this direction and offset, for the outline about the first cell.
    fn start(&self, direction: usize, [dx, dy]: [i32; 2]) -> usize {
        let rows = self.height + 2 * self.border;
        let at = |offset: i32| (self.border as i32 + offset) as usize;
        (direction * rows + at(dy)) * self.stride() + at(dx)
    }

    /// The cheapest places of an outline, no two of them near each other.
    fn best(&self, starts: &[usize]) -> Vec<Hit> {
        let mut hits: Vec<Hit> = vec![];
        if starts.is_empty() {
            return hits;
        }
        let most = (WORST * f64::from(NO_EDGE) * starts.len() as f64) as u16;
        let mut sums = vec![0u16; self.width];
        for v in 0..self.height {
            sums.fill(0);
            for start in starts {
                let costs = &self.values[start + v * self.stride()..][..self.width];
                for (sum, &cost) in sums.iter_mut().zip(costs) {
                    *sum += u16::from(cost);
                }
            }
            for (u, &cost) in sums.iter().enumerate() {
                let worst = if hits.len() < KEPT { most } else { hits.last().map_or(most, |h| h.cost) };
                if cost >= worst {
                    continue;
                }
                let near = |h: &Hit| h.cell[0].abs_diff(u) <= 2 && h.cell[1].abs_diff(v) <= 2;
                match hits.iter().position(near) {
                    Some(k) if hits[k].cost <= cost => continue,
                    Some(k) => drop(hits.remove(k)),
                    None if hits.len() == KEPT => drop(hits.pop()),
                    None => {}
                }
                let place = hits.partition_point(|h| h.cost <= cost);
                hits.insert(place, Hit { cost, posture: 0, cell: [u, v] });
            }
        }
        hits
    }
}

impl<P: PlanarMotion> Reinitializer<P> for ChamferSearch<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    fn needs(&self) -> &[EvidenceKey] {
        &self.needs
    }

    fn propose(
        &mut self,
        evidence: &Evidence,
        last: &Gaussian<P>,
        out: &mut Vec<Gaussian<P>>,
    ) -> Result<(), MeasureError> {
        check_prior(last)?;
        if let Some(factor) = self.last_trusted {
            out.push(Gaussian { mean: last.mean.clone(), covariance: &last.covariance * (factor * factor) });
        }
        let found = evidence.get::<EdgeDistance>(&self.needs[0])?;
        let starts = self.coarse(found, &last.mean);
        let Some(z) = self.modality.measure(evidence, last)? else { return Ok(()) };
        let solver = LeastSquares { max_iterations: 15, ..LeastSquares::levenberg_marquardt() };
        let contour = &self.contour;
        let fit = |start: &P| {
            let prior = spread(start, contour, 2.0 * f64::from(CELL))?;
            let belief = solver.fit(z, start, Some(&prior)).ok()?.belief();
            let mut log_likelihood = [0.0];
            z.log_likelihoods(core::slice::from_ref(&belief.mean), &mut log_likelihood);
            Some((log_likelihood[0], belief))
        };
        let mut fitted: Vec<(f64, Gaussian<P>)> = starts.par_iter().filter_map(fit).collect();
        fitted.sort_by(|a, b| b.0.total_cmp(&a.0));
        let first = out.len();
        for (_, belief) in fitted {
            if out.len() == first + self.params.proposals {
                break;
            }
            let same = |other: &Gaussian<P>| {
                self.distance(&other.mean, &belief.mean) < 2.0 * self.params.chamfer.sigma
            };
            if belief.is_finite() && !out[first..].iter().any(same) {
                out.push(belief);
            }
        }
        Ok(())
    }
}
