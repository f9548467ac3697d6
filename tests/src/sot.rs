//! Sequences with a box a frame as truth, followed by the task of `color-particle` for own pictures.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use cpu_time::ThreadTime;
use nalgebra::{Matrix3, Point2};
use vt_core::frame::Frame;
use vt_core::lie::picture_from_plane;
use vt_core::metrics::{Rectangle, success_auc};
use vt_core::report::Status;
use vt_fusion::loss::LossSigns;
use vt_task::assembly::Scene;
use vt_task::{Document, Registry, check};

/// The task, without pictures and box.
pub const TASK: &str = include_str!("../../vt-apps/examples/src/own-color.toml");

/// Decoded pictures and the true box of each, where there is one.
pub struct Sequence {
    /// Its folder's name.
    pub name: String,
    /// Folder of the pictures.
    pub pictures: PathBuf,
    frames: Vec<Frame>,
    truth: Vec<Option<Rectangle>>,
}

/// What one run gave.
pub struct Run {
    /// Success area of the frames that have a truth.
    pub auc: f64,
    /// CPU time of the thread from decoded pixels to the posterior, milliseconds a step; median and mean.
    pub ms: [f64; 2],
    /// Boxes of all frames.
    pub boxes: Vec<Rectangle>,
    /// Conditions of all frames.
    pub statuses: Vec<Status>,
    /// Overlap with the truth and signs of loss, of the frames that have both.
    pub signs: Vec<(f64, LossSigns)>,
    /// How often it was placed again.
    pub reinitialized: usize,
}

/// The upright box of four values, or that around four corners of eight; `None` for other numbers or no area.
fn parse(line: &str) -> Option<Rectangle> {
    let separator = |c: char| c == ',' || c.is_whitespace();
    let v: Vec<f64> = line.split(separator).filter(|t| !t.is_empty()).map_while(|t| t.parse().ok()).collect();
    let b = match v[..] {
        [x, y, width, height] => Rectangle { x, y, width, height },
        [x0, y0, x1, y1, x2, y2, x3, y3] => {
            around(&[[x0, y0], [x1, y1], [x2, y2], [x3, y3]].map(Point2::from))
        }
        _ => return None,
    };
    (b.width > 0.0 && b.height > 0.0).then_some(b)
}

/// The upright box around points.
fn around(points: &[Point2<f64>; 4]) -> Rectangle {
    let (low, high) = points[1..].iter().fold((points[0], points[0]), |(a, b), p| (a.inf(p), b.sup(p)));
    Rectangle { x: low.x, y: low.y, width: high.x - low.x, height: high.y - low.y }
}

impl Sequence {
    /// Reads `groundtruth.txt` and the pictures of a folder, in it or in `img`.
    ///
    /// # Errors
    /// When a file cannot be read or the first frame has no box.
    pub fn load(folder: &Path) -> Result<Self> {
        let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let text = std::fs::read_to_string(folder.join("groundtruth.txt")).with_context(|| name.clone())?;
        let truth = text.lines().filter(|l| !l.trim().is_empty()).map(parse).collect();
        let inner = folder.join("img");
        let pictures = if inner.is_dir() { inner } else { folder.to_owned() };
        let mut sequence = Self { name, pictures, frames: vec![], truth };
        let (document, registry) = (sequence.document(&[])?, Registry::standard());
        let mut scene = Scene::build(&document, &check(&document, &registry)?, &registry)?;
        let sensor = scene.sensors.first_mut().context("no sensor")?;
        while let Some(frame) = sensor.next()? {
            sequence.frames.push(frame);
            if sequence.frames.len() == sequence.truth.len() {
                break;
            }
        }
        Ok(sequence)
    }

    /// The task with the first true box and settings.
    fn document(&self, set: &[String]) -> Result<Document> {
        let b = self.truth.first().copied().flatten().context("the first frame has no box")?;
        let mut all = vec![
            format!("sensors.camera.params.folder='{}'", self.pictures.display()),
            format!("models.object.shape.params.size=['{} px', '{} px']", b.width, b.height),
            format!(
                "targets.object.init.params.box=['{} px', '{} px', '{} px', '{} px']",
                b.x, b.y, b.width, b.height
            ),
        ];
        all.extend_from_slice(set);
        Ok(Document::parse("own-color.toml", TASK, Path::new(""), &all, &|_| None)?)
    }

    /// Follows the box of the first frame under these settings of the task.
    ///
    /// # Errors
    /// When the settings are wrong or a step fails.
    pub fn track(&self, set: &[String], seed: u64) -> Result<Run> {
        let mut set = set.to_vec();
        set.push(format!("seed={seed}"));
        let (document, registry) = (self.document(&set)?, Registry::standard());
        let task = check(&document, &registry)?;
        let scene = Scene::build(&document, &task, &registry)?;
        let mut tracking = scene.tracking(&document, &task, &registry, &self.frames[..1])?;
        let b = self.truth[0].context("the first frame has no box")?;
        let (x, y) = (0.5 * b.width, 0.5 * b.height);
        let corners = [[-x, -y], [x, -y], [x, y], [-x, y]].map(Point2::from);
        let (mut boxes, mut statuses, mut times, mut reinitialized) = (vec![], vec![], vec![], 0);
        let mut signs = vec![];
        for frame in &self.frames {
            let frame = frame.clone();
            let begin = ThreadTime::now();
            let report = &tracking.step([frame])?[0];
            times.push(1e3 * begin.elapsed().as_secs_f64());
            ensure!(report.failure.is_none(), "{}: {:?}", self.name, report.failure);
            let matrix = picture_from_plane(&report.posterior).context("no pose of the plane")?;
            let estimate = bounds(&matrix, &corners);
            let overlap = self.truth.get(boxes.len()).copied().flatten().map(|t| t.iou(&estimate));
            signs.extend(overlap.zip(LossSigns::new(&report.assessment)));
            boxes.push(estimate);
            statuses.push(report.verdict.status);
            reinitialized += usize::from(report.reinitialized);
        }
        let overlaps: Vec<f64> =
            self.truth.iter().zip(&boxes).filter_map(|(t, b)| Some(t.as_ref()?.iou(b))).collect();
        let auc = success_auc(&overlaps).context("no truth")?;
        let ms = [crate::replay::median(&times), times.iter().sum::<f64>() / times.len() as f64];
        Ok(Run { auc, ms, boxes, statuses, signs, reinitialized })
    }
}

/// The upright box around the image of the corners, as files have it: pixels have their centre at whole coordinates, their
/// borders half a pixel off.
fn bounds(matrix: &Matrix3<f64>, corners: &[Point2<f64>; 4]) -> Rectangle {
    let image = corners.map(|c| matrix * c.to_homogeneous()).map(|h| Point2::new(h.x / h.z, h.y / h.z));
    let b = around(&image);
    Rectangle { x: b.x + 0.5, y: b.y + 0.5, ..b }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_are_four_numbers_or_four_corners() {
        let expected = Rectangle { x: 1.0, y: 2.0, width: 3.0, height: 4.0 };
        for line in ["1,2,3,4", "1\t2 3  4", "1,2,4,2,4,6,1,6", "2.5 2 4 4 2.5 6 1 4"] {
            assert_eq!(parse(line), Some(expected), "{line}");
        }
        for line in ["1,2,3", "nan", "1,2,0,4", "1,2,nan,4"] {
            assert_eq!(parse(line), None, "{line}");
        }
    }
}
