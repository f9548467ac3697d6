//! Scenarios by name, tasks whose simulated sensors are worth recording, and what a recording of one needs.

use std::collections::BTreeMap;
use std::path::Path;

use vt_core::frame::SensorId;
use vt_io::recording;
use vt_sim::camera::SimulatedCamera;

use crate::assembly::{node, shapes};
use crate::document::Document;
use crate::error::{Problem, TaskErrors};
use crate::geometry::PoseText;
use crate::language::{Choice, Task};
use crate::quantity::Length;
use crate::reader::ReadError;
use crate::registry::{Registry, located};
use crate::roles::{Place, SensorContext, Simulation};
use crate::standard::simulation::{Simulated, camera};

/// Declares the scenarios of the folder `scenarios`.
macro_rules! library {
    ($($name:literal),+ $(,)?) => {
        /// Names and texts of the scenarios that come with this crate.
        pub const LIBRARY: &[(&str, &str)] =
            &[$(($name, include_str!(concat!("../../scenarios/", $name, ".toml")))),+];
    };
}

library![
    "still",
    "smooth",
    "fast",
    "light",
    "blur",
    "occlusion",
    "full-occlusion",
    "clutter",
    "dropped-frames",
    "teleport",
    "two-objects",
    "two-cameras",
];

/// A scenario of the [`LIBRARY`] as a document, with `KEY=VALUE` overrides applied; `None` when there is none of this
/// name.
///
/// # Errors
/// [`TaskErrors`] for an override that does not fit.
pub fn find(name: &str, set: &[String]) -> Option<Result<Document, TaskErrors>> {
    let (name, text) = LIBRARY.iter().find(|(n, _)| *n == name)?;
    Some(Document::parse(name, text, Path::new(""), set, &|_| None))
}

/// A simulated sensor of a task, ready to take pictures.
pub struct SimulatedSensor {
    /// Its name.
    pub name: String,
    /// The camera.
    pub camera: SimulatedCamera,
    /// Names of the objects that it sees.
    pub objects: Vec<String>,
    /// Its parameters as a text: the section `camera`, and where it stands.
    pub parameters: String,
}

/// The simulated sensors of a checked task.
///
/// # Errors
/// [`TaskErrors`] for a file without the content it should have, or a task without simulated sensors.
pub fn cameras(
    document: &Document,
    task: &Task,
    registry: &Registry,
) -> Result<Vec<SimulatedSensor>, TaskErrors> {
    let found = build(document, task, registry).map_err(|e| document.error(e))?;
    if found.is_empty() {
        let expected = "at least one sensor of kind `simulated`".into();
        return Err(document
            .error_at("sensors", Problem::Mismatch { found: "none".into(), expected })
            .into());
    }
    Ok(found)
}

fn build(document: &Document, task: &Task, registry: &Registry) -> Result<Vec<SimulatedSensor>, ReadError> {
    let shapes = shapes(document, task, registry)?;
    let mut simulated = BTreeMap::new();
    let mut out = vec![];
    for (k, section) in task.sensors.iter().enumerate().filter(|(_, s)| s.kind == "simulated") {
        let at = node(document, &format!("sensors.{k}"))?;
        let params = node(document, &format!("sensors.{k}.params"))?;
        let params: Simulated = crate::reader::read(params)?;
        let place = |e| located(e, at.get("params").unwrap_or(at));
        let intrinsics = section.camera.as_ref().map(|c| c.camera()).transpose().map_err(place)?;
        let context = SensorContext {
            place: Place { base: document.base() },
            id: SensorId(k as u32),
            section,
            seed: task.seed.into(),
            camera: intrinsics.as_ref(),
            shapes: &shapes,
            simulated: &simulated,
        };
        let camera = camera(&params, &context).map_err(place)?;
        let simulation = Simulation::of(&camera);
        let objects = simulation.truths.iter().map(|(name, _)| name.clone()).collect();
        simulated.insert(section.name.clone(), simulation);
        let parameters = parameters(section.camera.as_ref(), params.camera_from_world.as_ref());
        out.push(SimulatedSensor { name: section.name.clone(), camera, objects, parameters });
    }
    Ok(out)
}

fn parameters(camera: Option<&crate::geometry::CameraSection>, from_world: Option<&PoseText>) -> String {
    let mut table = toml::Table::new();
    let zero = PoseText { translation: Some([Length::default(); 3]), ..PoseText::default() };
    let parts = [
        ("camera", toml::Value::try_from(camera)),
        ("camera_from_world", toml::Value::try_from(from_world.unwrap_or(&zero))),
    ];
    for (key, value) in parts {
        table.extend(value.ok().map(|v| (key.to_owned(), v)));
    }
    table.to_string()
}

/// The task that tracks the recordings of these sensors, which lie in folders of their names beside it. Other files are
/// named by their full paths.
pub fn recorded(document: &Document, task: &Task, sensors: &[SimulatedSensor]) -> Task {
    let mut task = task.clone();
    let recorded = |name: &str| sensors.iter().find(|s| s.name == name);
    let text = |p: std::path::PathBuf| toml::Value::String(p.to_string_lossy().replace('\\', "/"));
    let folder = |name: &str| recording::folder(Path::new(""), name);
    for sensor in &mut task.sensors {
        if recorded(&sensor.name).is_some() {
            sensor.kind = "images".into();
            sensor.params = toml::Table::from_iter([
                ("folder".to_owned(), text(folder(&sensor.name).join("images"))),
                ("timestamps".to_owned(), text(folder(&sensor.name).join("timestamps.txt"))),
            ]);
        } else {
            absolute(&mut sensor.params, document);
        }
    }
    for model in &mut task.models {
        absolute(&mut model.shape.params, document);
        model.appearance.iter_mut().for_each(|a| absolute(&mut a.params, document));
    }
    for target in &mut task.targets {
        absolute(&mut target.init.params, document);
        let Some(truth) = &mut target.truth else { continue };
        let word = |key: &str| truth.params.get(key).and_then(toml::Value::as_str);
        let sensor = word("sensor").filter(|_| truth.kind == "simulated").and_then(recorded);
        match sensor {
            Some(sensor) => {
                let at = word("object").and_then(|o| sensor.objects.iter().position(|n| n == o)).unwrap_or(0);
                let path = recording::truth(&folder(&sensor.name), &sensor.objects, at);
                *truth = Choice {
                    kind: "tum".into(),
                    params: toml::Table::from_iter([("path".to_owned(), text(path))]),
                };
            }
            None => absolute(&mut truth.params, document),
        }
    }
    task
}

/// Keys whose texts are paths.
const PATHS: [&str; 5] = ["file", "path", "folder", "pattern", "timestamps"];

/// Makes the paths of parameters independent of the folder of the task file.
fn absolute(params: &mut toml::Table, document: &Document) {
    for (key, value) in params.iter_mut() {
        match value {
            toml::Value::String(s) if PATHS.contains(&key.as_str()) => {
                let path = document.base().join(&*s);
                *s = std::path::absolute(&path).unwrap_or(path).to_string_lossy().into_owned();
            }
            toml::Value::Table(table) => absolute(table, document),
            toml::Value::Array(items) => {
                items.iter_mut().filter_map(toml::Value::as_table_mut).for_each(|t| absolute(t, document));
            }
            _ => {}
        }
    }
}
