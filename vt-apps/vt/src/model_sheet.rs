//! Six views of a model's edges as the tracker sees them, on one sheet.

use image::{Rgb, RgbImage};
use nalgebra::{Matrix3, Point2, Point3, Rotation3, UnitQuaternion, Vector3};
use vt_core::lie::SE3;
use vt_io::canvas::Canvas;
use vt_models::camera::{Camera, CameraError};
use vt_models::edges::EdgeModel;
use vt_models::mesh::Mesh;
use vt_models::raster::NONE;
use vt_models::visibility::{EdgeSite, SiteKind, VisibilityOptions, VisibleEdges};

/// Columns and rows of a view in pixels.
const VIEW: [u32; 2] = [480, 400];
const COLUMNS: u32 = 3;
/// Height of the legend under the views.
const LEGEND: u32 = 40;
const PAPER: [u8; 3] = [250; 3];
const INK: [u8; 3] = [40; 3];

/// Directions to the camera with their names: along the axes, turned aside so that depth shows.
const DIRECTIONS: [(&str, [f64; 3]); 6] = [
    ("+x", [1.0, 0.35, 0.3]),
    ("+y", [-0.35, 1.0, 0.3]),
    ("+z", [0.3, -0.35, 1.0]),
    ("-x", [-1.0, -0.35, 0.3]),
    ("-y", [0.35, -1.0, -0.3]),
    ("-z", [-0.3, 0.35, -1.0]),
];

/// Colours of what a site may be.
const KINDS: [(&str, [u8; 3]); 6] = [
    ("occluding contour", [220, 60, 20]),
    ("crease", [30, 90, 200]),
    ("boundary", [20, 140, 60]),
    ("three or more faces", [190, 30, 160]),
    ("line", [90, 90, 90]),
    ("silhouette before itself", [230, 150, 0]),
];

/// Draws the sheet.
///
/// # Errors
/// [`CameraError`] for a model without extent, of which no camera makes a picture.
pub fn sheet(mesh: &Mesh, edges: &EdgeModel) -> Result<RgbImage, CameraError> {
    let [width, height] = VIEW;
    let rows = (DIRECTIONS.len() as u32).div_ceil(COLUMNS);
    let paper = RgbImage::from_pixel(COLUMNS * width, rows * height + LEGEND, Rgb(PAPER));
    let mut canvas = Canvas { picture: paper };
    let mut visible = VisibleEdges::default();
    for (k, (name, direction)) in DIRECTIONS.iter().enumerate() {
        let (camera, pose) = view(mesh, direction)?;
        let options = VisibilityOptions {
            step: 2.0,
            raster_scale: 1.0,
            border: 0.0,
            max_sites: 20_000,
            near: 1e-6 * mesh.bounds().diagonal(),
            ..VisibilityOptions::default()
        };
        visible.update(mesh, edges, &camera, &pose, &options);
        let corner = [f64::from(k as u32 % COLUMNS * width), f64::from(k as u32 / COLUMNS * height)];
        shade(&mut canvas, &visible, mesh, &pose, corner);
        for site in visible.sites() {
            stroke(&mut canvas, site, &camera, &pose, corner);
        }
        let at = corner.map(|c| c as i64 + 8);
        canvas.text(at[0], at[1], &format!("from {name}"), INK);
    }
    let mut column = 8;
    for (name, colour) in KINDS {
        let row = i64::from(rows * height) + 16;
        canvas.bar(column, row, 16, 8, colour, 1.0);
        column = canvas.text(column + 22, row, name, INK) + 24;
    }
    Ok(canvas.picture)
}

/// Camera and pose that show all of the model from a direction.
fn view(mesh: &Mesh, direction: &[f64; 3]) -> Result<(Camera, SE3), CameraError> {
    let toward = Vector3::from(*direction).normalize();
    let up = if toward.z.abs() > 0.7 { Vector3::y() } else { Vector3::z() };
    // Rows of camera_from_object: right, down, ahead.
    let right = up.cross(&toward).normalize();
    let down = -toward.cross(&right);
    let rows = Matrix3::from_rows(&[right.transpose(), down.transpose(), -toward.transpose()]);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rows));
    let ahead = Vector3::new(0.0, 0.0, 2.5 * mesh.bounds().diagonal());
    let pose = SE3::new(rotation, ahead - rotation * mesh.bounds().center().coords);
    // The extent of the picture at a focal length of one.
    let (mut low, mut high) = (Point2::new(f64::MAX, f64::MAX), Point2::new(f64::MIN, f64::MIN));
    for p in mesh.vertices() {
        let p = pose.act(p);
        let q = Point2::new(p.x / p.z, p.y / p.z);
        (low, high) = (low.inf(&q), high.sup(&q));
    }
    let [width, height] = VIEW.map(f64::from);
    let focal = (0.86 * width / (high.x - low.x)).min(0.86 * height / (high.y - low.y));
    let middle = nalgebra::center(&low, &high);
    let center = [0.5 * (width - 1.0) - focal * middle.x, 0.5 * (height - 1.0) - focal * middle.y];
    Ok((Camera::new(focal, focal, center[0], center[1], VIEW[0], VIEW[1])?, pose))
}

/// Faint grey surfaces, darker where they turn away.
fn shade(canvas: &mut Canvas, visible: &VisibleEdges, mesh: &Mesh, pose: &SE3, corner: [f64; 2]) {
    let raster = visible.raster();
    let viewport = raster.viewport();
    for (k, &id) in raster.ids().iter().enumerate() {
        let Some(triangle) = mesh.triangles().get(id as usize).filter(|_| id != NONE) else { continue };
        let normal = mesh.normal(triangle.polygon as usize).unwrap_or_else(Vector3::zeros);
        let facing = (pose.rotation * normal).z.abs();
        let grey = 195 + (45.0 * facing) as u8;
        let (x, y) = ((k % viewport.width) as i64, (k / viewport.width) as i64);
        let (x, y) = (x + i64::from(viewport.x), y + i64::from(viewport.y));
        if (0..i64::from(VIEW[0])).contains(&x) && (0..i64::from(VIEW[1])).contains(&y) {
            canvas.bar(corner[0] as i64 + x, corner[1] as i64 + y, 1, 1, [grey; 3], 1.0);
        }
    }
}

/// A piece of an edge about a site.
fn stroke(canvas: &mut Canvas, site: &EdgeSite, camera: &Camera, pose: &SE3, corner: [f64; 2]) {
    let kind = match site.kind {
        _ if site.contour.is_some() => 0,
        SiteKind::Crease => 1,
        SiteKind::Boundary => 2,
        SiteKind::NonManifold => 3,
        SiteKind::Line => 4,
        SiteKind::Silhouette => 5,
    };
    let p: Point3<f64> = pose.act(&site.p_in_object);
    let Some((at, jacobian)) = camera.project_with_jacobian(&p) else { return };
    let along = jacobian * (pose.rotation * site.tangent);
    let Some(along) = along.try_normalize(0.0) else { return };
    let reach = along * (0.5 * f64::from(site.weight) + 0.3);
    let end = |d: nalgebra::Vector2<f64>| [at.x + d.x + corner[0], at.y + d.y + corner[1]];
    canvas.line(end(-reach), end(reach), 1.4, KINDS[kind].1, 1.0);
}
