//! The command `vt run`: one task, or one task on every sequence of a folder.

use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

use clap::Args;
use vt_task::{Document, Registry, TaskErrors};

use crate::failure::Failure;
use crate::progress::Bar;
use crate::protocol::{Limits, Protocol, truths};
use crate::run::{Options, run};
use crate::sequences::run_all;

#[derive(Args)]
/// Which task, with what changed.
pub struct TaskArgs {
    /// Task file.
    pub task: PathBuf,
    /// Sets a value of the task: a dotted key (elements of lists by name or number) and a value.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Seed of all random numbers, instead of that of the task.
    #[arg(long, value_name = "N")]
    pub seed: Option<u32>,
}

impl TaskArgs {
    /// The text of the task with its changes and, before them, `set`.
    ///
    /// # Errors
    /// [`TaskErrors`].
    pub fn document(&self, set: &[String]) -> Result<Document, TaskErrors> {
        let seed = self.seed.map(|s| format!("seed={s}"));
        let all: Vec<String> = set.iter().chain(&self.set).cloned().chain(seed).collect();
        Document::load(&self.task, &all)
    }
}

/// Arguments of `vt run`.
#[derive(Args)]
pub struct RunArgs {
    #[command(flatten)]
    task: TaskArgs,
    /// Folder for results; out/NAME-OF-THE-TASK when absent.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Number of threads; all cores when absent. Results do not depend on it.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Ends after so many frames.
    #[arg(long, value_name = "N")]
    max_frames: Option<usize>,
    /// Method that gives the first pose of every target, with its default parameters, instead of that of the task:
    /// `auto` searches the picture.
    #[arg(long, value_name = "KIND")]
    init: Option<String>,
    /// Shows no progress and no summary.
    #[arg(long)]
    quiet: bool,
    /// True poses (a TUM file or a folder of 4x4 matrices): the target starts at that of the first frame, and
    /// estimates.tum is written for scoring. TARGET= where the task has several targets.
    #[arg(long, value_name = "[TARGET=]FILE", group = "against")]
    truth: Vec<String>,
    /// Runs the task on each folder in DIR that has camera.txt and poses.tum, and writes a table.
    #[arg(long, value_name = "DIR", group = "against")]
    sequences: Option<PathBuf>,
    /// Puts a target to the true pose after every frame whose error reaches one of these limits, as 5cm,5deg.
    #[arg(long, value_name = "LENGTH,ANGLE", requires = "against")]
    reset_on_failure: Option<Limits>,
}

impl RunArgs {
    /// Runs.
    ///
    /// # Errors
    /// [`Failure`].
    pub fn start(&self, registry: &Registry) -> Result<(), Failure> {
        if let Some(n) = self.threads
            && let Err(e) = rayon::ThreadPoolBuilder::new().num_threads(n.into()).build_global()
        {
            eprintln!("warning: --threads {n}: {e}");
        }
        let task = &self.task.task;
        let out = self.out.clone();
        let out = out.unwrap_or_else(|| Path::new("out").join(task.file_stem().unwrap_or_default()));
        // The task is read before anything else, so that what is wrong with it is said first.
        let document = match &self.sequences {
            None => Some(self.document(&out)?),
            Some(_) => None,
        };
        let stop = crate::interrupt::flag().unwrap_or_else(|e| {
            eprintln!("warning: Ctrl-C will end the run at once: {e}");
            Default::default()
        });
        let mut options = Options { out, max_frames: self.max_frames, stop, protocol: None };
        let bar = Bar::new(self.quiet);
        let (shown, interrupted) = match (document, &self.sequences) {
            (Some((document, protocol)), _) => {
                options.protocol = protocol;
                let outcome = run(&document, registry, &options, &mut |p| bar.show(p));
                bar.finish();
                let outcome = outcome?;
                (crate::verdict::describe(&outcome), outcome.interrupted)
            }
            (None, folder) => {
                let folder = folder.as_deref().unwrap_or(Path::new("."));
                let load = |set: &[String]| self.initialised(set);
                let limits = self.reset_on_failure;
                let observe = &mut |name: &str, p: &crate::run::Progress<'_>| bar.show_of(name, p);
                let table = run_all(&load, registry, folder, &options, limits, observe);
                bar.finish();
                (table?.text(), options.stop.load(Ordering::Relaxed))
            }
        };
        if !self.quiet {
            print!("{shown}");
            println!("results are in {}", options.out.display());
        }
        if interrupted { Err(Failure::Interrupted) } else { Ok(()) }
    }

    /// The text of the task with the changes `set`, in which every target starts as `--init` says.
    fn initialised(&self, set: &[String]) -> Result<Document, TaskErrors> {
        let Some(kind) = &self.init else { return self.task.document(set) };
        let targets = self.task.document(set)?.task()?.targets.len();
        let inits = (0..targets).map(|k| format!("targets.{k}.init={{ kind = {kind:?} }}"));
        self.task.document(&set.iter().cloned().chain(inits).collect::<Vec<_>>())
    }

    /// The task with the truth that the command line gives, and how it is judged by it.
    fn document(&self, out: &Path) -> Result<(Document, Option<Protocol>), Failure> {
        let document = self.initialised(&[])?;
        if self.truth.is_empty() {
            return Ok((document, None));
        }
        let names: Vec<String> = document.task()?.targets.into_iter().map(|t| t.name).collect();
        let (targets, settings): (_, Vec<String>) = truths(&names, &self.truth)?.into_iter().unzip();
        let protocol = Protocol {
            targets,
            limits: self.reset_on_failure.unwrap_or_else(Limits::usual),
            reset: self.reset_on_failure.is_some(),
            folder: out.to_owned(),
            stem: "estimates".into(),
        };
        Ok((self.initialised(&settings)?, Some(protocol)))
    }
}
