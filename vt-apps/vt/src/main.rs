//! The command `vt`.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::error::ErrorKind;
use clap::{Args, CommandFactory, Parser, Subcommand};
use miette::Report;
use vt::progress::Bar;
use vt::run::{Options, RunError, run};
use vt::sim::{SimArgs, SimError};
use vt_task::{Document, Registry, TaskErrors, check, explain, schema};

/// Model-based visual tracking: run, check and explain task files.
///
/// Exit code 0: done; 1: something failed while running; 2: the task or the command line is wrong.
#[derive(Parser)]
#[command(version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Runs a task.
    Run {
        #[command(flatten)]
        task: TaskArgs,
        /// Folder for results; out/NAME-OF-THE-TASK when absent.
        #[arg(long, value_name = "DIR")]
        out: Option<PathBuf>,
        /// Number of threads; all cores when absent. Results do not depend on it.
        #[arg(long, value_name = "N")]
        threads: Option<usize>,
        /// Ends after so many frames.
        #[arg(long, value_name = "N")]
        max_frames: Option<usize>,
        /// Shows no progress and no summary.
        #[arg(long)]
        quiet: bool,
    },
    /// Checks a task without running it.
    Check {
        #[command(flatten)]
        task: TaskArgs,
    },
    /// Prints the specification sheet of a task.
    Explain {
        #[command(flatten)]
        task: TaskArgs,
    },
    /// Records a simulated scenario: pictures, truth, and a task that tracks them.
    Sim(SimArgs),
    /// Prints the JSON Schema of task files.
    Schema,
    /// Lists all methods that tasks can choose.
    List,
}

#[derive(Args)]
struct TaskArgs {
    /// Task file.
    task: PathBuf,
    /// Sets a value of the task: a dotted key (elements of lists by name or number) and a value.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Seed of all random numbers, instead of that of the task.
    #[arg(long, value_name = "N")]
    seed: Option<u32>,
}

impl TaskArgs {
    fn document(&self) -> Result<Document, TaskErrors> {
        let seed = self.seed.map(|s| format!("seed={s}"));
        Document::load(&self.task, &self.set.iter().cloned().chain(seed).collect::<Vec<_>>())
    }
}

fn main() -> ExitCode {
    let registry = Registry::standard();
    let result = match Cli::parse().command {
        Command::Schema => {
            println!("{:#}", schema::schema(&registry));
            Ok(())
        }
        Command::List => {
            print!("{}", explain::table(&registry));
            Ok(())
        }
        Command::Check { task } => {
            checked(&task, &registry).map(|_| println!("{}: no problems", task.task.display()))
        }
        Command::Explain { task } => {
            checked(&task, &registry).map(|t| print!("{}", explain::explain(&t, &registry)))
        }
        Command::Sim(sim) => match sim.run(&registry) {
            Ok(shown) => {
                print!("{shown}");
                Ok(())
            }
            Err(SimError::Task(e)) => Err(e.into()),
            Err(SimError::Device(e)) => Err(e.into()),
            Err(e) => Cli::command().error(ErrorKind::InvalidValue, e).exit(),
        },
        Command::Run { task, out, threads, max_frames, quiet } => {
            let out = out.unwrap_or_else(|| Path::new("out").join(task.task.file_stem().unwrap_or_default()));
            start(&task, &registry, out, threads, max_frames, quiet)
        }
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
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

fn checked(task: &TaskArgs, registry: &Registry) -> Result<vt_task::Task, RunError> {
    Ok(check(&task.document()?, registry)?)
}

fn start(
    task: &TaskArgs,
    registry: &Registry,
    out: PathBuf,
    threads: Option<usize>,
    max_frames: Option<usize>,
    quiet: bool,
) -> Result<(), RunError> {
    let document = task.document()?;
    if let Some(n) = threads
        && let Err(e) = rayon::ThreadPoolBuilder::new().num_threads(n).build_global()
    {
        eprintln!("warning: --threads {n}: {e}");
    }
    let stop = vt::interrupt::flag().unwrap_or_else(|e| {
        eprintln!("warning: Ctrl-C will end the run at once: {e}");
        Default::default()
    });
    let bar = Bar::new(quiet);
    let options = Options { out, max_frames, stop };
    let result = run(&document, registry, &options, &mut |p| bar.show(p));
    bar.finish();
    let summary = result?;
    if !quiet {
        print!("{}", vt::verdict::describe(&summary));
        println!("results are in {}", options.out.display());
    }
    Ok(())
}
