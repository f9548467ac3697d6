//! The command `vt`.

use std::process::ExitCode;

use clap::error::ErrorKind;
use clap::{CommandFactory, Parser, Subcommand};
use vt::eval::EvalArgs;
use vt::failure::Failure;
use vt::model::ModelCommand;
use vt::run_command::{RunArgs, TaskArgs};
use vt::sim::{SimArgs, SimError};
use vt_task::{Registry, check, explain, schema};

/// Model-based visual tracking: run, check and explain task files, score poses.
///
/// Exit code 0: done; 1: something failed while running; 2: the task, another file or the command line is wrong; 130:
/// ended by Ctrl-C.
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
    /// Records a simulated scenario: pictures, truth, and a task that tracks them.
    Sim(SimArgs),
    /// Prints the JSON Schema of task files.
    Schema,
    /// Lists all methods that tasks can choose.
    List,
    /// Looks at model files.
    #[command(subcommand)]
    Model(ModelCommand),
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
        Command::Model(model) => return model.run(),
        Command::Sim(sim) => match sim.run(&registry) {
            Ok(shown) => {
                print!("{shown}");
                Ok(())
            }
            Err(SimError::Task(e)) => Err(e.into()),
            Err(SimError::Device(e)) => Err(e.into()),
            Err(e) => Cli::command().error(ErrorKind::InvalidValue, e).exit(),
        },
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => e.report(),
    }
}

fn checked(task: &TaskArgs, registry: &Registry) -> Result<vt_task::Task, Failure> {
    Ok(check(&task.document(&[])?, registry)?)
}
