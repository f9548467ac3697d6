//! Judging a run frame by frame against truth, after the protocol of RBOT (H. Tjaden et al., "A Region-based
//! Gauss-Newton Approach to Real-Time Monocular Multiple Object Tracking", 2018): start at the true pose of the first
//! frame; optionally back to the true pose after every frame that fails. The truth is used for nothing else.

use core::str::FromStr;
use std::path::{Path, PathBuf};

use vt_core::error::DeviceError;
use vt_core::lie::SE3;
use vt_core::manifold::Coordinates;
use vt_core::metrics::PoseError;
use vt_core::report::{BeliefRecord, StepReport};
use vt_io::poses::PoseFile;
use vt_io::summary::{Statistics, pose};
use vt_io::truth::Truth;
use vt_task::quantity::{Angle, Length};

/// Errors from which on a frame has failed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Of the position.
    pub translation: Length,
    /// Of the orientation.
    pub rotation: Angle,
}

/// A text that gives no limits.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LimitsError {
    /// Not two quantities.
    #[error("expected a length and an angle with a comma between, as in 5cm,5deg")]
    Form,
    /// A number or a unit is wrong.
    #[error("found `{found}`; expected {expected}")]
    Quantity {
        /// What is written.
        found: String,
        /// What is allowed.
        expected: String,
    },
    /// Nothing can succeed.
    #[error("found `{0}`; expected a limit above zero")]
    NotPositive(String),
}

impl Limits {
    /// The limits that are usual: 5 cm and 5 degrees.
    pub fn usual() -> Self {
        // Finite numbers of known units always are quantities.
        let translation = Length::new(5.0, "cm").unwrap_or_default();
        Self { translation, rotation: Angle::new(5.0, "deg").unwrap_or_default() }
    }

    /// True when both errors are below their limits.
    pub fn hold(&self, error: &PoseError) -> bool {
        error.within(self.translation.si(), self.rotation.si())
    }
}

impl core::fmt::Display for Limits {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{} and {}", self.translation, self.rotation)
    }
}

impl FromStr for Limits {
    type Err = LimitsError;

    fn from_str(text: &str) -> Result<Self, LimitsError> {
        let (length, angle) = text.split_once(',').ok_or(LimitsError::Form)?;
        let wrong = |found: &str, wanted: vt_task::quantity::Wanted| LimitsError::Quantity {
            found: found.into(),
            expected: wanted.to_string(),
        };
        let limits = Self {
            translation: Length::parse(length).map_err(|w| wrong(length, w))?,
            rotation: Angle::parse(angle).map_err(|w| wrong(angle, w))?,
        };
        for (text, value) in [(length, limits.translation.si()), (angle, limits.rotation.si())] {
            if value <= 0.0 {
                return Err(LimitsError::NotPositive(text.into()));
            }
        }
        Ok(limits)
    }
}

/// How a run is judged.
#[derive(Clone, Debug)]
pub struct Protocol {
    /// Names of the targets that are judged; the task must say their truth.
    pub targets: Vec<String>,
    /// Errors from which on a frame has failed.
    pub limits: Limits,
    /// Whether a target is put to the true pose after a frame that failed.
    pub reset: bool,
    /// Folder of the estimates.
    pub folder: PathBuf,
    /// Name of the file of estimates without `.tum`; with several judged targets, their names follow.
    pub stem: String,
}

/// Why a run cannot be judged.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ProtocolError {
    /// A name that no target has.
    #[error("--truth: no target named `{name}`; known: {}", known.join(", "))]
    UnknownTarget {
        /// The name.
        name: String,
        /// Names of the targets.
        known: Vec<String>,
    },
    /// Several targets, and a truth without a name.
    #[error("--truth {found}: expected TARGET=FILE, since the task has the targets {}", known.join(", "))]
    WhichTarget {
        /// What is written.
        found: String,
        /// Names of the targets.
        known: Vec<String>,
    },
    /// Truth is given for the same target twice.
    #[error("--truth: second truth of the target `{name}`")]
    Twice {
        /// Name of the target.
        name: String,
    },
    /// A frame that must be judged has no true pose.
    #[error("target `{target}`: the truth has no frame {frame}; a run with resets needs every frame")]
    NoTruth {
        /// Name of the target.
        target: String,
        /// Number of the frame.
        frame: u64,
    },
    /// A pose of another kind.
    #[error("target `{target}` has a pose of the space `{space}`; expected `se3`")]
    Space {
        /// Name of the target.
        target: String,
        /// The space.
        space: &'static str,
    },
}

/// The settings of a task that give targets the truth of `--truth [TARGET=]FILE` arguments, with the names of these
/// targets. A folder is one of 4×4 matrices, a file one of TUM lines.
///
/// # Errors
/// [`ProtocolError`] when it is not clear which target is meant.
pub fn truths(names: &[String], arguments: &[String]) -> Result<Vec<(String, String)>, ProtocolError> {
    let mut out: Vec<(String, String)> = vec![];
    for argument in arguments {
        let named = argument.split_once('=').filter(|(n, _)| names.iter().any(|t| t == n));
        let (name, file) = match (named, names) {
            (Some((name, file)), _) => (name.to_owned(), file),
            (None, [only]) => (only.clone(), argument.as_str()),
            (None, _) => {
                let known = names.to_vec();
                return Err(match argument.split_once('=') {
                    Some((name, _)) => ProtocolError::UnknownTarget { name: name.into(), known },
                    None => ProtocolError::WhichTarget { found: argument.clone(), known },
                });
            }
        };
        if out.iter().any(|(n, _)| *n == name) {
            return Err(ProtocolError::Twice { name });
        }
        let setting = setting(&name, Path::new(file));
        out.push((name, setting));
    }
    Ok(out)
}

/// The `--set` argument that gives a target this truth. Paths of the command line start where the command does, not at
/// the task.
pub fn setting(target: &str, file: &Path) -> String {
    let kind = if file.is_dir() { "matrices" } else { "tum" };
    let path = std::path::absolute(file).unwrap_or_else(|_| file.to_owned());
    // A JSON text is a TOML text.
    let path = serde_json::Value::from(path.display().to_string().replace("${", "$${"));
    format!("targets.{target}.truth={{ kind = '{kind}', params = {{ path = {path} }} }}")
}

/// How well one target did.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Score {
    /// Name of the target.
    pub target: String,
    /// Frames that were judged: all that have a true pose but the first, which is given.
    pub frames: usize,
    /// Errors of the frames that succeeded, metres and radians.
    pub succeeded: Vec<PoseError>,
    /// Number of the first frame that failed.
    pub first_failure: Option<u64>,
    /// How often the target was put to the true pose.
    pub resets: usize,
}

impl Score {
    /// Succeeded frames in per cent of the judged ones; `None` without frames.
    pub fn success_percent(&self) -> Option<f64> {
        (self.frames > 0).then(|| 100.0 * self.succeeded.len() as f64 / self.frames as f64)
    }

    /// Median errors of the frames that succeeded, millimetres and degrees; `None` without any.
    pub fn medians(&self) -> Option<(f64, f64)> {
        let median = |value: fn(&PoseError) -> f64| {
            Statistics::of(&self.succeeded.iter().map(value).collect::<Vec<_>>()).map(|s| s.median)
        };
        Some((median(|e| 1e3 * e.translation)?, median(|e| e.rotation.to_degrees())?))
    }
}

/// Judges one target of a run.
pub(crate) struct Judge {
    /// Index of the target in the run.
    pub(crate) index: usize,
    pub(crate) score: Score,
    truth: Truth,
    limits: Limits,
    reset: bool,
    file: PoseFile,
    /// Uncertainty of the start, which is that of every reset; `None` before the first frame.
    covariance: Option<Vec<f64>>,
    last: Option<u64>,
}

impl Judge {
    /// A judge of number `k` of the protocol's targets, `index` in the run.
    pub(crate) fn new(
        protocol: &Protocol,
        k: usize,
        index: usize,
        truth: Truth,
    ) -> Result<Self, DeviceError> {
        let file = PoseFile::create(&protocol.folder, &protocol.stem, &protocol.targets, k)?;
        let score = Score { target: protocol.targets[k].clone(), ..Score::default() };
        let (limits, reset) = (protocol.limits, protocol.reset);
        Ok(Self { index, score, truth, limits, reset, file, covariance: None, last: None })
    }

    /// Takes in a step; gives the belief that the target is to be put to, if it is.
    pub(crate) fn see(&mut self, report: &StepReport) -> Result<Option<BeliefRecord>, super::run::RunError> {
        let target = || report.target.clone();
        let space = report.posterior.space;
        if space != SE3::SPACE {
            return Err(ProtocolError::Space { target: target(), space }.into());
        }
        // A step of another sensor shows the same frame again.
        if self.last.replace(report.frame) == Some(report.frame) {
            return Ok(None);
        }
        let truth = self.truth.poses.get(&report.frame);
        let Some(covariance) = &self.covariance else {
            self.covariance = Some(report.prediction.covariance.clone());
            let given = truth.map_or_else(|| report.prediction.coordinates.clone(), coordinates);
            self.file.write(report.frame, &given)?;
            return Ok(None);
        };
        self.file.write(report.frame, &report.posterior.coordinates)?;
        let Some(truth) = truth else {
            let missing = ProtocolError::NoTruth { target: target(), frame: report.frame };
            return if self.reset { Err(missing.into()) } else { Ok(None) };
        };
        self.score.frames += 1;
        let error = pose(report).map(|p| PoseError::new(&p, truth));
        if let Some(error) = error.filter(|e| self.limits.hold(e)) {
            self.score.succeeded.push(error);
            return Ok(None);
        }
        self.score.first_failure.get_or_insert(report.frame);
        if !self.reset {
            return Ok(None);
        }
        self.score.resets += 1;
        let covariance = covariance.clone();
        Ok(Some(BeliefRecord { space: SE3::SPACE, coordinates: coordinates(truth), covariance }))
    }
}

fn coordinates(pose: &SE3) -> Vec<f64> {
    let mut out = vec![];
    pose.write(&mut out);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_need_units() {
        let limits: Limits = "5cm,5deg".parse().unwrap();
        assert_eq!((limits.translation.si(), limits), (0.05, Limits::usual()));
        let limits: Limits = "20 mm, 0.1rad".parse().unwrap();
        assert_eq!((limits.translation.si(), limits.rotation.si()), (0.02, 0.1));
        for (text, word) in [
            ("5,5", "with a unit"),
            ("5cm", "a comma"),
            ("5deg,5cm", "a length"),
            ("5cm,5", "an angle"),
            ("0cm,5deg", "above zero"),
            ("5cm,-1deg", "above zero"),
            ("5cm,5deg,3s", "an angle"),
            ("nan cm,5deg", "a length"),
        ] {
            let error = text.parse::<Limits>().unwrap_err().to_string();
            assert!(error.contains(word), "{text}: {error}");
        }
    }

    #[test]
    fn truth_goes_to_the_target_that_is_meant() {
        let names = |n: &[&str]| n.iter().map(ToString::to_string).collect::<Vec<_>>();
        let one = truths(&names(&["cow"]), &names(&["a=b.tum"])).unwrap();
        assert_eq!(one[0].0, "cow");
        assert!(one[0].1.starts_with("targets.cow.truth={ kind = 'tum'") && one[0].1.contains("a=b.tum"));
        let two = truths(&names(&["a", "b"]), &names(&["b=x.tum", "a=y.tum"])).unwrap();
        assert_eq!((two[0].0.as_str(), two[1].0.as_str()), ("b", "a"));
        let fail = |args: &[&str]| truths(&names(&["a", "b"]), &names(args)).unwrap_err();
        assert!(matches!(fail(&["x.tum"]), ProtocolError::WhichTarget { .. }));
        assert!(matches!(fail(&["c=x.tum"]), ProtocolError::UnknownTarget { .. }));
        assert!(matches!(fail(&["a=x", "a=y"]), ProtocolError::Twice { .. }));
    }
}
