//! Accuracy and speed of the edge tracker on ViSP's sequences.
use nalgebra::*;
use std::sync::Arc;
use vt_core::agent::*;
use vt_core::belief::*;
use vt_core::dynamics::*;
use vt_core::frame::*;
use vt_core::lie::SE3;
use vt_core::time::*;
use vt_estimators::kalman::KalmanFilter;
use vt_fusion::loss::FusedLoss;
use vt_fusion::*;
use vt_models::camera::Camera;
use vt_models::edges::*;
use vt_models::mesh::*;
use vt_models::visibility::*;
use vt_tests::rig::TempWarp;
use vt_vision::edge::*;

fn main() {
    let root = std::env::var("VISP_IMAGES").unwrap();
    let castle = std::env::args().nth(1).as_deref() != Some("cube");
    let cam;
    let mesh;
    let mut frames = vec![];
    let mut truth = vec![];
    if castle {
        let d = format!("{root}/mbt-depth/Castle-simu");
        cam = Camera::new(700.0, 700.0, 320.0, 240.0, 640, 480).unwrap();
        mesh = vt_models::loaders::load_mesh(format!("{d}/Models/chateau.wrl"), vt_models::mesh::Unit::Metre).unwrap();
        for k in 1..=40 {
            let img = image::open(format!("{d}/Images/Image_{k:04}.pgm")).unwrap().to_luma8();
            frames.push(Frame { sensor: SensorId(0), number: k, time: Timestamp((k as i64) * 40_000_000), payload: Payload::Grey(Arc::new(img)) });
            let t = std::fs::read_to_string(format!("{d}/CameraPose/Camera_{k:03}.txt")).unwrap();
            let v: Vec<f64> = t.split_whitespace().map(|x| x.parse().unwrap()).collect();
            truth.push(SE3::from_matrix(&Matrix4::from_row_slice(&v), 1e-3).unwrap());
        }
    } else {
        let d = format!("{root}/mbt");
        cam = Camera::new(547.7367575, 542.0744058, 338.7036994, 234.5083345, 640, 480).unwrap();
        mesh = vt_models::loaders::load_mesh(format!("{d}/cube.wrl"), vt_models::mesh::Unit::Metre).unwrap();
        for k in 0..218u64 {
            let img = image::open(format!("{d}/cube/image{k:04}.pgm")).unwrap().to_luma8();
            frames.push(Frame { sensor: SensorId(0), number: k, time: Timestamp((k as i64) * 40_000_000), payload: Payload::Grey(Arc::new(img)) });
        }
        for l in std::fs::read_to_string("/tmp/visp_cube_edgeklt.tum").unwrap().lines().skip(1) {
            let v: Vec<f64> = l.split_whitespace().map(|x| x.parse().unwrap()).collect();
            truth.push(SE3::new(UnitQuaternion::from_quaternion(Quaternion::new(v[7], v[4], v[5], v[6])), Vector3::new(v[1], v[2], v[3])));
        }
    }
    let edges = EdgeModel::new(&mesh, &EdgeOptions::default()).unwrap();
    println!("{:?}", edges.report());
    let start = if castle { truth[0] } else {
        SE3::from_rotation_vector(&Vector3::new(2.100485509, 1.146812236, -0.4560126437), Vector3::new(0.02231950571, 0.1071368004, 0.5071128378)) };
    let arg = |k: &str, d: f64| std::env::var(k).ok().map_or(d, |v| v.parse().unwrap());
    let opts = VisibilityOptions { step: arg("STEP", 5.0), raster_scale: arg("RS", 0.5), max_sites: arg("SITES", 1000.0) as usize, ..Default::default() };
    let (mesh, edges) = (Arc::new(mesh), Arc::new(edges));
    let view = MeshView::new(mesh, edges, cam, ViewCache::new(opts, Default::default()));
    let params = EdgeParams { sigma: arg("SIGMA", 0.4), min_contrast: arg("C", 8.0), range: [arg("R0", 6.0), arg("R1", 30.0)], searches: arg("N", 3.0) as usize, iterations: arg("IT", 8.0) as usize, ..Default::default() }.check().unwrap();
    let modality = EdgeModality::new(params, SensorId(0), TempWarp(cam), view, 0.3);
    let prior = Gaussian::from_sigmas(start, &Vector6::new(0.005, 0.005, 0.005, 0.02, 0.02, 0.02));
    let q = Vector6::new(0.5, 0.5, 0.5, 2.0, 2.0, 2.0).map(|x: f64| x * x * arg("Q", 1.0));
    let est = KalmanFilter::<SE3, Moving<SE3>, _>::new(&prior, vec![Vector6::new(0.1, 0.1, 0.1, 0.5, 0.5, 0.5)], ConstantVelocity::new(q).unwrap(), 5).unwrap();
    let target = Target::new("t", vec![SensorId(0)], vec![Box::new(modality)], Box::new(est), Box::new(FusedLoss::default()), None, Vector6::new(0.01, 0.01, 0.01, 0.03, 0.03, 0.03));
    let mut looped = TrackingLoop::new(vec![Box::new(target)]);
    let (mut ts, mut rs, mut ms) = (vec![], vec![], vec![]);
    for (k, f) in frames.into_iter().enumerate() {
        let t0 = std::time::Instant::now();
        let r = &looped.step([f]).unwrap()[0];
        ms.push(t0.elapsed().as_secs_f64() * 1e3);
        let g = r.posterior.get::<SE3>().unwrap();
        if k < truth.len() {
            let t = (g.mean.translation - truth[k].translation).norm() * 1e3;
            let a = g.mean.rotation.angle_to(&truth[k].rotation).to_degrees();
            let d = g.mean.translation - truth[k].translation;
            if std::env::var("V").is_ok() { println!("{k} t {t:.3} [{:.2} {:.2} {:.2}] r {a:.3} q {:?} nis {:.1}/{} p {:.2} nees {:.1}", d.x*1e3, d.y*1e3, d.z*1e3, r.assessment.quality.map(|q| (q.expected, q.inliers, (q.log_ratio*100.).round()/100.)), r.assessment.innovation.unwrap().nis, r.assessment.innovation.unwrap().iterations, r.verdict.loss_probability, g.nees(&truth[k]).unwrap_or(f64::NAN)); }
            ts.push(t); rs.push(a);
        }
    }
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    let max = |v: &[f64]| v.iter().cloned().fold(0.0, f64::max);
    ms.sort_by(f64::total_cmp);
    println!("t mean {:.3} max {:.3}  r mean {:.3} max {:.3}  ms median {:.3}", mean(&ts), max(&ts), mean(&rs), max(&rs), ms[ms.len() / 2]);
}
