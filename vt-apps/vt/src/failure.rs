//! What ends a command early, and the exit code that says so.

use std::process::ExitCode;

use miette::Report;
use vt_core::error::DeviceError;
use vt_task::TaskErrors;

use crate::eval::EvalError;
use crate::interrupt::INTERRUPTED;
use crate::protocol::ProtocolError;
use crate::run::RunError;
use crate::sequences::SequencesError;

/// Exit code of a failure that no file and no argument is to blame for.
const FAILED: u8 = 1;
/// Exit code of a wrong file or command line.
const WRONG: u8 = 2;

/// What ends a command early.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Failure {
    /// The task is wrong.
    #[error(transparent)]
    Task(#[from] TaskErrors),
    /// The arguments about truth do not fit the task.
    #[error(transparent)]
    Protocol(#[from] ProtocolError),
    /// A run failed.
    #[error(transparent)]
    Run(RunError),
    /// A file cannot be written.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// Poses cannot be scored.
    #[error(transparent)]
    Eval(#[from] EvalError),
    /// A run over sequences failed.
    #[error(transparent)]
    Sequences(#[from] SequencesError),
    /// Ctrl-C; the outputs are complete up to the last frame.
    #[error("interrupted")]
    Interrupted,
}

impl From<RunError> for Failure {
    fn from(e: RunError) -> Self {
        match e {
            RunError::Task(e) => Self::Task(e),
            e => Self::Run(e),
        }
    }
}

impl Failure {
    /// Shows it on stderr. Exit code 2: a file that was given or the command line is wrong; 130: Ctrl-C; 1: the rest.
    pub fn report(self) -> ExitCode {
        let code = match &self {
            Self::Task(_) | Self::Protocol(_) => WRONG,
            Self::Run(e) => of_run(e),
            Self::Eval(EvalError::Output(_)) | Self::Device(_) => FAILED,
            Self::Eval(_) => WRONG,
            Self::Sequences(SequencesError::Sequence { source, .. }) => of_run(source),
            Self::Sequences(SequencesError::Output(_)) => FAILED,
            Self::Sequences(_) => WRONG,
            Self::Interrupted => INTERRUPTED,
        };
        match self {
            Self::Task(e) => eprintln!("{:?}", Report::new(e)),
            Self::Sequences(SequencesError::Sequence { name, source }) => match *source {
                RunError::Task(e) => eprintln!("sequence {name}:\n{:?}", Report::new(e)),
                e => eprintln!("error: sequence {name}: {e}"),
            },
            e => eprintln!("error: {e}"),
        }
        ExitCode::from(code)
    }
}

fn of_run(e: &RunError) -> u8 {
    match e {
        RunError::Task(_) | RunError::Sensor(_) | RunError::Protocol(_) => WRONG,
        RunError::Output(_) | RunError::Reset { .. } | RunError::Step { .. } => FAILED,
    }
}
