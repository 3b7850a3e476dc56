//! JSON Schema of scenes and sweeps, generated from the types that read them. Editors use it to complete and
//! check TOML files, and the reference of the book is written from it. The schema covers keys, kinds of
//! values and choices; rules across several keys are checked by the program only.

use crate::spec::SceneSpec;
use crate::sweep::spec::SweepFile;
use schemars::generate::SchemaSettings;
use schemars::transform::{RecursiveTransform, Transform};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde_json::{Value, json};
use std::borrow::Cow;

/// Returns the schema of scene files (draft 7, which editors of TOML understand).
pub fn scene() -> Value {
    of::<SceneSpec>("Scene of Arlequin")
}

/// Returns the schema of sweep files.
pub fn sweep() -> Value {
    of::<SweepFile>("Sweep of Arlequin")
}

fn of<T: JsonSchema>(title: &str) -> Value {
    let settings = SchemaSettings::draft07().with_transform(RecursiveTransform(plain));
    let mut schema = settings.into_generator().into_root_schema_for::<T>();
    schema.insert("title".into(), title.into());
    schema.to_value()
}

/// Removes what TOML and readers do not need: null, formats of numbers, and escapes of Rust's documentation.
fn plain(schema: &mut Schema) {
    let Some(object) = schema.as_object_mut() else {
        return;
    };
    object.remove("format");
    if let Some(Value::Array(types)) = object.get_mut("type") {
        types.retain(|t| t != "null");
        if let [one] = types.as_slice() {
            let one = one.clone();
            object.insert("type".into(), one);
        }
    }
    if let Some(Value::Array(names)) = object.get_mut("enum") {
        names.retain(|n| !n.is_null());
    }
    if let Some(Value::Array(choices)) = object.get_mut("anyOf") {
        choices.retain(|c| *c != json!({ "type": "null" }));
        if let [Value::Object(one)] = choices.as_slice() {
            let one = one.clone();
            object.remove("anyOf");
            // Draft 7 ignores every key beside a reference.
            if one.contains_key("$ref") && !object.is_empty() {
                object.insert("allOf".into(), json!([one]));
            } else {
                object.extend(one);
            }
        }
    }
    if object.get("default").is_some_and(Value::is_null) {
        object.remove("default");
    }
    if let Some(Value::String(text)) = object.get_mut("description") {
        *text = text.replace("\\[", "[").replace("\\]", "]");
    }
}

/// Requires `command` or `address` of a link, and `shape` and `material` of all other models.
pub(crate) fn but_for_links() -> impl Transform {
    move |schema: &mut Schema| {
        let kind = json!({ "const": "link", "description": "A solver in another process." });
        let link = json!({ "properties": { "kind": kind } });
        schema.insert("if".into(), link);
        let one = json!({ "oneOf": [{ "required": ["command"] }, { "required": ["address"] }] });
        schema.insert("then".into(), one);
        schema.insert("else".into(), json!({ "required": ["shape", "material"] }));
    }
}

/// Requires exactly one of these keys, which are separated by spaces.
// One text instead of a list, because a list in the attribute would need all of `syn`, which `derive` of
// schemars alone does not have.
pub(crate) fn exactly_one(keys: impl Into<String>) -> impl Transform {
    let keys = keys.into();
    move |schema: &mut Schema| {
        let one = |key: &str| json!({ "required": [key] });
        schema.insert("oneOf".into(), keys.split(' ').map(one).collect());
    }
}

/// Allows at most one of these keys, which are separated by spaces.
pub(crate) fn at_most_one(keys: &'static str) -> impl Transform {
    move |schema: &mut Schema| {
        let keys: Vec<&str> = keys.split(' ').collect();
        let pair = |(k, a): (usize, &&str)| {
            let later = keys[k + 1..].iter();
            later.map(|b| json!({ "required": [a, b] })).collect::<Vec<_>>()
        };
        let pairs: Vec<Value> = keys.iter().enumerate().flat_map(pair).collect();
        schema.insert("not".into(), json!({ "anyOf": pairs }));
    }
}

/// Declares schemas for enums of the core that list the names of their variants.
macro_rules! of_the_core {
    ($($kind:ident),*) => {
        $(
            /// Schema with the names of the variants.
            pub(super) struct $kind;

            impl JsonSchema for $kind {
                fn inline_schema() -> bool {
                    true
                }
                fn schema_name() -> Cow<'static, str> {
                    stringify!($kind).into()
                }
                fn json_schema(_: &mut SchemaGenerator) -> Schema {
                    json_schema!({ "type": "string", "enum": arlequin::core::$kind::NAMES })
                }
            }
        )*
    };
}

of_the_core!(JunctionKind, Partition, ProfileKind, Sampling, Weighting);
