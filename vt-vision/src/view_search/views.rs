//! What a model's contour looks like from all around: the templates of the search.

use nalgebra::{Matrix3, Point3, Rotation3, UnitQuaternion, Vector2, Vector3};
use rayon::prelude::*;
use vt_core::error::ConfigError;
use vt_core::lie::SE3;
use vt_core::math;
use vt_models::camera::Camera;
use vt_models::edges::EdgeModel;
use vt_models::mesh::Mesh;
use vt_models::raster::NONE;
use vt_models::visibility::{EdgeSite, VisibilityOptions, VisibleEdges};

use super::scan::INSIDE;

/// Size at which views are rendered, pixels for the diameter of the bounding sphere.
const RENDERED: f64 = 128.0;

/// Side of the picture they are rendered in: strong perspective enlarges the sphere.
const PICTURE: u32 = 288;

/// Distance of sites along rendered edges, pixels.
const STEP: f64 = 3.0;

/// Most contour points kept of a view.
pub(super) const POINTS: usize = 96;

/// Distance of the places inside the outline that are looked at, rendered pixels.
const GRID: usize = 5;

/// Their distance from visible edges, diameters of the bounding sphere: farther than edges are spread.
const CLEARANCE: f32 = 0.1;

/// A view with fewer points shows too little to be found.
const FEWEST: usize = 8;

/// A point of a visible contour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContourPoint {
    /// Where it is seen from the view's pose, in diameters of the bounding sphere from the centre of the view.
    pub at: [f32; 2],
    /// Angle of the contour's normal in the picture, 0 to π.
    pub angle: f32,
    /// Place on the model, object frame, metres.
    pub point: Point3<f64>,
    /// Direction of the edge, object frame.
    pub tangent: Vector3<f64>,
    /// Edge of the model.
    pub edge: u32,
    /// True on an occluding contour.
    pub contour: bool,
}

/// The contour from one direction.
#[derive(Clone, Debug)]
pub struct View {
    /// Turns the object into a camera that looks at its centre.
    pub rotation: UnitQuaternion<f64>,
    /// Points of the contour, well spread: each is the one farthest from all before it.
    pub points: Vec<ContourPoint>,
    /// Places inside the outline where no edge is seen, in diameters of the bounding sphere, well spread.
    pub inside: Vec<[f32; 2]>,
    /// Length of the visible contour in diameters of the bounding sphere.
    pub length: f64,
}

/// Views of a model from all around at some distances, which differ in perspective.
#[derive(Clone, Debug)]
pub struct Views {
    /// Middle of the bounding sphere, object frame, metres.
    pub center: Point3<f64>,
    /// Diameter of the bounding sphere, metres.
    pub diameter: f64,
    /// Sizes in pixels of the camera's picture for which views were rendered, ascending, one octave apart.
    sizes: Vec<f64>,
    /// Views by size.
    views: Vec<Vec<View>>,
}

/// `count` directions, evenly on the sphere: a Fibonacci lattice.
fn directions(count: u32) -> Vec<Vector3<f64>> {
    let golden = core::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    (0..count)
        .map(|k| {
            let z = 1.0 - (2.0 * f64::from(k) + 1.0) / f64::from(count);
            let (s, c) = math::sin_cos(golden * f64::from(k));
            let radius = (1.0 - z * z).sqrt();
            Vector3::new(radius * c, radius * s, z)
        })
        .collect()
}

/// Rotation into a camera that looks along `-toward_camera`.
fn looking(toward_camera: &Vector3<f64>) -> UnitQuaternion<f64> {
    let z = -toward_camera;
    let mut helper = Vector3::zeros();
    helper[z.iamin()] = 1.0;
    let x = helper.cross(&z).normalize();
    let y = z.cross(&x);
    let rotation =
        Rotation3::from_matrix_unchecked(Matrix3::from_rows(&[x.transpose(), y.transpose(), z.transpose()]));
    UnitQuaternion::from_rotation_matrix(&rotation)
}

impl Views {
    /// Renders the views of a model for a camera in which the diameter of its bounding sphere has from `sizes[0]` to
    /// `sizes[1]` pixels.
    ///
    /// # Errors
    /// [`ConfigError`] for a model without extent or without any edge that can be seen.
    pub fn new(
        mesh: &Mesh,
        edges: &EdgeModel,
        camera: &Camera,
        sizes: [f64; 2],
        directions: u32,
    ) -> Result<Self, ConfigError> {
        let center = mesh.bounds().center();
        let radius = mesh.vertices().iter().map(|p| (p - center).norm()).fold(0.0, f64::max);
        if !(radius > 0.0 && radius.is_finite()) {
            return Err(ConfigError::Mismatch {
                found: "a model without extent".into(),
                expected: "a model whose views can be searched".into(),
            });
        }
        let diameter = 2.0 * radius;
        let octaves = math::ln(sizes[1] / sizes[0]) / core::f64::consts::LN_2;
        let count = octaves.ceil().max(1.0);
        let sizes: Vec<f64> = (0..count as usize)
            .map(|k| sizes[0] * math::exp((k as f64 + 0.5) * octaves / count * core::f64::consts::LN_2))
            .collect();
        let directions = self::directions(directions);
        let focal = focal(camera);
        let views: Vec<Vec<View>> = sizes
            .iter()
            .map(|size| {
                let distance = diameter * focal / size;
                let render = |edges_seen: &mut VisibleEdges, d| {
                    view(edges_seen, mesh, edges, center, diameter, distance, d)
                };
                directions
                    .par_iter()
                    .map_init(VisibleEdges::default, render)
                    .collect::<Vec<_>>()
                    .into_iter()
                    .flatten()
                    .collect()
            })
            .collect();
        if views.iter().any(Vec::is_empty) {
            return Err(ConfigError::Mismatch {
                found: "a model without visible edges".into(),
                expected: "a model with creases, rims or silhouettes".into(),
            });
        }
        Ok(Self { center, diameter, sizes, views })
    }

    /// The views rendered for the size nearest to `size`.
    pub fn at_size(&self, size: f64) -> &[View] {
        let ratio = |k: usize| (self.sizes[k] / size).max(size / self.sizes[k]);
        let nearest = (0..self.sizes.len()).min_by(|&a, &b| ratio(a).total_cmp(&ratio(b)));
        nearest.map_or(&[], |k| &self.views[k])
    }

    /// The pose under which `view`, turned by `roll` about its line of sight, is seen in the direction `ray` of the
    /// camera with the bounding sphere `size` pixels large.
    pub fn pose(&self, view: &View, roll: f64, ray: &Vector3<f64>, size: f64, camera: &Camera) -> SE3 {
        let ray = ray.normalize();
        let turn = UnitQuaternion::rotation_between(&Vector3::z(), &ray).unwrap_or_default();
        let rotation = turn * UnitQuaternion::from_scaled_axis(Vector3::z() * roll) * view.rotation;
        // Off the axis a picture is larger by 1/cos across the radius and by 1/cos² along it.
        let cosine = ray.z.max(0.1);
        let distance = self.diameter * focal(camera) / (size * cosine * cosine.sqrt());
        SE3::new(rotation, ray * distance - rotation * self.center.coords)
    }

    /// Size in pixels of the bounding sphere under a pose, on the axis of the camera.
    pub fn size(&self, pose: &SE3, camera: &Camera) -> f64 {
        let p = pose.act(&self.center);
        let cosine = (p.z / p.coords.norm()).max(0.1);
        self.diameter * focal(camera) / (p.coords.norm() * cosine * cosine.sqrt())
    }
}

/// Mean focal length, pixels.
pub(super) fn focal(camera: &Camera) -> f64 {
    0.5 * (camera.focal().0 + camera.focal().1)
}

/// The view from one direction; `None` where it shows too little.
fn view(
    seen: &mut VisibleEdges,
    mesh: &Mesh,
    edges: &EdgeModel,
    center: Point3<f64>,
    diameter: f64,
    distance: f64,
    toward_camera: &Vector3<f64>,
) -> Option<View> {
    let middle = 0.5 * f64::from(PICTURE - 1);
    let focal = RENDERED * distance / diameter;
    let camera = Camera::new(focal, focal, middle, middle, PICTURE, PICTURE).ok()?;
    let rotation = looking(toward_camera);
    let pose = SE3::new(rotation, Vector3::z() * distance - rotation * center.coords);
    let options = VisibilityOptions {
        step: STEP,
        raster_scale: 1.0,
        border: 0.0,
        // Fine meshes have short edges only.
        min_length: 0.3,
        max_sites: 2000,
        near: 1e-3 * diameter,
        ..VisibilityOptions::default()
    };
    seen.update(mesh, edges, &camera, &pose, &options);
    let all: Vec<ContourPoint> = seen
        .sites()
        .iter()
        .filter_map(|site| {
            let angle = normal_angle(site, &camera, &pose, 1e-4 * diameter)?;
            let at = [site.pixel.x, site.pixel.y].map(|c| ((c - middle) / RENDERED) as f32);
            Some(ContourPoint {
                at,
                angle: angle as f32,
                point: site.p_in_object,
                tangent: site.tangent,
                edge: site.edge,
                contour: site.contour.is_some(),
            })
        })
        .collect();
    let length = seen.sites().iter().map(|s| f64::from(s.weight)).sum::<f64>() / RENDERED;
    let points = spread(&all, POINTS, |p| p.at);
    let inside = inside(seen, &all, middle);
    (points.len() >= FEWEST).then_some(View { rotation, points, inside, length })
}

/// Places of the drawn object away from all its visible edges.
fn inside(seen: &VisibleEdges, edges: &[ContourPoint], middle: f64) -> Vec<[f32; 2]> {
    let raster = seen.raster();
    let viewport = raster.viewport();
    let place = |c: usize, first: i32| ((f64::from(first) + c as f64 - middle) / RENDERED) as f32;
    let square = |a: [f32; 2], b: [f32; 2]| (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2);
    let mut free = vec![];
    for row in (GRID / 2..viewport.height).step_by(GRID) {
        for column in (GRID / 2..viewport.width).step_by(GRID) {
            let at = [place(column, viewport.x), place(row, viewport.y)];
            if raster.ids()[row * viewport.width + column] != NONE
                && edges.iter().all(|p| square(p.at, at) > CLEARANCE * CLEARANCE)
            {
                free.push(at);
            }
        }
    }
    spread(&free, INSIDE, |at| *at)
}

/// Angle of the normal of a site's edge in the picture, 0 to π.
fn normal_angle(site: &EdgeSite, camera: &Camera, pose: &SE3, probe: f64) -> Option<f64> {
    let y = camera.project(&pose.act(&site.p_in_object))?;
    let ahead = camera.project(&pose.act(&(site.p_in_object + site.tangent * probe)))?;
    let d: Vector2<f64> = ahead - y;
    (d.norm_squared() > 0.0).then(|| half_turn(math::atan2(d.x, -d.y)))
}

/// An angle of a line, 0 to π.
pub(super) fn half_turn(angle: f64) -> f64 {
    angle.rem_euclid(core::f64::consts::PI)
}

/// At most `count` of `all`, each the farthest from those before it; the first is the farthest from the centre.
fn spread<T: Copy>(all: &[T], count: usize, at: impl Fn(&T) -> [f32; 2]) -> Vec<T> {
    let square = |a: [f32; 2], b: [f32; 2]| (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2);
    let mut gap: Vec<f32> = vec![f32::INFINITY; all.len()];
    let from_centre = |k: usize| square(at(&all[k]), [0.0; 2]);
    let mut next = (0..all.len()).max_by(|&a, &b| from_centre(a).total_cmp(&from_centre(b)).then(b.cmp(&a)));
    let mut chosen = vec![];
    while let Some(k) = next.filter(|_| chosen.len() < count) {
        chosen.push(all[k]);
        let mut farthest = 0.0;
        next = None;
        for (i, g) in gap.iter_mut().enumerate() {
            *g = g.min(square(at(&all[i]), at(&all[k])));
            if *g > farthest {
                (farthest, next) = (*g, Some(i));
            }
        }
    }
    chosen
}
