//! Poses in the TUM format, with the frame's number in place of the time.

use core::fmt::Write;
use core::ops::ControlFlow;
use std::path::Path;

use vt_core::agent::{Output, Step};
use vt_core::error::DeviceError;
use vt_core::report::Status;

use crate::files::{Lines, of_target};

/// Writes `poses.tum`: `frame tx ty tz qx qy qz qw` a line, camera_from_object, metres, `qw ≥ 0`, 10 digits. With
/// several targets there is one file each, `poses-NAME.tum`.
pub struct Poses {
    files: Vec<Lines>,
    lost: bool,
}

impl Poses {
    /// Files in `folder` for these targets. Poses of lost targets are left out unless `lost` is true.
    ///
    /// # Errors
    /// [`DeviceError`] when a file cannot be made.
    pub fn create(folder: &Path, targets: &[String], lost: bool) -> Result<Self, DeviceError> {
        let file = |k| Lines::create(of_target(folder, "poses", "tum", targets, k), HEADER);
        Ok(Self { files: (0..targets.len()).map(file).collect::<Result<_, _>>()?, lost })
    }
}

/// First line of a file of poses.
pub(crate) const HEADER: &str = "# frame tx ty tz qx qy qz qw (camera_from_object, metres)\n";

/// Adds the line of a pose with the coordinates `tx ty tz qx qy qz qw`.
pub(crate) fn line(out: &mut String, frame: u64, c: &[f64]) {
    let sign = if c.get(6).is_some_and(|w| *w < 0.0) { -1.0 } else { 1.0 };
    let _ = write!(out, "{frame}");
    for (k, v) in c.iter().enumerate() {
        let v = if k < 3 { *v } else { sign * v };
        // Adding zero turns -0 into 0.
        let _ = write!(out, " {:.9e}", v + 0.0);
    }
    out.push('\n');
}

impl Output for Poses {
    fn step(&mut self, step: &Step<'_>) -> Result<ControlFlow<()>, DeviceError> {
        for (file, report) in self.files.iter_mut().zip(step.reports) {
            if report.posterior.space != "se3" || (report.verdict.status == Status::Lost && !self.lost) {
                continue;
            }
            line(file.buffer(), report.frame, &report.posterior.coordinates);
            file.flush()?;
        }
        Ok(ControlFlow::Continue(()))
    }
}
