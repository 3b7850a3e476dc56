//! The schemas of scenes and sweeps, as an editor would use them.

use arlequin_scene::spec::schema;

/// Returns whether the schema (`scene`, or else that of sweeps) accepts a text, or `None` if the text is not
/// TOML.
pub(crate) fn verdict(what: &str, text: &str) -> Option<bool> {
    let read: serde_json::Value = toml::from_str(text).ok()?;
    let schema = if what == "scene" {
        schema::scene()
    } else {
        schema::sweep()
    };
    let validator = jsonschema::validator_for(&schema).expect("a schema");
    Some(validator.is_valid(&read))
}
