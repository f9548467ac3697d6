//! The search of views on pictures whose pose is known: found where it is, nothing where nothing is, always the same.

use std::sync::Arc;

use image::{GrayImage, Luma};
use nalgebra::Point3;
use vt_core::agent::Reinitializer;
use vt_core::belief::Gaussian;
use vt_core::error::{ConfigError, MeasureError};
use vt_core::evidence::Evidence;
use vt_core::frame::{Frame, Payload};
use vt_core::lie::SE3;
use vt_core::metrics::PoseError;
use vt_core::random::{Random, Stream};
use vt_core::time::Timestamp;
use vt_models::camera::Camera;
use vt_models::edges::EdgeModel;
use vt_models::mesh::{Mesh, MeshData};
use vt_vision::view_search::{ViewReinitializer, ViewSearch, ViewSearchParams};

use crate::scene::{SENSOR, Solid, pose};
use crate::shapes::camera;

/// A block with one corner far out: no turn maps it onto itself.
fn block() -> Solid {
    let corners = [
        [-0.06, -0.04, -0.03],
        [0.06, -0.04, -0.03],
        [0.05, 0.05, -0.03],
        [-0.06, 0.03, -0.03],
        [-0.06, -0.04, 0.02],
        [0.02, -0.04, 0.05],
        [0.02, 0.03, 0.05],
        [-0.06, 0.03, 0.02],
    ];
    let vertices = corners.map(|[x, y, z]| Point3::new(x, y, z)).to_vec();
    let faces = [
        (vec![0, 1, 2, 3], 60.0),
        (vec![4, 5, 6, 7], 190.0),
        (vec![0, 1, 5, 4], 40.0),
        (vec![1, 2, 6, 5], 160.0),
        (vec![2, 3, 7, 6], 20.0),
        (vec![3, 0, 4, 7], 220.0),
    ];
    Solid::new(vertices, faces.to_vec())
}

fn params() -> ViewSearchParams {
    ViewSearchParams { sizes: [60.0, 160.0], ..ViewSearchParams::default() }
}

fn search_for(solid: &Solid, camera: &Camera) -> ViewSearch {
    let mesh = solid.mesh();
    let edges = EdgeModel::new(&mesh, &Default::default()).unwrap();
    ViewSearch::new(Arc::new(mesh), Arc::new(edges), *camera, params()).unwrap()
}

fn frame(image: GrayImage) -> Frame {
    Frame { sensor: SENSOR, number: 0, time: Timestamp(0), payload: Payload::Grey(Arc::new(image)) }
}

/// The picture with noise of this deviation.
fn noisy(image: &GrayImage, deviation: f64, seed: u64) -> GrayImage {
    let mut random = Random::new(seed, Stream::Sim, 5, 0, 0);
    GrayImage::from_fn(image.width(), image.height(), |x, y| {
        let grey = f64::from(image.get_pixel(x, y)[0]) + deviation * random.normal();
        Luma([grey.round().clamp(0.0, 255.0) as u8])
    })
}

fn truths() -> [SE3; 4] {
    [
        pose([35.0, 20.0, 10.0], [0.01, -0.01, 0.6]),
        pose([-120.0, 40.0, 60.0], [-0.08, 0.04, 0.75]),
        pose([15.0, -150.0, 30.0], [0.06, 0.03, 0.5]),
        pose([60.0, 80.0, -100.0], [0.0, 0.05, 0.9]),
    ]
}

#[test]
fn a_body_is_found_wherever_it_is_and_says_how_precisely() {
    let (solid, camera) = (block(), camera());
    let search = search_for(&solid, &camera);
    let all: Vec<usize> = (0..search.sizes()).collect();
    for (k, truth) in truths().iter().enumerate() {
        let picture = noisy(&solid.draw(&camera, truth), 2.0, k as u64);
        let found = search.search(&frame(picture), &all).unwrap();
        let first = found.first().unwrap_or_else(|| panic!("{k}: nothing found"));
        let error = PoseError::new(&first.pose.mean, truth);
        assert!(error.translation < 5e-3 && error.rotation < 2f64.to_radians(), "{k}: {error:?}");
        assert!(first.support.share > 0.8, "{k}: {:?}", first.support);
        let nees = first.pose.nees(truth).unwrap();
        assert!(nees < 30.0, "{k}: squared error of {nees} in units of the covariance");
        assert!(found.windows(2).all(|f| f[0].support.rank() >= f[1].support.rank()), "best first");
    }
}

#[test]
fn noise_alone_and_empty_pictures_hold_no_body() {
    let camera = camera();
    let search = search_for(&block(), &camera);
    let all: Vec<usize> = (0..search.sizes()).collect();
    let plain = GrayImage::from_pixel(320, 240, Luma([100]));
    for (deviation, seed) in [(0.0, 0), (3.0, 1), (15.0, 2), (60.0, 3)] {
        let found = search.search(&frame(noisy(&plain, deviation, seed)), &all).unwrap();
        assert!(found.is_empty(), "noise of {deviation}: {:?}", found[0].support);
    }
}

#[test]
fn any_number_of_threads_finds_the_same() {
    let (solid, camera) = (block(), camera());
    let search = search_for(&solid, &camera);
    let all: Vec<usize> = (0..search.sizes()).collect();
    let picture = frame(noisy(&solid.draw(&camera, &truths()[0]), 4.0, 9));
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let found = pool.install(|| search.search(&picture, &all).unwrap());
        found.iter().map(|f| (f.pose.mean, f.pose.covariance, f.support)).collect::<Vec<_>>()
    };
    let one = run(1);
    assert!(!one.is_empty());
    assert_eq!(one, run(2));
    assert_eq!(one, run(3));
}

#[test]
fn wrong_parameters_models_and_pictures_are_refused_by_name() {
    let camera = camera();
    let broken = [
        ("sizes", ViewSearchParams { sizes: [100.0, 50.0], ..params() }),
        ("sizes", ViewSearchParams { sizes: [f64::NAN, 50.0], ..params() }),
        ("sizes", ViewSearchParams { sizes: [1.0, 50.0], ..params() }),
        ("min_contrast", ViewSearchParams { min_contrast: 0.0, ..params() }),
        ("least_log_ratio", ViewSearchParams { least_log_ratio: f64::INFINITY, ..params() }),
        ("least_share", ViewSearchParams { least_share: 1.5, ..params() }),
        ("directions", ViewSearchParams { directions: 1, ..params() }),
        ("hits", ViewSearchParams { hits: 0, ..params() }),
        ("compared", ViewSearchParams { compared: 0, ..params() }),
        ("refined", ViewSearchParams { refined: 0, ..params() }),
    ];
    for (key, params) in broken {
        let Err(ConfigError::Parameter { key: found, .. }) = params.check() else { panic!("{key} passes") };
        assert_eq!(found, key);
    }
    let dot = MeshData { vertices: vec![Point3::origin(); 3], ..Default::default() };
    if let Ok(mesh) = Mesh::new(dot) {
        let edges = EdgeModel::new(&mesh, &Default::default()).unwrap();
        let search = ViewSearch::new(Arc::new(mesh), Arc::new(edges), camera, params());
        assert!(matches!(search, Err(ConfigError::Mismatch { .. })));
    }
    let search = search_for(&block(), &camera);
    let small = search.search(&frame(GrayImage::new(100, 80)), &[0]);
    assert!(matches!(small, Err(MeasureError::Payload { .. })));
    let flow = Frame { payload: Payload::Vector(vec![]), ..frame(GrayImage::new(1, 1)) };
    assert!(matches!(search.search(&flow, &[0]), Err(MeasureError::Payload { .. })));
}

#[test]
fn the_reinitialiser_comes_to_every_size_within_a_few_frames() {
    let (solid, camera) = (block(), camera());
    let mesh = Arc::new(solid.mesh());
    let edges = Arc::new(EdgeModel::new(&mesh, &Default::default()).unwrap());
    let mut views = ViewReinitializer::new(SENSOR, mesh, edges, camera, params(), 2).unwrap();
    let truth = truths()[2];
    let mut evidence = Evidence::default();
    // What was trusted last lies much farther away, elsewhere.
    let last = Gaussian::from_sigmas(pose([0.0; 3], [-0.1, 0.0, 1.1]), &nalgebra::Vector6::repeat(0.01));
    let mut hit = None;
    for step in 0..4 {
        evidence.begin([frame(noisy(&solid.draw(&camera, &truth), 2.0, step))]);
        let mut proposals = vec![];
        views.propose(&evidence, &last, &mut proposals).unwrap();
        let good = |p: &Gaussian<SE3>| PoseError::new(&p.mean, &truth).translation < 5e-3;
        hit = hit.or(proposals.iter().any(good).then_some(step));
    }
    assert!(hit.is_some(), "six sizes are three frames of two");
}
