//! Finding the pose under which the contour explains the picture best: rounds of searching edges along normals and of
//! aligning the contour with all of them at once, coarse to fine, from one start or from several.

use image::GrayImage;
use nalgebra::{DefaultAllocator, Point2, Point3, Vector2};
use vt_core::agent::{Posed, Visibility, Warp};
use vt_core::belief::{Gaussian, cholesky};
use vt_core::manifold::{Alloc, Manifold, Square};
use vt_core::math;
use vt_core::measurement::NormalEquations;
use vt_core::random::LowDiscrepancy;

use super::memory::AppearanceMemory;
use super::mixture::{Line, LineEdge};
use super::modality::EdgeModality;
use super::params::Hypotheses;
use crate::edge_search::{SearchLine, Searched, search};
use crate::pyramid::{Pyramid, to_level};
use vt_models::visibility::EdgeSite;

/// Stop aligning when the contour moves less than this on average, pixels.
const STILL: f64 = 0.01;

/// Search again when the contour moved more than this on average since the last search, pixels.
const MOVED: f64 = 0.1;

/// Weight of the prior's information in the alignment: it decides where the data are silent and nothing else.
const TIE: f64 = 1e-3;

/// Residuals of a pose that is compared with others count on this scale: that of the model's and lens's own errors, pixels.
const COMPARED: f64 = 1.0;

/// Most starts where the longest search range covers the prediction's uncertainty and the least one does not.
const NEAR_STARTS: u32 = 8;

/// Squared Mahalanobis distance from the prediction beyond which a pose is no less probable: the prediction itself may
/// be wrong.
const FARTHEST: f64 = 20.0;

/// Share of the contour that must be supported for a pose to be taken without trying further starts.
const CONVINCING: f64 = 0.85;

/// The same where another start led to that pose, too.
const AGREED: f64 = 0.7;

impl<P, W, V> EdgeModality<P, W, V>
where
    P: Manifold,
    W: Warp<P, Body = Point3<f64>>,
    V: Visibility<P, Feature = EdgeSite>,
    DefaultAllocator: Alloc<P::D>,
{
    /// The pose near `prior` under which the contour explains the picture best; `root` is a root of the prior's
    /// covariance. The lines and edges searched from there stay behind. `None` where nothing of the contour is in the
    /// picture.
    ///
    /// Where the prediction is uncertain by more than the longest search range, one alignment often ends at a wrong
    /// edge. Then starts are spread evenly over the prior, and the most probable end counts.
    pub(super) fn locate(
        &mut self,
        image: &GrayImage,
        pyramid: Option<&Pyramid>,
        prior: &Gaussian<P>,
        root: &Square<P>,
    ) -> Option<P> {
        let needed = self.reach(&prior.mean, &prior.covariance);
        let levels = pyramid.map_or(0, |p| p.levels.len() as u32);
        let [least, most] = self.params.range;
        let start = (0..levels).find(|&l| needed <= most * f64::from(1u32 << l)).unwrap_or(levels);
        let starts = match start {
            0 if needed <= least && self.followed => 1,
            0 => self.params.starts.min(NEAR_STARTS),
            _ => self.params.starts,
        };
        let dim = prior.mean.dim();
        let sequence = LowDiscrepancy::new(root.nrows());
        let mut best: Option<(f64, P)> = None;
        let mut current = false;
        for k in 0..starts {
            let mut pose = prior.mean.clone();
            if k > 0 {
                let mut offset = pose.zero();
                for d in 0..offset.len() {
                    offset[d] = math::normal_quantile(sequence.at(k, d));
                }
                pose = pose.retract(&(root * offset));
            }
            if !self.converge(image, pyramid, start, &mut pose, &prior.covariance, root) {
                // It left no lines, those of the best start included.
                current = false;
                continue;
            }
            let mixture = &self.features.mixture;
            let (likelihood, support) = mixture.compare(&pose, COMPARED);
            let score = likelihood - 0.5 * prior.nees(&pose).unwrap_or(0.0).min(FARTHEST);
            if starts == 1 {
                return Some(pose);
            }
            let agreed =
                best.as_ref().is_some_and(|(_, other)| mixture.motion(&pose.local(other)) < COMPARED);
            current = best.as_ref().is_none_or(|(most, _)| score > *most);
            if current {
                best = Some((score, pose));
            }
            if support > CONVINCING || agreed && support > AGREED {
                break;
            }
        }
        let (_, mut pose) = best?;
        if !current {
            // The lines that were searched last are those of another start.
            let nothing = Square::<P>::zeros_generic(dim, dim);
            self.converge(image, None, 0, &mut pose, &nothing, root);
        }
        Some(pose)
    }

    /// Searches and aligns from the pyramid level `start` down to the picture itself; `spread` is the covariance of the
    /// error of `pose`. False when nothing of the contour is in the picture.
    fn converge(
        &mut self,
        image: &GrayImage,
        pyramid: Option<&Pyramid>,
        start: u32,
        pose: &mut P,
        spread: &Square<P>,
        root: &Square<P>,
    ) -> bool {
        let mut spread = spread.clone();
        let [least, most] = self.params.range;
        for level in (1..=start).rev() {
            let Some(image) = pyramid.and_then(|p| p.levels.get(level as usize - 1)) else { continue };
            let pixel = f64::from(1u32 << level);
            let Some(deviation) = self.search(image, level, pose, &spread) else { break };
            // A range below two pixels leaves no room above the least deviation.
            self.align(pose, root, deviation.min(0.5 * most * pixel).max(pixel), pixel);
            spread.fill(0.0);
        }
        for _ in 0..self.params.searches {
            let Some(deviation) = self.search(image, 0, pose, &spread) else { return false };
            let sigma = self.params.sigma;
            let first = if start > 0 { least } else { deviation };
            if self.align(pose, root, first.min(0.5 * most).max(sigma), sigma) < MOVED {
                break;
            }
            // The next search starts near the contour: only the least range is needed.
            spread.fill(0.0);
        }
        true
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

    /// Three deviations of the least certain contour point in the picture, pixels.
    fn reach(&mut self, pose: &P, spread: &Square<P>) -> f64 {
        let posed = self.features.mixture.warp.at(pose);
        let sites = self.visibility.visible(pose);
        let mut widest = 0.0f64;
        for (_, j) in sites.iter().filter_map(|s| posed.linearize(&s.p_in_object)) {
            for row in 0..2 {
                let j = j.row(row).transpose();
                widest = widest.max((spread * &j).dot(&j));
            }
        }
        3.0 * widest.sqrt()
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
}
