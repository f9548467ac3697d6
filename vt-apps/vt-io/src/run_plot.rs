//! A run at a glance: errors or residuals, uncertainty, loss and time over the steps.

use core::ops::ControlFlow;
use std::path::{Path, PathBuf};

use nalgebra::Matrix3;
use vt_core::agent::{Output, Step};
use vt_core::error::DeviceError;
use vt_core::lie::image_of_plane_point;
use vt_core::metrics::PoseError;
use vt_core::report::{Status, StepReport};

use crate::boxes::{Bounds, around, seen};
use crate::files::{forget, of_target};
use crate::plot::{Band, CURVES, Curve, Figure, Panel, Rgb, Span};
use crate::summary::pose;
use crate::truth::Truth;

/// Samples kept of a run; of longer ones neighbours are joined, so that memory is bounded.
const MOST: usize = 4096;

/// Colour of a condition.
pub(crate) fn status_colour(status: Status) -> Rgb {
    match status {
        Status::Tracking => [60, 190, 80],
        Status::Doubtful => [250, 190, 30],
        Status::Lost => [230, 40, 40],
    }
}

/// Names of the curves of a sample, with the figure that they show.
const FIGURES: usize = 13;
const ERROR_MM: usize = 0;
const ERROR_DEG: usize = 1;
const SIGMA_MM: usize = 2;
const SIGMA_DEG: usize = 3;
const RESIDUAL: usize = 4;
const MISSING: usize = 5;
const LOG_DET: usize = 6;
const LOSS: usize = 7;
const MEASURE_MS: usize = 8;
const TOTAL_MS: usize = 9;
const ERROR_PX: usize = 10;
const SIGMA_PX: usize = 11;
const OVERLAP: usize = 12;

/// The worst of one or several neighbouring steps; NaN where there is nothing.
#[derive(Clone, Copy, Debug)]
struct Sample {
    step: u64,
    figures: [f64; FIGURES],
    status: Status,
}

impl Sample {
    fn new(step: u64, report: &StepReport, truth: Option<&Truth>, bounds: &Bounds) -> Self {
        let quality = report.assessment.quality;
        let t = &report.timings;
        let total = t.predict + t.measure + t.correct + t.assess + t.reinitialize;
        let true_pose = truth.and_then(|t| t.poses.get(&report.frame));
        let error = pose(report).zip(true_pose).map(|(p, t)| PoseError::new(&p, t));
        let true_corners = truth.and_then(|t| t.corners.get(&report.frame));
        let boxes = seen(report, bounds).zip(true_corners).map(|(found, t)| [around(&found), around(t)]);
        let [position, rotation] = deviations(report);
        let mut figures = [f64::NAN; FIGURES];
        figures[ERROR_MM] = error.map_or(f64::NAN, |e| 1e3 * e.translation);
        figures[ERROR_DEG] = error.map_or(f64::NAN, |e| e.rotation.to_degrees());
        figures[SIGMA_MM] = 3e3 * position;
        figures[SIGMA_DEG] = 3.0 * rotation.to_degrees();
        figures[RESIDUAL] = quality.map_or(f64::NAN, |q| q.normalized_rms);
        figures[MISSING] = quality.map_or(f64::NAN, |q| 1.0 - q.inlier_ratio);
        figures[LOG_DET] = report.assessment.log_det.unwrap_or(f64::NAN);
        figures[LOSS] = report.verdict.loss_probability;
        figures[MEASURE_MS] = 1e-6 * t.measure as f64;
        figures[TOTAL_MS] = 1e-6 * total as f64;
        figures[ERROR_PX] = boxes.map_or(f64::NAN, |[found, t]| t.centre_error(&found));
        figures[SIGMA_PX] = 3.0 * centre_deviation(report, bounds);
        figures[OVERLAP] = boxes.map_or(f64::NAN, |[found, t]| t.iou(&found));
        Self { step, figures, status: report.verdict.status }
    }

    /// The worse of both in everything. `f64::max` and `f64::min` ignore NaN.
    fn join(&mut self, other: &Self) {
        for (k, (a, b)) in self.figures.iter_mut().zip(other.figures).enumerate() {
            *a = if k == OVERLAP { a.min(b) } else { a.max(b) };
        }
        if other.status as usize > self.status as usize {
            self.status = other.status;
        }
    }
}

/// Largest deviation of the position in metres and of the orientation in radians, over all directions; NaN where the
/// pose is not rigid.
fn deviations(report: &StepReport) -> [f64; 2] {
    let p = &report.posterior;
    [0, 3].map(|from| {
        if pose(report).is_none() || p.covariance.len() != 36 {
            return f64::NAN;
        }
        let block = Matrix3::from_fn(|r, c| p.covariance[6 * (from + r) + from + c]);
        if block.iter().all(|v| v.is_finite()) {
            block.symmetric_eigenvalues().max().max(0.0).sqrt()
        } else {
            f64::NAN
        }
    })
}

/// Largest deviation of the image of the middle of a flat shape in pixels, over all directions; NaN for bodies in space.
fn centre_deviation(report: &StepReport, bounds: &Bounds) -> f64 {
    let covariance = bounds.and_then(|[first, _, third, _]| {
        let middle = nalgebra::center(&first, &third);
        Some(image_of_plane_point(&report.posterior, &middle)?.1)
    });
    let finite = covariance.filter(|c| c.iter().all(|v| v.is_finite()));
    finite.map_or(f64::NAN, |c| c.symmetric_eigenvalues().max().max(0.0).sqrt())
}

/// A target that is plotted.
#[derive(Clone, Debug)]
pub struct Plotted {
    /// Name.
    pub name: String,
    /// What is true of it, where that is known.
    pub truth: Option<Truth>,
    /// Corners of a flat model's bounds.
    pub bounds: Bounds,
}

/// Samples of one target.
#[derive(Debug)]
struct Track {
    target: Plotted,
    samples: Vec<Sample>,
}

/// Writes `plot.png` and `plot.svg` at the end of a run, also of an interrupted one; with several targets one pair each.
/// Times differ from run to run, and with them the last panel.
pub struct RunPlot {
    files: Vec<PathBuf>,
    tracks: Vec<Track>,
    index: u64,
    /// Steps a sample.
    stride: u64,
}

impl RunPlot {
    /// Plots in `folder` of these targets, with errors where their truth is known.
    ///
    /// # Errors
    /// [`DeviceError`] when an old plot cannot be removed: it would be mistaken for that of this run.
    pub fn create(folder: &Path, targets: Vec<Plotted>) -> Result<Self, DeviceError> {
        let names: Vec<String> = targets.iter().map(|t| t.name.clone()).collect();
        let files: Vec<PathBuf> =
            (0..names.len()).map(|k| of_target(folder, "plot", "png", &names, k)).collect();
        files.iter().flat_map(|f| [f.clone(), f.with_extension("svg")]).try_for_each(|path| forget(&path))?;
        let tracks = targets.into_iter().map(|target| Track { target, samples: vec![] });
        Ok(Self { files, tracks: tracks.collect(), index: 0, stride: 1 })
    }
}

impl Output for RunPlot {
    fn step(&mut self, step: &Step<'_>) -> Result<ControlFlow<()>, DeviceError> {
        let fresh = self.index.is_multiple_of(self.stride);
        for (track, report) in self.tracks.iter_mut().zip(step.reports) {
            let Plotted { truth, bounds, .. } = &track.target;
            let sample = Sample::new(self.index, report, truth.as_ref(), bounds);
            match track.samples.last_mut() {
                Some(last) if !fresh => last.join(&sample),
                _ => track.samples.push(sample),
            }
        }
        self.index += 1;
        if self.tracks.iter().any(|t| t.samples.len() > MOST) {
            self.tracks.iter_mut().for_each(Track::halve);
            self.stride *= 2;
        }
        Ok(ControlFlow::Continue(()))
    }

    fn finish(&mut self) -> Result<(), DeviceError> {
        for (path, track) in self.files.iter().zip(&self.tracks) {
            let figure = track.figure(self.stride);
            figure.save(path)?;
            figure.save(&path.with_extension("svg"))?;
        }
        Ok(())
    }
}

impl Track {
    fn halve(&mut self) {
        let joined = self.samples.chunks(2).filter_map(|pair| {
            let mut first = *pair.first()?;
            pair.iter().skip(1).for_each(|s| first.join(s));
            Some(first)
        });
        self.samples = joined.collect();
    }

    fn curve(&self, figure: usize, name: &str, colour: Rgb) -> Curve {
        let points = self.samples.iter().map(|s| [s.step as f64, s.figures[figure]]).collect();
        Curve { name: name.into(), colour, points }
    }

    fn band(&self, figure: usize) -> Band {
        let points = self.samples.iter().map(|s| [s.step as f64, 0.0, s.figures[figure]]).collect();
        Band { name: "3 sigma".into(), colour: [120, 120, 120], points }
    }

    /// Backgrounds of the runs of equal condition.
    fn spans(&self, stride: u64) -> Vec<Span> {
        let equal = self.samples.chunk_by(|a, b| a.status == b.status);
        let span = |run: &[Sample]| {
            let (first, last) = (run.first()?, run.last()?);
            let places = [first.step as f64 - 0.5, (last.step + stride) as f64 - 0.5];
            Some(Span { places, colour: status_colour(first.status) })
        };
        equal.filter_map(span).collect()
    }

    fn figure(&self, stride: u64) -> Figure {
        let panel = |title: &str, bands: Vec<Band>, curves: Vec<Curve>| Panel {
            title: title.into(),
            spans: vec![],
            bands,
            curves,
        };
        let known = |figure: usize| self.samples.iter().any(|s| !s.figures[figure].is_nan());
        let accuracy = |of: &str, sigma: usize, error: usize| {
            let (title, curves) = if known(error) {
                (format!("error and deviation of the {of}"), vec![self.curve(error, "error", CURVES[1])])
            } else {
                (format!("deviation of the {of}"), vec![])
            };
            panel(&title, vec![self.band(sigma)], curves)
        };
        let mut panels = if self.target.bounds.is_some() {
            vec![accuracy("centre, px", SIGMA_PX, ERROR_PX)]
        } else {
            vec![
                accuracy("position, mm", SIGMA_MM, ERROR_MM),
                accuracy("rotation, deg", SIGMA_DEG, ERROR_DEG),
            ]
        };
        if known(OVERLAP) {
            let overlap = vec![self.curve(OVERLAP, "", CURVES[1])];
            panels.push(panel("overlap of the box with the true one", vec![], overlap));
        }
        if !known(ERROR_MM) && !known(ERROR_PX) {
            let curves = vec![
                self.curve(RESIDUAL, "rms of the residuals (1: as claimed)", CURVES[0]),
                self.curve(MISSING, "share without support", CURVES[1]),
            ];
            panels.push(panel("residuals", vec![], curves));
        }
        let log_det = vec![self.curve(LOG_DET, "", CURVES[0])];
        panels.push(panel(
            "ln det of the scaled covariance a degree of freedom (low: informed)",
            vec![],
            log_det,
        ));
        let mut loss = panel(
            "loss probability; green tracking, yellow doubtful, red lost",
            vec![],
            vec![self.curve(LOSS, "", [30, 30, 30])],
        );
        loss.spans = self.spans(stride);
        panels.push(loss);
        let times =
            vec![self.curve(TOTAL_MS, "all", CURVES[0]), self.curve(MEASURE_MS, "measurement", CURVES[1])];
        panels.push(panel("time of the target, ms", vec![], times));
        Figure {
            title: format!("{} over {} steps", self.target.name, self.samples.len() as u64 * stride),
            panels,
        }
    }
}
