//! The JSON Schema of the language with all methods of a registry.

use schemars::generate::SchemaSettings;
use schemars::{Schema, SchemaGenerator, json_schema};
use serde_json::{Map, Value, json};

use crate::language::Task;
use crate::registry::Registry;

/// The JSON Schema (2020-12) of task files with the methods of `registry`.
pub fn schema(registry: &Registry) -> Value {
    let mut generator = SchemaSettings::draft2020_12().into_generator();
    let mut roles: Vec<&'static str> = registry.listings().iter().map(|l| l.key).collect();
    roles.sort_unstable();
    roles.dedup();
    let mut defs = Map::new();
    for key in ROLES.iter().chain(roles.iter().filter(|r| !ROLES.contains(r))) {
        let methods = registry.schemas(key, &mut generator);
        let variants: Vec<Value> = methods
            .iter()
            .map(|(l, params)| {
                json!({
                    "type": "object", "description": l.about, "required": ["kind"],
                    "properties": { "kind": { "const": l.kind }, "params": params },
                    "additionalProperties": false,
                })
            })
            .collect();
        defs.insert(
            format!("role-{key}"),
            if variants.is_empty() { json!(false) } else { json!({ "oneOf": variants }) },
        );
        let kinds: Vec<Value> =
            methods.iter().map(|(l, _)| json!({ "const": l.kind, "description": l.about })).collect();
        let rules: Vec<Value> = methods
            .iter()
            .map(|(l, params)| {
                json!({
                    "if": { "properties": { "kind": { "const": l.kind } } },
                    "then": { "properties": { "params": params } },
                })
            })
            .collect();
        defs.insert(
            format!("kinds-{key}"),
            if kinds.is_empty() { json!(false) } else { json!({ "oneOf": kinds }) },
        );
        defs.insert(
            format!("rules-{key}"),
            if rules.is_empty() { json!(true) } else { json!({ "allOf": rules }) },
        );
    }
    let mut root = generator.root_schema_for::<Task>().to_value();
    if let Some(own) = root.get_mut("$defs").and_then(Value::as_object_mut) {
        // Sections that hold `kind` and `params` beside other keys get the parameters of the kind by rule.
        for (section, key) in [("SensorSection", "sensor"), ("ModalitySection", "modality")] {
            if let Some(s) = own.get_mut(section).and_then(Value::as_object_mut) {
                s.insert("allOf".into(), json!([{ "$ref": format!("#/$defs/rules-{key}") }]));
            }
        }
        own.extend(defs);
    }
    root
}

const ROLES: [&str; 14] = [
    "sensor",
    "shape",
    "appearance",
    "warp",
    "dynamics",
    "init",
    "truth",
    "modality",
    "fusion",
    "estimator",
    "loss",
    "reinit",
    "association",
    "output",
];

/// Schema of the key `version`.
pub(crate) fn version(_: &mut SchemaGenerator) -> Schema {
    json_schema!({ "const": 1, "description": "Version of the language." })
}

/// References to the methods of a role, which [`schema`] fills in.
pub(crate) mod choice {
    use super::{Schema, SchemaGenerator, json_schema};

    macro_rules! references {
        ($($name:ident: $key:literal),+) => {$(
            pub fn $name(_: &mut SchemaGenerator) -> Schema {
                json_schema!({ "$ref": concat!("#/$defs/role-", $key) })
            }
        )+};
    }
    references!(
        shape: "shape", appearance: "appearance", warp: "warp", dynamics: "dynamics", init: "init", truth: "truth",
        fusion: "fusion", estimator: "estimator", loss: "loss", reinit: "reinit", association: "association"
    );

    pub fn outputs(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": "array", "items": { "$ref": "#/$defs/role-output" } })
    }
    pub fn sensor_kind(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "$ref": "#/$defs/kinds-sensor" })
    }
    pub fn modality_kind(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "$ref": "#/$defs/kinds-modality" })
    }
    pub fn params(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": "object" })
    }
}
