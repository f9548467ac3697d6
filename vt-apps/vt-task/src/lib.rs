#![doc = include_str!("../README.md")]

pub mod assembly;
pub mod check;
pub mod document;
pub mod error;
pub mod explain;
pub mod geometry;
pub mod language;
pub mod nearest;
pub mod node;
mod products;
pub mod quantity;
pub mod reader;
pub mod registry;
pub mod roles;
pub mod scenarios;
pub mod schema;
pub mod standard;

pub use check::check;
pub use document::Document;
pub use error::{Problem, TaskError, TaskErrors};
pub use language::Task;
pub use registry::Registry;
