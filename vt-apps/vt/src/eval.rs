//! The command `vt eval`: pose files against truth.

use core::fmt::Write;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use clap::Args;
use rayon::prelude::*;
use serde_json::{Value, json};
use vt_core::belief::Gaussian;
use vt_core::error::{ConfigError, DeviceError};
use vt_core::lie::SE3;
use vt_core::math;
use vt_core::metrics::{PoseError, add, add_s, area_under_errors, share_below};
use vt_core::nalgebra::Point3;
use vt_io::plot;
use vt_io::summary::Statistics;
use vt_io::truth::{Truth, read_covariances, read_estimates};
use vt_task::standard::shape::{FileUnit, vertices};

/// Largest threshold of the area under the curve of ADD in metres, as is usual since PoseCNN (Y. Xiang et al., 2018).
const AUC_LIMIT: f64 = 0.1;

/// Most points for ADD-S, which compares all pairs; of larger models every n-th vertex is taken.
const SYMMETRIC_POINTS: usize = 4000;

/// Arguments of `vt eval`.
#[derive(Args)]
pub struct EvalArgs {
    /// Estimates: a TUM file (frame tx ty tz qx qy qz qw) or a folder of 4x4 matrices. NaN is a failed frame.
    estimates: PathBuf,
    /// True poses in one of the same forms.
    #[arg(long, value_name = "FILE")]
    truth: PathBuf,
    /// Covariances of the estimates: frame and 21 values a line, as the output `covariances` writes them.
    #[arg(long, value_name = "FILE")]
    cov: Option<PathBuf>,
    /// Model for the distances ADD and ADD-S.
    #[arg(long, value_name = "FILE", requires = "unit")]
    model: Option<PathBuf>,
    /// Length unit of the model file.
    #[arg(long, value_name = "UNIT", requires = "model", value_parser = ["m", "cm", "mm", "in"])]
    unit: Option<String>,
    /// Plots the errors over the frames, as PNG or SVG by the name's ending.
    #[arg(long, value_name = "FILE", value_parser = plot_file)]
    plot: Option<PathBuf>,
    /// Prints one JSON object.
    #[arg(long)]
    json: bool,
}

/// Why poses cannot be scored.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EvalError {
    /// A file cannot be read, or is not what it should be.
    #[error(transparent)]
    Input(#[from] DeviceError),
    /// The plot cannot be written.
    #[error("--plot: {0}")]
    Output(DeviceError),
    /// The model cannot be read.
    #[error("--model: {0}")]
    Model(#[from] ConfigError),
    /// A file without poses.
    #[error("{}: no poses", .0.display())]
    Empty(PathBuf),
    /// Nothing can be compared.
    #[error(
        "{} has the frames {} to {} and {} has {} to {}: none in common",
        estimates.display(), found[0], found[1], truth.display(), expected[0], expected[1]
    )]
    NoCommonFrame {
        /// File of the estimates.
        estimates: PathBuf,
        /// Their first and last frame.
        found: [u64; 2],
        /// File of the truth.
        truth: PathBuf,
        /// Its first and last frame.
        expected: [u64; 2],
    },
    /// A covariance that is none.
    #[error("{}: line {line}: the covariance of frame {frame} is not positive definite", file.display())]
    Covariance {
        /// The file.
        file: PathBuf,
        /// The line, from 1.
        line: usize,
        /// Number of the frame.
        frame: u64,
    },
    /// Covariances of other frames.
    #[error("{}: no covariance belongs to a frame with estimate and truth", .0.display())]
    NoCovariance(PathBuf),
}

impl EvalArgs {
    /// Scores, and prints the scores.
    ///
    /// # Errors
    /// [`EvalError`].
    pub fn start(&self) -> Result<(), EvalError> {
        let scores = self.scores()?;
        if let Some(path) = &self.plot {
            plot::errors(&scores.title(), &scores.errors).save(path).map_err(EvalError::Output)?;
        }
        if self.json {
            println!("{}", scores.json());
        } else {
            print!("{}", scores.text());
        }
        Ok(())
    }

    /// Reads all files and compares them.
    ///
    /// # Errors
    /// [`EvalError`].
    pub fn scores(&self) -> Result<Scores, EvalError> {
        let truth = if self.truth.is_dir() {
            Truth::read_matrices(&self.truth)?.poses
        } else {
            Truth::read_tum(&self.truth)?.poses
        };
        let estimates = read_estimates(&self.estimates)?;
        let (found, expected) = (span(&self.estimates, &estimates)?, span(&self.truth, &truth)?);
        if !estimates.keys().any(|frame| truth.contains_key(frame)) {
            let (estimates, truth) = (self.estimates.clone(), self.truth.clone());
            return Err(EvalError::NoCommonFrame { estimates, found, truth, expected });
        }
        let name = self.estimates.file_name().unwrap_or(self.estimates.as_os_str());
        let estimates: BTreeMap<u64, SE3> =
            estimates.into_iter().filter_map(|(frame, pose)| Some((frame, pose?))).collect();
        let pairs: Vec<(u64, SE3, SE3)> =
            truth.iter().filter_map(|(k, t)| Some((*k, *estimates.get(k)?, *t))).collect();
        let mut scores = Scores {
            name: name.to_string_lossy().into_owned(),
            frames: truth.len(),
            errors: truth.iter().map(|(k, t)| (*k, estimates.get(k).map(|e| PoseError::new(e, t)))).collect(),
            nees: None,
            distances: None,
        };
        if let Some(file) = &self.cov {
            scores.nees = Some(nees(file, &estimates, &truth)?);
        }
        if let (Some(file), Some(unit)) = (&self.model, self.unit.as_deref().and_then(FileUnit::named)) {
            scores.distances = Some(Distances::new(&vertices(file, unit)?, &pairs));
        }
        Ok(scores)
    }
}

/// A name with the ending of a kind of plot.
fn plot_file(name: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(name);
    let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    match ending.as_deref() {
        Some("png" | "svg") => Ok(path),
        _ => Err("expected a name that ends in .png or .svg".into()),
    }
}

/// First and last frame.
fn span<T>(file: &Path, poses: &BTreeMap<u64, T>) -> Result<[u64; 2], EvalError> {
    match (poses.keys().next(), poses.keys().next_back()) {
        (Some(first), Some(last)) => Ok([*first, *last]),
        _ => Err(EvalError::Empty(file.to_owned())),
    }
}

fn nees(
    file: &Path,
    estimates: &BTreeMap<u64, SE3>,
    truth: &BTreeMap<u64, SE3>,
) -> Result<Vec<f64>, EvalError> {
    let mut out = vec![];
    for (line, frame, covariance) in read_covariances(file)? {
        let (Some(mean), Some(truth)) = (estimates.get(&frame), truth.get(&frame)) else { continue };
        let value = Gaussian { mean: *mean, covariance }.nees(truth);
        out.push(value.ok_or_else(|| EvalError::Covariance { file: file.to_owned(), line, frame })?);
    }
    if out.is_empty() { Err(EvalError::NoCovariance(file.to_owned())) } else { Ok(out) }
}

/// Distances of model points, metres, for each estimated frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Distances {
    /// Mean distance of a point from itself.
    pub add: Vec<f64>,
    /// Mean distance of a point from the nearest one.
    pub add_s: Vec<f64>,
}

impl Distances {
    fn new(points: &[Point3<f64>], pairs: &[(u64, SE3, SE3)]) -> Self {
        let stride = points.len().div_ceil(SYMMETRIC_POINTS).max(1);
        let few: Vec<_> = points.iter().step_by(stride).copied().collect();
        let both = pairs.par_iter().filter_map(|(_, e, t)| add(e, t, points).zip(add_s(e, t, &few)));
        let (add, add_s) = both.unzip();
        Self { add, add_s }
    }
}

/// How good estimates are.
#[derive(Clone, Debug, PartialEq)]
pub struct Scores {
    /// Name of the file of estimates.
    pub name: String,
    /// Frames with truth.
    pub frames: usize,
    /// The error of each of them, `None` without an estimate.
    pub errors: Vec<(u64, Option<PoseError>)>,
    /// Squared errors against covariances, six degrees of freedom each.
    pub nees: Option<Vec<f64>>,
    /// Distances of model points.
    pub distances: Option<Distances>,
}

/// Rounded to four places, as the scores of pose files usually are.
fn rounded(v: f64) -> Value {
    // A decimal text is a number.
    json!(format!("{v:.4}").parse::<f64>().unwrap_or(v))
}

fn figures(s: &Statistics) -> Value {
    json!({ "mean": rounded(s.mean), "median": rounded(s.median), "p95": rounded(s.p95), "max": rounded(s.max) })
}

impl Scores {
    fn of(&self, value: fn(&PoseError) -> f64) -> Option<Statistics> {
        Statistics::of(&self.errors.iter().filter_map(|(_, e)| e.as_ref().map(value)).collect::<Vec<_>>())
    }

    fn translation(&self) -> Option<Statistics> {
        self.of(|e| 1e3 * e.translation)
    }

    fn rotation(&self) -> Option<Statistics> {
        self.of(|e| e.rotation.to_degrees())
    }

    /// Frames with an estimate.
    pub fn estimated(&self) -> usize {
        self.errors.iter().filter(|(_, e)| e.is_some()).count()
    }

    /// Share of all frames with truth whose error is below both limits, centimetres and degrees.
    pub fn success(&self, centimetres: f64, degrees: f64) -> f64 {
        let (t, r) = (1e-2 * centimetres, degrees.to_radians());
        let good = self.errors.iter().filter(|(_, e)| e.is_some_and(|e| e.within(t, r))).count();
        good as f64 / (self.frames as f64).max(1.0)
    }

    /// Share of the values of NEES below the bound of the 95 % ellipsoid.
    fn coverage(nees: &[f64]) -> f64 {
        share_below(nees, math::chi_square_quantile(0.95, 6.0)).unwrap_or(0.0)
    }

    /// Area under the curve of success over the threshold, frames without estimate counted as failed.
    fn auc(&self, distances: &[f64]) -> f64 {
        let all: Vec<f64> =
            distances.iter().copied().chain(core::iter::repeat(f64::INFINITY)).take(self.frames).collect();
        area_under_errors(&all, AUC_LIMIT).unwrap_or(0.0)
    }

    fn title(&self) -> String {
        let share = 100.0 * self.success(5.0, 5.0);
        format!(
            "{}: {} of {} frames, {share:.1} % within 5 cm 5 deg",
            self.name,
            self.estimated(),
            self.frames
        )
    }

    /// One JSON object; lengths in millimetres, angles in degrees, shares from 0 to 1.
    pub fn json(&self) -> Value {
        let mut out = json!({
            "estimate": self.name, "frames": self.frames, "estimated": self.estimated(),
            "t_mm": self.translation().as_ref().map(figures), "r_deg": self.rotation().as_ref().map(figures),
            "success_5cm_5deg": rounded(self.success(5.0, 5.0)),
            "success_2cm_2deg": rounded(self.success(2.0, 2.0)),
        });
        if let Some((nees, s)) = self.nees.as_ref().and_then(|n| Some((n, Statistics::of(n)?))) {
            out["nees"] = figures(&s);
            out["nees"]["frames"] = json!(nees.len());
            out["nees"]["expected_mean"] = json!(6);
            out["nees"]["per_dof"] = rounded(s.mean / 6.0);
            out["nees"]["below_95_bound"] = rounded(Self::coverage(nees));
        }
        if let Some(d) = &self.distances {
            for (name, values) in [("add", &d.add), ("add_s", &d.add_s)] {
                let mm: Vec<f64> = values.iter().map(|v| 1e3 * v).collect();
                out[format!("{name}_mm")] = json!(Statistics::of(&mm).as_ref().map(figures));
                out[format!("{name}_auc_10cm")] = rounded(self.auc(values));
            }
        }
        out
    }

    /// Lines for people.
    pub fn text(&self) -> String {
        let mut out = format!("{}: {} of {} frames estimated\n", self.name, self.estimated(), self.frames);
        let mut line = |name: &str, s: Option<Statistics>, rest: &str| {
            let Some(s) = s else { return };
            let Statistics { mean, median, p95, max } = s;
            let _ = write!(out, "{name:<16} mean {mean:>9.4}  median {median:>9.4}  95 % {p95:>9.4}");
            let _ = writeln!(out, "  max {max:>9.4}{rest}");
        };
        line("translation mm", self.translation(), "");
        line("rotation deg", self.rotation(), "");
        if let Some((n, s)) = self.nees.as_ref().and_then(|n| Some((n, Statistics::of(n)?))) {
            let rest = format!(
                "  (6 expected; {:.4} a degree of freedom; {:.4} within the 95 % ellipsoid)",
                s.mean / 6.0,
                Self::coverage(n)
            );
            line("NEES", Some(s), &rest);
        }
        if let Some(d) = &self.distances {
            for (name, values) in [("ADD mm", &d.add), ("ADD-S mm", &d.add_s)] {
                let mm: Vec<f64> = values.iter().map(|v| 1e3 * v).collect();
                line(name, Statistics::of(&mm), &format!("  AUC to 10 cm {:.4}", self.auc(values)));
            }
        }
        for limit in [5.0, 2.0] {
            let _ = writeln!(out, "success {limit} cm {limit} deg   {:.4}", self.success(limit, limit));
        }
        out
    }
}
