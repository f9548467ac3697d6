//! The command `vt sim`: scenarios as recordings, with the truth and a task that tracks them.

use std::path::{Path, PathBuf};

use clap::Args;
use vt_core::error::DeviceError;
use vt_io::files::replace;
use vt_io::recording::{self, Recording};
use vt_task::scenarios::{self, LIBRARY};
use vt_task::{Document, Registry, TaskErrors, check, nearest};

/// Arguments of `vt sim`.
#[derive(Args)]
pub struct SimArgs {
    /// Name of a scenario, or a task file with simulated sensors.
    #[arg(required_unless_present = "list")]
    scenario: Option<String>,
    /// Lists the scenarios that come with vt.
    #[arg(long)]
    list: bool,
    /// Folder for the recording; out/sim/NAME when absent.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Sets a value of the task: a dotted key (elements of lists by name or number) and a value.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Seed of all random numbers, instead of that of the task.
    #[arg(long, value_name = "N")]
    seed: Option<u32>,
    /// Number of frames of all simulated sensors, instead of that of the task.
    #[arg(long, value_name = "N")]
    frames: Option<u64>,
}

/// Why a scenario was not recorded.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SimError {
    /// The task is wrong.
    #[error(transparent)]
    Task(#[from] TaskErrors),
    /// A file could not be written.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// No scenario and no file of this name.
    #[error("no scenario and no file `{found}`; expected a task file or one of {}{}", names(), hint(found))]
    Unknown {
        /// What was asked for.
        found: String,
    },
}

fn names() -> String {
    LIBRARY.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(", ")
}

fn hint(found: &str) -> String {
    let nearest = nearest::nearest(found, LIBRARY.iter().map(|(name, _)| *name));
    nearest.map(|n| format!("; nearest: {n}")).unwrap_or_default()
}

/// Names and titles of the scenarios.
pub fn list() -> String {
    let line = |(name, text): &(&str, &str)| {
        let about = text.lines().next().unwrap_or_default().trim_start_matches(['#', ' ']);
        format!("{name:16}{about}\n")
    };
    LIBRARY.iter().map(line).collect()
}

impl SimArgs {
    /// Overrides of the whole task. Frames of the sensors need the task and come later.
    fn document(&self, scenario: &str, more: &[String]) -> Result<Document, SimError> {
        let seed = self.seed.map(|s| format!("seed={s}"));
        let set: Vec<String> = self.set.iter().cloned().chain(seed).chain(more.iter().cloned()).collect();
        let path = Path::new(scenario);
        match scenarios::find(scenario, &set) {
            Some(document) => Ok(document?),
            None if path.exists() || path.extension().is_some() => Ok(Document::load(path, &set)?),
            None => Err(SimError::Unknown { found: scenario.into() }),
        }
    }

    /// Lists scenarios or records one; returns what to print.
    ///
    /// # Errors
    /// [`SimError`].
    pub fn run(&self, registry: &Registry) -> Result<String, SimError> {
        let Some(scenario) = self.scenario.as_ref().filter(|_| !self.list) else { return Ok(list()) };
        let mut document = self.document(scenario, &[])?;
        let mut task = check(&document, registry)?;
        if let Some(n) = self.frames {
            let simulated = task.sensors.iter().filter(|s| s.kind == "simulated");
            let set: Vec<_> = simulated.map(|s| format!("sensors.{}.params.frames={n}", s.name)).collect();
            document = self.document(scenario, &set)?;
            task = check(&document, registry)?;
        }
        let mut sensors = scenarios::cameras(&document, &task, registry)?;
        let stem = Path::new(scenario).file_stem().unwrap_or_default();
        let out = self.out.clone().unwrap_or_else(|| Path::new("out").join("sim").join(stem));
        let recorded = scenarios::recorded(&document, &task, &sensors);
        let mut shown = String::new();
        for sensor in &mut sensors {
            let folder = recording::folder(&out, &sensor.name);
            let mut recording = Recording::create(&folder, &sensor.objects)?;
            replace(&folder.join("camera.toml"), sensor.parameters.as_bytes())?;
            let mut frames = 0;
            while let Some(shot) = sensor.camera.shot() {
                recording.add(&shot.frame, &shot.poses, &shot.visible)?;
                frames += 1;
            }
            shown += &format!("{}: {frames} frames in {}\n", sensor.name, folder.display());
        }
        let path = out.join("task.toml");
        replace(&path, recorded.print().as_bytes())?;
        Ok(shown + &format!("vt run {} tracks them\n", path.display()))
    }
}
