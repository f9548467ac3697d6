//! The edge tracker on random scenes with truth: raw figures for calibration and for tests of loss.

use std::sync::Arc;

use anyhow::{Context, Result};
use image::{GrayImage, RgbImage};
use nalgebra::Vector6;
use rayon::prelude::*;
use vt_core::agent::{Estimator, Visibility};
use vt_core::belief::{Gaussian, Moving};
use vt_core::dynamics::ConstantVelocity;
use vt_core::frame::SensorId;
use vt_core::lie::SE3;
use vt_core::manifold::Manifold;
use vt_core::metrics::PoseError;
use vt_core::random::{Random, Stream};
use vt_core::report::{Assessment, Verdict};
use vt_estimators::kalman::KalmanFilter;
use vt_fusion::loss::{FusedLoss, tolerated};
use vt_fusion::{Target, TrackingLoop};
use vt_io::canvas::Canvas;
use vt_models::edges::{EdgeModel, EdgeOptions};
use vt_models::mesh::Mesh;
use vt_models::visibility::{MeshView, ViewCache};
use vt_models::warp::Se3Warp;
use vt_sim::bodies;
use vt_sim::bracket::bracket;
use vt_sim::scenario::{Disturbance, Scenario};
use vt_vision::edge::{EdgeModality, EdgeParams};
use vt_vision::pyramid::PyramidProcessing;

/// Bodies whose noise constants and loss weights are fitted.
pub const FITTED: [&str; 2] = ["bracket", "house"];

/// Bodies on which both are judged.
pub const JUDGED: [&str; 2] = ["stairs", "tee"];

/// Deviation of the first prior along each axis: 3 mm and 1°.
const PRIOR: [f64; 2] = [3e-3, 0.017];

/// A body by its name, 150 mm large or so.
///
/// # Errors
/// When there is no such body.
pub fn body(name: &str) -> Result<Mesh> {
    Ok(match name {
        "bracket" => bracket(0.05),
        "house" => bodies::house(0.15),
        "stairs" => bodies::stairs(0.15),
        "tee" => bodies::tee(0.15),
        "wedge" => bodies::wedge(0.15),
        _ => anyhow::bail!("no body {name}"),
    })
}

/// One frame of one run.
#[derive(Clone, Debug)]
pub struct Record {
    /// Number of the scene.
    pub seed: u64,
    /// Number of the frame.
    pub frame: u64,
    /// Share of the object that the picture shows.
    pub visible: f64,
    /// True pose, camera_from_object.
    pub truth: SE3,
    /// Estimated pose.
    pub estimate: SE3,
    /// Distance and angle between the two.
    pub error: PoseError,
    /// Distance from the truth as a part of the object's diameter.
    pub relative: f64,
    /// Normalised squared error of the pose.
    pub nees: f64,
    /// Figures for loss tests.
    pub assessment: Assessment,
    /// What the loss detector made of them.
    pub verdict: Verdict,
}

/// Tracks the scenes `seeds` of a body without re-initialisation. The first prior is off the truth as its covariance
/// says.
///
/// # Errors
/// When a step fails.
pub fn track(
    name: &str,
    seeds: core::ops::Range<u64>,
    disturbance: Disturbance,
    frames: u64,
    params: EdgeParams,
) -> Result<Vec<Record>> {
    let mesh = body(name)?;
    let edges = Arc::new(EdgeModel::new(&mesh, &EdgeOptions::default())?);
    let runs: Vec<u64> = seeds.collect();
    let records: Result<Vec<Vec<Record>>> = runs
        .into_par_iter()
        .map(|seed| {
            run(&mesh, &edges, seed, disturbance, frames, params).with_context(|| format!("{name} {seed}"))
        })
        .collect();
    Ok(records?.into_iter().flatten().collect())
}

fn run(
    mesh: &Mesh,
    edges: &Arc<EdgeModel>,
    seed: u64,
    disturbance: Disturbance,
    frames: u64,
    params: EdgeParams,
) -> Result<Vec<Record>> {
    let scenario = Scenario::random(mesh.clone(), seed, disturbance);
    let mut sensor = scenario.sensor(0).context("a camera")?;
    let camera = scenario.cameras[0].0;
    let id = SensorId(0);
    let view = MeshView::new(Arc::new(mesh.clone()), edges.clone(), camera, ViewCache::default());
    let modality = EdgeModality::new(params.check()?, id, Se3Warp::new(camera), view, mesh.diameter());
    let sigmas = Vector6::from_fn(|k, _| PRIOR[k / 3]);
    let mut tracking: Option<TrackingLoop> = None;
    let mut modality = Some(modality);
    let mut records = vec![];
    for _ in 0..frames {
        let Some(shot) = sensor.shot() else { break };
        let truth = shot.poses[0];
        let tracking = match &mut tracking {
            Some(tracking) => tracking,
            None => {
                let mut random = Random::new(seed, Stream::Sim, 1 << 40, 0, 0);
                let offset = sigmas.map(|s| s * random.normal());
                let prior = Gaussian::from_sigmas(truth.retract(&offset), &sigmas);
                let density = Vector6::from_fn(|k, _| if k < 3 { 0.5 } else { 2.0 });
                let rest = vec![Vector6::from_fn(|k, _| if k < 3 { 0.1 } else { 0.5 })];
                let filter: KalmanFilter<SE3, Moving<SE3>, _> =
                    KalmanFilter::new(&prior, rest, ConstantVelocity::new(density)?, 5)?;
                let filter: Box<dyn Estimator<SE3>> = Box::new(filter);
                let loss = Box::new(FusedLoss::default());
                let modality = Box::new(modality.take().context("one start")?);
                let target = Target::new(
                    "object",
                    vec![id],
                    vec![modality as _],
                    filter,
                    loss,
                    None,
                    tolerated(mesh.diameter()),
                );
                let mut fresh = TrackingLoop::new(vec![Box::new(target)]);
                fresh.add_processing(Box::new(PyramidProcessing::new(id, params.coarse_levels)));
                tracking.insert(fresh)
            }
        };
        let frame = shot.frame.number;
        let report = &tracking.step([shot.frame])?[0];
        let estimate = report.posterior.get::<SE3>().context("a rigid pose")?;
        let error = PoseError::new(&estimate.mean, &truth);
        records.push(Record {
            seed,
            frame,
            visible: shot.visible[0],
            truth,
            estimate: estimate.mean,
            error,
            relative: error.translation / mesh.diameter(),
            nees: estimate.nees(&truth).unwrap_or(f64::INFINITY),
            assessment: report.assessment,
            verdict: report.verdict,
        });
    }
    Ok(records)
}

/// The picture of a record, enlarged about the object, with the contour at its true pose (green) and at the estimate
/// (red).
///
/// # Errors
/// When the scene has no such frame.
pub fn picture(name: &str, disturbance: Disturbance, record: &Record) -> Result<RgbImage> {
    let mesh = Arc::new(body(name)?);
    let edges = Arc::new(EdgeModel::new(&mesh, &EdgeOptions::default())?);
    let scenario = Scenario::random((*mesh).clone(), record.seed, disturbance);
    let (camera, _) = scenario.cameras[0];
    let mut sensor = scenario.sensor(0).context("a camera")?;
    let shot = std::iter::from_fn(|| sensor.shot()).find(|s| s.frame.number == record.frame);
    let shot = shot.context("a frame of this number")?;
    let at = camera.project(&record.truth.translation.into()).context("an object before the camera")?;
    let (focal, _) = camera.focal();
    let half = (0.8 * mesh.diameter() * focal / record.truth.translation.z).max(20.0);
    let scale = 400.0 / half;
    let corner = [at.x - half, at.y - half];
    let grey = shot.frame.grey()?;
    let (w, h) = (i64::from(grey.width()) - 1, i64::from(grey.height()) - 1);
    let enlarged = GrayImage::from_fn(800, 800, |x, y| {
        let [u, v] = [(x, corner[0]), (y, corner[1])].map(|(x, c)| (f64::from(x) / scale + c).round() as i64);
        *grey.get_pixel(u.clamp(0, w) as u32, v.clamp(0, h) as u32)
    });
    let mut canvas = Canvas::of_grey(&enlarged);
    for (pose, colour) in [(&record.truth, [0, 255, 0]), (&record.estimate, [255, 40, 40])] {
        let mut view = MeshView::new(mesh.clone(), edges.clone(), camera, ViewCache::default());
        let sites = view.visible(pose).iter();
        for y in sites.filter_map(|s| camera.project(&pose.act(&s.p_in_object))) {
            canvas.disc([(y.x - corner[0]) * scale, (y.y - corner[1]) * scale], 3.0, colour, 0.8);
        }
    }
    Ok(canvas.picture)
}
