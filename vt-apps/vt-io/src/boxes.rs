//! Where flat targets are in the picture: boxes and corners.

use core::fmt::Write;
use core::ops::ControlFlow;
use std::path::Path;

use nalgebra::Point2;
use vt_core::agent::{Output, Step};
use vt_core::error::DeviceError;
use vt_core::lie::picture_from_plane;
use vt_core::metrics::Rectangle;
use vt_core::report::StepReport;

use crate::files::{Lines, of_target};

/// Four corners in order around them.
pub type Corners = [Point2<f64>; 4];

/// Corners of a flat model's bounds in its own units; `None` for bodies in space.
pub type Bounds = Option<Corners>;

/// What is written of the corners' images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// `boxes.txt`: `x,y,width,height` of the upright box around them; `(x, y)` is its first pixel.
    Boxes,
    /// `corners.txt`: `x1 y1 x2 y2 x3 y3 x4 y4`, pixels, whole numbers at pixel centres.
    Corners,
}

/// Writes one line a frame, lost or not; `nan` where the model cannot be projected. With several targets one file each,
/// `boxes-NAME.txt`.
pub struct PlanarFile {
    form: Form,
    targets: Vec<(Lines, Bounds)>,
}

impl PlanarFile {
    /// Files in `folder` for these targets.
    ///
    /// # Errors
    /// [`DeviceError`] when a file cannot be made.
    pub fn create(
        folder: &Path,
        form: Form,
        targets: &[String],
        bounds: &[Bounds],
    ) -> Result<Self, DeviceError> {
        let stem = match form {
            Form::Boxes => "boxes",
            Form::Corners => "corners",
        };
        let file = |k| {
            let lines = Lines::create(of_target(folder, stem, "txt", targets, k), "")?;
            Ok((lines, bounds.get(k).copied().flatten()))
        };
        Ok(Self { form, targets: (0..targets.len()).map(file).collect::<Result<_, _>>()? })
    }
}

/// Images of the corners; `None` for bodies in space and where a corner has none.
pub fn seen(report: &StepReport, bounds: &Bounds) -> Option<Corners> {
    let m = picture_from_plane(&report.posterior)?;
    let images = bounds.as_ref()?.map(|p| m * p.to_homogeneous());
    images.iter().all(|h| h.z > 0.0).then(|| images.map(|h| Point2::new(h.x / h.z, h.y / h.z)))
}

/// The upright box around corners.
pub fn around(corners: &Corners) -> Rectangle {
    let (low, high) = corners.iter().fold((corners[0], corners[0]), |(a, b), p| (a.inf(p), b.sup(p)));
    Rectangle { x: low.x, y: low.y, width: high.x - low.x, height: high.y - low.y }
}

impl Output for PlanarFile {
    fn step(&mut self, step: &Step<'_>) -> Result<ControlFlow<()>, DeviceError> {
        for ((lines, bounds), report) in self.targets.iter_mut().zip(step.reports) {
            if bounds.is_none() {
                continue;
            }
            let p = seen(report, bounds).unwrap_or([Point2::new(f64::NAN, f64::NAN); 4]);
            let out = lines.buffer();
            match self.form {
                Form::Boxes => {
                    let Rectangle { x, y, width, height } = around(&p);
                    // Pixels have their centre at whole coordinates, their borders half a pixel off.
                    let _ = writeln!(out, "{:.2},{:.2},{width:.2},{height:.2}", x + 0.5, y + 0.5);
                }
                Form::Corners => {
                    let numbers = p.iter().flat_map(|p| [p.x, p.y]).map(|v| format!("{v:.3}"));
                    let _ = writeln!(out, "{}", numbers.collect::<Vec<_>>().join(" "));
                }
            }
            lines.flush()?;
        }
        Ok(ControlFlow::Continue(()))
    }
}
