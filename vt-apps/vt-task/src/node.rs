//! The tree of a task's text: values that know where they were written.

use toml::de::DeValue;

/// Bytes of one of the texts of a document.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Span {
    /// 0 for the task file, `k` for the `k`-th `--set`.
    pub source: usize,
    /// First byte.
    pub start: usize,
    /// Byte after the last.
    pub end: usize,
}

/// A value and its place.
#[derive(Clone, Debug)]
pub struct Node {
    /// Where it was written; for a table the header or the braces.
    pub span: Span,
    /// The value.
    pub value: Value,
}

/// A value of a task.
#[derive(Clone, Debug)]
pub enum Value {
    /// True or false.
    Bool(bool),
    /// Whole number.
    Integer(i64),
    /// Number.
    Float(f64),
    /// Text.
    String(String),
    /// List.
    Array(Vec<Node>),
    /// Keys and values in the order of the text.
    Table(Vec<(Key, Node)>),
}

/// A key and its place.
#[derive(Clone, Debug)]
pub struct Key {
    /// Where it was written.
    pub span: Span,
    /// Its name.
    pub name: String,
}

impl Node {
    /// Takes over a value of the parser. Dates become text, since no key of the language is a date.
    pub(crate) fn new(span: core::ops::Range<usize>, value: &DeValue<'_>, source: usize) -> Self {
        let at = |r: core::ops::Range<usize>| Span { source, start: r.start, end: r.end };
        let value = match value {
            DeValue::String(s) => Value::String(s.to_string()),
            DeValue::Boolean(b) => Value::Bool(*b),
            DeValue::Datetime(d) => Value::String(d.to_string()),
            // Integers beyond 64 bits go on as text, and are refused where a number is expected.
            DeValue::Integer(i) => i64::from_str_radix(i.as_str(), i.radix())
                .map_or_else(|_| Value::String(i.as_str().to_owned()), Value::Integer),
            DeValue::Float(f) => {
                f.as_str().parse().map_or_else(|_| Value::String(f.as_str().to_owned()), Value::Float)
            }
            DeValue::Array(a) => {
                Value::Array(a.iter().map(|v| Self::new(v.span(), v.get_ref(), source)).collect())
            }
            DeValue::Table(t) => Value::Table(
                t.iter()
                    .map(|(k, v)| {
                        let key = Key { span: at(k.span()), name: k.get_ref().to_string() };
                        (key, Self::new(v.span(), v.get_ref(), source))
                    })
                    .collect(),
            ),
        };
        Self { span: at(span), value }
    }

    /// An empty table at this place.
    pub fn empty(span: Span) -> Self {
        Self { span, value: Value::Table(vec![]) }
    }

    /// The value of a key of a table, or of an element of a list by its number or by its `name`.
    pub fn get(&self, key: &str) -> Option<&Self> {
        match &self.value {
            Value::Table(t) => t.iter().find(|(k, _)| k.name == key).map(|(_, v)| v),
            Value::Array(a) => element(a, key).map(|k| &a[k]),
            _ => None,
        }
    }

    /// The element of a list with this number.
    pub fn nth(&self, k: usize) -> Option<&Self> {
        match &self.value {
            Value::Array(a) => a.get(k),
            _ => None,
        }
    }

    /// The node at a dotted path of keys, numbers and names.
    pub fn at(&self, path: &str) -> Option<&Self> {
        path.split('.').filter(|s| !s.is_empty()).try_fold(self, |node, key| node.get(key))
    }

    /// The nearest existing node on the way to `path`.
    pub fn deepest(&self, path: &str) -> &Self {
        let mut node = self;
        for key in path.split('.').filter(|s| !s.is_empty()) {
            match node.get(key) {
                Some(next) => node = next,
                None => break,
            }
        }
        node
    }

    /// The text, when this is one.
    pub fn text(&self) -> Option<&str> {
        match &self.value {
            Value::String(s) => Some(s),
            _ => None,
        }
    }
}

/// Index of the element of a list that is meant by its `name`, by its `kind` where it has no name, or by a number.
pub(crate) fn element(list: &[Node], key: &str) -> Option<usize> {
    let text = |n: &Node, k: &str| n.get(k).and_then(Node::text) == Some(key);
    let is = |n: &Node| {
        matches!(n.value, Value::Table(_)) && (text(n, "name") || n.get("name").is_none() && text(n, "kind"))
    };
    list.iter().position(is).or_else(|| key.parse().ok().filter(|&k: &usize| k < list.len()))
}
