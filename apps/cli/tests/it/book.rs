//! The book: its reference is that of the schema, its pages exist, its links lead somewhere, and its scenes
//! and commands run.

use crate::common::{schemas::verdict, scratch, succeed, text};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

fn docs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs")
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// Returns all pages below a folder.
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

/// Returns the targets of a page's links and pictures, except web addresses.
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
    let files: BTreeSet<PathBuf> = pages(&root)
        .into_iter()
        .filter(|p| !p.ends_with("SUMMARY.md"))
        .collect();
    assert_eq!(chapters, files);
    let mut broken = Vec::new();
    for page in &files {
        let words = read(page);
        for link in links(&words) {
            let file = link.split('#').next().unwrap_or_default();
            let place = page.parent().expect("a folder").join(file);
            // A reader of the book has only the files within the book.
            let inside = place.canonicalize().is_ok_and(|p| p.starts_with(&root));
            if !inside {
                broken.push(format!("{}: {link}", page.display()));
            }
        }
    }
    assert_eq!(broken, Vec::<String>::new());
}

/// Every block of the kind `toml run` is a whole scene and runs.
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
            assert_eq!(
                crate::common::summary(&out)["status"],
                "complete",
                "{}",
                page.display()
            );
            count += 1;
        }
    }
    assert!(count >= 9, "{count} scenes");
}

/// Returns the lines of a page's command blocks.
fn commands(page: &str) -> Vec<String> {
    let blocks = page.split("```").skip(1).step_by(2);
    let shell = blocks.filter_map(|b| b.strip_prefix("sh\n").or_else(|| b.strip_prefix('\n')));
    shell.flat_map(str::lines).map(|l| l.trim().to_owned()).collect()
}

/// Issue 26, G: every page with commands says how to get the program.
#[test]
fn pages_with_commands_say_where_the_command_comes_from() {
    for page in pages(&docs()) {
        if page.parent().is_some_and(|p| p.ends_with("decisions")) {
            continue;
        }
        let words = read(&page);
        let uses = commands(&words)
            .iter()
            .any(|l| l.starts_with("arlequin ") || l.contains(" arlequin "));
        assert!(
            !uses || words.contains("cargo install --path apps/cli"),
            "{}",
            page.display()
        );
    }
}

/// Issue 26, G: the tutorials' commands run as they are written, in the order of the book, in one folder.
#[test]
fn the_commands_of_the_tutorials_run() {
    let folder = scratch("tutorials");
    let root = docs();
    let order = read(&root.join("SUMMARY.md"));
    let order = links(&order)
        .into_iter()
        .filter(|l| l.starts_with("tutorial/") || *l == "introduction.md");
    let mut count = 0;
    for page in order {
        for line in commands(&read(&root.join(page))) {
            let Some(line) = line.strip_prefix("arlequin ") else {
                continue;
            };
            let line = line.split('#').next().unwrap_or_default();
            // Quotes surround only values that contain spaces.
            let mut words: Vec<String> = Vec::new();
            for (k, part) in line.split('"').enumerate() {
                if k % 2 == 0 {
                    words.extend(part.split_whitespace().map(str::to_owned));
                } else if let Some(last) = words.last_mut() {
                    last.push_str(part);
                }
            }
            let words: Vec<&str> = words.iter().map(String::as_str).collect();
            let done = crate::common::command(&words)
                .current_dir(&folder)
                .output()
                .expect("runs");
            let stderr = String::from_utf8_lossy(&done.stderr);
            assert!(done.status.success(), "{page}: arlequin {line}: {stderr}");
            count += 1;
        }
    }
    assert!(count >= 14, "{count} commands");
}

/// Issue 26, G: the changes that section 4 of the first tutorial describes give a scene that runs.
#[test]
fn particles_around_the_hole_of_the_first_tutorial() {
    let folder = scratch("tutorial-zone");
    succeed(&["new", "--template", "plate", text(&folder.join("plate"))]);
    let page = read(&docs().join("tutorial/plate.md"));
    let section = page.split("## 4. ").nth(1).expect("section 4");
    let tables = section
        .split("```toml\n")
        .nth(1)
        .and_then(|s| s.split("```").next())
        .expect("tables");
    let (body, probe) = tables.split_once("[probe.hole]").expect("a probe");
    let path = folder.join("plate/scene.toml");
    let scene = read(&path);
    // Replaces one table of a scene, from its head to the next head.
    let exchanged = |scene: &str, head: &str, replacement: &str| {
        let (before, after) = scene.split_once(head).expect(head);
        let end = after.find("\n[").expect("a further table");
        format!("{before}{replacement}{}", &after[end..])
    };
    let scene = exchanged(&scene, "[probe.hole]", &format!("[probe.hole]{probe}"));
    let scene = exchanged(&scene, "[model.plate]", body).replace("model = \"plate\"", "model = \"body\"");
    std::fs::write(&path, &scene).expect("writes");
    // Larger spheres keep the run within seconds.
    let larger = ["--set", "zone.hole.spacing=0.3e-3"];
    succeed(&[&["check", text(&path)], &larger[..]].concat());
    // The unchanged probe on the body lies in the zone: the error names the zone before anything is packed.
    let old = exchanged(
        &scene,
        "[probe.hole]",
        "[probe.hole]\nmodel = \"body\"\nat = [0.0, 5e-3, 0.5e-3]\ncomponent = \"x\"\n",
    );
    std::fs::write(&path, old).expect("writes");
    let done = crate::common::arlequin(&["check", text(&path)]);
    let stderr = String::from_utf8_lossy(&done.stderr);
    assert!(
        !done.status.success() && stderr.contains("lies in zone 'hole'"),
        "{stderr}"
    );
    assert!(!stderr.contains("packing of"), "{stderr}");
}
