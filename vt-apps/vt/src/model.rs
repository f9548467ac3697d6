//! `vt model inspect`: what is in a model file, what is wrong with it and what a tracker will see of it.

use std::fmt;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Subcommand;
use serde_json::{Value, json};
use vt_core::error::DeviceError;
use vt_io::files::save_png;
use vt_models::diagnostics::{Diagnostics, diagnose};
use vt_models::edges::{EdgeModel, EdgeOptions, MeshReport};
use vt_models::loaders::{LoadError, load_mesh, loader};
use vt_models::mesh::{Mesh, Unit};
use vt_models::symmetry::Symmetries;

use crate::model_sheet::sheet;

/// What can be done with model files.
#[derive(Subcommand)]
pub enum ModelCommand {
    /// Prints contents, size, problems, symmetries and edges of a model file.
    Inspect {
        /// VRML 97, OBJ, PLY, STL, glTF or CAO file.
        file: PathBuf,
        /// Length unit of the file.
        #[arg(long, value_name = "UNIT", default_value = "m", value_parser = ["m", "cm", "mm", "in"])]
        unit: String,
        /// Draws the edges from six sides as the tracker sees them.
        #[arg(long, value_name = "PNG")]
        out: Option<PathBuf>,
        /// Prints JSON instead of text.
        #[arg(long)]
        json: bool,
    },
}

impl ModelCommand {
    /// Does it; 2 for a bad model file, 1 where the picture cannot be written.
    pub fn run(&self) -> ExitCode {
        let Self::Inspect { file, unit, out, json } = self;
        let inspection = match Inspection::of(file, named(unit)) {
            Ok(inspection) => inspection,
            Err(e) => {
                eprintln!("error: {e}");
                return ExitCode::from(2);
            }
        };
        let text = if *json { format!("{:#}\n", inspection.json()) } else { inspection.to_string() };
        // A reader that has seen enough, such as `head`, is no failure.
        std::io::stdout().write_all(text.as_bytes()).ok();
        let Some(out) = out else { return ExitCode::SUCCESS };
        let saved = sheet(&inspection.mesh, &inspection.edges)
            .map_err(|e| DeviceError::new(out.display(), e))
            .and_then(|s| save_png(out, &s, &mut vec![]));
        match saved {
            Ok(()) => ExitCode::SUCCESS,
            Err(e) => {
                eprintln!("error: {e}");
                ExitCode::FAILURE
            }
        }
    }
}

/// Everything there is to say about a model.
pub struct Inspection {
    file: PathBuf,
    format: String,
    unit: Unit,
    /// The surface.
    pub mesh: Mesh,
    /// Its edges.
    pub edges: EdgeModel,
    diagnostics: Diagnostics,
    symmetries: Symmetries,
}

impl Inspection {
    /// Reads a model file whose lengths are in `unit` and examines it.
    ///
    /// # Errors
    /// [`LoadError`] where the file gives no mesh.
    pub fn of(file: &Path, unit: Unit) -> Result<Self, LoadError> {
        let format = loader(file)?.extensions().join("/");
        let mesh = load_mesh(file, unit)?;
        let edges = EdgeModel::new(&mesh, &EdgeOptions::default()).map_err(|e| LoadError::Element {
            file: file.to_owned(),
            element: "edges".into(),
            found: e.to_string(),
            expected: "a model whose edges can be found".into(),
        })?;
        let (diagnostics, symmetries) = (diagnose(&mesh), Symmetries::find(&mesh));
        Ok(Self { file: file.to_owned(), format, unit, mesh, edges, diagnostics, symmetries })
    }

    /// The same for programs: lengths in metres.
    pub fn json(&self) -> Value {
        let (d, s, e) = (&self.diagnostics, &self.symmetries, self.edges.report());
        let vector = |v: &nalgebra::Vector3<f64>| json!([v.x, v.y, v.z]);
        let bounds = self.mesh.bounds();
        let rotational = s.rotational.iter().map(|r| {
            let order = r.order.map_or_else(|| json!("infinite"), |n| json!(n));
            json!({ "axis": vector(&r.axis), "order": order, "residual_m": r.residual })
        });
        let mirrors =
            s.mirrors.iter().map(|m| json!({ "normal": vector(&m.normal), "residual_m": m.residual }));
        json!({
            "file": self.file.display().to_string(),
            "format": self.format,
            "unit": name(self.unit),
            "vertices": self.mesh.vertices().len(),
            "polygons": self.mesh.polygons().len(),
            "triangles": self.mesh.triangles().len(),
            "lines": self.mesh.segments().len(),
            "parts": self.mesh.parts(),
            "materials": self.mesh.materials().len(),
            "images": self.mesh.images().len(),
            "joints": self.mesh.skin().map_or(0, |s| s.joints.len()),
            "bounds_m": { "min": vector(&bounds.min.coords), "max": vector(&bounds.max.coords) },
            "diameter_m": d.diameter,
            "diagnostics": {
                "findings": d.to_string().lines().collect::<Vec<_>>(),
                "degenerate_faces": d.degenerate_faces,
                "duplicate_faces": d.duplicate_faces,
                "open_sides": d.open_sides,
                "boundaries": d.boundaries,
                "non_manifold_sides": d.non_manifold_sides,
                "inconsistent_sides": d.inconsistent_sides,
                "inverted_parts": d.inverted_parts,
                "connected_parts": d.parts,
                "unused_vertices": d.unused_vertices,
                "double_vertices": d.double_vertices,
            },
            "symmetries": {
                "center_m": vector(&s.center.coords),
                "rotational": rotational.collect::<Vec<_>>(),
                "mirrors": mirrors.collect::<Vec<_>>(),
            },
            "edges": {
                "creases": e.creases,
                "boundaries": e.boundaries,
                "non_manifold": e.non_manifold,
                "lines": e.lines,
                "smooth": e.smooth,
            },
        })
    }
}

/// The unit with a name of the command line.
fn named(name: &str) -> Unit {
    match name {
        "cm" => Unit::Centimetre,
        "mm" => Unit::Millimetre,
        "in" => Unit::Inch,
        _ => Unit::Metre,
    }
}

/// A unit as on the command line.
fn name(unit: Unit) -> &'static str {
    match unit {
        Unit::Metre => "m",
        Unit::Centimetre => "cm",
        Unit::Millimetre => "mm",
        Unit::Inch => "in",
    }
}

/// A length in the unit that shows it best.
fn length(metres: f64) -> String {
    match metres.abs() {
        m if m < 1.0 => format!("{:.4} mm", metres * 1e3),
        _ => format!("{metres:.4} m"),
    }
}

impl fmt::Display for Inspection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mesh = &self.mesh;
        writeln!(f, "{}: {}, lengths in {}", self.file.display(), self.format, name(self.unit))?;
        writeln!(
            f,
            "  contents    {} vertices, {} polygons, {} triangles, {} lines, {} parts, {} materials, {} images",
            mesh.vertices().len(),
            mesh.polygons().len(),
            mesh.triangles().len(),
            mesh.segments().len(),
            mesh.parts().len(),
            mesh.materials().len(),
            mesh.images().len(),
        )?;
        if let Some(skin) = mesh.skin() {
            writeln!(f, "  skeleton    {} joints", skin.joints.len())?;
        }
        let bounds = mesh.bounds();
        let size = bounds.max - bounds.min;
        let [x, y, z] = [size.x, size.y, size.z].map(length);
        writeln!(f, "  size        {x} x {y} x {z}, diameter {}", length(self.diagnostics.diameter))?;
        let MeshReport { creases, boundaries, non_manifold, lines, smooth, .. } = self.edges.report();
        writeln!(
            f,
            "  edges       {creases} creases, {boundaries} boundaries, {non_manifold} of three or more faces, {lines} \
             lines, {smooth} smooth (silhouettes)"
        )?;
        let findings = self.diagnostics.to_string();
        if findings.is_empty() {
            writeln!(f, "  diagnostics no problems")?;
        }
        for (k, line) in findings.lines().enumerate() {
            writeln!(f, "  {}{line}", if k == 0 { "diagnostics " } else { "            " })?;
        }
        if self.symmetries.rotational.is_empty() && self.symmetries.mirrors.is_empty() {
            writeln!(f, "  symmetries  none")?;
        }
        for (k, r) in self.symmetries.rotational.iter().enumerate() {
            let order = r.order.map_or_else(|| "any angle".into(), |n| format!("{n}-fold"));
            let head = if k == 0 { "symmetries  " } else { "            " };
            let [x, y, z] = [r.axis.x, r.axis.y, r.axis.z];
            writeln!(f, "  {head}{order} about ({x:+.3} {y:+.3} {z:+.3}), residual {}", length(r.residual))?;
        }
        for m in &self.symmetries.mirrors {
            let [x, y, z] = [m.normal.x, m.normal.y, m.normal.z];
            writeln!(
                f,
                "              mirror across ({x:+.3} {y:+.3} {z:+.3}), residual {}",
                length(m.residual)
            )?;
        }
        Ok(())
    }
}
