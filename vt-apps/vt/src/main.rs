//! The command `vt`.

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use vt::eval::EvalArgs;
use vt::failure::Failure;
use vt::run_command::{RunArgs, TaskArgs};
use vt_task::{Registry, check, explain, schema};

/// Model-based visual tracking: run, check and explain task files, score poses.
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
    Run(Box<RunArgs>),
    /// Scores estimated poses against true ones.
    Eval(EvalArgs),
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
        Command::Eval(args) => args.start().map_err(Failure::from),
        Command::Run(args) => args.start(&registry),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => e.report(),
    }
}

fn checked(task: &TaskArgs, registry: &Registry) -> Result<vt_task::Task, Failure> {
    Ok(check(&task.document(&[])?, registry)?)
}
