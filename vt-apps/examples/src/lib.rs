//! What the programs of the paper's examples share: how a task is started and how it ends.

pub mod flat;

use std::io::Write;
use std::path::Path;
use std::process::ExitCode;

use miette::Report;
use vt::progress::Bar;
use vt::run::{Options, RunError, run};
use vt_task::{Document, Registry, TaskErrors};

/// Reads a task: a file, or a text that is called `name`; `set` holds settings as in `vt run --set`.
///
/// # Errors
/// [`TaskErrors`] with the place of what is wrong.
pub fn document(file: Option<&Path>, name: &str, text: &str, set: &[String]) -> Result<Document, TaskErrors> {
    match file {
        Some(file) => Document::load(file, set),
        None => Document::parse(name, text, Path::new(""), set, &|variable| std::env::var(variable).ok()),
    }
}

/// Runs a task into the folder `out`, prints the verdict and where the `results` are (a word and a file of `out`).
pub fn start(
    document: Result<Document, TaskErrors>,
    out: &Path,
    max_frames: Option<usize>,
    results: &[(&str, &str)],
) -> ExitCode {
    let done = document.map_err(RunError::from).and_then(|document| {
        let stop = vt::interrupt::flag().unwrap_or_default();
        let bar = Bar::new(false);
        let options = Options { out: out.to_owned(), max_frames, stop, ..Options::default() };
        let result = run(&document, &Registry::standard(), &options, &mut |p| bar.show(p));
        bar.finish();
        result
    });
    match done {
        Ok(outcome) => {
            let mut text = vt::verdict::describe(&outcome);
            for (what, file) in results {
                text += &format!("{:<15}{}\n", format!("{what}:"), out.join(file).display());
            }
            // Whoever reads may have seen enough.
            let _ = std::io::stdout().write_all(text.as_bytes());
            ExitCode::SUCCESS
        }
        Err(RunError::Task(e)) => {
            eprintln!("{:?}", Report::new(e));
            ExitCode::from(2)
        }
        Err(e) => {
            eprintln!("error: {e}");
            ExitCode::FAILURE
        }
    }
}

/// A text as a value of a setting.
pub(crate) fn quoted(text: &str) -> String {
    format!("'{text}'")
}

/// The settings of a sensor `camera` for pictures in a folder or after a numbered pattern.
pub fn pictures(images: &str) -> String {
    let source = if images.contains('%') { "pattern" } else { "folder" };
    format!("sensors.camera.params.{source}={}", quoted(images))
}
