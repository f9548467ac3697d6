//! From a picture to poses: scan, align, compare, refine, verify.

use std::sync::Arc;

use image::GrayImage;
use nalgebra::{Matrix6, Point2, Vector6};
use rayon::prelude::*;
use vt_core::belief::Gaussian;
use vt_core::error::{ConfigError, MeasureError};
use vt_core::evidence::Evidence;
use vt_core::frame::Frame;
use vt_core::lie::SE3;
use vt_core::math;
use vt_core::measurement::{Level, Modality};
use vt_models::camera::Camera;
use vt_models::edges::EdgeModel;
use vt_models::mesh::Mesh;
use vt_models::visibility::{MeshView, ViewCache, ViewThresholds, VisibilityOptions, VisibleEdges};
use vt_models::warp::Se3Warp;

use super::alignment::{LevelEdges, SCALES, Site, Support, align, support};
use super::candidates::{Candidate, distinct};
use super::lookalikes::{lookalikes, neighbours};
use super::orientation_map::{EdgeBits, OrientationMap, blurred, resized};
use super::params::ViewSearchParams;
use super::scan::{self, Hit, scan};
use super::views::{ContourPoint, View, Views, focal};
use crate::edge::{EdgeModality, EdgeParams};
use crate::pyramid::{Pyramid, PyramidProcessing};

/// Ratio of neighbouring sizes.
const SIZE_STEP: f64 = 1.2;

/// Contour points with which candidates are aligned first.
const QUICK: usize = 32;

/// Scales of their first alignment, pixels of the level.
const QUICK_SCALES: [f64; 5] = [5.0, 4.0, 3.0, 2.0, 1.5];

/// Size of the object on the pyramid level on which it is aligned first: from here to twice as large.
const ALIGNED_SIZE: f64 = 60.0;

/// Candidates that are aligned with all points of their view.
const ALIGNED: usize = 1000;

/// Deviation of an edge from the contour where the object is when poses are judged, pixels of the picture.
const JUDGED: f64 = 0.7;

/// Candidates of which poses that look alike are compared, too.
const LOOKALIKES: usize = 6;

/// Candidates around which others are compared, too.
const NEIGHBOURS: usize = 8;

/// A pose found.
#[derive(Clone, Debug)]
pub struct FoundPose {
    /// The pose camera_from_object with a cautious covariance.
    pub pose: Gaussian<SE3>,
    /// How far the picture speaks for it.
    pub support: Support,
}

/// Searches a model in single pictures, without any prior.
pub struct ViewSearch {
    params: ViewSearchParams,
    mesh: Arc<Mesh>,
    edges: Arc<EdgeModel>,
    camera: Camera,
    views: Views,
}

/// The first `most` points of a view.
fn sites_of(view: &View, most: usize) -> Vec<Site> {
    let site =
        |p: &ContourPoint| Site { point: p.point, tangent: p.tangent, edge: p.edge, contour: p.contour };
    view.points.iter().take(most).map(site).collect()
}

/// What is made of one picture and needed for all candidates.
struct Picture<'a> {
    frame: &'a Frame,
    levels: Vec<LevelEdges>,
}

impl ViewSearch {
    /// Prepares all views of a model.
    ///
    /// # Errors
    /// [`ConfigError`] for parameters out of range and for models without extent or edges.
    pub fn new(
        mesh: Arc<Mesh>,
        edges: Arc<EdgeModel>,
        camera: Camera,
        params: ViewSearchParams,
    ) -> Result<Self, ConfigError> {
        let params = params.check()?;
        let views = Views::new(&mesh, &edges, &camera, params.sizes, params.directions)?;
        Ok(Self { params, mesh, edges, camera, views })
    }

    /// Number of sizes that are searched; see [`ViewSearch::search`].
    pub fn sizes(&self) -> usize {
        let [least, most] = self.params.sizes;
        (math::ln(most / least) / math::ln(SIZE_STEP)).ceil() as usize + 1
    }

    /// The size with this index, pixels.
    fn size(&self, index: usize) -> f64 {
        self.params.sizes[0] * math::pow(SIZE_STEP, index as f64)
    }

    /// Indices of all sizes, the one of `pose` first and the others by how far they are from it.
    pub fn order(&self, pose: &SE3) -> Vec<usize> {
        let size = self.views.size(pose, &self.camera);
        let index = math::ln(size / self.params.sizes[0]) / math::ln(SIZE_STEP);
        let index = if index.is_finite() { index } else { 0.0 };
        let mut all: Vec<usize> = (0..self.sizes()).collect();
        all.sort_by(|&a, &b| (a as f64 - index).abs().total_cmp(&(b as f64 - index).abs()));
        all
    }

    /// Poses that the picture speaks for, best first, among the sizes with these indices.
    ///
    /// # Errors
    /// [`MeasureError`] when the frame is no grey picture of the camera's size.
    pub fn search(&self, frame: &Frame, sizes: &[usize]) -> Result<Vec<FoundPose>, MeasureError> {
        let image = frame.grey()?;
        if image.dimensions() != self.camera.size() {
            return Err(MeasureError::Payload {
                sensor: frame.sensor.0,
                found: format!("a picture of {} x {} pixels", image.width(), image.height()),
                expected: format!("one of {} x {}", self.camera.size().0, self.camera.size().1),
            });
        }
        let picture = self.picture(frame, image);
        let mut candidates: Vec<Candidate> = vec![];
        for &index in sizes.iter().filter(|&&k| k < self.sizes()) {
            candidates.extend(self.scan(image, &picture, index));
        }
        let distinct = |all: &mut [Candidate], most, coarse| distinct(all, most, coarse, &self.views);
        let best = distinct(&mut candidates, ALIGNED, 0.4);
        let mut candidates: Vec<Candidate> = best.par_iter().map(|c| self.align(&picture, c)).collect();
        let mut compared = self.compare(&picture, &distinct(&mut candidates, self.params.compared, 0.5));
        let center = &self.views.center;
        let others = distinct(&mut compared, LOOKALIKES, 2.0);
        let others = others.iter().flat_map(|c| lookalikes(&c.pose, center).map(|pose| c.at(pose)));
        compared.extend(self.compare(&picture, &others.collect::<Vec<_>>()));
        let others = distinct(&mut compared, NEIGHBOURS, 2.0);
        let others = others.iter().flat_map(|c| neighbours(&c.pose, center).map(|pose| c.at(pose)));
        compared.extend(self.compare(&picture, &others.collect::<Vec<_>>()));
        let best = distinct(&mut compared, self.params.refined, 1.0);
        let refined: Vec<Option<(Candidate, Gaussian<SE3>)>> =
            best.par_iter().map(|c| self.refine(&picture, c)).collect();
        let mut found: Vec<FoundPose> = refined
            .into_iter()
            .flatten()
            .map(|(c, pose)| FoundPose { pose, support: c.support })
            .filter(|f| {
                f.support.log_ratio >= self.params.least_log_ratio
                    && f.support.share >= self.params.least_share
            })
            .collect();
        found.sort_by(|a, b| b.support.rank().total_cmp(&a.support.rank()));
        Ok(found)
    }

    fn picture<'a>(&self, frame: &'a Frame, image: &GrayImage) -> Picture<'a> {
        let mut pyramid = Pyramid::default();
        let most = self.level(self.params.sizes[1]) + 1;
        pyramid.compute(image, most as usize);
        let levels = (0..=pyramid.levels.len())
            .into_par_iter()
            .map(|l| {
                let mut level = LevelEdges::default();
                let least = self.params.min_contrast;
                if l == 0 {
                    let (picture, least) = blurred(image, least);
                    level.edges.compute(&picture, least);
                } else {
                    level.edges.compute(if l == 0 { image } else { &pyramid.levels[l - 1] }, least);
                }
                level.count(l as u32);
                level
            })
            .collect();
        Picture { frame, levels }
    }

    /// Pyramid level for the first alignment of an object of this size.
    fn level(&self, size: f64) -> u32 {
        (0..6).find(|&l| size < 2.0 * ALIGNED_SIZE * f64::from(1_u32 << l)).unwrap_or(6)
    }

    /// Scans for one size and aligns what was found.
    fn scan(&self, image: &GrayImage, picture: &Picture<'_>, index: usize) -> Vec<Candidate> {
        let size = self.size(index);
        // Unequal focal lengths are made equal.
        let (fx, fy) = self.camera.focal();
        let searched = scan::searched_size(size);
        let factor = |f: f64| (searched / size * focal(&self.camera) / f).min(1.0);
        let factors = [factor(fx), factor(fy)];
        let small = resized(image, factors);
        let (mut edges, mut map) = (EdgeBits::default(), OrientationMap::default());
        edges.compute(&small, self.params.min_contrast);
        map.compute(&edges, searched.ceil() as usize);
        let views = self.views.at_size(size);
        let hits = scan(views, &map, searched, self.params.hits);
        let level = (self.level(size) as usize + usize::from(size > 80.0)).min(picture.levels.len() - 1);
        let level = &picture.levels[level];
        let warp = Se3Warp::new(self.camera);
        let diameter = self.views.diameter;
        let finish = |hit: &Hit| {
            let at = [0, 1].map(|k| (hit.at[k] + 0.5) / factors[k] - 0.5);
            let ray = self.camera.unproject(&Point2::from(at)).ok()?;
            let view = &views[hit.view];
            let pose = self.views.pose(view, hit.roll, &ray, size, &self.camera);
            let sites = sites_of(view, QUICK);
            let pose = align(level, &warp, &pose, &sites, &QUICK_SCALES, diameter);
            let pixels = size / f64::from(1_u32 << level.level);
            let spacing = view.length * pixels / sites.len() as f64;
            let support = support(level, &warp, &pose, &sites, spacing, 2.0);
            Some(Candidate { pose, support, size, view: Some((index, hit.view)) })
        };
        hits.par_iter().map(finish).collect::<Vec<_>>().into_iter().flatten().collect()
    }

    /// Aligns with all points of the view.
    fn align(&self, picture: &Picture<'_>, candidate: &Candidate) -> Candidate {
        let Some((size, view)) = candidate.view else { return *candidate };
        let view = &self.views.at_size(self.size(size))[view];
        let level = (self.level(candidate.size) as usize).min(picture.levels.len() - 1);
        let level = &picture.levels[level];
        let warp = Se3Warp::new(self.camera);
        let sites = sites_of(view, usize::MAX);
        let pose = align(level, &warp, &candidate.pose, &sites, &SCALES[2..], self.views.diameter);
        let pixels = candidate.size / f64::from(1_u32 << level.level);
        let spacing = view.length * pixels / sites.len() as f64;
        let support = support(level, &warp, &pose, &sites, spacing, 2.0);
        Candidate { pose, support, ..*candidate }
    }

    /// Sites visible under a pose on a level, with their spacing in pixels of the level.
    fn sites(&self, seen: &mut VisibleEdges, pose: &SE3, level: u32) -> (Vec<Site>, f64) {
        let step = 4.0 * f64::from(1_u32 << level);
        let options = VisibilityOptions {
            step,
            raster_scale: (0.5 / f64::from(1_u32 << level)).max(0.125),
            near: 1e-3 * self.views.diameter,
            max_sites: 400,
            min_length: 0.5,
            ..VisibilityOptions::default()
        };
        seen.update(&self.mesh, &self.edges, &self.camera, pose, &options);
        let sites = seen.sites();
        let length: f64 = sites.iter().map(|s| f64::from(s.weight)).sum();
        let spacing = length / (sites.len() as f64).max(1.0) / f64::from(1_u32 << level);
        (
            sites
                .iter()
                .map(|s| Site {
                    point: s.p_in_object,
                    tangent: s.tangent,
                    edge: s.edge,
                    contour: s.contour.is_some(),
                })
                .collect(),
            spacing,
        )
    }

    /// Aligns all again, each with what is visible exactly from there.
    fn compare(&self, picture: &Picture<'_>, all: &[Candidate]) -> Vec<Candidate> {
        all.par_iter().map_init(VisibleEdges::default, |seen, c| self.compare_one(picture, seen, c)).collect()
    }

    /// From afar and from near: what is in reach from afar may lead away from a pose that is nearly right.
    fn compare_one(
        &self,
        picture: &Picture<'_>,
        seen: &mut VisibleEdges,
        candidate: &Candidate,
    ) -> Candidate {
        let size = self.views.size(&candidate.pose, &self.camera);
        let level = (self.level(size) as usize).min(picture.levels.len() - 1);
        let warp = Se3Warp::new(self.camera);
        let (sites, _) = self.sites(seen, &candidate.pose, picture.levels[level].level);
        let [afar, near] = [[2, 4], [5, 5]].map(|[first, finer]| {
            let levels = picture.levels[..=level].iter().rev().enumerate();
            let pose = levels.fold(candidate.pose, |pose, (k, edges)| {
                let scales = &SCALES[if k == 0 { first } else { finer }..];
                align(edges, &warp, &pose, &sites, scales, self.views.diameter)
            });
            self.judged(picture, seen, pose)
        });
        if near.support.rank() > afar.support.rank() { near } else { afar }
    }

    fn judged(&self, picture: &Picture<'_>, seen: &mut VisibleEdges, pose: SE3) -> Candidate {
        let edges = &picture.levels[0];
        let (sites, spacing) = self.sites(seen, &pose, edges.level);
        let warp = Se3Warp::new(self.camera);
        Candidate {
            pose,
            support: support(edges, &warp, &pose, &sites, spacing, JUDGED),
            size: 0.0,
            view: None,
        }
    }

    /// Lets the edge modality refine a candidate.
    fn refine(&self, picture: &Picture<'_>, candidate: &Candidate) -> Option<(Candidate, Gaussian<SE3>)> {
        let sensor = picture.frame.sensor;
        let mut evidence = Evidence::default();
        evidence.add(Box::new(PyramidProcessing::new(sensor, COARSE)));
        evidence.begin([picture.frame.clone()]);
        evidence.prepare(&PyramidProcessing::key_for(sensor, COARSE), None).ok()?;
        let params = EdgeParams { level: Level::Object, coarse_levels: COARSE, ..EdgeParams::default() };
        let cache = ViewCache::new(
            VisibilityOptions { min_length: 0.5, ..VisibilityOptions::default() },
            ViewThresholds::default(),
        );
        let view = MeshView::new(self.mesh.clone(), self.edges.clone(), self.camera, cache);
        let warp = Se3Warp::new(self.camera);
        let mut modality = EdgeModality::new(params, sensor, warp, view, self.views.diameter);
        let mut pose = candidate.pose;
        let mut covariance = None;
        for pixels in ROUNDS {
            let around = Gaussian::from_sigmas(pose, &self.spread(&pose, pixels));
            modality.measure(&evidence, &around).ok()??;
            let aligned = modality.object()?;
            pose = *aligned.pose();
            // Where the data are silent, the spread of a wrong alignment remains.
            let wide = Matrix6::from_diagonal(&self.spread(&pose, UNKNOWN).map(|s| 1.0 / (s * s)));
            covariance = (wide + aligned.information() / (CAUTION * CAUTION)).cholesky().map(|c| c.inverse());
        }
        let covariance = covariance?;
        let mut seen = VisibleEdges::default();
        let refined = self.judged(picture, &mut seen, pose);
        // Among clutter the modality may be led astray.
        Some(if refined.support.log_ratio > 0.9 * candidate.support.log_ratio {
            (refined, Gaussian { mean: refined.pose, covariance })
        } else {
            (*candidate, Gaussian { mean: candidate.pose, covariance })
        })
    }

    /// Deviations of a pose whose contour is uncertain by so many pixels.
    fn spread(&self, pose: &SE3, pixels: f64) -> Vector6<f64> {
        let across = 2.0 * pixels * pose.act(&self.views.center).z.abs() / focal(&self.camera);
        Vector6::from_fn(|k, _| if k < 3 { across } else { across / self.views.diameter })
    }
}

/// Uncertainty of a contour that no edge supports, pixels.
const UNKNOWN: f64 = 10.0;

/// Factor on the deviations that the edges leave: they were chosen among many.
const CAUTION: f64 = 3.0;

/// Pyramid levels on which the edge modality starts.
const COARSE: u32 = 1;

/// Uncertainty of the pose from one refinement to the next, pixels.
const ROUNDS: [f64; 2] = [1.0, 0.7];
