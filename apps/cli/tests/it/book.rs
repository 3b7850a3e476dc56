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

/// Returns the commands of a page.
fn commands(page: &str) -> Vec<String> {
    let command = |step| match step {
        Step::Command(c) => Some(c),
        _ => None,
    };
    steps(page).into_iter().filter_map(command).collect()
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

/// Commands of the book that this test leaves out, by their beginnings, and why.
const LEFT_OUT: [(&str, &str); 8] = [
    ("cargo install", "the program under test is there already"),
    ("cargo test", "this test is part of it"),
    ("mpirun", "apps/cli/tests/mpirun.rs"),
    ("srun", "needs a cluster"),
    ("apt-get", "the gate installs it"),
    ("python", "the gate's Python tests"),
    ("pip", "the gate's Python tests"),
    ("chromium", "apps/cli/tests/browser.rs"),
];

/// Commands that take minutes; the page that has them states their results.
const LONG: [&str; 14] = [
    "arlequin run examples/scenes/edge-crack.toml",
    "arlequin run examples/scenes/double-cantilever.toml",
    // The page of that run.
    "arlequin view arms",
    "arlequin run examples/scenes/pure-shear.toml",
    "arlequin run examples/scenes/branching.toml",
    // The page of that run.
    "arlequin view fork",
    "arlequin verify --fracture",
    "arlequin run examples/scenes/plate-impact.toml",
    "arlequin run examples/sweeps/scenes/plate-impact-fine.toml",
    "arlequin sweep examples/sweeps/plate-impact",
    "arlequin calibrate --cylinder 20e-3,1e-3 --count 5000",
    "arlequin calibrate --periodic",
    "arlequin calibrate --box 8e-3,3e-3,3e-3 --spacing 0.3e-3 --strength",
    "arlequin calibrate --box 32e-3,10e-3,4e-3 --spacing 0.5e-3 --toughness",
];

/// The pages with commands, and the shipped scene that stands for `SCENE.toml` there. The tutorials share one
/// folder, as for a reader who follows them.
const PAGES: [(&str, &str, &str); 15] = [
    ("../README.md", "readme", ""),
    ("branching.md", "branching", ""),
    ("kalthoff.md", "kalthoff", ""),
    ("edge-cracks.md", "edge-cracks", ""),
    ("cone.md", "cone", ""),
    ("circles.md", "circles", ""),
    ("introduction.md", "tutorials", ""),
    ("tutorial/plate.md", "tutorials", ""),
    ("tutorial/bend.md", "tutorials", ""),
    ("tutorial/impact.md", "tutorials", ""),
    ("scene.md", "scene", "quickstart.toml"),
    ("sweep.md", "sweep", "bar-1d.toml"),
    ("view.md", "view", "quickstart.toml"),
    ("calibration.md", "calibration", "dem-fem-beam.toml"),
    ("plate-impact.md", "plate-impact", ""),
];

/// Issue 28: every page with commands is run or left out with a reason.
#[test]
fn every_page_with_commands_is_run() {
    let root = docs();
    for page in pages(&root).into_iter().chain([root.join("../README.md")]) {
        let name = page.strip_prefix(&root).expect("below docs");
        if ["decisions", "design", "measurements"]
            .iter()
            .any(|f| name.starts_with(f))
        {
            continue;
        }
        let runs = commands(&read(&page)).iter().any(|l| l.starts_with("arlequin "));
        let listed = PAGES.iter().any(|(p, ..)| Path::new(p) == name);
        assert!(!runs || listed, "{}", page.display());
    }
}

/// Every command of these pages takes minutes; a command that does not is run here.
#[test]
fn the_pages_of_long_runs_have_no_other_commands() {
    run_pages("branching", 0);
    run_pages("plate-impact", 0);
    run_pages("edge-cracks", 0);
    run_pages("circles", 0);
}

#[test]
fn the_commands_of_the_readme_run() {
    run_pages("readme", 3);
}

#[test]
fn the_commands_of_the_tutorials_run_and_print_what_the_pages_say() {
    run_pages("tutorials", 40);
}

#[test]
fn the_commands_of_the_page_on_scenes_run() {
    run_pages("scene", 8);
}

#[test]
fn the_commands_of_the_page_on_sweeps_run() {
    run_pages("sweep", 5);
}

#[test]
fn the_commands_of_the_page_on_results_run() {
    run_pages("view", 5);
}

#[test]
fn the_commands_of_the_page_on_the_struck_plate_run() {
    run_pages("kalthoff", 1);
}

#[test]
fn the_commands_of_the_page_on_the_blunt_ball_run() {
    run_pages("cone", 2);
}

#[test]
fn the_commands_of_the_page_on_calibration_run() {
    run_pages("calibration", 1);
}

/// Commands and output of a page, in the order of its blocks.
enum Step {
    /// A command, with its program.
    Command(String),
    /// A line that the commands of the block before print.
    Printed(String),
    /// The begin of a further block of commands.
    Block,
}

/// Returns the commands of a page and the lines that they print, which stand in a block `text` behind them.
fn steps(page: &str) -> Vec<Step> {
    let mut out = Vec::new();
    for block in page.split("```").skip(1).step_by(2) {
        if let Some(expected) = block.strip_prefix("text\n") {
            let lines = expected.lines().filter(|l| !l.trim().is_empty());
            out.extend(lines.map(|l| Step::Printed(l.to_owned())));
        } else if let Some(shell) = block.strip_prefix("sh\n").or_else(|| block.strip_prefix('\n')) {
            out.push(Step::Block);
            let shell = shell.replace("\\\n", " ");
            for line in shell.lines().flat_map(|l| l.split(" && ")) {
                // Two spaces part a command from its explanation.
                let command = line.trim().split("  ").next().unwrap_or_default();
                let command = command.split(" #").next().unwrap_or_default().trim();
                // The program of the clone is the one under test.
                let command = command.replacen("cargo run --release -- ", "arlequin ", 1);
                out.push(Step::Command(command));
            }
        }
    }
    out
}

/// Creates the folder that readers of some pages work in: the examples, and the files that the pages name.
fn reader_folder(folder: &str, scene: &str) -> PathBuf {
    use crate::common::sweeps;
    let place = scratch(&format!("book-{folder}"));
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples");
    let shipped = shipped.canonicalize().expect("examples");
    std::os::unix::fs::symlink(shipped, place.join("examples")).expect("a link");
    if !scene.is_empty() {
        std::fs::copy(crate::common::scene(scene), place.join("SCENE.toml")).expect("copies");
    }
    if folder == "view" {
        let scene = place.join("SCENE.toml");
        succeed(&["run", text(&scene), "--out", text(&place.join("DIR"))]);
    }
    if folder == "sweep" {
        let files = sweeps::folder("book-sweep-files", sweeps::SWEEP);
        for file in std::fs::read_dir(files).expect("folder").flatten() {
            std::fs::copy(file.path(), place.join(file.file_name())).expect("copies");
        }
        std::fs::rename(place.join("sweep.toml"), place.join("SWEEP.toml")).expect("renames");
    }
    place
}

/// Leaves a run that was killed after its first checkpoint, which `out` will hold once it is resumed.
fn leave_killed_run(place: &Path, out: &str) {
    let output = "\n[output]\ncheckpoint_every = 200\nevery = 1000\nplots = false\n";
    let scene = crate::common::SMALL.to_owned() + output;
    std::fs::write(place.join("killed.toml"), scene).expect("writes");
    let _ = std::fs::remove_dir_all(place.join(out));
    let arguments = ["run", "killed.toml", "--out", out, "--set", "time.steps=180000"];
    let mut run = crate::common::command(&arguments);
    let mut run = run
        .current_dir(place)
        .stdout(std::process::Stdio::null())
        .spawn()
        .expect("starts");
    crate::common::wait_for(&place.join(format!("{out}.unfinished/checkpoint.bin")));
    run.kill().expect("kills");
    run.wait().expect("ends");
}

/// Runs the commands of pages that share a folder, in the order of the book, as they are written, and
/// compares what they print.
fn run_pages(folder: &str, least: usize) {
    let pages: Vec<_> = PAGES.iter().filter(|(_, f, _)| *f == folder).collect();
    let place = reader_folder(folder, pages[0].2);
    let mut count = 0;
    for (page, ..) in pages {
        let mut printed = String::new();
        for step in steps(&read(&docs().join(page))) {
            match step {
                Step::Block => printed.clear(),
                Step::Printed(line) => {
                    assert!(
                        has_line(&printed, &line),
                        "{page}: no line\n{line}\nin\n{printed}"
                    );
                    count += 1;
                }
                Step::Command(command) => {
                    let left_out = LEFT_OUT.iter().map(|l| l.0).chain(LONG);
                    let runs = !left_out.into_iter().any(|l| command.starts_with(l));
                    if let Some(arguments) = command.strip_prefix("arlequin ").filter(|_| runs) {
                        if let Some(out) = arguments.strip_prefix("resume ") {
                            leave_killed_run(&place, out);
                        }
                        printed += &run_as_written(&place, page, arguments);
                        count += 1;
                    }
                }
            }
        }
    }
    assert!(count >= least, "{count} commands and lines");
}

/// Returns whether a text has a line, apart from the number of spaces.
fn has_line(text: &str, line: &str) -> bool {
    let words = |l: &str| l.split_whitespace().collect::<Vec<_>>().join(" ");
    let line = words(line);
    text.lines().any(|l| words(l).contains(&line))
}

/// Runs a command as it stands on a page, and returns what it prints.
fn run_as_written(folder: &Path, page: &str, line: &str) -> String {
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
        .current_dir(folder)
        .output()
        .expect("runs");
    let stderr = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success(), "{page}: arlequin {line}: {stderr}");
    String::from_utf8_lossy(&done.stdout).into_owned() + &stderr
}
