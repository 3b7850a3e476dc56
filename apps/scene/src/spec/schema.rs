//! JSON Schema of scenes and sweeps, from the types that read them: with it editors complete and check TOML
//! files, and the reference of the book is written. It knows keys, kinds of values and choices; what
//! depends on several keys at once only the program knows.

use crate::spec::SceneSpec;
use crate::sweep::spec::SweepFile;
use schemars::generate::SchemaSettings;
use schemars::transform::{RecursiveTransform, Transform};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde_json::{Value, json};
use std::borrow::Cow;

/// The schema of scene files (draft 7, which editors of TOML understand).
pub fn scene() -> Value {
    of::<SceneSpec>("Scene of Arlequin")
}

/// The schema of sweep files.
pub fn sweep() -> Value {
    of::<SweepFile>("Sweep of Arlequin")
}

fn of<T: JsonSchema>(title: &str) -> Value {
    let settings = SchemaSettings::draft07().with_transform(RecursiveTransform(plain));
    let mut schema = settings.into_generator().into_root_schema_for::<T>();
    schema.insert("title".into(), title.into());
    schema.to_value()
}

/// What TOML and readers have no use for: null, formats of numbers, escapes and links of Rust's
/// documentation.
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
            // Draft 7 heeds nothing beside a reference.
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

/// A link has a command or an address; all other models need a shape and a material.
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

/// Exactly one of these keys, parted by spaces, must be there.
// Words in one text: a list in the attribute would need all of syn, which `derive` of schemars alone does
// not have.
pub(crate) fn exactly_one(keys: impl Into<String>) -> impl Transform {
    let keys = keys.into();
    move |schema: &mut Schema| {
        let one = |key: &str| json!({ "required": [key] });
        schema.insert("oneOf".into(), keys.split(' ').map(one).collect());
    }
}

/// Not more than one of these keys, parted by spaces, may be there.
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

/// Choices of the core, by their names.
macro_rules! of_the_core {
    ($($kind:ident),*) => {
        $(
            /// Its names.
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
