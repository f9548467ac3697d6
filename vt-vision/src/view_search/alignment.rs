//! Contours against the edges of a picture: quick alignment, and how far the edges found speak for a pose.

use nalgebra::{Matrix6, Point2, Point3, Vector2, Vector3, Vector6};
use vt_core::agent::{Posed, Warp};
use vt_core::lie::SE3;
use vt_core::manifold::Manifold;
use vt_core::math;
use vt_models::warp::Se3Warp;

use super::orientation_map::{EdgeBits, FINE, fine_bin};
use crate::pyramid::{from_level, to_level};

/// Side of the blocks in which edges are counted, pixels.
const CELL: usize = 16;

/// Blocks on each side of one over which its density is averaged: the object alone must not fill them.
const AROUND: usize = 5;

/// Probability that a visible contour point gives no edge.
const MISS: f64 = 0.1;

/// Length of contour that speaks for itself, pixels of the full picture.
const INDEPENDENT: f64 = 12.0;

/// What one edge of the model says counts in full up to about here, nats.
const SATURATION: f64 = 30.0;

/// Probability that an occluding contour stands out from what is behind it.
const CONTOUR_SEEN: f64 = 0.93;

/// Probability that the faces beside another edge differ in brightness.
const CREASE_SEEN: f64 = 0.8;

/// Farthest edge that is looked for, pixels of the level.
const RANGE: f64 = 12.0;

/// Scales of the residuals from one alignment step to the next, pixels of the level.
pub const SCALES: [f64; 9] = [6.0, 5.0, 4.0, 3.0, 2.5, 2.0, 1.5, 1.0, 1.0];

/// `√(2π)`.
const SQRT_TAU: f64 = 2.506_628_274_631_000_7;

/// A point on the model whose contour is looked for.
#[derive(Clone, Copy, Debug)]
pub struct Site {
    /// Place, object frame, metres.
    pub point: Point3<f64>,
    /// Direction of the edge, object frame.
    pub tangent: Vector3<f64>,
    /// Edge of the model.
    pub edge: u32,
    /// True on an occluding contour.
    pub contour: bool,
}

/// Edges of one pyramid level with their density by place and orientation.
#[derive(Clone, Debug, Default)]
pub struct LevelEdges {
    /// Pyramid level.
    pub level: u32,
    /// The edges.
    pub edges: EdgeBits,
    columns: usize,
    /// Share of pixels with an edge of nearly each orientation, by block and orientation.
    density: Vec<f32>,
}

/// Bits of an orientation and its neighbours.
fn mask(bin: usize) -> u16 {
    (1 << bin) | (1 << ((bin + 1) % FINE)) | (1 << ((bin + FINE - 1) % FINE))
}

impl LevelEdges {
    /// Counts the edges of `self.edges`, which were just computed.
    pub fn count(&mut self, level: u32) {
        self.level = level;
        let (w, h) = (self.edges.width, self.edges.height);
        let (columns, rows) = (w.div_ceil(CELL), h.div_ceil(CELL));
        self.columns = columns;
        let mut counts = vec![[0_u32; FINE]; columns * rows];
        for (k, &bits) in self.edges.bits.iter().enumerate().filter(|(_, b)| **b != 0) {
            let cell = &mut counts[(k / w / CELL) * columns + k % w / CELL];
            for (o, n) in cell.iter_mut().enumerate() {
                *n += u32::from(bits & mask(o) != 0);
            }
        }
        self.density.clear();
        for row in 0..rows {
            for column in 0..columns {
                for o in 0..FINE {
                    let (mut edges, mut cells) = (0, 0);
                    for r in row.saturating_sub(AROUND)..(row + AROUND + 1).min(rows) {
                        for c in column.saturating_sub(AROUND)..(column + AROUND + 1).min(columns) {
                            edges += counts[r * columns + c][o];
                            cells += 1;
                        }
                    }
                    let area = (cells * CELL * CELL) as f32;
                    self.density.push((edges as f32 + 0.01 * area) / (1.01 * area));
                }
            }
        }
    }

    /// Distance along the normal to the nearest edge of nearly the contour's orientation, and the density of such
    /// edges; the outer `None` outside the picture.
    #[inline]
    fn look(&self, at: Point2<f64>, normal: &Vector2<f64>, range: f64) -> Option<(Option<f64>, f64)> {
        let (w, h) = (self.edges.width as f64, self.edges.height as f64);
        if !(at.x > -0.5 && at.y > -0.5 && at.x < w - 0.5 && at.y < h - 0.5) {
            return None;
        }
        let orientation = fine_bin(normal);
        let mask = mask(orientation);
        let (x, y) = ((at.x + 0.5) as usize, (at.y + 0.5) as usize);
        let density = self.density[((y / CELL) * self.columns + x / CELL) * FINE + orientation];
        // Along the row or column nearer to the normal, on which the contour is met at `start`.
        let along_row = normal.x.abs() >= normal.y.abs();
        let (start, across, size, step, line) = if along_row {
            let start = at.x - normal.y / normal.x * (y as f64 - at.y);
            (start, normal.x, self.edges.width, 1, y * self.edges.width)
        } else {
            let start = at.y - normal.x / normal.y * (x as f64 - at.x);
            (start, normal.y, self.edges.height, self.edges.width, x)
        };
        let nearest = start.round();
        let reach = (range / across.abs()) as i64;
        let side = if start < nearest { -1 } else { 1 };
        let found = (0..=2 * reach).find_map(|k| {
            // Both sides in turn, the nearer one first.
            let p = nearest as i64 + (k + 1) / 2 * if k % 2 == 1 { side } else { -side };
            let inside = p >= 0 && p < size as i64;
            (inside && self.edges.bits[line + p as usize * step] & mask != 0)
                .then_some((p as f64 - start) * across)
        });
        Some((found, f64::from(density)))
    }
}

/// What the edges of a picture say about a pose.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Support {
    /// Log-likelihood ratio of the pose against edges that are there by chance, nats.
    pub log_ratio: f64,
    /// Share of the contour that lies on edges.
    pub share: f64,
    /// Points of the contour inside the picture.
    pub looked_for: usize,
    /// Edges of the model that the picture shows.
    pub edges: usize,
    /// Length of the occluding contour of those that it does not show, pixels of the full picture.
    pub missing: f64,
}

impl Support {
    /// Order of poses among each other, nats. A long contour crosses many edges of a background by chance, and to the
    /// log-likelihood ratio what it does not meet is one event however long it is: here that counts by its length.
    pub fn rank(&self) -> f64 {
        self.log_ratio - MISSING * self.missing / INDEPENDENT
    }

    /// How far the pose can be trusted to be no shape of the background; [`TRUSTED`] is enough. Long edges are common
    /// there, but seldom many at once, and the contour of a body is seldom hard to see. A pose of which the picture
    /// shows too little is not trusted however large it is.
    pub fn trust(&self) -> f64 {
        if self.share < LEAST_SHARE {
            return 0.0;
        }
        self.rank() + EDGE_TRUST * self.edges as f64
    }
}

/// [`Support::trust`] that at most one in twenty pictures without the body exceed.
pub const TRUSTED: f64 = 100.0;

/// Share of the contour below which no pose is trusted.
const LEAST_SHARE: f64 = 0.7;

/// Trust for each edge of the model that is seen, nats.
const EDGE_TRUST: f64 = 4.0;

/// Price of each independent length of contour that is not seen, nats.
const MISSING: f64 = 0.5;

/// An edge of the model is seen from here on, nats.
const SEEN: f64 = 2.5;

/// An edge of the model is not seen below this per pixel of its length, nats.
const UNSEEN: f64 = 0.02;

/// A contour point in a picture: where, and its normal.
type Seen = (Point2<f64>, Vector2<f64>);

/// Calls `f(site, seen, look, jacobian)` for every site inside the picture; the last is `∂(n · y)/∂δ` in pixels of the
/// level.
fn each(
    level: &LevelEdges,
    warp: &Se3Warp,
    pose: &SE3,
    sites: impl Iterator<Item = Site>,
    range: f64,
    mut f: impl FnMut(&Site, Seen, (Option<f64>, f64), Vector6<f64>),
) {
    let posed = warp.at(pose);
    let pixel = from_level(1.0, level.level) - from_level(0.0, level.level);
    for site in sites {
        let Some((y, j)) = posed.linearize(&site.point) else { continue };
        // Under a perturbation on the right a step along the tangent is one of the object's translation.
        let Some(along) = (j.fixed_columns::<3>(0) * site.tangent).try_normalize(0.0) else { continue };
        let normal = Vector2::new(-along.y, along.x);
        let at = Point2::new(to_level(y.x, level.level), to_level(y.y, level.level));
        if let Some(look) = level.look(at, &normal, range) {
            f(&site, (at, normal), look, j.tr_mul(&normal) / pixel);
        }
    }
}

/// Aligns the contour of `sites` with the edges by Gauss–Newton steps with a redescending weight (Geman and McClure)
/// and the given scales. `diameter` is the size of the model.
pub fn align(
    level: &LevelEdges,
    warp: &Se3Warp,
    pose: &SE3,
    sites: &[Site],
    scales: &[f64],
    diameter: f64,
) -> SE3 {
    let mut pose = *pose;
    // A step costs as much as residuals of one scale: weakly seen directions stay.
    let prior = Vector6::from_fn(|k, _| if k < 3 { 0.15 * diameter } else { 0.15 });
    for &scale in scales {
        let mut system = Matrix6::from_diagonal(&prior.map(|s| 1.0 / (s * s)));
        let mut gradient = Vector6::zeros();
        let range = (2.5 * scale).min(RANGE);
        each(level, warp, &pose, sites.iter().copied(), range, |_, _, (found, _), j| {
            if let Some(r) = found {
                let weight = 1.0 / (1.0 + (r / scale).powi(2)).powi(2) / (scale * scale);
                system.ger(weight, &j, &j, 1.0);
                gradient.axpy(weight * r, &j, 1.0);
            }
        });
        let Some(factor) = system.cholesky() else { break };
        let next = pose.retract(&factor.solve(&gradient));
        if !next.is_finite() {
            break;
        }
        pose = next;
    }
    pose
}

/// What a point of the contour says.
struct Said {
    /// Edge of the model, and whether it is an occluding contour there.
    group: (u32, bool),
    /// Where the edge of the picture is.
    on: Point2<f64>,
    normal: Vector2<f64>,
    /// Log-likelihood ratio.
    nats: f64,
}

/// An edge of the picture counts once: what it says is shared by all edges of the model that claim it. Views in which
/// many edges coincide would otherwise find themselves in every simple shape.
fn share_claims(said: &mut [Said], spacing: f64) {
    let claims: Vec<f64> = said
        .iter()
        .map(|a| {
            let same = said.iter().filter(|b| {
                let d = b.on - a.on;
                b.nats > 0.0
                    && b.group != a.group
                    && d.norm_squared() < 0.25 * spacing * spacing + SAME_EDGE * SAME_EDGE
                    && a.normal.dot(&d).abs() < SAME_EDGE
                    && a.normal.dot(&b.normal).abs() > PARALLEL
            });
            1.0 + same.count() as f64
        })
        .collect();
    for (a, n) in said.iter_mut().zip(claims).filter(|(a, _)| a.nats > 0.0) {
        a.nats /= n;
    }
}

/// Distance across of two claims to one edge of a picture, pixels.
const SAME_EDGE: f64 = 1.5;

/// Cosine of the angle up to which two edges are parallel: 18°.
const PARALLEL: f64 = 0.95;

/// How far the edges speak for `pose`; `spacing` is the length of contour of a site and `sigma` the deviation of an
/// edge from the contour where the object is, both in pixels of the level.
///
/// An edge of the model is seen as a whole or, where both its sides are alike, not at all; what its points say together
/// counts as a mixture of the two. Of long edges the root counts, since straight edges in the background are long, too.
pub fn support(
    level: &LevelEdges,
    warp: &Se3Warp,
    pose: &SE3,
    sites: &[Site],
    spacing: f64,
    sigma: f64,
) -> Support {
    let mut support = Support::default();
    let mut near = 0;
    let mut said: Vec<Said> = Vec::with_capacity(sites.len());
    // Shapes of the background have some size in the picture, whatever the level.
    let weight = spacing * f64::from(1_u32 << level.level) / INDEPENDENT;
    each(level, warp, pose, sites.iter().copied(), 4.0 * sigma, |site, (at, normal), (found, density), _| {
        let mut ratio = MISS;
        if let Some(r) = found {
            let there = math::exp(-0.5 * (r / sigma).powi(2)) / (sigma * SQRT_TAU);
            let chance = density * math::pow(1.0 - density, 2.0 * r.abs());
            ratio += (1.0 - MISS) * there / chance;
            near += usize::from(r.abs() <= 2.0 * sigma);
        }
        let on = at + normal * found.unwrap_or(0.0);
        said.push(Said { group: (site.edge, site.contour), on, normal, nats: weight * math::ln(ratio) });
    });
    share_claims(&mut said, spacing);
    said.sort_by_key(|s| s.group);
    for points in said.chunk_by(|a, b| a.group == b.group) {
        let sum: f64 = points.iter().map(|p| p.nats).sum();
        let length = points.len() as f64 * spacing;
        support.edges += usize::from(sum > SEEN);
        if points[0].group.1 && sum < UNSEEN * length {
            support.missing += length * f64::from(1_u32 << level.level);
        }
        let seen = if points[0].group.1 { CONTOUR_SEEN } else { CREASE_SEEN };
        // Grows as the sum first and as its root where an edge is very long.
        let long = if sum > 0.0 { 2.0 * SATURATION * ((1.0 + sum / SATURATION).sqrt() - 1.0) } else { sum };
        support.log_ratio += math::ln(seen * math::exp(long) + 1.0 - seen);
    }
    support.looked_for = said.len();
    support.share = near as f64 / (support.looked_for as f64).max(1.0);
    support
}
