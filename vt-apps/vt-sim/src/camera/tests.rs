use super::*;
use crate::backdrop::{Background, Clutter};
use crate::bodies::{cuboid, house};
use crate::light::{Lighting, Shadow};
use crate::path::{Line, Motion, Path, SmoothPath};
use crate::scene::Object;
use crate::texture::Texture;
use nalgebra::{UnitQuaternion, Vector3};
use vt_core::lie::LieGroup;

fn object(path: Path) -> Object {
    let texture = Texture::Faces { from: 0.2, to: 0.9 };
    Object { name: "house".into(), body: Body::new(house(0.1), texture, 5), path }
}

fn smooth() -> Path {
    let start = SE3::from_rotation_vector(&Vector3::new(2.4, 0.5, 0.2), Vector3::new(0.0, 0.0, 0.3));
    SmoothPath { start, translation: [0.02; 3], rotation: [0.2; 3], period: 2.0 }.into()
}

fn world(objects: Vec<Object>) -> World {
    let clutter = Clutter { size: 15.0, density: 0.4, brightness: 0.4, contrast: 0.4 };
    World { objects, lighting: Lighting::default(), background: Background::Clutter(clutter), seed: 5 }
}

fn quiet() -> Settings {
    let noise = Noise { gaussian: 0.0, ..Noise::default() };
    Settings { frames: 4, noise, ..Settings::default() }
}

fn camera(world: World, settings: Settings) -> SimulatedCamera {
    let intrinsics = Camera::new(120.0, 120.0, 63.5, 47.5, 128, 96).unwrap();
    SimulatedCamera::new(SensorId(0), Arc::new(world), intrinsics, SE3::identity(), settings)
}

fn pictures(mut c: SimulatedCamera) -> Vec<Vec<u8>> {
    let frames = std::iter::from_fn(|| c.next().unwrap());
    frames.map(|f| f.grey().unwrap().clone().into_raw()).collect()
}

#[test]
fn pictures_are_the_same_at_any_number_of_threads() {
    let pool = |n| rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
    let noise = Noise { gaussian: 2.0, photon: 0.1, salt_and_pepper: 0.01, ..Noise::default() };
    let run = |seed| {
        let lighting = Lighting {
            swing: 0.3,
            turn: 1.0,
            shadow: Some(Shadow { width: 30.0, soft: 5.0, depth: 0.5, angle: 0.4, reach: 50.0, period: 1.0 }),
            ..Lighting::default()
        };
        let plate = Object {
            name: "plate".into(),
            body: Body::new(cuboid([0.03, 0.1, 0.01]), Texture::Squares { size: 0.01, contrast: 0.5 }, 2),
            path: Path::still(SE3::from_rotation_vector(&Vector3::x(), Vector3::new(0.01, 0.0, 0.2))),
        };
        let world = World { lighting, ..world(vec![object(smooth()), plate]) };
        let settings = Settings { noise, exposure: 0.7, seed, duplicated: 0.3, ..quiet() };
        pictures(camera(world, settings))
    };
    let alone = pool(1).install(|| run(7));
    assert_eq!(alone, pool(2).install(|| run(7)));
    assert_ne!(alone, run(8));
}

#[test]
fn a_blurred_picture_is_the_mean_of_sharp_ones_and_its_truth_the_middle() {
    let line = Line {
        start: smooth().pose(0.0),
        velocity: Vector3::new(0.5, 0.2, 0.0),
        spin: Vector3::new(0.0, 2.0, 0.0),
    };
    let path = Path::from(Motion::Line(line));
    let settings = Settings { exposure: 0.8, ..quiet() };
    let mut blurred = camera(world(vec![object(path.clone())]), settings);
    blurred.shot();
    let shot = blurred.shot().unwrap();
    assert_eq!(shot.poses[0], path.pose(0.04));
    let times: Vec<f64> = blurred.subframes(1).collect();
    assert!(times.len() > 5, "{times:?}");
    assert!((times.iter().sum::<f64>() / times.len() as f64 - 0.04).abs() < 1e-12);
    assert!((times[times.len() - 1] - times[0] - 0.032).abs() < 0.032 / times.len() as f64 + 1e-12);
    let mut sum = vec![0.0; 128 * 96];
    for t in &times {
        let still = camera(world(vec![object(Path::still(path.pose(*t)))]), quiet());
        for (s, v) in sum.iter_mut().zip(&pictures(still)[0]) {
            *s += f64::from(*v) / times.len() as f64;
        }
    }
    // Each sharp picture is rounded, and so is the blurred one.
    for (blurred, mean) in shot.frame.grey().unwrap().iter().zip(sum) {
        assert!((f64::from(*blurred) - mean).abs() <= 1.001, "{blurred} instead of {mean}");
    }
}

#[test]
fn an_occluder_hides_its_object_while_it_is_there() {
    let wall = Object {
        name: "wall".into(),
        body: Body::new(cuboid([0.5, 0.5, 0.01]), Texture::Plain(0.3), 0),
        path: Motion::Line(Line {
            start: SE3::from_rotation_vector(&Vector3::zeros(), Vector3::new(-0.8, 0.0, 0.15)),
            velocity: Vector3::new(10.0, 0.0, 0.0),
            spin: Vector3::zeros(),
        })
        .into(),
    };
    let mut c = camera(world(vec![object(smooth()), wall]), quiet());
    let visible: Vec<f64> = std::iter::from_fn(|| c.shot()).map(|s| s.visible[0]).collect();
    assert_eq!((visible[0], visible[2]), (1.0, 0.0), "{visible:?}");
    let mut c = camera(world(vec![object(smooth())]), quiet());
    assert!(std::iter::from_fn(|| c.shot()).all(|s| s.visible == [1.0]));
}

#[test]
fn two_cameras_see_one_world() {
    let left = SE3::identity();
    let right = SE3::new(UnitQuaternion::from_euler_angles(0.0, 0.2, 0.1), Vector3::new(-0.1, 0.0, 0.02));
    let world = Arc::new(world(vec![object(smooth())]));
    let intrinsics = Camera::new(120.0, 120.0, 63.5, 47.5, 128, 96).unwrap();
    let mut cameras = [left, right]
        .map(|extrinsics| SimulatedCamera::new(SensorId(0), world.clone(), intrinsics, extrinsics, quiet()));
    let [a, b] = [0, 1].map(|k| {
        cameras[k].shot();
        cameras[k].shot().unwrap()
    });
    assert_eq!(a.frame.time, b.frame.time);
    assert_ne!(a.frame.grey().unwrap(), b.frame.grey().unwrap());
    // A vertex in the one camera's frame, carried over, is seen where the other truth says.
    let p = world.objects[0].body.mesh().vertices()[0];
    let carried = right.act(&left.inverse().act(&a.poses[0].act(&p)));
    let (from, to) = (intrinsics.project(&carried), intrinsics.project(&b.poses[0].act(&p)));
    assert!((from.unwrap() - to.unwrap()).norm() < 1e-9);
    // And the picture shows it there: the silhouette's box is that of the projected vertices.
    let background = pictures(camera(super::tests::world(vec![]), quiet()))[0].clone();
    let picture = b.frame.grey().unwrap();
    let changed = picture
        .enumerate_pixels()
        .filter(|(x, y, p)| background[*y as usize * 128 + *x as usize].abs_diff(p.0[0]) > 8);
    let columns: Vec<f64> = changed.map(|(x, ..)| f64::from(x)).collect();
    let corners = world.objects[0].body.mesh().vertices().iter();
    let seen: Vec<f64> = corners.map(|p| intrinsics.project(&b.poses[0].act(p)).unwrap().x).collect();
    let range = |v: &[f64]| v.iter().fold((f64::MAX, f64::MIN), |(l, h), x| (l.min(*x), h.max(*x)));
    let ((l0, h0), (l1, h1)) = (range(&columns), range(&seen));
    assert!((l0 - l1).abs() < 2.0 && (h0 - h1).abs() < 2.0, "{l0} {h0} instead of {l1} {h1}");
}

#[test]
fn dropped_frames_keep_the_numbers_and_times_of_the_others() {
    let all = pictures(camera(world(vec![object(smooth())]), Settings { frames: 40, ..quiet() }));
    let settings = Settings { frames: 40, dropped: 0.2, gaps: vec![[10, 14]], ..quiet() };
    let mut c = camera(world(vec![object(smooth())]), settings);
    let (expected, truth) = (c.remaining().unwrap(), c.truth(0));
    let frames: Vec<Frame> = std::iter::from_fn(|| c.next().unwrap()).collect();
    assert_eq!(frames.len(), expected);
    assert!(frames.len() < 35 && frames.len() > 15, "{}", frames.len());
    assert!(frames.iter().map(|f| f.number).eq(truth.keys().copied()));
    assert!(frames.iter().all(|f| !(10..=14).contains(&f.number)));
    for f in &frames {
        assert_eq!(f.time, Timestamp::from_seconds(f.number as f64 / 25.0));
        assert_eq!(f.grey().unwrap().as_raw(), &all[f.number as usize]);
    }
}

#[test]
fn duplicated_frames_show_the_picture_before() {
    let settings = Settings { frames: 60, duplicated: 0.3, ..quiet() };
    let mut c = camera(world(vec![object(smooth())]), settings);
    let shots: Vec<Shot> = std::iter::from_fn(|| c.shot()).collect();
    let same = |w: &[Shot]| w[0].frame.grey().unwrap() == w[1].frame.grey().unwrap();
    let repeated = shots.windows(2).filter(|w| same(w)).count();
    assert!((8..30).contains(&repeated), "{repeated}");
    assert!(shots.windows(2).all(|w| w[0].frame.time < w[1].frame.time && w[0].poses != w[1].poses));
}

#[test]
fn pictures_are_used_again_and_never_changed_while_held() {
    let settings = Settings { frames: 12, ..quiet() };
    let mut c = camera(world(vec![object(smooth())]), settings.clone());
    let held: Vec<Frame> = std::iter::from_fn(|| c.next().unwrap()).collect();
    let fleeting = pictures(camera(world(vec![object(smooth())]), settings));
    assert!(held.iter().zip(&fleeting).all(|(f, p)| f.grey().unwrap().as_raw() == p));
}

#[test]
fn colour_frames_and_brightness_over_time() {
    let mut c = camera(world(vec![object(smooth())]), Settings { colour: true, ..quiet() });
    assert_eq!(c.remaining(), Some(4));
    assert_eq!(c.next().unwrap().unwrap().rgb().unwrap().dimensions(), (128, 96));
    assert_eq!(std::iter::from_fn(|| c.next().unwrap()).count(), 3);
    let lighting = Lighting { swing: 0.5, period: 0.16, ..Lighting::default() };
    let world = World { lighting, background: Background::Plain(0.4), ..world(vec![]) };
    let grey: Vec<u8> = pictures(camera(world, quiet())).iter().map(|p| p[0]).collect();
    // A quarter of the period passes from frame to frame.
    assert_eq!(grey, [102, 153, 102, 51]);
}
