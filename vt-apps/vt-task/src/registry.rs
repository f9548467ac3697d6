//! The registry: which methods there are for each role, what they take, what they can do and how they are built.
//!
//! A method is one line: its name, one sentence, its capabilities and a function from typed parameters to the
//! product of its role. The schema comes from the parameter type. Methods of other crates are added in the same way,
//! see [`Registry::with`].

use core::any::{Any, TypeId};
use std::collections::HashMap;
use std::sync::Arc;

use nalgebra::{DefaultAllocator, DimAdd, DimSum};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::Serialize;
use serde::de::DeserializeOwned;
use vt_core::error::ConfigError;
use vt_core::manifold::Coordinates;

use crate::assembly::{TargetBuilder, build_target};

use crate::error::Problem;
use crate::language::{FilePath, Level, Picture};
use crate::node::{Node, Span, Value};
use crate::reader::{ReadError, read};
use crate::roles::StateAlloc;

/// A place in the system for which methods can be chosen. `Context` is what building needs besides the parameters.
pub trait Role: 'static {
    /// Name in messages and listings.
    const NAME: &'static str;
    /// Key of the role in the JSON Schema.
    const KEY: &'static str;
    /// Pose space its methods are made for; `None` where poses do not matter.
    const SPACE: Option<&'static str> = None;
    /// What a method builds.
    type Product;
    /// What it builds from, besides its parameters.
    type Context<'a>;
}

/// Parameters of a method, as a task file gives them.
pub trait Params: DeserializeOwned + Serialize + JsonSchema + Send + Sync + 'static {
    /// Checks ranges before the first frame; the error names the key.
    ///
    /// # Errors
    /// [`ConfigError`].
    fn check(&self) -> Result<(), ConfigError> {
        Ok(())
    }

    /// Files and folders that must exist, with the dotted key inside the parameters.
    fn files(&self) -> Vec<(String, FilePath)> {
        vec![]
    }

    /// References to other parts of the task.
    fn names(&self) -> Vec<Reference> {
        vec![]
    }
}

/// A reference of parameters to a part of the task.
#[derive(Clone, Debug, PartialEq)]
pub struct Reference {
    /// Dotted key inside the parameters.
    pub key: &'static str,
    /// What is referred to.
    pub to: Referent,
    /// Its name.
    pub name: String,
}

/// What can be referred to by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Referent {
    /// A sensor.
    Sensor,
    /// A model.
    Model,
    /// A target.
    Target,
}

/// Parameters of methods that have none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, serde::Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NoParams {}

impl Params for NoParams {}

/// What a method can do and needs, checked before the first frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Capabilities {
    /// Levels: those a modality can measure at, or an estimator or fusion can take. Empty: levels do not matter.
    pub levels: Vec<Level>,
    /// True when the sensor must be calibrated.
    pub calibrated: bool,
    /// The payload it needs, where it matters.
    pub picture: Option<Picture>,
}

/// A line of the registry's table.
#[derive(Clone, Debug, PartialEq)]
pub struct Listing {
    /// Role, as in messages.
    pub role: &'static str,
    /// Key of the role in the schema.
    pub key: &'static str,
    /// Name of the method in task files.
    pub kind: String,
    /// One line of description.
    pub about: String,
    /// What it can do and needs.
    pub capabilities: Capabilities,
    /// Pose spaces it is made for; empty where poses do not matter.
    pub spaces: Vec<&'static str>,
}

type Check = dyn Fn(&Node) -> Result<Checked, ReadError> + Send + Sync;
type Build<R> =
    dyn for<'a> Fn(&Node, <R as Role>::Context<'a>) -> Result<<R as Role>::Product, BuildError> + Send + Sync;

/// What checking the parameters of a method brought to light, for the checks that need the whole task.
#[derive(Clone, Debug, Default)]
pub struct Checked {
    /// Files that must exist.
    pub files: Vec<(String, FilePath)>,
    /// Names that must exist.
    pub names: Vec<Reference>,
}

/// A method could not be built.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BuildError {
    /// The parameters cannot be read; caught by checking.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// The parts do not fit together.
    #[error(transparent)]
    Config(#[from] ConfigError),
}

/// One method of the role `R`.
pub struct Method<R: Role> {
    listing: Listing,
    check: Arc<Check>,
    schema: fn(&mut SchemaGenerator) -> Schema,
    build: Box<Build<R>>,
}

impl<R: Role> Method<R> {
    /// A method called `kind`, described in one line, and built by `build` from its typed parameters.
    pub fn new<P: Params>(
        kind: &str,
        about: &str,
        build: impl for<'a> Fn(P, R::Context<'a>) -> Result<R::Product, ConfigError> + Send + Sync + 'static,
    ) -> Self {
        let listing = Listing {
            role: R::NAME,
            key: R::KEY,
            kind: kind.into(),
            about: about.into(),
            capabilities: Capabilities::default(),
            spaces: R::SPACE.into_iter().collect(),
        };
        Self {
            listing,
            check: Arc::new(|node| {
                let params: P = read(node)?;
                params.check().map_err(|e| located(e, node))?;
                Ok(Checked { files: params.files(), names: params.names() })
            }),
            schema: |generator| generator.subschema_for::<P>(),
            build: Box::new(move |node, context| Ok(build(read(node)?, context)?)),
        }
    }

    /// Levels it can measure at or take.
    #[must_use]
    pub fn levels(mut self, levels: &[Level]) -> Self {
        self.listing.capabilities.levels = levels.to_vec();
        self
    }

    /// Needs a calibrated sensor.
    #[must_use]
    pub fn calibrated(mut self) -> Self {
        self.listing.capabilities.calibrated = true;
        self
    }

    /// Needs this payload.
    #[must_use]
    pub fn picture(mut self, picture: Picture) -> Self {
        self.listing.capabilities.picture = Some(picture);
        self
    }

    /// Is for targets of these pose spaces alone.
    #[must_use]
    pub fn spaces(mut self, spaces: &[&'static str]) -> Self {
        self.listing.spaces = spaces.to_vec();
        self
    }

    /// Its line in the table.
    pub fn listing(&self) -> &Listing {
        &self.listing
    }

    /// Builds it from the parameters at `node`.
    ///
    /// # Errors
    /// [`BuildError`].
    pub fn build(&self, node: &Node, context: R::Context<'_>) -> Result<R::Product, BuildError> {
        (self.build)(node, context)
    }
}

/// An error of a parameter, at its key.
pub(crate) fn located(e: ConfigError, node: &Node) -> ReadError {
    match e {
        ConfigError::Parameter { key, found, expected } => {
            ReadError::at(Problem::Value { found, expected }, node.deepest(key).span)
        }
        ConfigError::Mismatch { found, expected } => {
            ReadError::at(Problem::Mismatch { found, expected }, node.span)
        }
        e => ReadError::at(
            Problem::Mismatch { found: e.to_string(), expected: "parts that fit".into() },
            node.span,
        ),
    }
}

/// A listing with its erased check, for code that does not know the role's types.
struct Row {
    listing: Listing,
    check: Arc<Check>,
    schema: fn(&mut SchemaGenerator) -> Schema,
}

/// All methods there are.
#[derive(Default)]
pub struct Registry {
    rows: Vec<Row>,
    // One `Vec<Method<R>>` for each role; found by type, never iterated.
    methods: HashMap<TypeId, Box<dyn Any + Send + Sync>>,
    builders: Vec<(&'static str, TargetBuilder)>,
}

impl Registry {
    /// A registry without methods.
    pub fn empty() -> Self {
        Self::default()
    }

    /// This registry with one method more. A method of the same role, pose space and name is replaced.
    ///
    /// ```
    /// use vt_core::error::ConfigError;
    /// use vt_task::registry::{Method, NoParams, Registry};
    /// use vt_task::roles::{Association, AssociationProduct};
    ///
    /// fn mine(_: NoParams, _: ()) -> Result<AssociationProduct, ConfigError> {
    ///     Ok(AssociationProduct::OneToOne)
    /// }
    /// let registry = Registry::standard().with(Method::<Association>::new("mine", "does what I want", mine));
    /// assert!(registry.listings().iter().any(|l| l.kind == "mine"));
    /// ```
    #[must_use]
    pub fn with<R: Role>(mut self, method: Method<R>) -> Self {
        let row = Row { listing: method.listing.clone(), check: method.check.clone(), schema: method.schema };
        let same = |l: &Listing| {
            (l.role, &l.kind, &l.spaces) == (row.listing.role, &row.listing.kind, &row.listing.spaces)
        };
        match self.rows.iter().position(|r| same(&r.listing)) {
            Some(k) => self.rows[k] = row,
            None => self.rows.push(row),
        }
        let table =
            self.methods.entry(TypeId::of::<R>()).or_insert_with(|| Box::new(Vec::<Method<R>>::new()));
        if let Some(table) = table.downcast_mut::<Vec<Method<R>>>() {
            table.retain(|m| m.listing.kind != method.listing.kind);
            table.push(method);
        }
        self
    }

    /// This registry with targets of one pose space more. Warps, motion models, inits, modalities and estimators of
    /// that space are added by [`Registry::with`].
    #[must_use]
    pub fn with_space<P: Coordinates>(mut self) -> Self
    where
        P::D: DimAdd<P::D>,
        DimSum<P::D, P::D>: DimAdd<P::D>,
        DefaultAllocator: StateAlloc<P::D>,
    {
        self.builders.retain(|(space, _)| *space != P::SPACE);
        self.builders.push((P::SPACE, build_target::<P>));
        self
    }

    /// Builds targets of a pose space.
    pub(crate) fn target_builder(&self, space: &str) -> Option<TargetBuilder> {
        self.builders.iter().find(|(s, _)| *s == space).map(|(_, b)| *b)
    }

    /// The method `kind` of the role `R`.
    pub fn method<R: Role>(&self, kind: &str) -> Option<&Method<R>> {
        let table: &Vec<Method<R>> = self.methods.get(&TypeId::of::<R>())?.downcast_ref()?;
        table.iter().find(|m| m.listing.kind == kind)
    }

    /// Builds what the node with `kind` and `params` chooses.
    ///
    /// # Errors
    /// [`ReadError`] with its place.
    pub fn build<R: Role>(&self, node: &Node, context: R::Context<'_>) -> Result<R::Product, ReadError> {
        let kind = node.get("kind").and_then(Node::text).unwrap_or_default();
        let method = self.method::<R>(kind).ok_or_else(|| self.unknown(R::KEY, R::NAME, node))?;
        let none = Node::empty(node.span);
        let params = node.get("params").unwrap_or(&none);
        method.build(params, context).map_err(|e| match e {
            BuildError::Read(e) => e,
            BuildError::Config(e) => located(e, params),
        })
    }

    /// The table, one line for each role and kind, in order of registration; pose spaces are united.
    pub fn listings(&self) -> Vec<Listing> {
        let mut out: Vec<Listing> = vec![];
        for row in &self.rows {
            let l = &row.listing;
            match out.iter_mut().find(|o| o.role == l.role && o.kind == l.kind) {
                Some(o) => {
                    o.spaces.extend(l.spaces.iter().filter(|s| !o.spaces.contains(s)).collect::<Vec<_>>())
                }
                None => out.push(l.clone()),
            }
        }
        out
    }

    /// Checks the choice at `node` for the role with this key in the pose space `space` (where it matters) and
    /// returns its line with what is left to check.
    ///
    /// # Errors
    /// [`ReadError`]: unknown kind, bad parameters, or a method of another pose space.
    pub fn check(
        &self,
        key: &str,
        role: &str,
        space: Option<&str>,
        node: &Node,
    ) -> Result<(Listing, Checked), ReadError> {
        let kind = node.get("kind").and_then(Node::text).unwrap_or_default();
        let rows: Vec<&Row> =
            self.rows.iter().filter(|r| r.listing.key == key && r.listing.kind == kind).collect();
        let Some(first) = rows.first() else { return Err(self.unknown(key, role, node)) };
        let fits =
            |r: &&&Row| space.is_none_or(|s| r.listing.spaces.is_empty() || r.listing.spaces.contains(&s));
        let Some(row) = rows.iter().find(fits) else {
            let has: Vec<_> = rows.iter().flat_map(|r| r.listing.spaces.iter().copied()).collect();
            let problem = Problem::Mismatch {
                found: format!("{role} `{}` of pose space {}", first.listing.kind, has.join(", ")),
                expected: format!("one of pose space {}, which the model's warp has", space.unwrap_or("any")),
            };
            return Err(ReadError::at(problem, kind_span(node)));
        };
        let none = Node::empty(node.span);
        let params = node.get("params").unwrap_or(&none);
        if !matches!(params.value, Value::Table(_)) {
            let problem =
                Problem::Value { found: "no table".into(), expected: "a table of parameters".into() };
            return Err(ReadError::at(problem, params.span));
        }
        let checked = (row.check)(params)?;
        Ok((row.listing.clone(), checked))
    }

    fn unknown(&self, key: &str, role: &str, node: &Node) -> ReadError {
        let found = node.get("kind").and_then(Node::text).unwrap_or_default().to_owned();
        let kinds = self.listings().into_iter().filter(|l| l.key == key).map(|l| l.kind).collect();
        ReadError::at(Problem::UnknownKind { role: role.into(), found, expected: kinds }, kind_span(node))
    }

    /// Kinds and parameter schemas of the role with this key; where a kind has other parameters in other pose spaces,
    /// any of them.
    pub(crate) fn schemas(&self, key: &str, generator: &mut SchemaGenerator) -> Vec<(Listing, Schema)> {
        let mut out: Vec<(Listing, Vec<Schema>)> = vec![];
        for row in self.rows.iter().filter(|r| r.listing.key == key) {
            let schema = (row.schema)(generator);
            match out.iter_mut().find(|(l, _)| l.kind == row.listing.kind) {
                Some((_, schemas)) if schemas.contains(&schema) => {}
                Some((_, schemas)) => schemas.push(schema),
                None => out.push((row.listing.clone(), vec![schema])),
            }
        }
        let any = |mut schemas: Vec<Schema>| match schemas.len() {
            1 => schemas.remove(0),
            _ => json_schema!({ "anyOf": schemas }),
        };
        out.into_iter().map(|(listing, schemas)| (listing, any(schemas))).collect()
    }
}

fn kind_span(node: &Node) -> Span {
    node.get("kind").map_or(node.span, |k| k.span)
}
