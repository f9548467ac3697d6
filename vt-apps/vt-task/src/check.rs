//! Checks of a whole task before the first frame: names, kinds, parameters, files, and whether the parts fit.

use vt_io::files::file_name;

use crate::document::Document;
use crate::error::{Problem, TaskError, TaskErrors};
use crate::language::{Level, Picture, Task};
use crate::node::Node;
use crate::reader::ReadError;
use crate::registry::{Checked, Listing, Referent, Registry};

/// Largest angle to the optical axis that the simulated camera can draw, degrees.
const WIDEST_SIMULATED: f64 = 70.0;

/// Most elements of a list of sections.
const MOST_SECTIONS: usize = 256;

/// Most problems that are told at once.
const MOST_PROBLEMS: usize = 64;

/// Checks a document and returns its task.
///
/// # Errors
/// [`TaskErrors`] with every problem that was found, in order of the text; problems of form end the check.
pub fn check(document: &Document, registry: &Registry) -> Result<Task, TaskErrors> {
    let task = document.task()?;
    few(document, &task)?;
    let mut checker = Checker { document, registry, task: &task, problems: vec![] };
    checker.names();
    checker.sensors();
    checker.models();
    checker.targets();
    checker.rest();
    let mut problems = checker.problems;
    if problems.is_empty() {
        return Ok(task);
    }
    problems.sort_by_key(|p| p.span);
    problems.truncate(MOST_PROBLEMS);
    Err(TaskErrors { name: document.name().to_owned(), problems })
}

/// Lists that are not too long, since everything is compared with everything.
fn few(document: &Document, task: &Task) -> Result<(), TaskErrors> {
    let lists = [
        ("sensors", task.sensors.len()),
        ("models", task.models.len()),
        ("targets", task.targets.len()),
        ("outputs", task.outputs.len()),
    ];
    let modalities = task.targets.iter().enumerate();
    let modalities = modalities.map(|(k, t)| (format!("targets.{k}.modalities"), t.modalities.len()));
    let mut lists = lists.map(|(path, n)| (path.to_owned(), n)).into_iter().chain(modalities);
    let Some((path, n)) = lists.find(|(_, n)| *n > MOST_SECTIONS) else { return Ok(()) };
    let found = format!("{n} sections");
    Err(document
        .error_at(&path, Problem::Value { found, expected: format!("at most {MOST_SECTIONS}") })
        .into())
}

/// The pose space of a warp's listing.
fn space(listing: Option<&Listing>) -> Option<&'static str> {
    listing.and_then(|l| l.spaces.first().copied())
}

struct Checker<'a> {
    document: &'a Document,
    registry: &'a Registry,
    task: &'a Task,
    problems: Vec<TaskError>,
}

impl Checker<'_> {
    fn add(&mut self, path: &str, problem: Problem) {
        self.problems.push(self.document.error_at(path, problem));
    }

    /// Checks the method chosen at `path`.
    fn choice(&mut self, path: &str, key: &str, role: &str, space: Option<&str>) -> Option<Listing> {
        let node: &Node = self.document.root().at(path)?;
        match self.registry.check(key, role, space, node) {
            Ok((listing, checked)) => {
                self.references(path, &checked);
                Some(listing)
            }
            Err(e) => {
                self.problems.push(self.document.error(e));
                None
            }
        }
    }

    fn references(&mut self, path: &str, checked: &Checked) {
        for (key, file) in &checked.files {
            let resolved = self.document.resolve(file);
            if !resolved.exists() {
                self.add(&format!("{path}.params.{key}"), Problem::MissingFile { path: resolved });
            }
        }
        for reference in &checked.names {
            let (what, known) = self.known(reference.to);
            self.refer(&format!("{path}.params.{}", reference.key), what, &reference.name, known);
        }
    }

    fn known(&self, to: Referent) -> (&'static str, Vec<String>) {
        match to {
            Referent::Sensor => ("sensor", self.task.sensors.iter().map(|s| s.name.clone()).collect()),
            Referent::Model => ("model", self.task.models.iter().map(|m| m.name.clone()).collect()),
            Referent::Target => ("target", self.task.targets.iter().map(|t| t.name.clone()).collect()),
        }
    }

    fn refer(&mut self, path: &str, what: &'static str, name: &str, known: Vec<String>) {
        if !known.iter().any(|k| k == name) {
            self.add(path, Problem::UnknownName { what, found: name.into(), known });
        }
    }

    /// Names differ, are not empty and have no dot, since dotted paths use them.
    fn names(&mut self) {
        for (list, what, to) in [
            ("sensors", "sensor", Referent::Sensor),
            ("models", "model", Referent::Model),
            ("targets", "target", Referent::Target),
        ] {
            let (_, names) = self.known(to);
            if names.is_empty() {
                let problem =
                    Problem::Value { found: format!("no {list}"), expected: format!("at least one {what}") };
                self.add(list, problem);
            }
            for (k, name) in names.iter().enumerate() {
                // By number: names may be double.
                let path = format!("{list}.{k}.name");
                let section = self.document.root().get(list).and_then(|n| n.nth(k));
                let span = section.and_then(|n| n.get("name")).map(|n| n.span);
                let same_files = names[..k].iter().find(|n| file_name(n) == file_name(name));
                let problem = if names[..k].contains(name) {
                    Problem::Duplicate { what, name: name.clone() }
                } else if let Some(other) = same_files {
                    let expected = format!("a name whose files are not those of `{other}`");
                    Problem::Value { found: format!("\"{name}\""), expected }
                } else if name.is_empty() || name.contains('.') {
                    let expected = "a name that is not empty and has no dot".into();
                    Problem::Value { found: format!("\"{name}\""), expected }
                } else {
                    continue;
                };
                match span {
                    Some(span) => {
                        self.problems.push(self.document.error(ReadError::at(problem, span)));
                    }
                    None => self.add(&path, problem),
                }
            }
        }
    }

    fn sensors(&mut self) {
        for (k, sensor) in self.task.sensors.iter().enumerate() {
            let path = format!("sensors.{k}");
            self.choice(&path, "sensor", "sensor", None);
            let Some(camera) = &sensor.camera else { continue };
            if let Err(e) = camera.check() {
                let node = self.document.root().at(&format!("{path}.camera"));
                let node = node.unwrap_or(self.document.root());
                self.problems.push(self.document.error(crate::registry::located(e, node)));
            }
            let widest = camera.camera().map_or(0.0, |c| c.widest_angle().to_degrees());
            if sensor.kind == "simulated" && widest > WIDEST_SIMULATED {
                let found = format!("a simulated camera that sees {widest:.0}° off its axis");
                let expected =
                    format!("at most {WIDEST_SIMULATED}°: it draws the image of a pinhole and bends it");
                self.add(&format!("{path}.camera"), Problem::Mismatch { found, expected });
            }
        }
    }

    fn models(&mut self) {
        for k in 0..self.task.models.len() {
            let path = format!("models.{k}");
            self.choice(&format!("{path}.shape"), "shape", "shape", None);
            self.choice(&format!("{path}.appearance"), "appearance", "appearance", None);
            let warp = self.choice(&format!("{path}.warp"), "warp", "warp", None);
            self.choice(&format!("{path}.dynamics"), "dynamics", "dynamics", space(warp.as_ref()));
        }
    }

    fn targets(&mut self) {
        for (k, target) in self.task.targets.iter().enumerate() {
            let path = format!("targets.{k}");
            let (what, known) = self.known(Referent::Model);
            self.refer(&format!("{path}.model"), what, &target.model, known);
            let model = self.task.models.iter().find(|m| m.name == target.model);
            let warps = self.registry.listings();
            let warp = model.and_then(|m| warps.iter().find(|l| l.key == "warp" && l.kind == m.warp.kind));
            let space = space(warp);
            for (key, role) in [
                ("init", "init"),
                ("loss", "loss detector"),
                ("reinit", "re-initialiser"),
                ("truth", "truth"),
            ] {
                self.choice(&format!("{path}.{key}"), key, role, space);
            }
            let fusion = self.choice(&format!("{path}.fusion"), "fusion", "fusion", space);
            let estimator = self.choice(&format!("{path}.estimator"), "estimator", "estimator", space);
            if target.modalities.is_empty() {
                let expected = "at least one modality".into();
                self.add(
                    &format!("{path}.modalities"),
                    Problem::Value { found: "no modality".into(), expected },
                );
            }
            for (m, modality) in target.modalities.iter().enumerate() {
                let at = format!("{path}.modalities.{m}");
                let listing = self.choice(&at, "modality", "modality", space);
                let (what, known) = self.known(Referent::Sensor);
                self.refer(&format!("{at}.sensor"), what, &modality.sensor, known);
                let Some(listing) = listing else { continue };
                self.level(&at, modality.level, &listing, &[&fusion, &estimator]);
                self.fit(&at, &modality.sensor, &listing);
            }
        }
    }

    /// The level must be one the modality measures at, and one that fusion and estimator take.
    fn level(&mut self, path: &str, level: Level, modality: &Listing, takers: &[&Option<Listing>]) {
        let all = |levels: &[Level]| levels.iter().map(|l| l.name()).collect::<Vec<_>>().join(" or ");
        let makes = &modality.capabilities.levels;
        let path = format!("{path}.level");
        if !makes.is_empty() && !makes.contains(&level) {
            let found = format!("level {} of modality `{}`", level.name(), modality.kind);
            self.add(&path, Problem::Mismatch { found, expected: format!("level {}", all(makes)) });
            return;
        }
        for taker in takers.iter().filter_map(|t| t.as_ref()) {
            let takes = &taker.capabilities.levels;
            if !takes.is_empty() && !takes.contains(&level) {
                let found = format!("level {} for {} `{}`", level.name(), taker.role, taker.kind);
                self.add(&path, Problem::Mismatch { found, expected: format!("level {}", all(takes)) });
            }
        }
    }

    /// Calibrated against uncalibrated, colour against grey.
    fn fit(&mut self, path: &str, sensor: &str, modality: &Listing) {
        let Some(sensor) = self.task.sensors.iter().find(|s| s.name == sensor) else { return };
        let path = format!("{path}.sensor");
        if modality.capabilities.calibrated && sensor.camera.is_none() {
            let found = format!("uncalibrated sensor `{}` for modality `{}`", sensor.name, modality.kind);
            self.add(&path, Problem::Mismatch { found, expected: "a sensor with a `camera` section".into() });
        }
        let word = |p: Picture| if p == Picture::Grey { "grey" } else { "colour" };
        if let Some(needs) = modality.capabilities.picture.filter(|p| *p != sensor.picture) {
            let found =
                format!("{} sensor `{}` for modality `{}`", word(sensor.picture), sensor.name, modality.kind);
            self.add(
                &path,
                Problem::Mismatch {
                    found,
                    expected: format!("a sensor with `picture = \"{}\"`", word(needs)),
                },
            );
        }
    }

    fn rest(&mut self) {
        self.choice("association", "association", "association", None);
        for k in 0..self.task.outputs.len() {
            self.choice(&format!("outputs.{k}"), "output", "output", None);
            let kind = &self.task.outputs[k].kind;
            // Outputs of one kind write the same files.
            if self.task.outputs[..k].iter().any(|o| o.kind == *kind) {
                let problem = Problem::Duplicate { what: "output of kind", name: kind.clone() };
                let node = self.document.root().get("outputs").and_then(|n| n.nth(k));
                let span = node.map_or(self.document.root().span, |n| n.get("kind").unwrap_or(n).span);
                self.problems.push(self.document.error(ReadError::at(problem, span)));
            }
        }
    }
}
