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
use vt_models::warp::Se3Warp;
use vt_vision::edge::*;

fn main() {
    let root = std::env::var("VISP_IMAGES").unwrap();
    let arg = |k: &str, d: f64| std::env::var(k).ok().map_or(d, |v| v.parse().unwrap());
    let castle = std::env::args().nth(1).as_deref() != Some("cube");
    let cam;
    let mesh;
    let mut frames = vec![];
    let mut truth = vec![];
    if castle {
        let d = format!("{root}/mbt-depth/Castle-simu");
        cam =
            Camera::new(700.0, 700.0, 320.0 - arg("HALF", 0.5), 240.0 - arg("HALF", 0.5), 640, 480).unwrap();
        mesh = vt_models::loaders::load_mesh(format!("{d}/Models/chateau.wrl"), vt_models::mesh::Unit::Metre)
            .unwrap();
        for k in 1..=40 {
            let img = image::open(format!("{d}/Images/Image_{k:04}.pgm")).unwrap().to_luma8();
            frames.push(Frame {
                sensor: SensorId(0),
                number: k,
                time: Timestamp((k as i64) * 40_000_000),
                payload: Payload::Grey(Arc::new(img)),
            });
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
            frames.push(Frame {
                sensor: SensorId(0),
                number: k,
                time: Timestamp((k as i64) * 40_000_000),
                payload: Payload::Grey(Arc::new(img)),
            });
        }
        for l in std::fs::read_to_string("/tmp/visp_cube_edgeklt.tum").unwrap().lines().skip(1) {
            let v: Vec<f64> = l.split_whitespace().map(|x| x.parse().unwrap()).collect();
            truth.push(SE3::new(
                UnitQuaternion::from_quaternion(Quaternion::new(v[7], v[4], v[5], v[6])),
                Vector3::new(v[1], v[2], v[3]),
            ));
        }
    }
    let edges = EdgeModel::new(&mesh, &EdgeOptions::default()).unwrap();
    println!("{:?}", edges.report());
    let start = if castle {
        truth[0]
    } else {
        SE3::from_rotation_vector(
            &Vector3::new(2.100485509, 1.146812236, -0.4560126437),
            Vector3::new(0.02231950571, 0.1071368004, 0.5071128378),
        )
    };
    let opts = VisibilityOptions {
        step: arg("STEP", 8.0),
        raster_scale: arg("RS", 0.5),
        max_sites: arg("SITES", 1000.0) as usize,
        ..Default::default()
    };
    let (mesh, edges) = (Arc::new(mesh), Arc::new(edges));
    for rep in 0..arg("REP", 1.0) as usize {
        let (mesh, edges, frames) = (mesh.clone(), edges.clone(), frames.clone());
        let view = MeshView::new(mesh, edges, cam, ViewCache::new(opts, Default::default()));
        let params = EdgeParams {
            sigma: arg("SIGMA", 0.4),
            min_contrast: arg("C", 5.0),
            range: [arg("R0", 6.0), arg("R1", 30.0)],
            searches: arg("N", 3.0) as usize,
            iterations: arg("IT", 8.0) as usize,
            ..Default::default()
        }
        .check()
        .unwrap();
        let modality = EdgeModality::new(params, SensorId(0), Se3Warp::new(cam), view, 0.3);
        let prior = Gaussian::from_sigmas(start, &Vector6::new(0.005, 0.005, 0.005, 0.02, 0.02, 0.02));
        let q = Vector6::new(0.5, 0.5, 0.5, 2.0, 2.0, 2.0).map(|x: f64| x * x * arg("Q", 1.0));
        let est = KalmanFilter::<SE3, Moving<SE3>, _>::new(
            &prior,
            vec![Vector6::new(0.1, 0.1, 0.1, 0.5, 0.5, 0.5)],
            ConstantVelocity::new(q).unwrap(),
            5,
        )
        .unwrap();
        let target = Target::new(
            "t",
            vec![SensorId(0)],
            vec![Box::new(modality)],
            Box::new(est),
            Box::new(FusedLoss::default()),
            None,
            Vector6::new(0.01, 0.01, 0.01, 0.03, 0.03, 0.03),
        );
        let mut looped = TrackingLoop::new(vec![Box::new(target)]);
        let (mut ts, mut rs, mut ms, mut ns) = (vec![], vec![], vec![], vec![]);
        for (k, f) in frames.into_iter().enumerate() {
            let t0 = std::time::Instant::now();
            let r = &looped.step([f]).unwrap()[0];
            ms.push(t0.elapsed().as_secs_f64() * 1e3);
            let r = r.clone();
            if let Ok(list) = std::env::var("DRAW") {
                if list.split(',').any(|x| x == k.to_string()) {
                    draw(&looped, k, truth.get(k), &cam);
                }
            }
            let g = r.posterior.get::<SE3>().unwrap();
            if k < truth.len() {
                let t = (g.mean.translation - truth[k].translation).norm() * 1e3;
                let a = g.mean.rotation.angle_to(&truth[k].rotation).to_degrees();
                let d = g.mean.translation - truth[k].translation;
                if std::env::var("V").is_ok() {
                    println!(
                        "{k} t {t:.3} [{:.2} {:.2} {:.2}] r {a:.3} q {:?} nis {:.1}/{} p {:.2} nees {:.1}",
                        d.x * 1e3,
                        d.y * 1e3,
                        d.z * 1e3,
                        r.assessment.quality.map(|q| (
                            q.expected,
                            q.inliers,
                            (q.log_ratio * 100.).round() / 100.
                        )),
                        r.assessment.innovation.unwrap().nis,
                        r.assessment.innovation.unwrap().iterations,
                        r.verdict.loss_probability,
                        g.nees(&truth[k]).unwrap_or(f64::NAN)
                    );
                }
                ts.push(t);
                ns.push(g.nees(&truth[k]).unwrap_or(f64::NAN));
                rs.push(a);
            }
        }
        let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
        let max = |v: &[f64]| v.iter().cloned().fold(0.0, f64::max);
        ms.sort_by(f64::total_cmp);
        println!(
            "t mean {:.3} max {:.3}  r mean {:.3} max {:.3}  ms median {:.3} nees {:.1}",
            mean(&ts),
            max(&ts),
            mean(&rs),
            max(&rs),
            ms[ms.len() / 2],
            mean(&ns)
        );
    }
}

fn draw(l: &TrackingLoop, k: usize, _truth: Option<&SE3>, _cam: &Camera) {
    use vt_core::sketch::*;
    let mut marks = vec![];
    l.sketch(0, &mut marks);
    l.with_step(|s| {
        let g = s.evidence.frames()[0].grey().unwrap();
        let z = 3u32;
        let mut im = image::RgbImage::from_fn(g.width() * z, g.height() * z, |x, y| {
            let v = g.get_pixel(x / z, y / z)[0];
            image::Rgb([v, v, v])
        });
        let mut line = |a: [f64; 2], b: [f64; 2], c: [u8; 3]| {
            for i in 0..=600 {
                let t = i as f64 / 600.0;
                let x = (a[0] + t * (b[0] - a[0]) + 0.5) * z as f64;
                let y = (a[1] + t * (b[1] - a[1]) + 0.5) * z as f64;
                if x >= 0.0 && y >= 0.0 && x < im.width() as f64 && y < im.height() as f64 {
                    im.put_pixel(x as u32, y as u32, image::Rgb(c));
                }
            }
        };
        for m in &marks {
            if let Mark::Segment { from, to, role } = m {
                line(
                    *from,
                    *to,
                    match role {
                        Role::Model => [0, 255, 0],
                        Role::Inlier => [0, 120, 255],
                        _ => [255, 0, 0],
                    },
                );
            }
        }
        if let Some(t) = _truth {
            let a = 0.084;
            let c: Vec<Point3<f64>> = (0..8)
                .map(|i| {
                    Point3::new(
                        if i & 1 == 1 { -a } else { 0.0 },
                        if i & 2 == 2 { a } else { 0.0 },
                        if i & 4 == 4 { a } else { 0.0 },
                    )
                })
                .collect();
            for i in 0..8usize {
                for j in i + 1..8 {
                    if (i ^ j).count_ones() == 1 {
                        if let (Some(p), Some(q)) = (_cam.project(&t.act(&c[i])), _cam.project(&t.act(&c[j])))
                        {
                            line([p.x, p.y], [q.x, q.y], [255, 255, 0]);
                        }
                    }
                }
            }
        }
        let xs: Vec<f64> = marks
            .iter()
            .filter_map(|m| if let Mark::Point { at, .. } = m { Some(at[0]) } else { None })
            .collect();
        let ys: Vec<f64> = marks
            .iter()
            .filter_map(|m| if let Mark::Point { at, .. } = m { Some(at[1]) } else { None })
            .collect();
        let lo = |v: &[f64], m: f64| (v.iter().cloned().fold(1e9, f64::min) - 20.0).clamp(0.0, m) as u32;
        let hi = |v: &[f64], m: f64| (v.iter().cloned().fold(0.0, f64::max) + 20.0).clamp(0.0, m) as u32;
        let (x0, x1, y0, y1) = (lo(&xs, 630.0), hi(&xs, 639.0), lo(&ys, 470.0), hi(&ys, 479.0));
        image::imageops::crop_imm(&im, x0 * z, y0 * z, (x1 - x0) * z, (y1 - y0) * z)
            .to_image()
            .save(format!("/tmp/see/d{k}.png"))
            .unwrap();
    });
}
