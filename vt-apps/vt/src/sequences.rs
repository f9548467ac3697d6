//! A task on every sequence of a folder, and the table of how well it did.
//!
//! A sequence is a folder with `camera.txt` (`fx fy cx cy width height`, pixels) and `poses.tum`; what else it holds
//! (pictures, a model) is the task's business, which finds it by the variables `SEQUENCE`, `FX`, `FY`, `CX` and `CY`.

use core::fmt::Write;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Serialize;
use vt_core::error::DeviceError;
use vt_core::file::MOST;
use vt_io::summary::Statistics;
use vt_task::{Document, Registry};

use crate::protocol::{Limits, Protocol, setting};
use crate::run::{Options, Outcome, Progress, RunError, run};

/// A folder with camera and true poses.
#[derive(Clone, Debug, PartialEq)]
pub struct Sequence {
    /// Name of the folder.
    pub name: String,
    /// The folder.
    pub folder: PathBuf,
    /// Intrinsic parameters `fx fy cx cy` in pixels, as they are written.
    camera: [String; 4],
}

/// Why the sequences of a folder cannot be run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SequencesError {
    /// A file cannot be read, or is not what it should be.
    #[error(transparent)]
    Input(DeviceError),
    /// A table cannot be written.
    #[error(transparent)]
    Output(#[from] DeviceError),
    /// Nothing to run.
    #[error("{}: no sequence; expected folders with camera.txt and poses.tum", .0.display())]
    None(PathBuf),
    /// The protocol of sequences knows one truth each.
    #[error("{task}: {targets} targets; sequences need a task with one")]
    Targets {
        /// The task file.
        task: String,
        /// How many there are.
        targets: usize,
    },
    /// A sequence failed.
    #[error("sequence {name}: {source}")]
    Sequence {
        /// Name of the sequence.
        name: String,
        /// What failed.
        source: Box<RunError>,
    },
}

/// The sequences among the folders in `folder`, sorted by name.
///
/// # Errors
/// When there is none, or a camera cannot be read.
pub fn find(folder: &Path) -> Result<Vec<Sequence>, SequencesError> {
    let fail = |e: std::io::Error| SequencesError::Input(DeviceError::new(folder.display(), e));
    let mut out = vec![];
    for entry in std::fs::read_dir(folder).map_err(fail)? {
        let path = entry.map_err(fail)?.path();
        if path.join("camera.txt").is_file() && path.join("poses.tum").is_file() {
            let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
            let camera = camera(&path.join("camera.txt")).map_err(SequencesError::Input)?;
            out.push(Sequence { name, camera, folder: path });
        }
    }
    out.sort_by(|a, b| a.name.cmp(&b.name));
    if out.is_empty() { Err(SequencesError::None(folder.to_owned())) } else { Ok(out) }
}

fn camera(path: &Path) -> Result<[String; 4], DeviceError> {
    let text = vt_core::file::read_text(path, MOST).map_err(|e| DeviceError::new(path.display(), e))?;
    let words: Vec<&str> = text.split_whitespace().collect();
    let fail = |found: String, expected: &str| {
        Err(DeviceError::new(path.display(), format!("found {found}; expected {expected}")))
    };
    let [fx, fy, cx, cy, width, height] = words[..] else {
        return fail(format!("{} words", words.len()), "six numbers: fx fy cx cy width height");
    };
    let number = |w: &str| w.parse::<f64>().ok().filter(|v| v.is_finite());
    if let Some(bad) = [fx, fy, cx, cy].into_iter().find(|w| number(w).is_none()) {
        return fail(format!("`{bad}`"), "a finite number (fx fy cx cy width height)");
    }
    if let Some(bad) = [fx, fy].into_iter().find(|w| number(w).is_none_or(|v| v <= 0.0)) {
        return fail(format!("the focal length `{bad}`"), "a positive number of pixels");
    }
    if let Some(bad) = [width, height].into_iter().find(|w| number(w).is_none_or(|v| v < 1.0)) {
        return fail(format!("the side `{bad}`"), "a number of pixels from 1");
    }
    Ok([fx, fy, cx, cy].map(str::to_owned))
}

impl Sequence {
    /// The `--set` arguments that fill in the variables of a task.
    pub fn settings(&self) -> Vec<String> {
        let folder = std::path::absolute(&self.folder).unwrap_or_else(|_| self.folder.clone());
        let values =
            [folder.display().to_string().replace("${", "$${")].into_iter().chain(self.camera.clone());
        let names = ["SEQUENCE", "FX", "FY", "CX", "CY"];
        names
            .iter()
            .zip(values)
            .map(|(n, v)| format!("variables.{n}={}", serde_json::Value::from(v)))
            .collect()
    }

    /// Path of the true poses.
    pub fn truth(&self) -> PathBuf {
        self.folder.join("poses.tum")
    }
}

/// One line of a table.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Row {
    /// Name of the sequence, or of a mean.
    pub sequence: String,
    /// Judged frames.
    pub frames: usize,
    /// Frames that succeeded.
    pub success_percent: Option<f64>,
    /// Median distance from the true position over succeeded frames.
    pub median_mm: Option<f64>,
    /// Median angle from the true orientation over succeeded frames.
    pub median_deg: Option<f64>,
    /// Median CPU time of a tracking step: all threads, without reading pictures and without outputs.
    pub cpu_ms: Option<f64>,
    /// Median wall-clock time of the same.
    pub wall_ms: Option<f64>,
    /// How often the target was put to the true pose.
    pub resets: usize,
    /// Number of the first frame that failed.
    pub first_failure: Option<u64>,
}

impl Row {
    fn new(sequence: &str, outcome: &Outcome) -> Self {
        let median = |of: fn(&crate::run::StepTime) -> f64| {
            Statistics::of(&outcome.times.iter().map(|t| 1e3 * of(t)).collect::<Vec<_>>()).map(|s| s.median)
        };
        let score = outcome.scores.first().cloned().unwrap_or_default();
        let medians = score.medians();
        Self {
            sequence: sequence.to_owned(),
            frames: score.frames,
            success_percent: score.success_percent(),
            median_mm: medians.map(|m| m.0),
            median_deg: medians.map(|m| m.1),
            cpu_ms: median(|t| t.cpu),
            wall_ms: median(|t| t.wall),
            resets: score.resets,
            first_failure: score.first_failure,
        }
    }

    /// Means of the columns over some rows, each over the rows that have a value.
    fn mean(name: &str, rows: &[&Row]) -> Self {
        let mean = |of: fn(&Row) -> Option<f64>| {
            let values: Vec<f64> = rows.iter().filter_map(|r| of(r)).collect();
            Statistics::of(&values).map(|s| s.mean)
        };
        Self {
            sequence: name.to_owned(),
            frames: rows.iter().map(|r| r.frames).sum(),
            success_percent: mean(|r| r.success_percent),
            median_mm: mean(|r| r.median_mm),
            median_deg: mean(|r| r.median_deg),
            cpu_ms: mean(|r| r.cpu_ms),
            wall_ms: mean(|r| r.wall_ms),
            resets: rows.iter().map(|r| r.resets).sum(),
            first_failure: None,
        }
    }

    /// The cells as text, absent ones as `absent`.
    fn cells(&self, absent: &str) -> [String; 9] {
        let number = |v: Option<f64>, digits: usize| v.map_or(absent.into(), |v| format!("{v:.digits$}"));
        [
            self.sequence.clone(),
            self.frames.to_string(),
            number(self.success_percent, 1),
            number(self.median_mm, 2),
            number(self.median_deg, 3),
            number(self.cpu_ms, 2),
            number(self.wall_ms, 2),
            self.resets.to_string(),
            self.first_failure.map_or(absent.into(), |f| f.to_string()),
        ]
    }
}

const COLUMNS: [&str; 9] = [
    "sequence",
    "frames",
    "success_percent",
    "median_mm",
    "median_deg",
    "cpu_ms",
    "wall_ms",
    "resets",
    "first_failure",
];

/// How well a task did on several sequences.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Table {
    /// `reset` or `online`.
    pub protocol: String,
    /// Limits of success.
    pub limits: String,
    /// Threads that a step may use.
    pub threads: usize,
    /// One row a sequence.
    pub sequences: Vec<Row>,
    /// Means over the sequences that share the first or the last word of their names (`BODY_VARIANT`), and over all.
    pub means: Vec<Row>,
}

impl Table {
    fn add(&mut self, row: Row) {
        self.sequences.push(row);
        let mut groups: BTreeMap<&str, Vec<&Row>> = BTreeMap::new();
        for row in &self.sequences {
            let name = row.sequence.as_str();
            let (first, last) = (name.split('_').next(), name.rsplit('_').next());
            for group in first.into_iter().chain(last.filter(|l| first != Some(l))) {
                groups.entry(group).or_default().push(row);
            }
        }
        let mut means: Vec<Row> = groups.iter().map(|(name, rows)| Row::mean(name, rows)).collect();
        means.push(Row::mean("all", &self.sequences.iter().collect::<Vec<_>>()));
        self.means = means;
    }

    /// The table for people.
    pub fn text(&self) -> String {
        let mut out = format!(
            "{} protocol, success below {}; times are medians of {} threads without reading pictures\n",
            self.protocol, self.limits, self.threads
        );
        let heads = [
            "sequence",
            "frames",
            "success %",
            "median mm",
            "median deg",
            "CPU ms",
            "wall ms",
            "resets",
            "first failure",
        ];
        let mut line = |cells: [String; 9]| {
            let [name, rest @ ..] = cells;
            let _ = write!(out, "{name:<24}");
            rest.iter().for_each(|c| {
                let _ = write!(out, " {c:>10}");
            });
            out.push('\n');
        };
        line(heads.map(str::to_owned));
        self.sequences.iter().for_each(|r| line(r.cells("-")));
        for mean in &self.means {
            let mut cells = mean.cells("-");
            cells[0].insert_str(0, "mean ");
            line(cells);
        }
        out
    }

    /// The table for programs: sequences, then means.
    pub fn csv(&self) -> String {
        let mut out = COLUMNS.join(",") + "\n";
        for row in &self.sequences {
            // A name with a comma or a quote is quoted.
            let mut cells = row.cells("");
            if cells[0].contains([',', '"', '\n']) {
                cells[0] = format!("\"{}\"", cells[0].replace('"', "\"\""));
            }
            out += &(cells.join(",") + "\n");
        }
        out
    }
}

/// Runs the task on every sequence in `folder`: estimates in `OUT/SEQUENCE.tum`, outputs of the task in
/// `OUT/SEQUENCE/`, and after every sequence the table so far in `OUT/table.txt`, `.json` and `.csv`. Of a sequence that
/// is interrupted the estimates stay, but it gets no row.
///
/// # Errors
/// [`SequencesError`] names the sequence that failed; the table of those before stays.
pub fn run_all(
    load: &dyn Fn(&[String]) -> Result<Document, vt_task::TaskErrors>,
    registry: &Registry,
    folder: &Path,
    options: &Options,
    limits: Option<Limits>,
    observe: &mut dyn FnMut(&str, &Progress<'_>),
) -> Result<Table, SequencesError> {
    let mut table = Table {
        protocol: if limits.is_some() { "reset" } else { "online" }.into(),
        limits: limits.map_or_else(|| Limits::usual().to_string(), |l| l.to_string()),
        threads: rayon::current_num_threads(),
        ..Table::default()
    };
    for sequence in find(folder)? {
        let fail =
            |e: RunError| SequencesError::Sequence { name: sequence.name.clone(), source: Box::new(e) };
        let settings = sequence.settings();
        let task = load(&settings).and_then(|d| d.task()).map_err(|e| fail(e.into()))?;
        let [target] = &task.targets[..] else {
            let document = load(&settings).map_err(|e| fail(e.into()))?;
            let (task, targets) = (document.name().to_owned(), task.targets.len());
            return Err(SequencesError::Targets { task, targets });
        };
        let truth = setting(&target.name, &sequence.truth());
        let document = load(&[settings, vec![truth]].concat()).map_err(|e| fail(e.into()))?;
        let protocol = Protocol {
            targets: vec![target.name.clone()],
            limits: limits.unwrap_or_else(Limits::usual),
            reset: limits.is_some(),
            folder: options.out.clone(),
            stem: sequence.name.clone(),
        };
        let options =
            Options { out: options.out.join(&sequence.name), protocol: Some(protocol), ..options.clone() };
        let outcome =
            run(&document, registry, &options, &mut |p| observe(&sequence.name, p)).map_err(fail)?;
        if outcome.interrupted {
            break;
        }
        table.add(Row::new(&sequence.name, &outcome));
        write(options.out.parent().unwrap_or(&options.out), &table)?;
    }
    Ok(table)
}

fn write(folder: &Path, table: &Table) -> Result<(), DeviceError> {
    let json = serde_json::to_string_pretty(table).map_err(|e| DeviceError::new("table.json", e))?;
    let files = [("table.txt", table.text()), ("table.json", json + "\n"), ("table.csv", table.csv())];
    for (name, content) in files {
        vt_io::files::replace(&folder.join(name), content.as_bytes())?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(name: &str, success: f64, mm: Option<f64>) -> Row {
        let success_percent = Some(success);
        Row { sequence: name.into(), frames: 10, success_percent, median_mm: mm, ..Row::default() }
    }

    #[test]
    fn means_are_over_bodies_variants_and_all() {
        let mut table = Table::default();
        table.add(row("cow_noisy", 50.0, Some(2.0)));
        table.add(row("cow_fast", 100.0, Some(4.0)));
        table.add(row("head_fast", 0.0, None));
        let mean = |name: &str| table.means.iter().find(|r| r.sequence == name).unwrap();
        let of = |name: &str| (mean(name).success_percent, mean(name).median_mm);
        assert_eq!(of("cow"), (Some(75.0), Some(3.0)));
        assert_eq!(of("fast"), (Some(50.0), Some(4.0)));
        assert_eq!(of("head"), (Some(0.0), None));
        assert_eq!(of("all"), (Some(50.0), Some(3.0)));
        assert_eq!(table.means.len(), 5);
        assert_eq!(table.csv().lines().nth(3), Some("head_fast,10,0.0,,,,,0,"));
        assert!(table.text().contains("mean all"));
    }

    #[test]
    fn only_folders_with_camera_and_truth_are_sequences() {
        let dir = tempfile::tempdir().unwrap();
        assert!(matches!(find(dir.path()), Err(SequencesError::None(_))));
        for name in ["b", "a", "notes"] {
            std::fs::create_dir(dir.path().join(name)).unwrap();
            std::fs::write(dir.path().join(name).join("poses.tum"), "").unwrap();
        }
        for name in ["a", "b"] {
            std::fs::write(dir.path().join(name).join("camera.txt"), "600 601 320.5 240 640 480\n").unwrap();
        }
        let found = find(dir.path()).unwrap();
        assert_eq!(found.iter().map(|s| s.name.as_str()).collect::<Vec<_>>(), ["a", "b"]);
        assert!(found[0].settings().contains(&"variables.CX=\"320.5\"".to_owned()));
        std::fs::write(dir.path().join("a/camera.txt"), "600 601 x").unwrap();
        assert!(find(dir.path()).unwrap_err().to_string().contains("six numbers"));
        assert!(find(&dir.path().join("nowhere")).is_err());
    }
}
