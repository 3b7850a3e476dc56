//! JSON Schema of scenes and sweeps, generated from the types that read them. Editors use it to complete and
//! check TOML files, and the reference of the book is written from it. The schema covers keys, kinds of
//! values, choices, ranges of numbers, and keys of one table that need or exclude each other. Rules between
//! tables are checked by the program only. The schema also checks tables that the program does not read, such
//! as `dem` beside `kind = "fem"`.

use crate::spec::SceneSpec;
use crate::spec::sweep::SweepFile;
use schemars::generate::SchemaSettings;
use schemars::transform::{RecursiveTransform, Transform};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde_json::{Value, json};
use std::borrow::Cow;

/// Pattern of names of models and other tables, which also name files.
pub(crate) const NAME: &str = "^[A-Za-z0-9_-]+$";
/// Pattern of names at the head of tables with commas: no comma, semicolon or quotation mark, and not blank.
pub(crate) const HEADLINE: &str = r#"^[^,;"\n]*[^,;"\s][^,;"\n]*$"#;

/// Returns the schema of scene files (draft 7, which editors of TOML understand).
pub fn scene() -> Value {
    schema_of::<SceneSpec>("Scene of Arlequin")
}

/// Returns the schema of sweep files.
pub fn sweep() -> Value {
    schema_of::<SweepFile>("Sweep of Arlequin")
}

fn schema_of<T: JsonSchema>(title: &str) -> Value {
    let settings = SchemaSettings::draft07().with_transform(RecursiveTransform(simplify));
    let mut schema = settings.into_generator().into_root_schema_for::<T>();
    schema.insert("title".into(), title.into());
    schema.to_value()
}

/// Removes what TOML and readers do not need: null, formats of numbers, and escapes of Rust's documentation.
fn simplify(schema: &mut Schema) {
    let Some(object) = schema.as_object_mut() else {
        return;
    };
    object.remove("format");
    if let Some(Value::Array(types)) = object.get_mut("type") {
        types.retain(|t| t != "null");
        if let [only_type] = types.as_slice() {
            let only_type = only_type.clone();
            object.insert("type".into(), only_type);
        }
    }
    if let Some(Value::Array(names)) = object.get_mut("enum") {
        names.retain(|n| !n.is_null());
    }
    if let Some(Value::Array(choices)) = object.get_mut("anyOf") {
        choices.retain(|c| *c != json!({ "type": "null" }));
        if let [Value::Object(only_choice)] = choices.as_slice() {
            let only_choice = only_choice.clone();
            object.remove("anyOf");
            // Draft 7 ignores every key beside a reference.
            if only_choice.contains_key("$ref") && !object.is_empty() {
                object.insert("allOf".into(), json!([only_choice]));
            } else {
                object.extend(only_choice);
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

/// Requires exactly one of these keys, which are separated by spaces.
// One text instead of a list, because a list in the attribute would need all of `syn`, which `derive` of
// schemars alone does not have.
pub(crate) fn exactly_one(keys: impl Into<String>) -> impl Transform {
    let keys = keys.into();
    move |schema: &mut Schema| {
        let required = |key: &str| json!({ "required": [key] });
        schema.insert("oneOf".into(), keys.split(' ').map(required).collect());
    }
}

/// Refuses `key` beside any of the keys `others`, which are separated by spaces.
pub(crate) fn excludes(key: &'static str, others: &'static str) -> impl Transform {
    move |schema: &mut Schema| {
        let both = |other: &str| json!({ "required": [key, other] });
        let pairs: Vec<Value> = others.split(' ').map(both).collect();
        schema.insert("not".into(), json!({ "anyOf": pairs }));
    }
}

/// Accepts a fracture energy with no criterion or one that compares energies, or a strength with its
/// criterion; for beams that soften, both without a criterion.
pub(crate) fn fracture_keys(schema: &mut Schema) {
    let softening = json!({ "required": ["softening"], "properties": { "softening": { "const": true } } });
    let both = json!({ "required": ["gc", "strength"], "properties": { "criterion": false } });
    let energies = json!({ "properties": { "criterion": { "enum": ["energy", "tensile-energy"] } } });
    let only = json!({
        "oneOf": [{ "required": ["gc"] }, { "required": ["strength"] }],
        "dependencies": { "strength": ["criterion"], "gc": energies },
    });
    schema.insert("if".into(), softening);
    schema.insert("then".into(), both);
    schema.insert("else".into(), only);
}

/// Requires `value` of a constant profile, and refuses `value` of all others.
pub(crate) fn value_if_constant(schema: &mut Schema) {
    let constant = json!({ "required": ["profile"], "properties": { "profile": { "const": "constant" } } });
    schema.insert("if".into(), constant);
    schema.insert("then".into(), json!({ "required": ["value"] }));
    schema.insert("else".into(), json!({ "properties": { "value": false } }));
}

/// Refuses a vector of zeros.
pub(crate) fn not_zero(schema: &mut Schema) {
    schema.insert("not".into(), json!({ "items": { "const": 0 } }));
}

/// Declares schemas for enums of the core that list the names of their variants.
macro_rules! core_names {
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

core_names!(JunctionKind, Partition, ProfileKind, Sampling, Weighting);
