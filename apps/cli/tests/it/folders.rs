//! What `--force` replaces, and what no flag does.
#![cfg(unix)]

use crate::common::{SMALL, arlequin, command, scratch, succeed, summary, text, wait_for};
use std::collections::BTreeMap;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::Stdio;

const MARK: &str = ".arlequin-results";

/// A small scene in a folder of its own, which is made.
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

/// Everything below a folder with its content; links by where they lead.
fn tree(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut out = BTreeMap::new();
    for entry in std::fs::read_dir(folder).expect("folder") {
        let entry = entry.expect("entry");
        let (path, kind) = (entry.path(), entry.file_type().expect("kind"));
        if kind.is_dir() {
            out.extend(tree(&path));
            out.insert(path, Vec::new());
        } else if kind.is_symlink() {
            let to = std::fs::read_link(&path).expect("link");
            out.insert(path, text(&to).as_bytes().to_vec());
        } else {
            let bytes = std::fs::read(&path).expect("file");
            out.insert(path, bytes);
        }
    }
    out
}

/// Runs with `--force` in a folder; must be refused with these words and change nothing below `all`.
fn refused(all: &Path, here: &Path, scene: &str, out: &str, words: &str) {
    let before = tree(all);
    let run = command(&["run", scene, "--out", out, "--force"])
        .current_dir(here)
        .env("HOME", all.join("home"))
        .output()
        .expect("runs");
    let said = String::from_utf8_lossy(&run.stderr)
        .replace(['\n', '│'], " ")
        .split_whitespace()
        .collect::<Vec<_>>()
        .join(" ");
    assert_eq!(run.status.code(), Some(2), "--out {out}: {said}");
    assert!(said.contains(words), "--out {out} should say '{words}': {said}");
    assert!(tree(all) == before, "--out {out} changed something");
}

#[test]
fn force_never_replaces_what_no_run_wrote() {
    let all = scratch("force-foreign");
    let scene = small(&all.join("scenes"));
    let scene = text(&scene);
    // A folder of unrelated files, one that merely looks like results, a scene's own folder, a parent of it.
    put(&all.join("thesis/chapter.txt"), "a year of work");
    put(&all.join("looks/summary.json"), "{}");
    put(&all.join("looks/vtu/left_00000000.vtu"), "someone else's");
    std::fs::create_dir_all(all.join("home")).expect("home");
    let go = |out: &str, words: &str| refused(&all, &all, scene, out, words);
    let unmarked = "does not bear the mark of results";
    go("thesis", unmarked);
    go("./looks/../thesis", unmarked);
    go("looks", unmarked);
    go("scenes", "is or holds");
    go(text(&all), "is or holds");
    go("home", "is or holds");
    go("scenes/..", "must name a folder to create");
    go("/", "must name a folder to create");
    go(".", "must name a folder to create");
    symlink(all.join("thesis"), all.join("link")).expect("link");
    go("link", "is a symbolic link");
    symlink(all.join("scenes"), all.join("also")).expect("link");
    refused(&all, &all, "also/small.toml", "scenes", "is or holds");
    // The working folder, by a path that does not end in a dot.
    let here = all.join("thesis");
    refused(&all, &here, scene, "../thesis", "is or holds");
}

#[test]
fn force_never_replaces_results_that_hold_something_else() {
    let all = scratch("force-mixed");
    let scene = small(&all.join("scenes"));
    succeed(&["run", text(&scene), "--out", text(&all.join("out"))]);
    let out = all.join("out");
    std::fs::create_dir_all(all.join("home")).expect("home");
    let go = |words: &str| refused(&all, &all, text(&scene), "out", words);
    for name in [
        "notes.txt",
        "vtu/mine_00000000.vtu",
        "plots/mine.svg",
        "fracture-mine.csv",
        "deep/er/still.csv",
    ] {
        put(&out.join(name), "mine");
        go(&format!("holds '{}", &name[..4]));
        let top = out.join(name.split('/').next().expect("name"));
        if name.starts_with("deep") {
            std::fs::remove_dir_all(top).expect("removed");
        } else {
            std::fs::remove_file(out.join(name)).expect("removed");
        }
    }
    std::fs::create_dir(out.join("empty")).expect("folder");
    go("holds 'empty'");
    std::fs::remove_dir(out.join("empty")).expect("removed");
    symlink(&scene, out.join("vtu/link_00000000.vtu")).expect("link");
    go("holds 'vtu/link_00000000.vtu'");
    std::fs::remove_file(out.join("vtu/link_00000000.vtu")).expect("removed");
    // A file of the run that was edited since belongs to the user.
    let table = std::fs::read_to_string(out.join("probes.csv")).expect("table");
    put(
        &out.join("probes.csv"),
        &format!("{table}# outlier, see page 7\n"),
    );
    go("holds 'probes.csv'");
    // Another digit in place of the last one: the length is the same.
    let mut digit = table.trim_end().to_owned();
    let last = digit.pop().expect("a table");
    digit.push(if last == '7' { '8' } else { '7' });
    digit.push_str(&table[digit.len()..]);
    assert_eq!(digit.len(), table.len());
    put(&out.join("probes.csv"), &digit);
    go("holds 'probes.csv'");
    put(&out.join("probes.csv"), &table);
    // An input that lies among results.
    let inside = out.join("small.toml");
    std::fs::copy(&scene, &inside).expect("copy");
    refused(&all, &all, text(&inside), "out", "is or holds");
    std::fs::remove_file(&inside).expect("removed");
    // A mark that was lost.
    std::fs::rename(out.join(MARK), all.join("mark")).expect("renamed");
    go("does not bear the mark");
    std::fs::rename(all.join("mark"), out.join(MARK)).expect("renamed");
    succeed(&["run", text(&scene), "--out", text(&out), "--force"]);
}

#[test]
fn force_never_replaces_spheres_read_from_earlier_results() {
    let all = scratch("force-inputs");
    let spheres = "\
[model.grains]
kind = \"dem\"
shape.box = { low = [0.0, 0.0, 0.0], high = [6e-3, 3e-3, 3e-3] }
dem = { count = 120, protocol = \"quench\" }
material = { young = 75e9, poisson = 0.17, density = 2200.0 }
[time]
steps = 2
";
    let scene = all.join("first.toml");
    put(&scene, spheres);
    let out = all.join("out");
    succeed(&["run", text(&scene), "--out", text(&out)]);
    let second = spheres.replace(
        "count = 120, protocol = \"quench\"",
        "file = \"out/vtu/grains_00000000.vtu\", radii = \"radius [m]\"",
    );
    put(&all.join("second.toml"), &second);
    std::fs::create_dir_all(all.join("home")).expect("home");
    refused(&all, &all, "second.toml", "out", "is or holds");
    succeed(&[
        "run",
        text(&all.join("second.toml")),
        "--out",
        text(&all.join("other")),
    ]);
}

#[test]
fn earlier_results_stay_until_there_are_new_ones() {
    let all = scratch("force-order");
    let scene = small(&all);
    let out = all.join("out");
    succeed(&["run", text(&scene), "--out", text(&out)]);
    let first = tree(&out);
    let force = |sets: &[&str]| {
        let fixed = ["run", text(&scene), "--out", text(&out), "--force"];
        let sets: Vec<&str> = sets.iter().flat_map(|s| ["--set", s]).collect();
        arlequin(&[&fixed[..], &sets].concat())
    };
    // It fails while it is set up.
    assert_eq!(force(&["model.left.spacing=-1"]).status.code(), Some(2));
    assert_eq!(force(&["time.step={seconds=9.0}"]).status.code(), Some(2));
    assert!(tree(&out) == first);
    assert_eq!(std::fs::read_dir(&all).expect("folder").count(), 2);
    // It is killed on its way.
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
    let left = all.join("out.unfinished/vtu/left_00000000.vtu");
    wait_for(&left);
    // Meanwhile nobody else writes there.
    let second = force(&[]);
    let said = String::from_utf8_lossy(&second.stderr);
    assert!(said.contains("another run is writing to"), "{said}");
    child.kill().expect("kill");
    child.wait().expect("ends");
    assert!(tree(&out) == first);
    // What it left is known by its name, and the next run clears it away, unless something else is in it.
    put(&all.join("out.unfinished/thoughts.txt"), "mine");
    let third = force(&[]);
    assert_eq!(third.status.code(), Some(2));
    assert!(all.join("out.unfinished/thoughts.txt").exists() && tree(&out) == first);
    std::fs::remove_file(all.join("out.unfinished/thoughts.txt")).expect("removed");
    assert!(force(&["time.steps=7"]).status.success());
    assert_eq!(summary(&out)["steps"], 7);
    let mut names: Vec<_> = std::fs::read_dir(&all)
        .expect("folder")
        .map(|e| e.expect("entry").file_name())
        .collect();
    names.sort();
    assert_eq!(names, ["out", "small.toml"]);
}

#[test]
fn killed_between_two_renames_nothing_is_lost() {
    let all = scratch("force-renames");
    let scene = small(&all);
    let out = all.join("out");
    let run = ["run", text(&scene), "--out", text(&out)];
    succeed(&run);
    // The earlier results were out of the way already, the new ones not yet there.
    std::fs::rename(&out, all.join("out.replaced")).expect("renamed");
    let said = arlequin(&run);
    assert_eq!(said.status.code(), Some(2));
    assert!(out.join("summary.json").exists() && !all.join("out.replaced").exists());
    // New results were whole, and not yet in their place.
    std::fs::rename(&out, all.join("out.unfinished")).expect("renamed");
    assert_eq!(arlequin(&run).status.code(), Some(2));
    assert!(out.join("summary.json").exists() && !all.join("out.unfinished").exists());
}

#[test]
fn what_could_be_resumed_stays_until_a_forced_run_has_ended() {
    let all = scratch("force-resumable");
    let scene = small(&all);
    let out = all.join("out");
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
    let checkpoint = all.join("out.unfinished/checkpoint.bin");
    wait_for(&checkpoint);
    child.kill().expect("kill");
    child.wait().expect("ends");
    let force = |set: &str| arlequin(&["run", text(&scene), "--out", text(&out), "--force", "--set", set]);
    assert_eq!(force("model.left.spacing=-1").status.code(), Some(2));
    assert!(checkpoint.exists());
    // Fails in its first step: what was put aside comes back.
    assert!(force("time.steps=4").status.success());
    assert!(!checkpoint.exists() && !all.join("out.unfinished.replaced").exists());
    assert_eq!(summary(&out)["steps"], 4);
}

#[test]
fn sweeps_and_verify_write_into_folders_of_their_own_only() {
    let all = scratch("force-sweep");
    let scene = small(&all);
    put(&all.join("mine/report.html"), "<p>mine</p>");
    put(&all.join("mine/verify.json"), "[]");
    put(&all.join("docs/validation.md"), "# My own page\n");
    let sweep = "scene = \"small.toml\"\n[axis.n]\nvalues = [3]\nset = [\"time.steps={}\"]\n";
    put(&all.join("sweep.toml"), sweep);
    let before = tree(&all);
    let mine = all.join("mine");
    let refused = |arguments: &[&str], words: &str| {
        let out = arlequin(arguments);
        let said = String::from_utf8_lossy(&out.stderr).replace('\n', " ");
        assert_eq!(out.status.code(), Some(2), "{said}");
        assert!(said.contains(words), "{said}");
    };
    refused(
        &["verify", "bauman", "--out", text(&mine)],
        "does not bear the mark",
    );
    refused(
        &["verify", "bauman", "--docs", text(&all.join("docs"))],
        "does not begin with '# Validation'",
    );
    refused(
        &["sweep", text(&all.join("sweep.toml")), "--out", text(&mine)],
        "mark",
    );
    refused(
        &["sweep", text(&all.join("sweep.toml")), "--out", text(&all)],
        "mark",
    );
    assert!(tree(&all) == before && scene.exists());
}
