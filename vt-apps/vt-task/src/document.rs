//! The text of a task with overrides applied and variables filled in, before it is read as a [`Task`].

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use toml::de::{DeTable, DeValue};

use crate::error::{Problem, TaskError, TaskErrors, short};
use crate::language::{FilePath, Task};
use crate::node::{Key, Node, Span, Value, element};
use crate::reader::{ReadError, read};

/// Nested variables are followed this deep before they count as a circle.
const DEPTH: usize = 16;

/// Most bytes of a task file, and of what its variables stand for all together.
const MOST: u64 = 16 << 20;

/// Most keys of a `--set`; what walks over the tree is recursive. The parser of files has a limit of its own.
const NESTING: usize = 64;

/// A parsed task text: tree, sources for messages, and the folder that relative paths start from.
#[derive(Clone, Debug)]
pub struct Document {
    sources: Vec<(String, Arc<String>)>,
    root: Node,
    base: PathBuf,
}

impl Document {
    /// Reads a task file, applies `--set` arguments and fills in variables, from the environment too.
    ///
    /// # Errors
    /// [`TaskErrors`] with place, found, expected and nearest name.
    pub fn load(path: &Path, set: &[String]) -> Result<Self, TaskErrors> {
        let name = path.display().to_string();
        let text = vt_core::file::read_text(path, MOST).map_err(|e| {
            let problem = Problem::Unreadable { path: path.to_owned(), why: e.to_string() };
            TaskError::new(problem, &[(name.clone(), Arc::default())], None)
        })?;
        let base = path.parent().map(Path::to_owned).unwrap_or_default();
        Self::parse(&name, &text, &base, set, &|variable| std::env::var(variable).ok())
    }

    /// Parses a text called `name`; relative paths start from `base`, variables that the task does not define come
    /// from `environment`.
    ///
    /// # Errors
    /// [`TaskErrors`] with place, found, expected and nearest name.
    pub fn parse(
        name: &str,
        text: &str,
        base: &Path,
        set: &[String],
        environment: &dyn Fn(&str) -> Option<String>,
    ) -> Result<Self, TaskErrors> {
        let mut sources = vec![(name.to_owned(), Arc::new(text.to_owned()))];
        let root = DeTable::parse(text).map_err(|e| {
            let span = e.span().or_else(|| {
                // Keys that are too deep come without a place: they are the line that alone has none, too.
                let mut lines = text.split_inclusive('\n').scan(0, |at, line| {
                    *at += line.len();
                    Some((*at - line.len(), line))
                });
                let placeless = |line: &str| DeTable::parse(line).is_err_and(|e| e.span().is_none());
                lines.find(|(_, line)| placeless(line)).map(|(at, line)| at..at + line.trim_end().len())
            });
            let span = span.map(|r| Span { source: 0, start: r.start, end: r.end });
            TaskError::new(Problem::Syntax(e.message().to_owned()), &sources, span)
        })?;
        let table = DeValue::Table(root.into_inner());
        let mut document = Self { root: Node::new(0..0, &table, 0), sources: vec![], base: base.to_owned() };
        sources.extend(set.iter().map(|s| (format!("--set {}", short(s)), Arc::new(s.clone()))));
        document.sources = sources;
        for (k, argument) in set.iter().enumerate() {
            document.set(k + 1, argument).map_err(|p| {
                let span = Span { source: k + 1, start: 0, end: argument.len() };
                document.error(ReadError::at(p, span))
            })?;
        }
        document.expand(environment).map_err(|e| document.error(e))?;
        Ok(document)
    }

    /// The printed text of a task made in code, as a document.
    ///
    /// # Errors
    /// As for [`Document::parse`].
    pub fn of(task: &Task, base: &Path) -> Result<Self, TaskErrors> {
        Self::parse("task", &task.print(), base, &[], &|_| None)
    }

    /// The task in this text, as far as its form goes; [`crate::check::check`] does the rest.
    ///
    /// # Errors
    /// [`TaskErrors`].
    pub fn task(&self) -> Result<Task, TaskErrors> {
        match self.root.get("version").map(|n| (&n.value, n.span)) {
            Some((Value::Integer(1), _)) => {}
            Some((value, span)) => {
                let found = match value {
                    Value::Integer(i) => i.to_string(),
                    Value::String(s) => format!("\"{s}\""),
                    _ => "not a number".to_owned(),
                };
                return Err(self.error(ReadError::at(Problem::Version { found }, span)).into());
            }
            None => {
                let start = Span { source: 0, start: 0, end: self.sources[0].1.find('\n').unwrap_or(0) };
                let problem = Problem::Version { found: "of the language is not given".into() };
                return Err(self.error(ReadError::at(problem, start)).into());
            }
        }
        read(&self.root).map_err(|e| self.error(e).into())
    }

    /// Where an error of the reader lies in the text.
    pub fn error(&self, e: ReadError) -> TaskError {
        TaskError::new(*e.problem, &self.sources, e.span)
    }

    /// An error at the node of a dotted path, or at the nearest one that exists.
    pub fn error_at(&self, path: &str, problem: Problem) -> TaskError {
        TaskError::new(problem, &self.sources, Some(self.root.deepest(path).span))
    }

    /// The tree.
    pub fn root(&self) -> &Node {
        &self.root
    }

    /// Name of the task file.
    pub fn name(&self) -> &str {
        &self.sources[0].0
    }

    /// Folder that relative paths start from.
    pub fn base(&self) -> &Path {
        &self.base
    }

    /// The path of a file named in the task.
    pub fn resolve(&self, file: &FilePath) -> PathBuf {
        self.base.join(&file.0)
    }

    /// Applies one `KEY=VALUE`. A value that is no TOML value is taken as text. A new `kind` drops the `params` of the
    /// old one, since they belong to it.
    fn set(&mut self, source: usize, argument: &str) -> Result<(), Problem> {
        let fail = |why: &str, found: &str, known: Vec<String>| Problem::Override {
            set: short(argument),
            why: why.into(),
            known,
            found: short(found),
        };
        let Some((path, value)) = argument.split_once('=') else {
            return Err(fail("no `=`", argument, vec![]));
        };
        let path = path.trim();
        if path.is_empty() || path.split('.').any(str::is_empty) {
            return Err(fail("empty key", path, vec![]));
        }
        let start = argument.len() - value.len();
        let whole = Span { source, start, end: argument.len() };
        let mut new = match DeValue::parse(value.trim()) {
            Ok(v) => Node::new(0..0, v.get_ref(), source),
            Err(_) => Node { span: whole, value: Value::String(value.to_owned()) },
        };
        relocate(&mut new, whole);
        let keys: Vec<&str> = path.split('.').collect();
        if keys.len() > NESTING {
            return Err(fail(&format!("more than {NESTING} keys"), path, vec![]));
        }
        let mut node = &mut self.root;
        let mut offset = 0;
        for (k, &key) in keys.iter().enumerate() {
            let place = Span { source, start: offset, end: offset + key.len() };
            offset += key.len() + 1;
            let last = k + 1 == keys.len();
            node = match &mut node.value {
                Value::Table(table) => {
                    if last && key == "kind" {
                        let same = table.iter().any(|(k, v)| k.name == "kind" && v.text() == new.text());
                        table.retain(|(k, _)| same || k.name != "params");
                    }
                    let index = table.iter().position(|(k, _)| k.name == key).unwrap_or_else(|| {
                        table.push((Key { span: place, name: key.into() }, Node::empty(place)));
                        table.len() - 1
                    });
                    &mut table[index].1
                }
                Value::Array(list) => {
                    let Some(index) = element(list, key) else {
                        let names = list
                            .iter()
                            .filter_map(|n| n.get("name").or(n.get("kind"))?.text().map(str::to_owned));
                        let known = names.chain((0..list.len()).map(|k| k.to_string())).collect();
                        return Err(fail(&format!("no element `{key}`"), key, known));
                    };
                    &mut list[index]
                }
                _ => {
                    return Err(fail(
                        &format!("`{}` is a value, not a table", keys[..k].join(".")),
                        key,
                        vec![],
                    ));
                }
            };
        }
        *node = new;
        Ok(())
    }

    fn expand(&mut self, environment: &dyn Fn(&str) -> Option<String>) -> Result<(), ReadError> {
        let mut variables = BTreeMap::new();
        if let Some(Value::Table(t)) = self.root.get("variables").map(|n| &n.value) {
            variables.extend(t.iter().filter_map(|(k, v)| Some((k.name.clone(), v.text()?.to_owned()))));
        }
        Filling { variables: &variables, environment, left: MOST as usize }.expand(&mut self.root)
    }
}

/// All parts of the value of a `--set` lie in that argument.
fn relocate(node: &mut Node, span: Span) {
    node.span = span;
    match &mut node.value {
        Value::Array(a) => a.iter_mut().for_each(|n| relocate(n, span)),
        Value::Table(t) => t.iter_mut().for_each(|(k, n)| {
            k.span = span;
            relocate(n, span);
        }),
        _ => {}
    }
}

/// Filling in the variables of a document.
struct Filling<'a> {
    variables: &'a BTreeMap<String, String>,
    environment: &'a dyn Fn(&str) -> Option<String>,
    /// Bytes that variables may still bring.
    left: usize,
}

impl Filling<'_> {
    /// Fills in the variables of all texts, and refuses numbers that are not finite.
    fn expand(&mut self, node: &mut Node) -> Result<(), ReadError> {
        match &mut node.value {
            Value::String(s) => *s = self.filled(s, 0).map_err(|p| ReadError::at(p, node.span))?,
            Value::Float(f) if !f.is_finite() => {
                let problem = Problem::Value { found: f.to_string(), expected: "a finite number".into() };
                return Err(ReadError::at(problem, node.span));
            }
            Value::Array(a) => a.iter_mut().try_for_each(|n| self.expand(n))?,
            Value::Table(t) => t.iter_mut().try_for_each(|(_, n)| self.expand(n))?,
            _ => {}
        }
        Ok(())
    }

    /// `${NAME}` is the value of a variable, `$${` a dollar sign with a brace.
    fn filled(&mut self, text: &str, depth: usize) -> Result<String, Problem> {
        let mut out = String::new();
        let mut rest = text;
        while let Some(at) = rest.find('$') {
            out.push_str(&rest[..at]);
            rest = &rest[at..];
            if let Some(after) = rest.strip_prefix("$${") {
                out.push_str("${");
                rest = after;
                continue;
            }
            let Some(inner) = rest.strip_prefix("${") else {
                out.push('$');
                rest = &rest[1..];
                continue;
            };
            let Some(end) = inner.find('}') else {
                let expected = "a closing `}` after `${`, or `$${` for the characters themselves".into();
                return Err(Problem::Value { found: format!("\"{text}\""), expected });
            };
            out.push_str(&self.variable(&inner[..end], depth)?);
            rest = &inner[end + 1..];
        }
        out.push_str(rest);
        Ok(out)
    }

    fn variable(&mut self, name: &str, depth: usize) -> Result<String, Problem> {
        let refuse = |found: &str, expected: &str| {
            Err(Problem::Value { found: format!("`${{{name}}}` {found}"), expected: expected.into() })
        };
        if depth == DEPTH {
            return refuse("again and again", "variables that do not refer to themselves");
        }
        let value = match self.variables.get(name) {
            Some(value) => self.filled(value, depth + 1)?,
            None => (self.environment)(name).ok_or_else(|| Problem::Variable {
                name: name.into(),
                known: self.variables.keys().cloned().collect(),
            })?,
        };
        // An empty value costs, too: variables of variables multiply.
        match self.left.checked_sub(1 + value.len()) {
            Some(left) => self.left = left,
            None => return refuse("too often", &format!("at most {MOST} bytes out of variables")),
        }
        Ok(value)
    }
}
