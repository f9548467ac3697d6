use super::*;
use nalgebra::{Matrix3, Point3, Vector2, Vector3};
use vt_core::lie::{SE3, SL3};
use vt_core::metrics::Consistency;
use vt_core::random::{Random, Stream};

use crate::camera::Camera;
use crate::warp::{PlanarWarp, Se3Warp};

fn error(random: &mut Random, deviation: f64) -> Vector2<f64> {
    Vector2::new(random.normal(), random.normal()) * deviation
}

fn homography() -> SL3 {
    SL3::from_matrix(&Matrix3::new(1.1, 0.1, 200.0, -0.05, 0.9, 150.0, 4e-4, -6e-4, 1.0)).unwrap()
}

fn pose() -> SE3 {
    SE3::from_rotation_vector(&Vector3::new(0.5, -0.4, 0.2), Vector3::new(0.05, -0.02, 0.9))
}

fn posed() -> Se3Warp {
    Se3Warp::new(Camera::new(600.0, 620.0, 320.0, 240.0, 640, 480).unwrap())
}

/// Pairs of a plane `size` wide; every tenth is wrong where `wrong`.
fn pairs<P: Manifold, W: Warp<P>>(
    warp: &W,
    truth: &P,
    count: u32,
    wrong: bool,
    noise: f64,
    random: &mut Random,
    body: impl Fn([f64; 2]) -> W::Body,
) -> Vec<Pair<W::Body>>
where
    DefaultAllocator: Alloc<P::D>,
{
    let pair = |k: u32| {
        let body = body([random.uniform() - 0.5, random.uniform() - 0.5]);
        let deviation = [0.5, 1.0, 2.0][random.index(3)];
        let mut seen = warp.at(truth).locate(&body).unwrap() + error(random, noise * deviation);
        if wrong && k.is_multiple_of(10) {
            seen += Vector2::new(random.uniform() - 0.5, random.uniform() - 0.5) * 120.0;
        }
        Pair { body, seen, deviation }
    };
    (0..count).map(pair).collect()
}

fn on_plane(p: [f64; 2]) -> nalgebra::Point2<f64> {
    nalgebra::Point2::from(p) * 120.0
}

fn in_space([x, y]: [f64; 2]) -> Point3<f64> {
    Point3::new(0.3 * x, 0.3 * y, 0.0)
}

#[test]
fn exact_pairs_give_the_exact_pose() {
    let mut random = Random::new(1, Stream::Sim, 0, 0, 0);
    for robust in [Robust::Square, Robust::HUBER, Robust::TUKEY] {
        let params = RefinementParams { robust, ..RefinementParams::default() }.check().unwrap();
        let planar = PlanarWarp::<SL3>::default();
        let exact = pairs(&planar, &homography(), 30, false, 0.0, &mut random, on_plane);
        let start =
            homography().retract(&Tangent::<SL3>::from([2.0, -1.0, 0.02, 0.01, 0.01, 0.0, 1e-5, 0.0]));
        let found = refine(&planar, &exact, &start, &params).unwrap();
        assert!((found.belief.mean.matrix - homography().matrix).norm() < 1e-6, "{:?}", found.solution.stop);
        let exact = pairs(&posed(), &pose(), 30, false, 0.0, &mut random, in_space);
        let start = pose().retract(&Tangent::<SE3>::from([0.01, -0.01, 0.03, 0.05, -0.04, 0.02]));
        let found = refine(&posed(), &exact, &start, &params).unwrap();
        assert!(pose().local(&found.belief.mean).norm() < 1e-6);
        assert_eq!((found.pairs, found.scale), (30, 0.3));
    }
}

/// Normalised errors over many trials are as large as the covariance says, for every estimator, with outliers and without.
#[test]
fn covariances_are_honest() {
    let planar = PlanarWarp::<SL3>::default();
    for (robust, wrong) in
        [(Robust::Square, false), (Robust::HUBER, false), (Robust::TUKEY, false), (Robust::TUKEY, true)]
    {
        for (scale, noise) in [(Scale::Known, 1.0), (Scale::Estimated { least: 0.05 }, 0.4)] {
            let params = RefinementParams { robust, scale, ..RefinementParams::default() };
            let mut records = [Consistency::default(); 2];
            for trial in 0..600 {
                let mut random = Random::new(2, Stream::Sim, 0, trial, 0);
                let seen = pairs(&planar, &homography(), 60, wrong, noise, &mut random, on_plane);
                let found = refine(&planar, &seen, &homography(), &params).unwrap();
                records[0].push(found.belief.nees(&homography()).unwrap(), 8);
                let seen = pairs(&posed(), &pose(), 60, wrong, noise, &mut random, in_space);
                let found = refine(&posed(), &seen, &pose(), &params).unwrap();
                records[1].push(found.belief.nees(&pose()).unwrap(), 6);
            }
            for record in records {
                // Three standard errors are 0.06 and 0.07; an estimated scale, and weights by errors, widen the law a little.
                let ratio = record.ratio().unwrap();
                assert!((0.88..1.16).contains(&ratio), "{robust:?} {wrong} {scale:?}: {ratio}");
            }
        }
    }
}

#[test]
fn constants_are_those_of_the_estimators() {
    let square = Constants::new(Robust::Square);
    assert!((square.weight - 1.0).abs() < 1e-4 && (square.covariance() - 1.0).abs() < 1e-3, "{square:?}");
    // The smaller the weights, the more is lost; the variance itself is slope and power.
    for robust in [Robust::HUBER, Robust::TUKEY, Robust::CAUCHY] {
        let c = Constants::new(robust);
        let efficiency = c.slope * c.slope / c.power;
        assert!(efficiency > 0.85 && efficiency < 1.0, "{robust:?} {efficiency}");
    }
}

#[test]
fn too_few_pairs_and_odd_ones_are_errors() {
    let mut random = Random::new(3, Stream::Sim, 0, 0, 0);
    let params = RefinementParams::default();
    let mut seen = pairs(&posed(), &pose(), 12, false, 1.0, &mut random, in_space);
    assert!(
        refine(&posed(), &[], &pose(), &params)
            .is_ok_and(|r| r.pairs == 0 && r.solution.unobservable.len() == 6)
    );
    seen[3].seen.x = f64::NAN;
    assert!(refine(&posed(), &seen, &pose(), &params).is_err());
    for least in [0.0, f64::NAN] {
        assert!(
            RefinementParams { scale: Scale::Estimated { least }, ..RefinementParams::default() }
                .check()
                .is_err()
        );
    }
}
