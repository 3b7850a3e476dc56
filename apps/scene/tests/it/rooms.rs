//! The rooms of the crate have one-way doors: no file names a room after its own.

use std::path::Path;

/// Modules at the root of the crate by room, and the names that `lib.rs` gives to items of the first room.
const ROOMS: [&[&str]; 5] = [
    &[
        "error", "ranks", "spectrum", "threads", "Error", "Result", "Progress",
    ],
    &["scene", "spec", "setup", "cells"],
    &["output"],
    &["run"],
    &["explore"],
];

fn room(module: &str) -> Option<usize> {
    ROOMS.iter().position(|r| r.contains(&module))
}

fn check(folder: &Path, own: Option<usize>, wrong: &mut Vec<String>) {
    for entry in std::fs::read_dir(folder).expect("a folder of sources") {
        let path = entry.expect("an entry").path();
        let stem = path.file_stem().and_then(|s| s.to_str()).unwrap_or_default();
        let own = own.or_else(|| room(stem));
        if path.is_dir() {
            check(&path, own, wrong);
        } else if stem != "lib" {
            let text = std::fs::read_to_string(&path).expect("a source");
            let code = text.lines().filter(|l| !l.trim_start().starts_with("//"));
            for word in code.flat_map(|l| l.split("crate::").skip(1)) {
                let name = word.split(|c: char| !c.is_alphanumeric() && c != '_').next();
                if name
                    .and_then(room)
                    .is_none_or(|named| own.is_none_or(|own| named > own))
                {
                    wrong.push(format!("{}: crate::{word}", path.display()));
                }
            }
        }
    }
}

#[test]
fn no_file_names_a_later_room() {
    let mut wrong = Vec::new();
    check(
        &Path::new(env!("CARGO_MANIFEST_DIR")).join("src"),
        None,
        &mut wrong,
    );
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// Tables are what the file says: they know nothing of what the set-up derives from them.
#[test]
fn tables_do_not_name_the_set_up() {
    let tables = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/spec");
    for entry in std::fs::read_dir(tables).expect("the tables") {
        let path = entry.expect("an entry").path();
        let text = std::fs::read_to_string(&path).expect("a source");
        let mut code = text.lines().filter(|l| !l.trim_start().starts_with("//"));
        assert!(!code.any(|l| l.contains("crate::setup")), "{}", path.display());
    }
}
