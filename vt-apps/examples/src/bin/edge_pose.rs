//! Edge-based tracking of a rigid body (the paper's Fig. 10).
//!
//! Model: ground shape without texture; visible edges as features; pose in SE(3), constant velocity.
//! Measurement: edges along the normals of the projected contour, at feature level.
//! Tracker: Kalman filter whose correction is the maximum a posteriori of prior and edges.
//!
//! Without options a simulated scene is tracked and the errors against the truth are printed. Own pictures take
//! `--images`, `--model`, `--camera` and `--init`; `--task` takes a whole task file.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use vt_examples::{document, pictures, start};

const SIMULATED: &str = include_str!("../../../tasks/edge-pose.toml");
const OWN: &str = include_str!("../own-edges.toml");

/// Tracks a rigid body by its edges.
#[derive(Parser)]
#[command(version)]
struct Cli {
    /// A task file instead of the built-in scene.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["images", "model", "camera", "init"])]
    task: Option<PathBuf>,
    /// Pictures: a folder, or a pattern such as Image_%04d.png.
    #[arg(long, value_name = "FOLDER|PATTERN", requires_all = ["model", "camera", "init"])]
    images: Option<String>,
    /// Shape: a VRML 97, OBJ, PLY, STL, glTF or CAO file.
    #[arg(long, value_name = "FILE", requires = "images")]
    model: Option<String>,
    /// Length unit of the model file.
    #[arg(long, value_name = "m|cm|mm|in", default_value = "m")]
    unit: String,
    /// Intrinsic parameters in pixels: width,height,fx,fy,cx,cy.
    #[arg(long, value_name = "W,H,FX,FY,CX,CY", requires = "images")]
    camera: Option<String>,
    /// Pose of the first picture, camera_from_object: a file with 6, 7, 8, 12 or 16 numbers (metres, radians).
    #[arg(long, value_name = "FILE", requires = "images")]
    init: Option<String>,
    /// Folder for results.
    #[arg(long, value_name = "DIR", default_value = "out/edge-pose")]
    out: PathBuf,
    /// Ends after so many frames.
    #[arg(long, value_name = "N")]
    max_frames: Option<usize>,
    /// Sets a value of the task, as in `vt run`.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    let set = match own(&cli) {
        Ok(own) => own.into_iter().chain(cli.set.iter().cloned()).collect::<Vec<_>>(),
        Err(message) => {
            eprintln!("error: {message}");
            return ExitCode::from(2);
        }
    };
    let (name, text) = match cli.images {
        Some(_) => ("edge-pose with own data", OWN),
        None => ("edge-pose.toml (built in)", SIMULATED),
    };
    let document = document(cli.task.as_deref(), name, text, &set);
    let results = [("overlays", "overlays"), ("contact sheet", "contact_sheet.png"), ("poses", "poses.tum")];
    start(document, &cli.out, cli.max_frames, &results)
}

/// The options for own data as settings of the task.
fn own(cli: &Cli) -> Result<Vec<String>, String> {
    let (Some(images), Some(model), Some(camera), Some(init)) =
        (&cli.images, &cli.model, &cli.camera, &cli.init)
    else {
        return Ok(vec![]);
    };
    let numbers: Vec<&str> = camera.split(',').map(str::trim).collect();
    let bad =
        || format!("--camera {camera}: expected six numbers W,H,FX,FY,CX,CY, as in 640,480,700,700,320,240");
    let [w, h, fx, fy, cx, cy] = numbers[..] else { return Err(bad()) };
    if numbers.iter().any(|n| n.parse::<f64>().is_err()) || [w, h].iter().any(|n| n.parse::<u32>().is_err()) {
        return Err(bad());
    }
    let quoted = |text: &str| format!("'{text}'");
    Ok(vec![
        pictures(images),
        format!("sensors.camera.camera.size=[{w}, {h}]"),
        format!("sensors.camera.camera.focal=['{fx} px', '{fy} px']"),
        format!("sensors.camera.camera.center=['{cx} px', '{cy} px']"),
        format!("models.object.shape.params.parts.0.file={}", quoted(model)),
        format!("models.object.shape.params.parts.0.unit={}", quoted(&cli.unit)),
        format!("targets.object.init.params.path={}", quoted(init)),
    ])
}
