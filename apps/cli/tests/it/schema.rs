//! The program's descriptions of itself: schemas, completions, man pages.

use crate::common::{schemas::verdict, scratch, succeed, text};
use std::path::{Path, PathBuf};

fn shipped(folder: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(folder);
    let paths = std::fs::read_dir(&folder).expect("folder").flatten();
    let mut paths: Vec<PathBuf> = paths.map(|e| e.path()).collect();
    paths.retain(|p| p.extension().is_some_and(|e| e == "toml"));
    assert!(!paths.is_empty());
    paths
}

#[test]
fn the_schema_accepts_every_shipped_scene_and_sweep() {
    for (what, folder) in [
        ("scene", "examples/scenes"),
        ("scene", "examples/compare"),
        ("scene", "examples/sweeps/scenes"),
        ("sweep", "examples/sweeps"),
    ] {
        for path in shipped(folder) {
            let scene = std::fs::read_to_string(&path).expect("readable");
            assert_eq!(verdict(what, &scene), Some(true), "{}", path.display());
        }
    }
}

/// Every key of the schema has a description, which editors show. Keys in rules need none.
#[test]
fn every_key_of_the_schema_has_a_description() {
    fn bare(node: &serde_json::Value, path: &str, out: &mut Vec<String>) {
        let Some(object) = node.as_object() else { return };
        for (key, value) in object
            .get("properties")
            .and_then(|p| p.as_object())
            .into_iter()
            .flatten()
        {
            let choice = object.contains_key("description") && object.contains_key("required");
            if value.get("description").is_none() && !choice {
                out.push(format!("{path}.{key}"));
            }
        }
        let rules = ["if", "then", "else", "not", "dependencies"];
        for (key, value) in object.iter().filter(|(k, _)| !rules.contains(&k.as_str())) {
            match value {
                serde_json::Value::Array(a) => a.iter().for_each(|v| bare(v, &format!("{path}.{key}"), out)),
                _ => bare(value, &format!("{path}.{key}"), out),
            }
        }
    }
    for schema in ["schema", "schema --sweep"] {
        let printed = succeed(&schema.split(' ').collect::<Vec<_>>());
        assert!(!printed.contains("\\["), "escapes of Rust's documentation");
        let mut out = Vec::new();
        bare(&serde_json::from_str(&printed).expect("JSON"), "", &mut out);
        assert_eq!(out, Vec::<String>::new());
    }
}

#[test]
fn completions_and_man_pages_know_every_command() {
    let commands = ["run", "check", "sweep", "schema", "resume"];
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let printed = succeed(&["completions", shell]);
        assert!(commands.iter().all(|c| printed.contains(c)), "{shell}");
    }
    let page = succeed(&["man"]);
    assert!(page.contains(".TH arlequin 1") && commands.iter().all(|c| page.contains(c)));
    let folder = scratch("man");
    succeed(&["man", text(&folder)]);
    assert!(folder.join("arlequin-run.1").is_file());
}
