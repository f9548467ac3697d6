//! What can be wrong with a task file: where, what was found, what was expected, and the nearest valid name.

use std::path::PathBuf;
use std::sync::Arc;

use miette::{Diagnostic, LabeledSpan, NamedSource, SourceCode};
use thiserror::Error;

use crate::node::Span;

/// Longest line of a text that is shown around a problem, and longest piece of a text in a message.
const LINE: usize = 1000;
const PIECE: usize = 100;

/// The beginning of a long text.
pub(crate) fn short(text: &str) -> String {
    match text.char_indices().nth(PIECE) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.to_owned(),
    }
}

/// What is wrong.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum Problem {
    /// The text is no TOML.
    #[error("syntax: {0}")]
    Syntax(String),
    /// The file cannot be read.
    #[error("{}: {why}", path.display())]
    Unreadable {
        /// The task file.
        path: PathBuf,
        /// Message of the system.
        why: String,
    },
    /// No `version`, or one this program does not speak.
    #[error("version {found}; expected version 1")]
    Version {
        /// What is written.
        found: String,
    },
    /// A key that has no meaning here.
    #[error("unknown key `{found}`")]
    UnknownKey {
        /// The key.
        found: String,
        /// Keys that are known here.
        expected: Vec<String>,
    },
    /// A key that must be given.
    #[error("missing key `{key}`")]
    MissingKey {
        /// The key.
        key: String,
    },
    /// A method that the registry does not have.
    #[error("unknown {role} `{found}`")]
    UnknownKind {
        /// Role of the method.
        role: String,
        /// What is written.
        found: String,
        /// Kinds of this role.
        expected: Vec<String>,
    },
    /// A word out of a fixed list.
    #[error("unknown word `{found}`")]
    UnknownWord {
        /// What is written.
        found: String,
        /// The list.
        expected: Vec<String>,
    },
    /// A value of the wrong type, without its unit or out of range.
    #[error("found {found}; expected {expected}")]
    Value {
        /// What is written.
        found: String,
        /// What is allowed.
        expected: String,
    },
    /// A variable without value.
    #[error(
        "variable `{name}` has no value: not given by --set variables.{name}=…, in [variables] or in the environment"
    )]
    Variable {
        /// Its name.
        name: String,
        /// Names of the variables of the task.
        known: Vec<String>,
    },
    /// A reference to something that is not in the task.
    #[error("no {what} named `{found}`")]
    UnknownName {
        /// Sensor, model, target …
        what: &'static str,
        /// The name used.
        found: String,
        /// The names there are.
        known: Vec<String>,
    },
    /// Two things with the same name.
    #[error("second {what} named `{name}`; names must differ")]
    Duplicate {
        /// Sensor, model, target …
        what: &'static str,
        /// The name.
        name: String,
    },
    /// A file or folder that is not there.
    #[error("{} does not exist", path.display())]
    MissingFile {
        /// Where it was looked for.
        path: PathBuf,
    },
    /// Two parts of the task do not fit together.
    #[error("{found} does not fit: expected {expected}")]
    Mismatch {
        /// What is written.
        found: String,
        /// What fits.
        expected: String,
    },
    /// A `--set` that cannot be applied.
    #[error("--set {set}: {why}")]
    Override {
        /// The argument.
        set: String,
        /// What is wrong with it.
        why: String,
        /// Names at the place where the path ends.
        known: Vec<String>,
        /// The part of the path that is not known.
        found: String,
    },
}

impl Problem {
    /// The nearest valid name to the one found, where names are at stake.
    pub fn nearest(&self) -> Option<String> {
        let (found, names) = match self {
            Self::UnknownKey { found, expected }
            | Self::UnknownKind { found, expected, .. }
            | Self::UnknownWord { found, expected } => (found, expected),
            Self::UnknownName { found, known, .. } | Self::Override { found, known, .. } => (found, known),
            Self::Variable { name, known } => (name, known),
            _ => return None,
        };
        crate::nearest::nearest(found, names.iter().map(String::as_str))
    }

    /// What was expected, for the help line.
    pub fn expected(&self) -> Option<String> {
        let list = |what: &str, names: &[String]| match names {
            [] => format!("expected {what}: there is none"),
            _ => format!("expected {what}: {}", names.join(", ")),
        };
        Some(match self {
            Self::Syntax(_) => "expected a TOML document, version 1 of the task language".into(),
            Self::Unreadable { .. } => "expected a readable task file".into(),
            Self::Version { .. } => "expected `version = 1` at the top of the file".into(),
            Self::UnknownKey { expected, .. } => list("one of the keys", expected),
            Self::MissingKey { key } => format!("expected a line `{key} = …` here"),
            Self::UnknownKind { role, expected, .. } => list(&format!("a {role} of the registry"), expected),
            Self::UnknownWord { expected, .. } => list("one of", expected),
            Self::Value { expected, .. } | Self::Mismatch { expected, .. } => format!("expected {expected}"),
            Self::Variable { name, .. } => format!("expected a value of `{name}`, as in `{name}=… vt run …`"),
            Self::UnknownName { what, known, .. } => {
                list(&format!("the name of a {what} of this task"), known)
            }
            Self::Duplicate { what, .. } => format!("expected another name for this {what}"),
            Self::MissingFile { .. } => {
                "expected an existing file; paths are relative to the task file".into()
            }
            Self::Override { known, .. } if known.is_empty() => "expected KEY=VALUE with a dotted key".into(),
            Self::Override { known, .. } => list("one of", known),
        })
    }

    fn code(&self) -> &'static str {
        match self {
            Self::Syntax(_) => "task::syntax",
            Self::Unreadable { .. } => "task::unreadable",
            Self::Version { .. } => "task::version",
            Self::UnknownKey { .. } => "task::unknown_key",
            Self::MissingKey { .. } => "task::missing_key",
            Self::UnknownKind { .. } => "task::unknown_kind",
            Self::UnknownWord { .. } => "task::unknown_word",
            Self::Value { .. } => "task::value",
            Self::Variable { .. } => "task::variable",
            Self::UnknownName { .. } => "task::unknown_name",
            Self::Duplicate { .. } => "task::duplicate",
            Self::MissingFile { .. } => "task::missing_file",
            Self::Mismatch { .. } => "task::mismatch",
            Self::Override { .. } => "task::override",
        }
    }
}

/// A problem at a place of the task's text.
#[derive(Debug, Clone, Error)]
#[error("{problem}")]
pub struct TaskError {
    /// What is wrong.
    pub problem: Problem,
    /// The text with its name: the task file, or the `--set` argument that brought the value.
    pub text: NamedSource<Arc<String>>,
    /// Bytes of the text.
    pub span: Option<(usize, usize)>,
}

impl TaskError {
    pub(crate) fn new(problem: Problem, sources: &[(String, Arc<String>)], span: Option<Span>) -> Self {
        let (name, text) = &sources[span.map_or(0, |s| s.source)];
        Self {
            problem,
            text: NamedSource::new(name, text.clone()),
            span: span.map(|s| (s.start, s.end.max(s.start))),
        }
    }

    /// Line of the place, from 1.
    pub fn line(&self) -> Option<usize> {
        Some(1 + self.before()?.matches('\n').count())
    }

    /// Column of the place in characters, from 1.
    pub fn column(&self) -> Option<usize> {
        Some(1 + self.before()?.chars().rev().take_while(|&c| c != '\n').count())
    }

    fn before(&self) -> Option<&str> {
        self.text.inner().get(..self.span?.0)
    }

    /// Whether the lines of the place are short enough to be shown.
    fn shown(&self) -> bool {
        let Some((start, _)) = self.span else { return false };
        let text = self.text.inner().as_bytes();
        let (before, after) = text.split_at(start.min(text.len()));
        let end = |b: &u8| *b == b'\n';
        before.iter().rev().take(LINE).any(end) | (before.len() < LINE)
            && after.iter().take(LINE).any(end) | (after.len() < LINE)
    }

    /// The text at the place.
    pub fn excerpt(&self) -> Option<&str> {
        self.span.and_then(|(a, b)| self.text.inner().get(a..b))
    }
}

impl Diagnostic for TaskError {
    fn code<'a>(&'a self) -> Option<Box<dyn core::fmt::Display + 'a>> {
        Some(Box::new(self.problem.code()))
    }

    fn help<'a>(&'a self) -> Option<Box<dyn core::fmt::Display + 'a>> {
        let near = self.problem.nearest().map(|n| format!("nearest: `{n}`"));
        let place = self.line().zip(self.column()).filter(|_| !self.shown());
        let place =
            place.map(|(line, column)| format!("in {}, line {line}, column {column}", self.text.name()));
        let parts: Vec<String> = place.into_iter().chain(near).chain(self.problem.expected()).collect();
        (!parts.is_empty()).then(|| Box::new(parts.join("\n")) as Box<dyn core::fmt::Display>)
    }

    fn source_code(&self) -> Option<&dyn SourceCode> {
        self.shown().then_some(&self.text as &dyn SourceCode)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        let (start, end) = self.span.filter(|_| self.shown())?;
        let label = self.problem.nearest().map_or_else(|| "here".to_owned(), |n| format!("nearest: {n}"));
        Some(Box::new(core::iter::once(LabeledSpan::new(Some(label), start, end - start))))
    }
}

/// All problems found in a task, in order of the text.
#[derive(Debug, Error)]
#[error("{} problem{} in task {name}", problems.len(), if problems.len() == 1 { "" } else { "s" })]
pub struct TaskErrors {
    /// Name of the task file.
    pub name: String,
    /// The problems, at least one.
    pub problems: Vec<TaskError>,
}

impl Diagnostic for TaskErrors {
    fn related<'a>(&'a self) -> Option<Box<dyn Iterator<Item = &'a dyn Diagnostic> + 'a>> {
        Some(Box::new(self.problems.iter().map(|p| p as &dyn Diagnostic)))
    }
}

impl From<TaskError> for TaskErrors {
    fn from(e: TaskError) -> Self {
        Self { name: e.text.name().to_owned(), problems: vec![e] }
    }
}
