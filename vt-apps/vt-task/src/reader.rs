//! Typed values out of nodes: a serde deserializer whose errors know their place.

use core::fmt::Display;

use serde::de::value::StrDeserializer;
use serde::de::{
    Deserialize, DeserializeSeed, Deserializer, EnumAccess, Error, Expected, IntoDeserializer, MapAccess,
    SeqAccess, Unexpected, VariantAccess, Visitor,
};
use serde::forward_to_deserialize_any;

use crate::error::{Problem, short};
use crate::node::{Key, Node, Span, Value};

/// A problem, and its place once it is known.
#[derive(Debug, Clone, PartialEq)]
pub struct ReadError {
    /// What is wrong.
    pub problem: Box<Problem>,
    /// Where.
    pub span: Option<Span>,
}

impl ReadError {
    /// A problem at a place.
    pub fn at(problem: Problem, span: Span) -> Self {
        Self { problem: Box::new(problem), span: Some(span) }
    }

    fn or_at(mut self, span: Span) -> Self {
        self.span.get_or_insert(span);
        self
    }
}

impl core::fmt::Display for ReadError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        self.problem.fmt(f)
    }
}

impl core::error::Error for ReadError {}

impl From<Problem> for ReadError {
    fn from(problem: Problem) -> Self {
        Self { problem: Box::new(problem), span: None }
    }
}

fn owned(names: &[&str]) -> Vec<String> {
    names.iter().map(|&n| n.to_owned()).collect()
}

impl Error for ReadError {
    fn custom<T: Display>(message: T) -> Self {
        Problem::Value { found: "a value that is not allowed".into(), expected: message.to_string() }.into()
    }
    fn invalid_type(found: Unexpected<'_>, expected: &dyn Expected) -> Self {
        Problem::Value { found: short(&found.to_string()), expected: expected.to_string() }.into()
    }
    fn invalid_value(found: Unexpected<'_>, expected: &dyn Expected) -> Self {
        Self::invalid_type(found, expected)
    }
    fn invalid_length(found: usize, expected: &dyn Expected) -> Self {
        Problem::Value { found: format!("{found} elements"), expected: expected.to_string() }.into()
    }
    fn unknown_variant(found: &str, expected: &'static [&'static str]) -> Self {
        Problem::UnknownWord { found: short(found), expected: owned(expected) }.into()
    }
    fn unknown_field(found: &str, expected: &'static [&'static str]) -> Self {
        Problem::UnknownKey { found: short(found), expected: owned(expected) }.into()
    }
    fn missing_field(key: &'static str) -> Self {
        Problem::MissingKey { key: key.into() }.into()
    }
    fn duplicate_field(key: &'static str) -> Self {
        Problem::Duplicate { what: "key", name: key.into() }.into()
    }
}

/// Reads a value of type `T`.
///
/// # Errors
/// [`ReadError`] with the innermost place that is known.
pub fn read<'de, T: Deserialize<'de>>(node: &'de Node) -> Result<T, ReadError> {
    T::deserialize(node)
}

impl<'de> Deserializer<'de> for &'de Node {
    type Error = ReadError;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ReadError> {
        match &self.value {
            Value::Bool(b) => visitor.visit_bool(*b),
            Value::Integer(i) => visitor.visit_i64(*i),
            Value::Float(f) => visitor.visit_f64(*f),
            Value::String(s) => visitor.visit_borrowed_str(s),
            Value::Array(a) => {
                let mut rest = Elements(a.iter());
                let value = visitor.visit_seq(&mut rest).map_err(|e| e.or_at(self.span))?;
                match rest.0.len() {
                    0 => Ok(value),
                    n => {
                        Err(ReadError::invalid_length(a.len(), &format!("{} elements", a.len() - n).as_str()))
                    }
                }
            }
            Value::Table(t) => visitor.visit_map(Entries(t.iter(), None)),
        }
        .map_err(|e| e.or_at(self.span))
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ReadError> {
        visitor.visit_some(self)
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        v: V,
    ) -> Result<V::Value, ReadError> {
        v.visit_newtype_struct(self)
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _: &'static str,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, ReadError> {
        let found = match &self.value {
            Value::String(s) => return visitor.visit_enum(Word(s)).map_err(|e| e.or_at(self.span)),
            Value::Table(t) if t.len() == 1 => return visitor.visit_enum(Tagged(&t[0].0, &t[0].1)),
            Value::Bool(b) => Unexpected::Bool(*b),
            Value::Integer(i) => Unexpected::Signed(*i),
            Value::Float(f) => Unexpected::Float(*f),
            Value::Array(_) => Unexpected::Seq,
            Value::Table(_) => Unexpected::Map,
        };
        Err(ReadError::invalid_type(found, &"a word").or_at(self.span))
    }

    /// A list has no keys, so it is no struct.
    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, ReadError> {
        match &self.value {
            Value::Array(_) => {
                Err(ReadError::invalid_type(Unexpected::Seq, &"a table with keys").or_at(self.span))
            }
            _ => self.deserialize_any(visitor),
        }
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf unit unit_struct seq
        tuple tuple_struct map identifier ignored_any
    }
}

struct Elements<'de>(core::slice::Iter<'de, Node>);

impl<'de> SeqAccess<'de> for &mut Elements<'de> {
    type Error = ReadError;
    fn next_element_seed<T: DeserializeSeed<'de>>(&mut self, seed: T) -> Result<Option<T::Value>, ReadError> {
        self.0.next().map(|node| seed.deserialize(node)).transpose()
    }
    fn size_hint(&self) -> Option<usize> {
        Some(self.0.len())
    }
}

struct Entries<'de>(core::slice::Iter<'de, (Key, Node)>, Option<&'de Node>);

impl<'de> MapAccess<'de> for Entries<'de> {
    type Error = ReadError;

    fn next_key_seed<K: DeserializeSeed<'de>>(&mut self, seed: K) -> Result<Option<K::Value>, ReadError> {
        let Some((key, node)) = self.0.next() else { return Ok(None) };
        self.1 = Some(node);
        let name: StrDeserializer<'_, ReadError> = key.name.as_str().into_deserializer();
        seed.deserialize(name).map(Some).map_err(|e| e.or_at(key.span))
    }

    fn next_value_seed<V: DeserializeSeed<'de>>(&mut self, seed: V) -> Result<V::Value, ReadError> {
        match self.1.take() {
            Some(node) => seed.deserialize(node).map_err(|e| e.or_at(node.span)),
            None => Err(ReadError::custom("a key before its value")),
        }
    }
}

struct Word<'de>(&'de str);

impl<'de> EnumAccess<'de> for Word<'de> {
    type Error = ReadError;
    type Variant = Self;
    fn variant_seed<V: DeserializeSeed<'de>>(self, seed: V) -> Result<(V::Value, Self), ReadError> {
        let name: StrDeserializer<'_, ReadError> = self.0.into_deserializer();
        Ok((seed.deserialize(name)?, self))
    }
}

impl<'de> VariantAccess<'de> for Word<'de> {
    type Error = ReadError;
    fn unit_variant(self) -> Result<(), ReadError> {
        Ok(())
    }
    fn newtype_variant_seed<T: DeserializeSeed<'de>>(self, _: T) -> Result<T::Value, ReadError> {
        Err(ReadError::invalid_type(Unexpected::Str(self.0), &"a table with this word as its only key"))
    }
    fn tuple_variant<V: Visitor<'de>>(self, _: usize, _: V) -> Result<V::Value, ReadError> {
        Err(ReadError::invalid_type(Unexpected::Str(self.0), &"a table with this word as its only key"))
    }
    fn struct_variant<V: Visitor<'de>>(
        self,
        _: &'static [&'static str],
        _: V,
    ) -> Result<V::Value, ReadError> {
        Err(ReadError::invalid_type(Unexpected::Str(self.0), &"a table with this word as its only key"))
    }
}

struct Tagged<'de>(&'de Key, &'de Node);

impl<'de> EnumAccess<'de> for Tagged<'de> {
    type Error = ReadError;
    type Variant = &'de Node;
    fn variant_seed<V: DeserializeSeed<'de>>(self, seed: V) -> Result<(V::Value, &'de Node), ReadError> {
        let name: StrDeserializer<'_, ReadError> = self.0.name.as_str().into_deserializer();
        Ok((seed.deserialize(name).map_err(|e| e.or_at(self.0.span))?, self.1))
    }
}

impl<'de> VariantAccess<'de> for &'de Node {
    type Error = ReadError;
    fn unit_variant(self) -> Result<(), ReadError> {
        Err(ReadError::invalid_type(Unexpected::Map, &"the bare word").or_at(self.span))
    }
    fn newtype_variant_seed<T: DeserializeSeed<'de>>(self, seed: T) -> Result<T::Value, ReadError> {
        seed.deserialize(self)
    }
    fn tuple_variant<V: Visitor<'de>>(self, _: usize, visitor: V) -> Result<V::Value, ReadError> {
        self.deserialize_any(visitor)
    }
    fn struct_variant<V: Visitor<'de>>(
        self,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, ReadError> {
        self.deserialize_any(visitor)
    }
}
