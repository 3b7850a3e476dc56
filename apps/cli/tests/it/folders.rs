//! Folders that `--force` replaces, and folders that no flag replaces.
#![cfg(unix)]

use crate::common::{SMALL, arlequin, changed, command, scratch, succeed, summary, text, wait_for, written};
use std::collections::BTreeMap;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::Stdio;

const MARK: &str = ".arlequin-results";

/// Writes a small scene into a new folder and returns its path.
fn small(folder: &Path) -> PathBuf {
    std::fs::create_dir_all(folder).expect("folder");
    let path = folder.join("small.toml");
    std::fs::write(&path, SMALL).expect("scene");
    path
}

fn put(path: &Path, text: &str) {
    std::fs::create_dir_all(path.parent().expect("parent")).expect("folder");
    std::fs::write(path, text).expect("file");
}

/// Returns every file below a folder with its content; the content of a link is its target.
fn tree(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut out = BTreeMap::new();
    for entry in std::fs::read_dir(folder).expect("folder") {
        let entry = entry.expect("entry");
        let (path, kind) = (entry.path(), entry.file_type().expect("kind"));
        if kind.is_dir() {
            out.extend(tree(&path));
            out.insert(path, Vec::new());
        } else if kind.is_symlink() {
            let target = std::fs::read_link(&path).expect("link");
            out.insert(path, text(&target).as_bytes().to_vec());
        } else {
            let bytes = std::fs::read(&path).expect("file");
            out.insert(path, bytes);
        }
    }
    out
}

/// Runs with `--force` from the folder `directory`: asserts that the run is refused with `words` and that
/// nothing below `root` changes.
fn assert_force_refused(root: &Path, directory: &Path, scene: &str, out: &str, words: &str) {
    let before = tree(root);
    let run = command(&["run", scene, "--out", out, "--force"])
        .current_dir(directory)
        .env("HOME", root.join("home"))
        .output()
        .expect("runs");
    let stderr = String::from_utf8_lossy(&run.stderr)
        .replace(['\n', '│'], " ")
        .split_whitespace()
        .collect::<Vec<_>>()
        .join(" ");
    assert_eq!(run.status.code(), Some(2), "--out {out}: {stderr}");
    assert!(
        stderr.contains(words),
        "--out {out} should say '{words}': {stderr}"
    );
    assert!(tree(root) == before, "--out {out} changed something");
}

#[test]
fn force_never_replaces_what_no_run_wrote() {
    let root = scratch("force-foreign");
    let scene = small(&root.join("scenes"));
    let scene = text(&scene);
    // An unrelated folder, one that only looks like results, the folder of the scene, and a parent of it.
    put(&root.join("thesis/chapter.txt"), "a year of work");
    put(&root.join("looks/summary.json"), "{}");
    put(&root.join("looks/vtu/left_00000000.vtu"), "someone else's");
    std::fs::create_dir_all(root.join("home")).expect("home");
    let assert_refused = |out: &str, words: &str| assert_force_refused(&root, &root, scene, out, words);
    let unmarked = "does not bear the mark of results";
    assert_refused("thesis", unmarked);
    assert_refused("./looks/../thesis", unmarked);
    assert_refused("looks", unmarked);
    assert_refused("scenes", "is or holds");
    assert_refused(text(&root), "is or holds");
    assert_refused("home", "is or holds");
    assert_refused("scenes/..", "must name a folder to create");
    assert_refused("/", "must name a folder to create");
    assert_refused(".", "must name a folder to create");
    symlink(root.join("thesis"), root.join("link")).expect("link");
    assert_refused("link", "is a symbolic link");
    symlink(root.join("scenes"), root.join("also")).expect("link");
    assert_force_refused(&root, &root, "also/small.toml", "scenes", "is or holds");
    // The working folder, given by a path that does not end in a dot.
    let directory = root.join("thesis");
    assert_force_refused(&root, &directory, scene, "../thesis", "is or holds");
}

#[test]
fn force_never_replaces_results_that_hold_something_else() {
    let root = scratch("force-mixed");
    let scene = small(&root.join("scenes"));
    succeed(&["run", text(&scene), "--out", text(&root.join("out"))]);
    let out = root.join("out");
    std::fs::create_dir_all(root.join("home")).expect("home");
    let assert_refused = |words: &str| assert_force_refused(&root, &root, text(&scene), "out", words);
    for name in [
        "notes.txt",
        "vtu/mine_00000000.vtu",
        "plots/mine.svg",
        "fracture-mine.csv",
        "deep/er/still.csv",
    ] {
        put(&out.join(name), "mine");
        assert_refused(&format!("holds '{}", &name[..4]));
        let top = out.join(name.split('/').next().expect("name"));
        if name.starts_with("deep") {
            std::fs::remove_dir_all(top).expect("removed");
        } else {
            std::fs::remove_file(out.join(name)).expect("removed");
        }
    }
    std::fs::create_dir(out.join("empty")).expect("folder");
    assert_refused("holds 'empty'");
    std::fs::remove_dir(out.join("empty")).expect("removed");
    symlink(&scene, out.join("vtu/link_00000000.vtu")).expect("link");
    assert_refused("holds 'vtu/link_00000000.vtu'");
    std::fs::remove_file(out.join("vtu/link_00000000.vtu")).expect("removed");
    // A file of the run that was edited since belongs to the user.
    let table = std::fs::read_to_string(out.join("probes.csv")).expect("table");
    put(
        &out.join("probes.csv"),
        &format!("{table}# outlier, see page 7\n"),
    );
    assert_refused("holds 'probes.csv'");
    // Another last digit: the length stays the same.
    let mut digit = table.trim_end().to_owned();
    let last = digit.pop().expect("a table");
    digit.push(if last == '7' { '8' } else { '7' });
    digit.push_str(&table[digit.len()..]);
    assert_eq!(digit.len(), table.len());
    put(&out.join("probes.csv"), &digit);
    assert_refused("holds 'probes.csv'");
    put(&out.join("probes.csv"), &table);
    // An input file that lies among the results.
    let inside = out.join("small.toml");
    std::fs::copy(&scene, &inside).expect("copy");
    assert_force_refused(&root, &root, text(&inside), "out", "is or holds");
    std::fs::remove_file(&inside).expect("removed");
    // The mark of the results is missing.
    std::fs::rename(out.join(MARK), root.join("mark")).expect("renamed");
    assert_refused("does not bear the mark");
    std::fs::rename(root.join("mark"), out.join(MARK)).expect("renamed");
    succeed(&["run", text(&scene), "--out", text(&out), "--force"]);
}

#[test]
fn force_never_replaces_spheres_read_from_earlier_results() {
    let root = scratch("force-inputs");
    let spheres = "\
[model.grains]
kind = \"dem\"
shape.box = { low = [0.0, 0.0, 0.0], high = [6e-3, 3e-3, 3e-3] }
dem = { count = 120, protocol = \"quench\" }
material = { young = 75e9, poisson = 0.17, density = 2200.0 }
[time]
steps = 2
";
    let scene = root.join("first.toml");
    put(&scene, spheres);
    let out = root.join("out");
    succeed(&["run", text(&scene), "--out", text(&out)]);
    let second = spheres.replace(
        "count = 120, protocol = \"quench\"",
        "file = \"out/vtu/grains_00000000.vtu\", radii = \"radius [m]\"",
    );
    put(&root.join("second.toml"), &second);
    std::fs::create_dir_all(root.join("home")).expect("home");
    assert_force_refused(&root, &root, "second.toml", "out", "is or holds");
    succeed(&[
        "run",
        text(&root.join("second.toml")),
        "--out",
        text(&root.join("other")),
    ]);
}

#[test]
fn earlier_results_stay_until_there_are_new_ones() {
    let root = scratch("force-order");
    let scene = small(&root);
    let out = root.join("out");
    succeed(&["run", text(&scene), "--out", text(&out)]);
    let first = tree(&out);
    let force = |sets: &[&str]| {
        let fixed = ["run", text(&scene), "--out", text(&out), "--force"];
        let sets: Vec<&str> = sets.iter().flat_map(|s| ["--set", s]).collect();
        arlequin(&[&fixed[..], &sets].concat())
    };
    // The new run fails during its set-up.
    assert_eq!(force(&["model.left.spacing=-1"]).status.code(), Some(2));
    assert_eq!(force(&["time.step={seconds=9.0}"]).status.code(), Some(2));
    assert!(tree(&out) == first);
    assert_eq!(std::fs::read_dir(&root).expect("folder").count(), 2);
    // The new run is killed.
    let mut child = command(&[
        "run",
        text(&scene),
        "--out",
        text(&out),
        "--force",
        "--set",
        "time.steps=100000000",
    ])
    .stdout(Stdio::null())
    .stderr(Stdio::null())
    .spawn()
    .expect("starts");
    let vtu_file = root.join("out.unfinished/vtu/left_00000000.vtu");
    wait_for(&vtu_file);
    // Meanwhile no second run may write there.
    let second = force(&[]);
    let stderr = String::from_utf8_lossy(&second.stderr);
    assert!(stderr.contains("another run is writing to"), "{stderr}");
    child.kill().expect("kill");
    child.wait().expect("ends");
    assert!(tree(&out) == first);
    // The next run recognises the unfinished folder by its name and removes it, unless it holds foreign
    // files.
    put(&root.join("out.unfinished/thoughts.txt"), "mine");
    let third = force(&[]);
    assert_eq!(third.status.code(), Some(2));
    assert!(root.join("out.unfinished/thoughts.txt").exists() && tree(&out) == first);
    std::fs::remove_file(root.join("out.unfinished/thoughts.txt")).expect("removed");
    assert!(force(&["time.steps=7"]).status.success());
    assert_eq!(summary(&out)["steps"], 7);
    let mut names: Vec<_> = std::fs::read_dir(&root)
        .expect("folder")
        .map(|e| e.expect("entry").file_name())
        .collect();
    names.sort();
    assert_eq!(names, ["out", "small.toml"]);
}

#[test]
fn killed_between_two_renames_nothing_is_lost() {
    let root = scratch("force-renames");
    let scene = small(&root);
    let out = root.join("out");
    let run = ["run", text(&scene), "--out", text(&out)];
    succeed(&run);
    // The earlier results were already moved away, the new ones not yet in place.
    std::fs::rename(&out, root.join("out.replaced")).expect("renamed");
    let outcome = arlequin(&run);
    assert_eq!(outcome.status.code(), Some(2));
    assert!(out.join("summary.json").exists() && !root.join("out.replaced").exists());
    // The new results were complete, but not yet in place.
    std::fs::rename(&out, root.join("out.unfinished")).expect("renamed");
    assert_eq!(arlequin(&run).status.code(), Some(2));
    assert!(out.join("summary.json").exists() && !root.join("out.unfinished").exists());
}

#[test]
fn what_could_be_resumed_stays_until_a_forced_run_has_ended() {
    let root = scratch("force-resumable");
    let scene = small(&root);
    let out = root.join("out");
    let mut child = command(&[
        "run",
        text(&scene),
        "--out",
        text(&out),
        "--set",
        "time.steps=100000000",
        "--set",
    ])
    .arg("output.checkpoint_every=5")
    .stdout(Stdio::null())
    .stderr(Stdio::null())
    .spawn()
    .expect("starts");
    let checkpoint = root.join("out.unfinished/checkpoint.bin");
    wait_for(&checkpoint);
    child.kill().expect("kill");
    child.wait().expect("ends");
    let force = |set: &str| arlequin(&["run", text(&scene), "--out", text(&out), "--force", "--set", set]);
    assert_eq!(force("model.left.spacing=-1").status.code(), Some(2));
    assert!(checkpoint.exists());
    // The forced run fails in its first step: the folder that was put aside is restored.
    assert!(force("time.steps=4").status.success());
    assert!(!checkpoint.exists() && !root.join("out.unfinished.replaced").exists());
    assert_eq!(summary(&out)["steps"], 4);
}

#[test]
fn sweeps_and_verify_write_into_folders_of_their_own_only() {
    let root = scratch("force-sweep");
    let scene = small(&root);
    put(&root.join("mine/report.html"), "<p>mine</p>");
    put(&root.join("mine/verify.json"), "[]");
    put(&root.join("docs/validation.md"), "# My own page\n");
    let sweep = "scene = \"small.toml\"\n[axis.n]\nvalues = [3]\nset = [\"time.steps={}\"]\n";
    put(&root.join("sweep.toml"), sweep);
    let before = tree(&root);
    let foreign = root.join("mine");
    let assert_not_replaced = |arguments: &[&str], words: &str| {
        let out = arlequin(arguments);
        let stderr = String::from_utf8_lossy(&out.stderr).replace('\n', " ");
        assert_eq!(out.status.code(), Some(2), "{stderr}");
        assert!(stderr.contains(words), "{stderr}");
    };
    assert_not_replaced(
        &["verify", "bauman", "--out", text(&foreign)],
        "does not bear the mark",
    );
    assert_not_replaced(
        &["verify", "bauman", "--docs", text(&root.join("docs"))],
        "does not begin with '# Validation'",
    );
    assert_not_replaced(
        &["sweep", text(&root.join("sweep.toml")), "--out", text(&foreign)],
        "mark",
    );
    assert_not_replaced(
        &["sweep", text(&root.join("sweep.toml")), "--out", text(&root)],
        "mark",
    );
    assert!(tree(&root) == before && scene.exists());
}

/// Every table that a run writes is in the list of its folder: `--force` replaces it.
#[test]
fn results_of_a_zone_that_follows_are_replaced() {
    let shipped = std::fs::read_to_string(crate::common::scene("following.toml")).expect("a shipped scene");
    let changes = [
        ("spacing = 0.5e-3", "spacing = 0.7e-3"),
        ("end = 70e-6", "end = 13e-6"),
        ("amplitude = 4e-6", "amplitude = 6e-6"),
    ];
    let scene = written("follow-again", &changed(&shipped, &changes));
    let out = scene.with_file_name("out");
    succeed(&["run", text(&scene), "--out", text(&out)]);
    assert!(out.join("zones.csv").is_file(), "the zone did not move");
    let again = [
        "run",
        text(&scene),
        "--out",
        text(&out),
        "--force",
        "--set",
        "time.end=1e-7",
    ];
    succeed(&again);
    assert!(!out.join("zones.csv").exists());
}
