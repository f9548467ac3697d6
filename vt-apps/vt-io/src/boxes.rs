//! Where flat targets are in the picture: boxes and corners.

use core::fmt::Write;
use core::ops::ControlFlow;
use std::path::Path;

use nalgebra::{Matrix3, Point2};
use vt_core::agent::{Output, Step};
use vt_core::error::DeviceError;
use vt_core::lie::picture_from_plane;

use crate::files::{Lines, of_target};

/// Corners of a flat model's bounds in its own units, in order around it; `None` for bodies in space.
pub type Bounds = Option<[Point2<f64>; 4]>;

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

/// Images of the corners.
fn project(m: &Matrix3<f64>, corners: &[Point2<f64>; 4]) -> Option<[Point2<f64>; 4]> {
    let images = corners.map(|p| m * p.to_homogeneous());
    images.iter().all(|h| h.z > 0.0).then(|| images.map(|h| Point2::new(h.x / h.z, h.y / h.z)))
}

impl Output for PlanarFile {
    fn step(&mut self, step: &Step<'_>) -> Result<ControlFlow<()>, DeviceError> {
        for ((lines, bounds), report) in self.targets.iter_mut().zip(step.reports) {
            let Some(bounds) = bounds else { continue };
            let p = picture_from_plane(&report.posterior)
                .and_then(|m| project(&m, bounds))
                .unwrap_or([Point2::new(f64::NAN, f64::NAN); 4]);
            let out = lines.buffer();
            match self.form {
                Form::Boxes => {
                    let (low, high) = p[1..].iter().fold((p[0], p[0]), |(a, b), p| (a.inf(p), b.sup(p)));
                    let size = high - low;
                    // Pixels have their centre at whole coordinates, their borders half a pixel off.
                    let _ =
                        writeln!(out, "{:.2},{:.2},{:.2},{:.2}", low.x + 0.5, low.y + 0.5, size.x, size.y);
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
