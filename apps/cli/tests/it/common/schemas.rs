//! The schemas of scenes and sweeps, as an editor would use them.

use arlequin_scene::spec::schema;
use jsonschema::Validator;
use std::sync::LazyLock;

static SCENE: LazyLock<Validator> = LazyLock::new(|| validator(&schema::scene()));
static SWEEP: LazyLock<Validator> = LazyLock::new(|| validator(&schema::sweep()));

fn validator(schema: &serde_json::Value) -> Validator {
    jsonschema::validator_for(schema).expect("a schema")
}

/// Returns whether the schema (`scene`, or else that of sweeps) accepts a text, or `None` if the text is not
/// TOML.
pub(crate) fn verdict(what: &str, text: &str) -> Option<bool> {
    let read: serde_json::Value = toml::from_str(text).ok()?;
    let validator = if what == "scene" { &SCENE } else { &SWEEP };
    Some(validator.is_valid(&read))
}
