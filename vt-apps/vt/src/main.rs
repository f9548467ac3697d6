//! The command `vt`.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};
use miette::Report;
use vt::model::Inspection;
use vt::model_sheet::sheet;
use vt::progress::Bar;
use vt::run::{Options, RunError, run};
use vt_models::mesh::Unit;
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
    /// Prints the JSON Schema of task files.
    Schema,
    /// Lists all methods that tasks can choose.
    List,
    /// Looks at model files.
    #[command(subcommand)]
    Model(ModelCommand),
}

#[derive(Subcommand)]
enum ModelCommand {
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
        Command::Model(ModelCommand::Inspect { file, unit, out, json }) => {
            return inspect(&file, &unit, out.as_deref(), json);
        }
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

fn inspect(file: &Path, unit: &str, out: Option<&Path>, json: bool) -> ExitCode {
    let unit = match unit {
        "cm" => Unit::Centimetre,
        "mm" => Unit::Millimetre,
        "in" => Unit::Inch,
        _ => Unit::Metre,
    };
    let inspection = match Inspection::of(file, unit) {
        Ok(inspection) => inspection,
        Err(e) => {
            eprintln!("error: {e}");
            return ExitCode::from(2);
        }
    };
    let text = if json { format!("{:#}\n", inspection.json()) } else { inspection.to_string() };
    // A reader that has seen enough, such as `head`, is no failure.
    std::io::stdout().write_all(text.as_bytes()).ok();
    let Some(out) = out else { return ExitCode::SUCCESS };
    let saved = sheet(&inspection.mesh, &inspection.edges)
        .map_err(|e| e.to_string())
        .and_then(|s| s.save_with_format(out, image::ImageFormat::Png).map_err(|e| e.to_string()));
    match saved {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("error: {}: {e}", out.display());
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
