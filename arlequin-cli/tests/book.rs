//! The book: its reference is the schema's, its pages are there and point at what exists, and what it says runs does run.

mod common;

use common::{schemas::verdict, scratch, succeed, text};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

fn docs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs")
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// All pages below a folder.
fn pages(folder: &Path) -> Vec<PathBuf> {
    let mut out = Vec::new();
    for entry in std::fs::read_dir(folder).expect("folder").flatten() {
        let path = entry.path();
        if path.is_dir() {
            out.extend(pages(&path));
        } else if path.extension().is_some_and(|e| e == "md") {
            out.push(path);
        }
    }
    out.sort();
    out
}

/// Targets of the links and pictures of a page, but for addresses.
fn links(page: &str) -> Vec<&str> {
    let targets = page.split("](").skip(1).filter_map(|t| t.split(')').next());
    targets
        .filter(|t| !t.contains("://") && !t.starts_with('#') && !t.contains(' '))
        .collect()
}

#[test]
fn the_reference_is_that_of_the_schema() {
    let printed = succeed(&["schema", "--reference"]);
    let page = read(&docs().join("reference.md"));
    assert!(
        page == printed,
        "write it again: arlequin schema --reference > docs/reference.md"
    );
}

#[test]
fn every_page_is_a_chapter_and_every_link_leads_somewhere() {
    let root = docs().canonicalize().expect("docs");
    let contents = read(&root.join("SUMMARY.md"));
    let chapters: BTreeSet<PathBuf> = links(&contents).into_iter().map(|l| root.join(l)).collect();
    let all: BTreeSet<PathBuf> = pages(&root)
        .into_iter()
        .filter(|p| !p.ends_with("SUMMARY.md"))
        .collect();
    assert_eq!(chapters, all);
    let mut broken = Vec::new();
    for page in &all {
        let words = read(page);
        for link in links(&words) {
            let file = link.split('#').next().unwrap_or_default();
            let place = page.parent().expect("a folder").join(file);
            // Only what lies in the book is there when it is read.
            let inside = place.canonicalize().is_ok_and(|p| p.starts_with(&root));
            if !inside {
                broken.push(format!("{}: {link}", page.display()));
            }
        }
    }
    assert_eq!(broken, Vec::<String>::new());
}

/// Blocks of the kind `toml run` are whole scenes.
#[test]
fn every_scene_of_the_book_runs() {
    let folder = scratch("book");
    let templates = Path::new(env!("CARGO_MANIFEST_DIR")).join("templates");
    std::fs::copy(templates.join("plate.msh"), folder.join("plate.msh")).expect("the mesh");
    let mut count = 0;
    for page in pages(&docs()) {
        let words = read(&page);
        for block in words.split("```toml run\n").skip(1) {
            let scene = block.split("```").next().unwrap_or_default();
            assert_eq!(verdict("scene", scene), Some(true), "{}", page.display());
            let path = folder.join("scene.toml");
            std::fs::write(&path, scene).expect("writes");
            let out = folder.join(format!("{count}"));
            succeed(&["run", text(&path), "--out", text(&out)]);
            succeed(&["view", text(&out)]);
            assert_eq!(common::summary(&out)["status"], "complete", "{}", page.display());
            count += 1;
        }
    }
    assert!(count >= 9, "{count} scenes");
}
