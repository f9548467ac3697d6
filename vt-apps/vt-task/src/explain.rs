//! The specification sheet of a task, in the form of the paper's §6: models, then pipeline.

use core::fmt::Write;

use toml::Value;

use crate::assembly::DEFAULT_REINIT;
use crate::geometry::{CameraSection, Distortion};
use crate::language::{Choice, ModelSection, Picture, TargetSection, Task};
use crate::registry::Registry;

/// Width of the first column.
const COLUMN: usize = 26;

/// Writes the sheet of a task that has been checked.
pub fn explain(task: &Task, registry: &Registry) -> String {
    let mut sheet = Sheet { registry, text: String::new() };
    let title = task.title.as_deref().unwrap_or("Tracking task");
    let _ = writeln!(sheet.text, "{title}\n{}\n", "=".repeat(title.chars().count()));
    for target in &task.targets {
        let _ = writeln!(sheet.text, "Target `{}`\n", target.name);
        sheet.text.push_str("  Models\n");
        if let Some(model) = task.models.iter().find(|m| m.name == target.model) {
            sheet.model(model, target);
        }
        sheet.text.push_str("\n  Pipeline\n");
        sheet.pipeline(task, target);
        sheet.text.push('\n');
    }
    let _ = writeln!(
        sheet.text,
        "Seed {}. Outputs: {}.",
        task.seed,
        list(task.outputs.iter().map(|o| o.kind.as_str()))
    );
    sheet.text
}

struct Sheet<'a> {
    registry: &'a Registry,
    text: String,
}

impl Sheet<'_> {
    fn row(&mut self, name: &str, value: &str) {
        let mut first = true;
        for line in value.lines() {
            let _ = writeln!(self.text, "    {:COLUMN$}{line}", if first { name } else { "" });
            first = false;
        }
    }

    /// `kind: what it is (parameters)`.
    fn method(&self, key: &str, kind: &str, params: &toml::Table) -> String {
        let listings = self.registry.listings();
        let about = listings.iter().find(|l| l.key == key && l.kind == kind).map_or("", |l| l.about.as_str());
        let mut out = format!("{kind}: {about}");
        for (k, v) in params {
            let _ = write!(out, "\n  {k} = {}", brief(v));
        }
        out
    }

    fn choice(&self, key: &str, choice: &Choice) -> String {
        self.method(key, &choice.kind, &choice.params)
    }

    fn optional(&self, key: &str, choice: Option<&Choice>, absent: &str) -> String {
        choice.map_or_else(|| absent.to_owned(), |c| self.choice(key, c))
    }

    fn model(&mut self, model: &ModelSection, target: &TargetSection) {
        let appearance = self.optional("appearance", model.appearance.as_ref(), "none");
        let shape = self.choice("shape", &model.shape);
        self.row("Shape & appearance", &format!("{shape}\nappearance: {appearance}"));
        let features = target.modalities.iter().map(|m| m.kind.as_str());
        self.row("Features", &format!("those of modality {}", list(features)));
        let (warp, dynamics) = (self.choice("warp", &model.warp), self.choice("dynamics", &model.dynamics));
        self.row("Warp", &warp);
        let listings = self.registry.listings();
        let space = listings
            .iter()
            .find(|l| l.key == "warp" && l.kind == model.warp.kind)
            .map_or("", |l| l.spaces.first().copied().unwrap_or(""));
        self.row("State", &format!("pose in {space}, with the derivatives of `{}`", model.dynamics.kind));
        self.row("Dynamics", &dynamics);
    }

    fn pipeline(&mut self, task: &Task, target: &TargetSection) {
        for sensor in task.sensors.iter().filter(|s| target.modalities.iter().any(|m| m.sensor == s.name)) {
            let picture = if sensor.picture == Picture::Grey { "grey" } else { "colour" };
            let camera = sensor.camera.as_ref().map_or_else(|| "uncalibrated".into(), describe);
            let method = self.method("sensor", &sensor.kind, &sensor.params);
            self.row("Sensor", &format!("`{}`, {picture}, {camera}\n{method}", sensor.name));
        }
        for m in &target.modalities {
            let method = self.method("modality", &m.kind, &m.params);
            self.row(
                "Processing & measurement",
                &format!("{} level, on `{}`\n{method}", m.level.name(), m.sensor),
            );
        }
        let absent =
            if target.modalities.len() > 1 { "static: stacked measurements" } else { "of the one modality" };
        let likelihood = self.optional("fusion", target.fusion.as_ref(), absent);
        self.row("Likelihood", &likelihood);
        let searched =
            format!("{DEFAULT_REINIT} (default), where the sensor is calibrated and the body free");
        let absent = if target.loss.is_some() { searched.as_str() } else { "none" };
        let rows = [
            ("Tracker", self.choice("estimator", &target.estimator)),
            ("Output", "posterior and prediction with covariance".to_owned()),
            ("Loss detection", self.optional("loss", target.loss.as_ref(), "none")),
            ("Initialisation", self.choice("init", &target.init)),
            ("Re-initialisation", self.optional("reinit", target.reinit.as_ref(), absent)),
        ];
        for (name, value) in rows {
            self.row(name, &value);
        }
    }
}

fn describe(camera: &CameraSection) -> String {
    let lens = match &camera.distortion {
        None => "no distortion",
        Some(Distortion::BrownConrady(_)) => "distortion",
        Some(Distortion::KannalaBrandt(_)) => "fisheye",
    };
    let ([w, h], [fx, fy]) = (camera.size, camera.focal);
    format!("{w}x{h} pixels, focal length {fx} and {fy}, {lens}")
}

fn list<'a>(names: impl Iterator<Item = &'a str>) -> String {
    let names: Vec<_> = names.collect();
    if names.is_empty() { "none".into() } else { names.join(", ") }
}

/// A value on one line, as in the task file.
fn brief(value: &Value) -> String {
    match value {
        Value::Array(a) => format!("[{}]", a.iter().map(brief).collect::<Vec<_>>().join(", ")),
        Value::Table(t) => {
            format!(
                "{{ {} }}",
                t.iter().map(|(k, v)| format!("{k} = {}", brief(v))).collect::<Vec<_>>().join(", ")
            )
        }
        Value::String(s) => s.clone(),
        v => v.to_string(),
    }
}

/// The registry's table: role, kind, what it is, levels and pose spaces.
pub fn table(registry: &Registry) -> String {
    let mut listings = registry.listings();
    listings.sort_by_key(|l| l.role);
    let mut out = format!("{:<16}{:<24}{:<22}{:<8}{}\n", "role", "kind", "levels", "poses", "what");
    for l in listings {
        let levels: Vec<_> = l.capabilities.levels.iter().map(|l| l.name()).collect();
        let dash = |s: String| if s.is_empty() { "-".into() } else { s };
        let (levels, spaces) = (dash(levels.join(" ")), dash(l.spaces.join(" ")));
        let _ = writeln!(out, "{:<16}{:<24}{levels:<22}{spaces:<8}{}", l.role, l.kind, l.about);
    }
    out
}
