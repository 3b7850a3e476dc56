//! The book: its reference is the schema's, its pages are there and point at what exists, and what it says
//! runs does run.

use crate::common::{schemas::verdict, scratch, succeed, text};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

fn docs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs")
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

/// Lines of a page's blocks of commands.
fn commands(page: &str) -> Vec<String> {
    let blocks = page.split("```").skip(1).step_by(2);
    let shell = blocks.filter_map(|b| b.strip_prefix("sh\n").or_else(|| b.strip_prefix('\n')));
    shell.flat_map(str::lines).map(|l| l.trim().to_owned()).collect()
}

/// Issue 26, G: a reader of any page has the command, or is told how to get it.
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

/// Issue 26, G: the tutorials' commands, as they are written, in the order of the book, in one folder.
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
            // The only quotes are around a value with spaces.
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
            let said = String::from_utf8_lossy(&done.stderr);
            assert!(done.status.success(), "{page}: arlequin {line}: {said}");
            count += 1;
        }
    }
    assert!(count >= 14, "{count} commands");
}

/// Issue 26, G: section 4 of the first tutorial, applied to its scene as it says.
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
    // One table in place of another: from its head to the next one.
    let exchanged = |scene: &str, head: &str, with: &str| {
        let (before, after) = scene.split_once(head).expect(head);
        let end = after.find("\n[").expect("a further table");
        format!("{before}{with}{}", &after[end..])
    };
    let scene = exchanged(&scene, "[probe.hole]", &format!("[probe.hole]{probe}"));
    let scene = exchanged(&scene, "[model.plate]", body).replace("model = \"plate\"", "model = \"body\"");
    std::fs::write(&path, &scene).expect("writes");
    // Larger spheres take seconds.
    let larger = ["--set", "zone.hole.spacing=0.3e-3"];
    succeed(&[&["check", text(&path)], &larger[..]].concat());
    // The probe as it was, on the body at the hole, is told to name the zone before anything is packed.
    let old = exchanged(
        &scene,
        "[probe.hole]",
        "[probe.hole]\nmodel = \"body\"\nat = [0.0, 5e-3, 0.5e-3]\ncomponent = \"x\"\n",
    );
    std::fs::write(&path, old).expect("writes");
    let done = crate::common::arlequin(&["check", text(&path)]);
    let said = String::from_utf8_lossy(&done.stderr);
    assert!(
        !done.status.success() && said.contains("lies in zone 'hole'"),
        "{said}"
    );
    assert!(!said.contains("packing of"), "{said}");
}
