//! Convex solids of grey faces before a grey background, drawn with the exact share of each pixel that a face covers.

use std::sync::Arc;

use image::{GrayImage, Luma};
use nalgebra::{Point3, Vector3, Vector6};
use vt_core::belief::Gaussian;
use vt_core::evidence::Evidence;
use vt_core::frame::{Frame, Payload, SensorId};
use vt_core::lie::SE3;
use vt_core::manifold::Manifold;
use vt_core::time::Timestamp;
use vt_models::camera::Camera;
use vt_models::edges::{EdgeModel, EdgeOptions};
use vt_models::mesh::{Mesh, MeshData, Polygon};
use vt_models::visibility::{MeshView, ViewCache};
use vt_models::warp::Se3Warp;
use vt_vision::edge::{EdgeModality, EdgeParams};

/// The only sensor.
pub const SENSOR: SensorId = SensorId(0);

/// Grey level behind the solid.
const BACKGROUND: f64 = 110.0;

/// All degrees of freedom.
pub const FREE: [bool; 6] = [true; 6];

/// Image points of a face.
type Outline = Vec<[f64; 2]>;

/// A convex body, or a flat plate through the origin.
pub struct Solid {
    vertices: Vec<Point3<f64>>,
    /// Corners of each face and its grey level.
    faces: Vec<(Vec<u32>, f64)>,
}

impl Solid {
    /// From faces wound in any way; a closed body holds the origin.
    pub fn new(vertices: Vec<Point3<f64>>, mut faces: Vec<(Vec<u32>, f64)>) -> Self {
        for (corners, _) in &mut faces {
            let [a, b, c] = [0, 1, 2].map(|k| vertices[corners[k] as usize]);
            if (b - a).cross(&(c - a)).dot(&a.coords) < 0.0 {
                corners.reverse();
            }
        }
        Self { vertices, faces }
    }

    /// A box with these edge lengths about the origin; all faces differ.
    pub fn cuboid(size: [f64; 3]) -> Self {
        let corner = |i: u32| Point3::from([0, 1, 2].map(|k| (f64::from(i >> k & 1) - 0.5) * size[k]));
        let faces = [[0, 4, 6, 2], [3, 7, 5, 1], [0, 1, 5, 4], [2, 6, 7, 3], [1, 3, 2, 0], [4, 5, 7, 6]];
        let levels = [60.0, 160.0, 30.0, 200.0, 230.0, 140.0];
        Self::new((0..8).map(corner).collect(), faces.map(Vec::from).into_iter().zip(levels).collect())
    }

    /// The surface alone, as a tracker knows it.
    pub fn mesh(&self) -> Mesh {
        let polygon =
            |(corners, _): &(Vec<u32>, f64)| Polygon { corners: corners.clone(), ..Default::default() };
        let polygons = self.faces.iter().map(polygon).collect();
        Mesh::new(MeshData { vertices: self.vertices.clone(), polygons, ..Default::default() }).unwrap()
    }

    /// The solid as `camera` sees it.
    pub fn view(&self, camera: &Camera) -> MeshView {
        let mesh = self.mesh();
        let edges = EdgeModel::new(&mesh, &EdgeOptions::default()).unwrap();
        MeshView::new(Arc::new(mesh), Arc::new(edges), *camera, ViewCache::default())
    }

    /// A modality for the solid with these degrees of freedom.
    pub fn modality(
        &self,
        camera: &Camera,
        params: EdgeParams,
        free: [bool; 6],
    ) -> EdgeModality<SE3, Se3Warp, MeshView> {
        let warp = Se3Warp::new(*camera).with_free(free);
        EdgeModality::new(params.check().unwrap(), SENSOR, warp, self.view(camera), self.mesh().diameter())
    }

    /// The picture of the solid; all of it must lie before the camera, which must have no distortion.
    pub fn draw(&self, camera: &Camera, pose: &SE3) -> GrayImage {
        let (width, height) = camera.size();
        let mut grey = vec![BACKGROUND; (width * height) as usize];
        for (corners, level) in &self.faces {
            let image = |c: &u32| camera.project(&pose.act(&self.vertices[*c as usize])).unwrap().into();
            let face: Outline = corners.iter().map(image).collect();
            // With v down, the outside of a face is seen where its corners run against the clock.
            let [a, b, c] = [0, 1, 2].map(|k| self.vertices[corners[k] as usize]);
            let plate = (b - a).cross(&(c - a)).dot(&a.coords) == 0.0;
            if area(&face) >= 0.0 && !plate {
                continue;
            }
            for y in pixels(&face, 1, height) {
                let row = strip(&face, 1, y);
                for x in pixels(&row, 0, width) {
                    grey[(y * width + x) as usize] += (level - BACKGROUND) * area(&strip(&row, 0, x)).abs();
                }
            }
        }
        GrayImage::from_fn(width, height, |x, y| Luma([grey[(y * width + x) as usize].round() as u8]))
    }
}

/// Signed area of a polygon.
fn area(polygon: &Outline) -> f64 {
    let ends = polygon.iter().zip(polygon.iter().cycle().skip(1));
    0.5 * ends.map(|(a, b)| a[0] * b[1] - a[1] * b[0]).sum::<f64>()
}

/// Pixels along an axis that a polygon touches.
fn pixels(polygon: &Outline, axis: usize, size: u32) -> core::ops::Range<u32> {
    let along = || polygon.iter().map(|q| q[axis]);
    let low = along().fold(f64::INFINITY, f64::min).round().max(0.0);
    let high = along().fold(-1.0, f64::max).round().min(f64::from(size) - 1.0);
    low as u32..(high + 1.0) as u32
}

/// The part of a convex polygon within half a pixel of `centre` along an axis.
fn strip(polygon: &Outline, axis: usize, centre: u32) -> Outline {
    let mut rest = polygon.clone();
    for (sign, bound) in [(1.0, f64::from(centre) - 0.5), (-1.0, f64::from(centre) + 0.5)] {
        let inside = |q: &[f64; 2]| sign * (q[axis] - bound);
        let mut kept = vec![];
        for (a, b) in rest.iter().zip(rest.iter().cycle().skip(1)) {
            let (da, db) = (inside(a), inside(b));
            if da >= 0.0 {
                kept.push(*a);
            }
            if (da > 0.0 && db < 0.0) || (da < 0.0 && db > 0.0) {
                let t = da / (da - db);
                kept.push([0, 1].map(|k| a[k] + t * (b[k] - a[k])));
            }
        }
        rest = kept;
    }
    rest
}

/// A pose from a rotation vector in degrees and a translation in metres.
pub fn pose(degrees: [f64; 3], translation: [f64; 3]) -> SE3 {
    SE3::from_rotation_vector(&Vector3::from(degrees.map(f64::to_radians)), Vector3::from(translation))
}

/// A tangent vector from a shift in metres and a turn in degrees, body axes.
pub fn tangent(shift: [f64; 3], degrees: [f64; 3]) -> Vector6<f64> {
    let turn = degrees.map(f64::to_radians);
    Vector6::new(shift[0], shift[1], shift[2], turn[0], turn[1], turn[2])
}

/// The pose `offset` away from `truth`, with deviations of `shift` metres and `degrees` in every coordinate.
pub fn prior(truth: &SE3, offset: &Vector6<f64>, shift: f64, degrees: f64) -> Gaussian<SE3> {
    Gaussian::from_sigmas(truth.retract(offset), &tangent([shift; 3], [degrees; 3]))
}

/// A step with one picture.
pub fn show(evidence: &mut Evidence, image: GrayImage) {
    let payload = Payload::Grey(Arc::new(image));
    evidence.begin([Frame { sensor: SENSOR, number: 0, time: Timestamp(0), payload }]);
}
