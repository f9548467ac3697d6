//! Covariances of pose estimates.

use core::fmt::Write;
use core::ops::ControlFlow;
use std::path::Path;

use vt_core::agent::{Output, Step};
use vt_core::error::DeviceError;
use vt_core::report::Status;

use crate::files::{Lines, of_target};

/// Writes `covariances.csv`: the frame's number and the upper triangle by rows (21 values for SE(3)) of the covariance
/// of the tangent error, translation before rotation, metres and radians. With several targets there is one file
/// each.
pub struct Covariances {
    files: Vec<Lines>,
    lost: bool,
}

impl Covariances {
    /// Files in `folder` for these targets. Lost targets are left out unless `lost` is true.
    ///
    /// # Errors
    /// [`DeviceError`] when a file cannot be made.
    pub fn create(folder: &Path, targets: &[String], lost: bool) -> Result<Self, DeviceError> {
        let file = |k| Lines::create(of_target(folder, "covariances", "csv", targets, k), "");
        Ok(Self { files: (0..targets.len()).map(file).collect::<Result<_, _>>()?, lost })
    }
}

impl Output for Covariances {
    fn step(&mut self, step: &Step<'_>) -> Result<ControlFlow<()>, DeviceError> {
        for (file, report) in self.files.iter_mut().zip(step.reports) {
            if report.verdict.status == Status::Lost && !self.lost {
                continue;
            }
            let n = report.posterior.dim();
            let _ = write!(file.buffer(), "{}", report.frame);
            for r in 0..n {
                for c in r..n {
                    let _ = write!(file.buffer(), ",{:.9e}", report.posterior.covariance[r * n + c]);
                }
            }
            file.buffer().push('\n');
            file.flush()?;
        }
        Ok(ControlFlow::Continue(()))
    }
}
