//! Fusion of two modalities of a target, chosen in one line.

use std::path::Path;

use vt_core::lie::SE3;
use vt_core::math;
use vt_core::metrics::PoseError;
use vt_core::report::{Status, StepReport};
use vt_task::assembly::Scene;
use vt_task::{Document, Registry, check};

const TASK: &str = include_str!("../../tasks/edge-pose.toml");

/// Edges at two levels.
const TWO: &str = "targets.bracket.modalities=[
    { kind = 'edges', level = 'feature', sensor = 'camera' },
    { kind = 'edges', level = 'object', sensor = 'camera' }]";

const WALK: &str = "models.bracket.dynamics={ kind = 'brownian', params = {
    translation = '50 mm/s^0.5', rotation = '20 deg/s^0.5' } }";

fn document(fusion: &str, more: &[&str]) -> Document {
    let fusion = format!("targets.bracket.fusion={fusion}");
    let set = ["sensors.camera.params.frames=6", TWO, &fusion].into_iter().chain(more.iter().copied());
    let set: Vec<String> = set.map(str::to_owned).collect();
    Document::parse("task", TASK, Path::new(""), &set, &|_| None).unwrap()
}

fn run(fusion: &str, more: &[&str]) -> Result<Vec<StepReport>, String> {
    let (registry, document) = (Registry::standard(), document(fusion, more));
    let task = check(&document, &registry).unwrap();
    let mut scene = Scene::build(&document, &task, &registry).unwrap();
    let frames: Vec<_> = std::iter::from_fn(|| scene.sensors[0].next().unwrap()).collect();
    let tracking = scene.tracking(&document, &task, &registry, &frames[..1]);
    let mut tracking = tracking.map_err(|e| format!("{e:?}"))?;
    assert_eq!(tracking.count(), 1);
    let reports: Vec<StepReport> =
        frames.into_iter().map(|f| tracking.step([f]).unwrap()[0].clone()).collect();
    let truth = scene.truths[0].as_ref().unwrap();
    for report in &reports {
        let pose = report.posterior.get::<SE3>().unwrap().mean;
        let error = PoseError::new(&pose, &truth.poses[&report.frame]);
        assert!(error.within(2e-3, 0.02), "{fusion}: {error:?} in frame {}", report.frame);
        assert_eq!((report.verdict.status, report.target.as_str()), (Status::Tracking, "bracket"));
    }
    Ok(reports)
}

#[test]
fn one_line_changes_the_fusion() {
    let statics = ["stacked", "sequential", "information-sum"];
    let dynamics = ["intersection", "equivalent-measurements"];
    let spread = |fusion: &&str| {
        let reports = run(&format!("{{ kind = '{fusion}' }}"), &[]).unwrap();
        math::ln(reports.last().unwrap().posterior.get::<SE3>().unwrap().covariance.determinant()) / 12.0
    };
    let spreads: Vec<f64> = statics.iter().chain(&dynamics).map(spread).collect();
    // The same edges twice: whoever takes them for independent is surer than the intersection, by the root of two.
    let [stacked, .., intersection, central] = spreads[..] else { unreachable!() };
    assert!((intersection - stacked - 0.5 * math::ln(2.0)).abs() < 0.1, "{spreads:?}");
    assert!((central - stacked).abs() < 0.05, "{spreads:?}");
    run("{ kind = 'intersection', params = { criterion = 'trace', feedback = true } }", &[]).unwrap();
}

#[test]
fn cross_covariances_need_two_tracks_of_poses_alone() {
    let kind = "{ kind = 'bar-shalom-campo' }";
    run(kind, &[WALK]).unwrap();
    let e = run(kind, &[]).unwrap_err();
    assert!(e.contains("dynamics of the pose alone"), "{e}");
    let one = "targets.bracket.modalities=[{ kind = 'edges', level = 'feature', sensor = 'camera' }]";
    let e = run(kind, &[WALK, one]).unwrap_err();
    assert!(e.contains("1 modalities") && e.contains("two modalities"), "{e}");
}
