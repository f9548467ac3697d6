//! Pictures with the model, the measurements and the uncertainty drawn in.

use core::ops::ControlFlow;
use std::path::{Path, PathBuf};

use image::RgbImage;
use nalgebra::{Matrix2, Matrix2x3, Matrix3, Point2, Point3, Vector3};
use vt_core::agent::{Output, Step};
use vt_core::error::DeviceError;
use vt_core::frame::{Payload, SensorId};
use vt_core::lie::{SE3, image_of_plane_point};
use vt_core::report::{Status, StepReport};
use vt_core::sketch::{Mark, Role};

use crate::canvas::Canvas;
use crate::files::{forget, save_png};
use crate::sheet::Sheet;
use crate::summary::pose;

/// The image point of a point in the camera frame, `None` behind the camera.
pub type Projector = Box<dyn Fn(&Point3<f64>) -> Option<Point2<f64>> + Send>;

/// 95 % of a Gaussian of two dimensions lie within this squared Mahalanobis distance.
const CHI2_95_OF_2: f64 = 5.991_464_547_107_98;

/// Colour, name and order of drawing of the roles.
const ROLES: [(Role, [u8; 3], &str); 7] = [
    (Role::Search, [90, 140, 220], "search"),
    (Role::Particle, [255, 160, 220], "particle"),
    (Role::Missing, [150, 150, 150], "missing"),
    (Role::Outlier, [255, 60, 50], "outlier"),
    (Role::Inlier, [70, 235, 90], "inlier"),
    (Role::Model, [255, 215, 40], "model"),
    (Role::Uncertainty, [60, 225, 255], "95 % of origin"),
];

/// What is drawn and written.
pub struct Settings {
    /// Every how many steps a picture is written; 0 writes none.
    pub every: u64,
    /// Whether search lines and missing observations are drawn.
    pub search: bool,
    /// Whether a contact sheet of at most 25 pictures is written at the end.
    pub sheet: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Self { every: 1, search: true, sheet: true }
    }
}

/// Writes `overlays/step_00012_frame_0013.png` and `contact_sheet.png`.
pub struct Overlays {
    folder: PathBuf,
    drawing: Drawing,
    settings: Settings,
    sheet: Sheet,
    index: u64,
    encoded: Vec<u8>,
}

/// Draws steps on the pictures of one sensor.
pub struct Drawing {
    sensor: SensorId,
    project: Option<Projector>,
    search: bool,
    marks: Vec<Mark>,
}

impl Drawing {
    /// On the pictures of this sensor. The uncertainty of the model's origin is drawn, for bodies in space with `project`
    /// alone; with `search` also search lines and missing observations.
    pub fn new(sensor: SensorId, project: Option<Projector>, search: bool) -> Self {
        Self { sensor, project, search, marks: vec![] }
    }

    /// The picture of a step with everything drawn in; `None` when the sensor has no picture in this step.
    pub fn draw(&mut self, step: &Step<'_>) -> Option<RgbImage> {
        let frame = step.evidence.frames().iter().find(|f| f.sensor == self.sensor)?;
        let mut canvas = match &frame.payload {
            Payload::Grey(picture) => Canvas::of_grey(picture),
            Payload::Rgb(picture) => Canvas::of_rgb(picture),
            _ => return None,
        };
        self.marks.clear();
        for (k, report) in step.reports.iter().enumerate() {
            (step.sketch)(k, &mut self.marks);
            self.marks.extend(origin(report, self.project.as_ref()));
        }
        for (role, colour, _) in ROLES {
            if self.search || !matches!(role, Role::Search | Role::Missing) {
                self.marks.iter().filter(|m| role_of(m) == role).for_each(|m| stroke(&mut canvas, m, colour));
            }
        }
        for (k, report) in step.reports.iter().enumerate() {
            headline(&mut canvas, k as i64, report);
        }
        legend(&mut canvas, &self.marks);
        Some(canvas.picture)
    }
}

impl Overlays {
    /// Pictures of one sensor in `folder`. The uncertainty of the model's origin is drawn, for bodies in space with `project` alone.
    ///
    /// # Errors
    /// [`DeviceError`] when an old contact sheet cannot be removed.
    pub fn create(
        folder: &Path,
        sensor: SensorId,
        project: Option<Projector>,
        settings: Settings,
    ) -> Result<Self, DeviceError> {
        forget(&folder.join("contact_sheet.png"))?;
        let drawing = Drawing::new(sensor, project, settings.search);
        let (folder, sheet) = (folder.to_owned(), Sheet::default());
        Ok(Self { folder, drawing, settings, sheet, index: 0, encoded: vec![] })
    }
}

impl Output for Overlays {
    fn step(&mut self, step: &Step<'_>) -> Result<ControlFlow<()>, DeviceError> {
        let write = self.settings.every != 0 && self.index.is_multiple_of(self.settings.every);
        let keep = self.settings.sheet && self.sheet.wants(self.index);
        if (write || keep)
            && let Some(picture) = self.drawing.draw(step)
        {
            if write {
                let number = step.reports.first().map_or(0, |r| r.frame);
                let name = format!("overlays/step_{:05}_frame_{number:04}.png", self.index);
                save_png(&self.folder.join(name), &picture, &mut self.encoded)?;
            }
            if keep {
                self.sheet.add(self.index, &picture);
            }
        }
        self.index += 1;
        Ok(ControlFlow::Continue(()))
    }

    fn finish(&mut self) -> Result<(), DeviceError> {
        match self.sheet.compose() {
            Some(picture) => save_png(&self.folder.join("contact_sheet.png"), &picture, &mut self.encoded),
            None => Ok(()),
        }
    }
}

fn role_of(mark: &Mark) -> Role {
    match mark {
        Mark::Segment { role, .. } | Mark::Point { role, .. } | Mark::Ellipse { role, .. } => *role,
    }
}

fn stroke(canvas: &mut Canvas, mark: &Mark, colour: [u8; 3]) {
    let (width, opacity) = match role_of(mark) {
        Role::Model => (1.4, 0.9),
        Role::Search | Role::Missing => (0.8, 0.45),
        Role::Particle => (0.8, 0.35),
        _ => (1.2, 0.9),
    };
    match *mark {
        Mark::Segment { from, to, .. } => canvas.line(from, to, width, colour, opacity),
        Mark::Point { at, .. } => canvas.disc(at, 1.3 * width, colour, opacity),
        Mark::Ellipse { center, shape, .. } => canvas.ellipse(center, shape, width, colour, opacity),
    }
}

fn headline(canvas: &mut Canvas, row: i64, report: &StepReport) {
    let colour = match report.verdict.status {
        Status::Tracking => [90, 240, 110],
        Status::Doubtful => [255, 200, 40],
        Status::Lost => [255, 80, 70],
    };
    let width = i64::from(canvas.picture.width());
    canvas.bar(0, 12 * row, width, 12, [0; 3], 0.65);
    let x = canvas.text(4, 12 * row + 2, &format!("{}  frame {}  ", report.target, report.frame), [235; 3]);
    let state =
        format!("{}{}", report.verdict.status.name(), if report.reinitialized { " (again)" } else { "" });
    let x = canvas.text(x, 12 * row + 2, &state, colour);
    let mut rest = format!("  loss {:.2}", report.verdict.loss_probability);
    if let Some(q) = report.assessment.quality {
        rest += &format!("  inliers {}/{}", q.inliers, q.expected);
    }
    canvas.text(x, 12 * row + 2, &rest, [235; 3]);
}

fn legend(canvas: &mut Canvas, marks: &[Mark]) {
    let (width, height) = canvas.picture.dimensions();
    let y = i64::from(height) - 12;
    canvas.bar(0, y, i64::from(width), 12, [0; 3], 0.65);
    let mut x = 4;
    for (role, colour, name) in ROLES.iter().filter(|(role, ..)| marks.iter().any(|m| role_of(m) == *role)) {
        let middle = y as f64 + 5.5;
        match role {
            Role::Model | Role::Search | Role::Uncertainty => {
                canvas.line([x as f64, middle], [x as f64 + 8.0, middle], 1.6, *colour, 1.0);
            }
            _ => canvas.disc([x as f64 + 4.0, middle], 2.2, *colour, 1.0),
        }
        x = canvas.text(x + 13, y + 2, name, [235; 3]) + 12;
    }
}

/// The ellipse of the image of the model's origin.
fn origin(report: &StepReport, project: Option<&Projector>) -> Option<Mark> {
    let (center, covariance) = match pose(report) {
        Some(pose) => projected(report, &pose, project?)?,
        None => image_of_plane_point(&report.posterior, &Point2::origin())?,
    };
    let s = covariance * CHI2_95_OF_2;
    let shape = [s[(0, 0)], s[(0, 1)], s[(1, 1)]];
    Some(Mark::Ellipse { center: [center.x, center.y], shape, role: Role::Uncertainty })
}

/// Image of a body's origin with its covariance. The origin moves by `R δt` under a pose error `δ`, so only the
/// translation block of the covariance counts.
fn projected(report: &StepReport, pose: &SE3, project: &Projector) -> Option<(Point2<f64>, Matrix2<f64>)> {
    let n = report.posterior.dim();
    let covariance = Matrix3::from_fn(|r, c| report.posterior.covariance[r * n + c]);
    let at = Point3::from(pose.translation);
    let step = 1e-4 * at.coords.norm();
    let mut jacobian = Matrix2x3::zeros();
    for k in 0..3 {
        let mut e = Vector3::zeros();
        e[k] = step;
        jacobian.set_column(k, &((project(&(at + e))? - project(&(at - e))?) / (2.0 * step)));
    }
    let j = jacobian * pose.rotation.to_rotation_matrix().matrix();
    Some((project(&at)?, j * covariance * j.transpose()))
}
