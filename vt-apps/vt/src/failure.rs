//! What ends a command early, and the exit code that says so.

use std::process::ExitCode;

use miette::Report;
use vt_core::error::DeviceError;
use vt_task::TaskErrors;

use crate::eval::EvalError;
use crate::protocol::ProtocolError;
use crate::run::RunError;
use crate::sequences::SequencesError;

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
    /// A file cannot be read or written.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// Poses cannot be scored.
    #[error(transparent)]
    Eval(#[from] EvalError),
    /// A run over sequences failed.
    #[error(transparent)]
    Sequences(#[from] SequencesError),
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
    /// Shows it on stderr; the exit code is 2 when the task or the command line is wrong, otherwise 1.
    pub fn report(self) -> ExitCode {
        match self {
            Self::Task(e) => {
                eprintln!("{:?}", Report::new(e));
                ExitCode::from(2)
            }
            Self::Sequences(SequencesError::Sequence { name, source }) => match *source {
                RunError::Task(e) => {
                    eprintln!("sequence {name}:\n{:?}", Report::new(e));
                    ExitCode::from(2)
                }
                e => {
                    eprintln!("error: sequence {name}: {e}");
                    ExitCode::FAILURE
                }
            },
            Self::Protocol(e) => {
                eprintln!("error: {e}");
                ExitCode::from(2)
            }
            e => {
                eprintln!("error: {e}");
                ExitCode::FAILURE
            }
        }
    }
}
